"""The mean (ballistic, coherent) field: [Bar19] Eq. 20; Eqs. 46-48; section 3 of docs/physics.md.

Where a point is involved, a sensor or a source, it is the attenuated ray tau xi of the *total* field. Between far
lights and far views it depends on the medium:

* behind a slab or thin screens, beams: the total transmitted mean of a wide beam, e^(-OD/2) times the diffraction
  pattern of its window. At v = i its amplitude is ``(k / 2 pi)^((d-1)/2) A e^(-OD/2)``, and for a square window its
  first zero lies lambda / W away. The constant phase is chosen such that the field on the exit face is real and
  positive at the window's centre for a beam along the axis. Refracting faces let the root of
  (1 - R(i)) (1 - R(v)) through; echoes between them are left out;
* on the plane that a lens is focused on: the image of that of the slab; of focused light: the sum of its beams';
* of a box or a voxel grid: the field *scattered* by it, for the light that misses or crosses it is not limited by
  it (that of a plane wave is a delta at v = i): see :mod:`specklegen.mean.finite`.
"""

import math

import numpy as np

from specklegen.core.arguments import instance
from specklegen.core.budgets import require_time
from specklegen.core.errors import reject
from specklegen.core.memory import require_memory
from specklegen.core.shielded import shielded
from specklegen.kernels import mean_integrals
from specklegen.mean.finite import scattered_mean
from specklegen.paths.endpoints import light_endpoints, view_endpoints
from specklegen.paths.faces import both_reflectances, reflectance
from specklegen.paths.lit_plane import lens_of
from specklegen.paths.steps import refracting_layers, straight_light
from specklegen.paths.volumes import volume_of
from specklegen.scene.illumination import CollimatedBeams
from specklegen.scene.media import Slab
from specklegen.scene.scene import Scene
from specklegen.synthesis.drawn_screens import unscattered_field


@shielded()
def mean_field(scene: Scene, *, most_nodes: float = 2e8) -> np.ndarray:
    """Mean field of a scene, complex128[T, *sensor.shape], in the unit of u; dark in a slab's reflection.

    Of beams on a slab or with points involved it is the total field; seen in the far field, that of boxes and voxel
    grids is the scattered one, without the unscattered light, which u does not hold either.

    Parameters
    ----------
    scene
        Anything but an incoherent object.
    most_nodes
        Quadrature nodes, over all lights and views, from which a box or voxel grid is refused: a node takes some
        0.1 microseconds on one core, and several times that among many voxels.

    Raises
    ------
    RuleError
        For illumination without a field of its own (an incoherent object), a sensor point on a source, particles
        that scatter nothing forward, or a mean that costs too much.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=sg.media.Isotropic())
    >>> light = sg.light.CollimatedBeams.tilts([0.0], width=100.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.sensors.FarField.grid((1, 3), 1e-3))
    >>> sg.statistics.mean_field(scene).shape
    (1, 1, 3)
    """
    lights = instance("mean_field scene", scene, Scene).illumination
    if not lights.coherent:
        reject("mean_field scene.illumination", "CollimatedBeams, PlaneWaves or PointSources", lights.type)
    if scene.thin is not None and lights.gridded and scene.sensor.regular_grid is None:
        return unscattered_field(scene)
    if scene.imaged:
        lens = lens_of(scene)
        field = lens.image(mean_field(lens.pupil_scene, most_nodes=most_nodes))
        return field.reshape(len(field), *scene.sensor.shape)
    even = not (scene.medium.has_sides or scene.medium.refracts)
    if lights.gridded and even and scene.sensor.regular_grid is not None:
        return _object(scene.at_rest) * np.ones((len(lights.vectors), 1, 1))  # the same at all times of a film
    if lights.focused:
        beams = mean_field(scene.replace(illumination=scene.beams), most_nodes=most_nodes)
        return np.tensordot(lights.amplitudes(scene.wavelength), beams, axes=1)  # type: ignore[attr-defined]
    counts = len(scene.lights), math.prod(scene.sensor.shape)
    require_memory("mean_field scene", "of a field that is held", 32.0 * math.prod(counts) + _VIEW_BYTES * counts[1],
                   f"{counts[0]} lights, {counts[1]} views", "Use fewer views at a time.", share=0.9)  # fmt: skip
    took = 1e-9 * _NANOSECONDS * math.prod(counts)
    require_time("mean_field scene", took, f"{counts[0]} lights, {counts[1]} views", "Use fewer views.")
    if scene.sensor.near or lights.near:
        field = _rays(scene)
    elif not scene.medium.has_sides:  # of plane waves it would have no far field
        field = _layer(scene, scene.beams)
        if scene.polarisers is not None:  # forward, a sphere sends on the polarisation that it has met
            field *= scene.polarisers.straight
    else:
        field = scattered_mean(scene, most_nodes)
    return field.reshape(len(scene.lights), *scene.sensor.shape)


_VIEW_BYTES = 80
"""Of one view, beside its fields: directions, differences, the pattern of the window; as measured."""
_NANOSECONDS = 700
"""Of one light at one view, as measured; a box's nodes have a bound of their own."""


def _rays(scene: Scene) -> np.ndarray:
    """complex128[T, V], the field of every light at every view with what is lost on the straight line."""
    lights, views = light_endpoints(scene), view_endpoints(scene)
    field = np.empty((len(lights), len(views)), np.complex128)
    met = mean_integrals.rays(volume_of(scene.volume, scene.dimension), lights.near, lights.vectors, views.near,
                              views.vectors, scene.wavelength, lights.footprint, lights.radius, field)  # fmt: skip
    if met >= 0:
        reject("mean_field scene.sensor.points", "away from every source", scene.views[met % len(views)],
               "The field of a point source is infinite there.")  # fmt: skip
    return field


def _layer(scene: Scene, beams: CollimatedBeams) -> np.ndarray:
    """complex128[T, V], diffraction patterns of the window as the exit face of a slab or of screens sends them."""
    views, wavelength = scene.views, scene.wavelength
    field = np.empty((len(beams.directions), len(views)), np.complex128)
    for tilt, direction, depth in zip(field, beams.directions, _depths(scene), strict=True):
        difference = (direction - views) / wavelength
        # On the exit face the beam has walked off by its slope times the thickness.
        turns = difference @ _walked_off(scene, direction)
        if scene.refracts_inside:  # phases along z are those of all layers
            along = np.square(views[:, :2]).sum(axis=1), np.square(direction[None, :2]).sum(axis=1)
            turns += (scene.slab.lag(along[0]) - scene.slab.lag(along[1])) / wavelength
        pattern = beams.window.transform(*difference[:, :-1].T)
        attenuation = np.exp(-0.5 * depth)
        crossed = np.sqrt((_crossing(scene, direction[-1:]) * _crossing(scene, views[:, -1])).mean(axis=0))
        obliquity = np.sqrt(direction[-1])  # face area to cross section
        scale = obliquity * attenuation / wavelength ** (difference.shape[-1] / 2 - 0.5)
        tilt[...] = np.where(views[:, -1] > 0, scale * crossed * pattern * np.exp(2j * np.pi * turns), 0)
    return field


def _object(scene: Scene) -> np.ndarray:
    """complex128[T, H, W] of coherent objects: what is left of their waves, through the window on the entrance face.

    The far field does not feel how far waves walk: no window walks with them, by rays, as in :func:`_layer`.
    """
    beams, (x, y), wavelength = scene.beams, scene.grid.sines, scene.wavelength
    if scene.grid.sign < 0:
        return np.zeros((len(scene.illumination.vectors), len(y), len(x)), complex)
    along, across = (
        beams.width * np.sinc((sines[:, None] - views) * beams.width / wavelength)
        for sines, views in zip(beams.directions.T, (x, y), strict=False)
    )
    left = np.sqrt(beams.directions[:, 2]) * np.exp(-0.5 * _depths(scene)) / wavelength
    left = left if scene.polarisers is None else left * scene.polarisers.straight
    return across.T @ ((scene.illumination.amplitudes(wavelength) * left)[:, :, None] * along)  # type: ignore[attr-defined]


def _depths(scene: Scene) -> np.ndarray:
    """float64[T], what the unscattered light of every beam has lost: ln of its share is -depth."""
    directions = scene.beams.directions
    if scene.thin is not None:
        return np.square(scene.thin.phases(scene.wavelength, np.hypot(*directions[:, :2].T))).sum(axis=0)
    if scene.refracts_inside:
        return straight_light(scene.slab, np.hypot(*directions[:, :2].T)).depth
    return scene.optical_depth / directions[:, -1]


def ballistic_fraction(scene: Scene) -> float:
    """e^(-OD), the share of the light that crosses the medium without a collision, at the steepest tilt.

    Of a slab with refracting faces, what both let through of it at the first pass.
    """
    directions = scene.beams.directions
    if not len(directions):
        return float(np.exp(-scene.optical_depth))
    steepest = directions[:, -1].argmax()
    straight = float(np.exp(-_depths(scene)[steepest]))
    return straight * float(np.square(_crossing(scene, directions[steepest, -1:])).mean())


def straight_through(slab: Slab) -> float:
    """Share of light along the axis that crosses a slab without a collision and without an echo."""
    if refracting_layers(slab):
        return float(np.exp(-slab.optical_depth) * straight_light(slab, np.zeros(1)).let_through[0])
    return float(np.exp(-slab.optical_depth) * (1 - reflectance(slab.faces, np.ones(1))[0]) ** 2)


def _crossing(scene: Scene, cosines: np.ndarray) -> np.ndarray:
    """1 - R_s and 1 - R_p float64[2, n] at cosines inside; 1 without faces. Of layers the root of all, [1, n]."""
    if scene.refracts_inside:
        return np.sqrt(straight_light(scene.slab, np.sqrt(np.maximum(1 - np.square(cosines), 0.0))).let_through)[None]
    return 1 - both_reflectances(scene.medium.faces, cosines)


def _walked_off(scene: Scene, direction: np.ndarray) -> np.ndarray:
    """Return the place on the exit face where the middle of a beam arrives, float64[3] or float64[2].

    Behind layers that refract, at depth 0: their phases along z are added apart.
    """
    if scene.refracts_inside:
        slope = straight_light(scene.slab, np.hypot(*direction[:2])[None]).slope[0]
        return np.append(direction[:2] * slope, 0.0)
    return direction / direction[-1] * scene.thickness
