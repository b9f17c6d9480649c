"""Algorithm 2 of [Bar19] as a straightforward Numba program: the yardstick of speed.

    u(t, v) = N^(-1/2) sum over paths and B of z sqrt(W) A_t(x1, omega_1) B_v(x_B, omega_(B-1))

Paths are drawn well (first vertex exponentially deep along the light, first direction from the medium's
own lobe about it), but every connection of every path is evaluated, at every tilt and view: with one
complex exponential each ("plain"), or with those of the view hoisted out of the loop over tilts
("hoisted"). No thinning, no reversed paths, no transform. physics.md 1-2.
"""

import cmath
import math

import numpy as np
from numba import njit

from specklegen.scene.media import Slab


def naive_field(
    medium: Slab, *, wavelength: float, width: float, tilts: np.ndarray, views: np.ndarray, paths: int, seed: int,
    hoisted: bool = True,
) -> np.ndarray:  # fmt: skip
    """Field u - m of a slab under square collimated beams, complex128[T, V].

    Parameters
    ----------
    medium
        The slab.
    wavelength, width
        Inside the medium; full side of the beam on the face z = 0, centred at the origin. Unit irradiance
        per area of the face at every tilt, so |u|^2 is area per steradian.
    tilts, views
        float64[T, 3] with z > 0, and float64[V, 3]; unit vectors of travel.
    paths, seed
        Number of paths; seed of Numba's own generator, below 2^32.
    hoisted
        Compute the sensor's end of a connection once per view, not once per tilt and view; the result
        differs by rounding only.
    """
    scene, reference, half_side = laid_out(medium, wavelength, width, tilts)
    field = np.zeros((len(tilts), len(views)), np.complex128)
    _algorithm2(scene, medium.albedo, half_side, reference, np.ascontiguousarray(tilts), np.ascontiguousarray(views),
                paths, seed, hoisted, field)  # fmt: skip
    return field / math.sqrt(paths)


def laid_out(
    medium: Slab, wavelength: float, width: float, tilts: np.ndarray
) -> tuple[tuple[float, float, float, float, float], np.ndarray, float]:
    """The numbers of the kernels, the light along which first vertices lie, and half the side of what covers all."""
    reference = tilts.mean(axis=0)
    reference /= np.linalg.norm(reference)
    drift = tilts[:, :2] / tilts[:, 2:] - reference[:2] / reference[2]
    half_side = width / 2 + medium.thickness * float(np.abs(drift).max())
    scene = (medium.thickness, medium.extinction, medium.scatterer.g, 2 * math.pi / wavelength, width / 2)
    return scene, reference, half_side


@njit
def _algorithm2(scene, albedo, half_side, reference, tilts, views, paths, seed, hoisted, field):
    thickness, sigma_t, g, _, _ = scene
    np.random.seed(seed)  # noqa: NPY002 (Numba's own generator)
    x1, w1, x, w = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for _ in range(paths):
        weight = _first_vertex(sigma_t, albedo, half_side, reference, x1)
        if x1[2] > thickness:
            continue  # crossed without a collision
        _connect(scene, weight, True, x1, w1, x1, w, tilts, views, hoisted, field)
        cosine = _sample_cosine(g)
        _deflect(reference, cosine, w1)
        weight /= _phase_function(g, cosine)  # p_omega
        x[:] = x1
        w[:] = w1
        while True:
            x += np.random.exponential(1 / sigma_t) * w  # noqa: NPY002
            if x[2] < 0 or x[2] > thickness:
                break
            weight *= albedo
            _connect(scene, weight, False, x1, w1, x, w, tilts, views, hoisted, field)
            _deflect(w, _sample_cosine(g), w)


@njit
def _first_vertex(sigma_t, albedo, half_side, reference, x1):
    """Draw x1 exponentially along a light and uniformly across it; return sigma_s / p1."""
    depth = np.random.exponential(1 / sigma_t)  # noqa: NPY002
    x1[:] = depth * reference
    x1[0] += half_side * (2 * np.random.random() - 1)  # noqa: NPY002
    x1[1] += half_side * (2 * np.random.random() - 1)  # noqa: NPY002
    # A volume is (area of the face) x (depth along the light) x (cosine).
    return albedo * reference[2] * (2 * half_side) ** 2 * math.exp(sigma_t * depth)


@njit
def _connect(scene, weight, single, x1, w1, x, w, tilts, views, hoisted, field):
    """Add one connection to every tilt and view, with one random phase for all of them."""
    g = scene[2]
    z = cmath.exp(2j * math.pi * np.random.random()) * math.sqrt(weight)  # noqa: NPY002
    lights = np.empty(len(tilts), np.complex128)
    for t in range(len(tilts)):
        lights[t] = z * _illumination_end(scene, x1, tilts[t])
        if not single:
            lights[t] *= _amplitude(g, _dot(tilts[t], w1))
    for v in range(len(views)):
        vx, vy, vz = views[v, 0], views[v, 1], views[v, 2]  # a slice here would double the time
        if single:
            sensor = _sensor_end(scene, x, vx, vy, vz)
            for t in range(len(tilts)):
                s = _amplitude(g, tilts[t, 0] * vx + tilts[t, 1] * vy + tilts[t, 2] * vz)
                field[t, v] += lights[t] * s * sensor
        elif hoisted:
            sensor = _amplitude(g, w[0] * vx + w[1] * vy + w[2] * vz) * _sensor_end(scene, x, vx, vy, vz)
            for t in range(len(tilts)):
                field[t, v] += lights[t] * sensor
        else:
            for t in range(len(tilts)):
                s = _amplitude(g, w[0] * vx + w[1] * vy + w[2] * vz)
                field[t, v] += lights[t] * s * _sensor_end(scene, x, vx, vy, vz)


@njit
def _illumination_end(scene, x, tilt):
    """b_i(x) tau(i, x) xi(i -> x)."""
    _, sigma_t, _, k, half_width = scene
    depth = x[2] / tilt[2]
    if abs(x[0] - depth * tilt[0]) > half_width or abs(x[1] - depth * tilt[1]) > half_width:
        return 0j
    return cmath.exp(complex(-0.5 * sigma_t * depth, k * _dot(tilt, x))) / math.sqrt(tilt[2])


@njit
def _sensor_end(scene, x, vx, vy, vz):
    """Compute tau(x, v) xi(x -> v)."""
    thickness, sigma_t, _, k, _ = scene
    distance = (thickness - x[2]) / vz if vz > 0 else -x[2] / vz
    return cmath.exp(complex(-0.5 * sigma_t * distance, -k * (x[0] * vx + x[1] * vy + x[2] * vz)))


@njit
def _amplitude(g, cosine):
    """s, the root of the phase function."""
    return math.sqrt(_phase_function(g, cosine))


@njit
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit
def _phase_function(g, cosine):
    """Henyey-Greenstein, per steradian."""
    base = 1 + g * g - 2 * g * cosine
    return (1 - g * g) / (4 * math.pi * base * math.sqrt(base))


@njit
def _sample_cosine(g):
    u = np.random.random()  # noqa: NPY002
    if g == 0:
        return 1 - 2 * u
    return (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g)


@njit
def _deflect(w, cosine, out):
    """Turn the unit vector ``w`` by a polar angle, at a uniform azimuth, into ``out`` (the textbook frame)."""
    azimuth = 2 * math.pi * np.random.random()  # noqa: NPY002
    sine = math.sqrt(max(0.0, 1 - cosine * cosine))
    c, s = sine * math.cos(azimuth), sine * math.sin(azimuth)
    x, y, z = w[0], w[1], w[2]  # ``out`` may be ``w``
    r = math.sqrt(x * x + y * y)  # not sqrt(1 - z^2), which cancels near the axis
    if r < 1e-12:
        out[0], out[1], out[2] = c, s, math.copysign(1.0, z) * cosine
        return
    out[0] = (x * z * c - y * s) / r + x * cosine
    out[1] = (y * z * c + x * s) / r + y * cosine
    out[2] = z * cosine - r * c
