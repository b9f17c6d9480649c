"""Single scattering in closed form: the covariance of [Bar19] Eq. 41, without Monte Carlo.

    C = s(i1.v1) s(i2.v2)* integral of sigma_s e^(ik D.x) tau(x, i1) tau(x, v1) tau(x, i2) tau(x, v2) dx,
    D = (i1 - v1) - (i2 - v2)

In a box the distance to the way out is piecewise linear, so the exponent is too: the box is cut into simplices on
which it is linear (a plane through an edge for every ray that can leave by either face), and on a simplex the
integral is d! times its volume times a divided difference of exp at the corners (Hermite and Genocchi).
"""

import math
from collections.abc import Callable
from functools import partial
from itertools import combinations, permutations
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.units import INVERSE_LENGTH, LENGTH, WAVELENGTH

_BLOCK = {2: 4096, 3: 64}  # quadruples at a time: a box is cut into up to 60 triangles or some 1000 tetrahedra each
_TAYLOR = 1.0
_ORDER = 20  # 1 / 20! is below rounding


@with_units
def box_covariance(
    lower: Annotated[ArrayLike, LENGTH], upper: Annotated[ArrayLike, LENGTH], *,
    extinction: Annotated[float, INVERSE_LENGTH], albedo: float = 1.0, wavelength: Annotated[float, WAVELENGTH],
    amplitude: Callable[[np.ndarray], np.ndarray], lights: tuple[ArrayLike, ArrayLike],
    views: tuple[ArrayLike, ArrayLike],
) -> np.ndarray:  # fmt: skip
    """Covariance of singly scattered far fields of a homogeneous box under plane waves, complex128[...].

    Exact but for rounding: to some 1e-14 of the scattering cross-section sigma_s V times |s|^2. A mixture of particles
    is the sum of its kinds, each with its share of the result. Slower in three dimensions than in two, and there the
    slower the fewer of the directions share a plane. Raise a `RuleError` for a field out of its range, a box without a
    volume, or directions of another dimension.

    Parameters
    ----------
    lower, upper
        float[d], corners; d = 2 or 3.
    extinction, albedo, wavelength
        sigma_t per unit length, sigma_s / sigma_t, and the wavelength inside the medium.
    amplitude
        s(cos theta), real or complex, of arrays.
    lights, views
        (i1, i2) and (v1, v2): unit vectors of travel, float[..., d] each, broadcast against each other.
    """
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    dimension = lower.size
    _check("box_covariance", extinction=extinction, albedo=albedo, wavelength=wavelength)
    if lower.shape != upper.shape or dimension not in (2, 3) or not (upper > lower).all():
        reject("box_covariance upper", "above lower on each of 2 or 3 axes", (lower, upper))
    i1, i2, v1, v2 = _quadruples("box_covariance", dimension, lights, views)
    k = 2 * np.pi / wavelength
    away = np.stack([-i1, -i2, v1, v2], axis=-2).reshape(-1, 4, dimension)
    wave = k * ((i1 - v1) - (i2 - v2)).reshape(-1, dimension)
    integral = np.concatenate(
        [
            _integrate_boxes(upper - lower, extinction, away[part], wave[part])
            for part in np.array_split(np.arange(len(away)), max(1, math.ceil(len(away) / _BLOCK[dimension])))
        ]
    )
    phase = np.exp(1j * wave @ lower)  # corners are measured from the lower one
    s = amplitude((i1 * v1).sum(axis=-1)) * np.conj(amplitude((i2 * v2).sum(axis=-1)))
    return albedo * extinction * s * (integral * phase).reshape(i1.shape[:-1])


def _check(owner: str, **values: float) -> None:
    for name, value in values.items():
        above = value > 0 if name in ("wavelength", "width") else value >= 0
        if not (np.isfinite(value) and above):
            reject(f"{owner} {name}", "greater than 0" if name in ("wavelength", "width") else "at least 0", value)
    if values["albedo"] > 1:
        reject(f"{owner} albedo", "at most 1", values["albedo"])


def _quadruples(owner: str, dimension: int, lights, views) -> list[np.ndarray]:
    vectors = [np.asarray(v, dtype=np.float64) for v in (*lights, *views)]
    for name, vector in zip(("lights", "lights", "views", "views"), vectors, strict=True):
        if dimension not in (2, 3) or vector.shape[-1:] != (dimension,):
            reject(f"{owner} {name}", f"two arrays of shape (..., {dimension})", vector.shape)
        if not (np.abs(np.linalg.norm(vector, axis=-1) - 1) <= 1e-6).all():
            reject(f"{owner} {name}", "unit vectors", vector, "Divide by np.linalg.norm(..., axis=-1, keepdims=True).")
    return list(np.broadcast_arrays(*vectors))


def _integrate_boxes(size: np.ndarray, extinction: float, away: np.ndarray, wave: np.ndarray) -> np.ndarray:
    """Integrals over the box of ``exp(i wave.x - sigma_t/2 sum of exit distances along away)``, away [Q, 4, d]."""
    axes = range(len(size))
    # Kuhn's simplices, one for each order of the axes: x_a >= x_b >= ...
    steps = np.eye(len(size))[list(permutations(axes))]
    kuhn = np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1) * size
    corners = np.tile(kuhn, (len(away), 1, 1))
    owner = np.repeat(np.arange(len(away)), len(kuhn))
    speed, face = np.abs(away), np.where(away > 0, size, 0.0)
    for ray in range(away.shape[1]):
        for a, b in combinations(axes, 2):
            level = partial(_lead, speed[:, ray], face[:, ray], a, b)
            corners, owner = _cut(corners, owner, level, 1e-13 * float(size.max()))
    # One face is the way out of a whole simplex, that which is nearest from its corners together: a single one may lie
    # on another face as well, which a ray all but along that face meets at once there and nowhere else.
    every = _distances(corners, owner, speed, face)
    with np.errstate(over="ignore"):
        first = every.sum(axis=1, keepdims=True).argmin(axis=-1)
    distance = np.take_along_axis(every, first[..., None], axis=-1)[..., 0]
    exponent = 1j * (corners * wave[owner, None]).sum(axis=-1) - 0.5 * extinction * distance.sum(axis=-1)
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))  # d! times that of the simplex
    pieces = volume * _divided_exp(exponent)
    return np.bincount(owner, pieces.real, len(away)) + 1j * np.bincount(owner, pieces.imag, len(away))


def _distances(points: np.ndarray, owner: np.ndarray, speed: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Distances from points float64[n, m, d] to each face ahead of each ray, float64[n, m, rays, d]; inf along it."""
    gap, u = np.abs(face[owner, None] - points[:, :, None]), speed[owner, None]
    with np.errstate(over="ignore"):  # along a face but for a denormal: as far as along it
        return np.divide(gap, u, out=np.full(gap.shape, np.inf), where=np.broadcast_to(u > 0, gap.shape))


def _lead(speed, face, a: int, b: int, corners: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Lead of face b over face a at every corner, float64[n, d+1]; 0 where another face is always first.

    Times are scaled by the product of the speeds, so that rays parallel to a face need no exception.
    """
    gap, u = np.abs(face[owner, None] - corners), speed[owner, None]

    def later(first: int, second: int) -> np.ndarray:
        return gap[..., first] * u[..., second] - gap[..., second] * u[..., first]

    lead = later(a, b)
    for c in set(range(corners.shape[-1])) - {a, b}:
        lead[(later(c, a) <= 0).all(axis=1) | (later(c, b) <= 0).all(axis=1)] = 0
    return lead


def _cut(corners: np.ndarray, owner: np.ndarray, level, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Cut simplices float64[n, d+1, d] along the plane level = 0, halving an edge that crosses until none does."""
    done = [], []
    while len(owner):
        height = level(corners, owner)
        top, bottom = height.argmax(axis=1), height.argmin(axis=1)
        rows = np.arange(len(owner))
        high, low = height[rows, top], height[rows, bottom]
        crossing = (high > tolerance) & (low < -tolerance)
        done[0].append(corners[~crossing])
        done[1].append(owner[~crossing])
        corners, owner, top, bottom, high, low = (v[crossing] for v in (corners, owner, top, bottom, high, low))
        rows = np.arange(len(owner))
        share = (high / (high - low))[:, None]
        middle = (1 - share) * corners[rows, top] + share * corners[rows, bottom]
        below, above = corners.copy(), corners.copy()
        below[rows, top], above[rows, bottom] = middle, middle
        corners, owner = np.concatenate([below, above]), np.concatenate([owner, owner])
    return np.concatenate(done[0]), np.concatenate(done[1])


def _divided_exp(f: np.ndarray) -> np.ndarray:
    """Divided difference exp[f_0, ..., f_m] of complex128[n, m+1], for any spacing.

    The recurrence divides by the widest gap; where that is small, the Taylor series about the mean instead, whose
    terms are the complete homogeneous polynomials of the deviations.
    """
    n, count = f.shape
    if count == 1:
        return np.exp(f[:, 0])
    pairs = np.array(list(combinations(range(count), 2)))
    widest = pairs[np.abs(f[:, pairs[:, 0]] - f[:, pairs[:, 1]]).argmax(axis=1)]
    rows = np.arange(n)
    gap = f[rows, widest[:, 0]] - f[rows, widest[:, 1]]
    near = np.abs(gap) <= _TAYLOR
    result = np.empty(n, np.complex128)

    centre = f[near].mean(axis=1)
    homogeneous = np.zeros((_ORDER, len(centre)), np.complex128)
    homogeneous[0] = 1
    for node in range(count):
        deviation = f[near, node] - centre
        for order in range(1, _ORDER):
            homogeneous[order] += deviation * homogeneous[order - 1]
    factorials = np.array([math.factorial(order + count - 1) for order in range(_ORDER)], dtype=np.float64)
    result[near] = np.exp(centre) * (homogeneous / factorials[:, None]).sum(axis=0)

    far, chosen = f[~near], widest[~near]
    first, second = (
        _divided_exp(far[np.arange(count) != drop[:, None]].reshape(len(far), count - 1)) for drop in chosen.T[::-1]
    )
    result[~near] = (first - second) / gap[~near]
    return result
