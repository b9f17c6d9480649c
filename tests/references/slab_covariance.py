"""Covariance of light scattered once by a slab under square beams: Eq. 41 of [Bar19] as one integral over depth.

    C = s(i1.v1) s(i2.v2)* integral of sigma_s e^(ik D.x) tau(x, i1) tau(x, v1) tau(x, i2) tau(x, v2) dx,
    D = (i1 - v1) - (i2 - v2)

At every depth the two footprints overlap in a rectangle.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

_NODES = 16


def slab_covariance(
    thickness: float,
    *,
    extinction: float,
    albedo: float = 1.0,
    wavelength: float,
    width: float,
    amplitude: Callable[[np.ndarray], np.ndarray],
    lights: tuple[ArrayLike, ArrayLike],
    views: tuple[ArrayLike, ArrayLike],
) -> np.ndarray:
    """Covariance of singly scattered far fields of a slab 0 <= z <= thickness under square beams, complex128[...].

    The beams pass a window of side ``width`` in the face z = 0, centred on the axis, with unit irradiance per area of
    that face; the window is carried straight along each direction. Gauss quadrature over depth, on panels that end
    where overlaps of footprints have kinks and that resolve attenuation and phase: rounding accuracy. In two
    dimensions the window is an interval.

    Parameters
    ----------
    thickness, width
        Lengths in the unit of the wavelength.
    extinction, albedo, wavelength, amplitude, lights, views
        As of `specklegen.theory.single_scattering.box_covariance`; lights travel towards +z, views not sideways.
    """
    dimension = np.shape(lights[0])[-1]
    i1, i2, v1, v2 = np.broadcast_arrays(*(np.asarray(x, np.float64) for x in (*lights, *views)))
    shape, k = i1.shape[:-1], 2 * np.pi / wavelength
    flat = (part.reshape(-1, dimension) for part in (i1, i2, v1, v2))
    integral = np.array([_integrate_depth(thickness, extinction, width, k, *rays) for rays in zip(*flat, strict=True)])
    s = amplitude((i1 * v1).sum(axis=-1)) * np.conj(amplitude((i2 * v2).sum(axis=-1)))
    return albedo * extinction * s * integral.reshape(shape)


def _integrate_depth(thickness, extinction, width, k, i1, i2, v1, v2) -> complex:
    """Depth integral of attenuation, phase and the overlap of two footprints, times sqrt(irradiances)."""
    wave = k * ((i1 - v1) - (i2 - v2))
    drift = i1[:-1] / i1[-1], i2[:-1] / i2[-1]
    edges = [0.0, thickness]
    # An overlap vanishes where footprints are a width apart, and changes its form where one edge passes another: at 0.
    edges += [width / abs(gap) for gap in drift[0] - drift[1] if abs(gap) * thickness > width]
    per_length = extinction * (np.abs(1 / np.array([i1[-1], i2[-1], v1[-1], v2[-1]])).sum()) / 2
    per_length += abs(wave[-1]) + sum(abs(w) * max(abs(a), abs(b)) for w, a, b in zip(wave, *drift, strict=False))
    total = 0.0
    for start, end in zip(sorted(edges)[:-1], sorted(edges)[1:], strict=True):
        panels = 1 + int(per_length * (end - start) / 4)
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        bounds = np.linspace(start, end, panels + 1)
        half = np.diff(bounds)[:, None] / 2
        z = (bounds[:-1, None] + half * (1 + nodes)).ravel()
        overlap = np.ones(len(z), np.complex128)
        for axis, w in enumerate(wave[:-1]):
            first, second = drift[0][axis] * z, drift[1][axis] * z
            low, high = np.maximum(first, second) - width / 2, np.minimum(first, second) + width / 2
            length = np.clip(high - low, 0, None)
            overlap *= length * np.exp(0.5j * w * (low + high)) * np.sinc(w * length / (2 * np.pi))
        path = z / i1[-1] + z / i2[-1] + sum(((thickness if v[-1] > 0 else 0) - z) / v[-1] for v in (v1, v2))
        total += ((half * weights).ravel() * overlap * np.exp(1j * wave[-1] * z - 0.5 * extinction * path)).sum()
    return total / np.sqrt(i1[-1] * i2[-1])
