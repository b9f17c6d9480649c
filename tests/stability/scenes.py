"""Small scenes that the rows share."""

import numpy as np
from references.slab_covariance import slab_covariance

import specklegen as sg

AXIS = np.array([0.0, 0.0, 1.0])
REQUIRED = "required here"


def slab(optical_depth: float, g: float = 0.0, albedo: float = 1.0, thickness: float = 100.0) -> sg.Slab:
    """A slab of Henyey-Greenstein scatterers."""
    scatterer = sg.HenyeyGreenstein(g=g) if g else sg.Isotropic()
    return sg.Slab(thickness=thickness, mean_free_path=thickness / optical_depth, albedo=albedo, scatterer=scatterer)


def cube(side: float, mean_free_path: float, albedo: float = 1.0) -> sg.Box:
    """A cube of isotropic scatterers, centred sideways."""
    half = side / 2
    return sg.Box(lower=[-half, -half, 0], upper=[half, half, side], mean_free_path=mean_free_path, albedo=albedo,
                  scatterer=sg.Isotropic())  # fmt: skip


def beams(angles, width: float = 30.0) -> sg.CollimatedBeams:
    """Square beams tilted in the x-z plane."""
    return sg.CollimatedBeams.tilts(np.asarray(angles, dtype=float), width=width)


def unit(*vectors) -> np.ndarray:
    """Vectors made unit long, float64[n, d]."""
    array = np.array(vectors, dtype=float)
    return array / np.linalg.norm(array, axis=-1, keepdims=True)


def views(*vectors) -> sg.FarField:
    """Far-field views along vectors of any length."""
    return sg.FarField(directions=unit(*vectors))


def scene(medium, light=None, sensor=None, wavelength: float = 1.0) -> sg.Scene:
    """A scene of one beam along the axis and three views, unless told otherwise."""
    return sg.Scene(wavelength=wavelength, medium=medium, illumination=beams([0.0]) if light is None else light,
                    sensor=views([0, 0, 1], [0.1, 0, 1], [0.3, 0.2, -1]) if sensor is None else sensor)  # fmt: skip


def exact_single(of: sg.Scene) -> np.ndarray:
    """Eq. 41 for every light and view of a scene of square beams on a slab, complex128[T, V, T, V]."""
    medium, i, v = of.slab, of.lights, of.views
    return slab_covariance(medium.thickness, extinction=medium.extinction, albedo=medium.albedo,
                           wavelength=of.wavelength, width=of.beams.width, amplitude=medium.scatterer.amplitude,
                           lights=(i[:, None, None, None], i[None, None, :, None]),
                           views=(v[None, :, None, None], v[None, None, None]))  # fmt: skip
