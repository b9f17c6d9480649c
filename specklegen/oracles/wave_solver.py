"""Foldy-Lax: multiple scattering of a scalar wave by many circular cylinders in flatland, exactly.

Around cylinder j, at r_j, the scattered wave is sum_n b_jn psi_n(r - r_j) with psi_n(d) = H_n^(1)(k|d|) e^{in phi},
phi the angle of d; the wave that excites it is the light's plus that of all others, moved to r_j by Graf's
addition theorem:

    b_jn = T_n [ a_jn + sum_{l != j} sum_m psi_{m-n}(r_j - r_l) b_lm ]

One dense system of N (2M + 1) unknowns for all lights at once; no other approximation than the orders kept.
The addition theorem holds between cylinders that do not overlap.

Conventions (physics.md 1): time e^{-i omega t}; positions and directions are (x, z), angle theta is the direction (sin
theta, cos theta); the far field u(v) of u_sc -> u(v) e^{ikr} / sqrt(r) has no further factor. Sources: Foldy, *Phys.
Rev.* 67, 107 (1945); Martin, *Multiple Scattering* (2006): sections 2.5 and 4.5.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import j0, j1, jv, y0, y1

from specklegen.core.errors import reject
from specklegen.core.values import unit_vectors
from specklegen.oracles.cylinder import Cylinder

CHUNK = 1 << 20
"""Pairs of a point and a cylinder treated at once; bounds the memory of near fields."""


class Light(Protocol):
    """A set of L sources of unit strength."""

    def regular(self, k: float, centres: np.ndarray, order: int) -> np.ndarray:
        """Coefficients a_jn of J_n(k|r - r_j|) e^{in phi} about each centre, complex128[L, 2 order + 1, N]."""
        ...

    def field(self, k: float, points: np.ndarray) -> np.ndarray:
        """Field without any cylinder, complex128[L, P]."""
        ...


@dataclass(frozen=True)
class PlaneLights:
    """Plane waves e^{ik i.x} along the unit vectors ``directions`` float64[L, 2]."""

    directions: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "directions", _planar("PlaneLights.directions", self.directions, unit=True))

    def regular(self, k: float, centres: np.ndarray, order: int) -> np.ndarray:
        """Jacobi-Anger: a_jn = e^{ik i.r_j} (i e^{-i theta_i})^n."""
        n = np.arange(-order, order + 1)
        turn = (1j * _unit_phase(self.directions).conj())[:, None] ** n
        return turn[:, :, None] * self.field(k, centres)[:, None, :]

    def field(self, k: float, points: np.ndarray) -> np.ndarray:
        """e^{ik i.x}, complex128[L, P]."""
        return np.exp(1j * k * (self.directions @ points.T))


@dataclass(frozen=True)
class LineSources:
    """Line sources at ``points`` float64[L, 2], outside all cylinders.

    The exact cylindrical wave ``sqrt(pi k / 2) e^{i pi / 4} H_0^(1)(kr)``. The point source ``e^{ikr} / sqrt(r)`` of
    docs/physics.md is its limit, ``1 / (8 kr)`` away: 2 % at one wavelength.
    """

    points: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _planar("LineSources.points", self.points))

    def regular(self, k: float, centres: np.ndarray, order: int) -> np.ndarray:
        """Graf: a_jn = sqrt(pi k / 2) e^{i pi / 4} psi_{-n}(r_j - p)."""
        waves = outgoing(k, centres[None] - self.points[:, None], order)[::-1]
        return _source_strength(k) * waves.transpose(1, 0, 2)

    def field(self, k: float, points: np.ndarray) -> np.ndarray:
        """Return ``sqrt(pi k / 2) e^{i pi / 4} H_0^(1)(kr)``, complex128[L, P]."""
        return _source_strength(k) * outgoing(k, points[None] - self.points[:, None], 0)[0]


@dataclass(frozen=True)
class Scattered:
    """The solved problem: outgoing waves b_jn of every cylinder for every light.

    Attributes
    ----------
    centres : float64[N, 2]
    waves : complex128[L, 2M + 1, N]
        b_jn.
    """

    cylinder: Cylinder
    centres: np.ndarray
    light: Light
    waves: np.ndarray

    def far_field(self, directions: np.ndarray) -> np.ndarray:
        """Far field u(v) of the scattered wave, complex128[L, V], for unit vectors float64[V, 2]."""
        directions = _planar("directions", directions, unit=True)
        k, n = self.cylinder.wavenumber, self.cylinder.orders
        shift = np.exp(-1j * k * (directions @ self.centres.T))
        turn = (-1j * _unit_phase(directions))[:, None] ** n
        moments = self.waves @ shift.T  # L, 2M + 1, V
        return np.sqrt(2 / (np.pi * k)) * np.exp(-0.25j * np.pi) * np.einsum("lnv,vn->lv", moments, turn)

    def near_field(self, points: np.ndarray) -> np.ndarray:
        """Scattered field, total minus incident, complex128[L, P], at float64[P, 2]; inside cylinders too."""
        points = _planar("points", points)
        k, order = self.cylinder.wavenumber, self.cylinder.order
        field = np.zeros((len(self.waves), len(points)), np.complex128)
        if not len(self.centres) or not len(points):
            return field
        distance, nearest = cKDTree(self.centres).query(points)
        within = distance < self.cylinder.radius
        outside, step = np.flatnonzero(~within), max(1, CHUNK // len(self.centres))
        for start in range(0, len(outside), step):
            some = outside[start : start + step]
            waves = outgoing(k, points[some, None] - self.centres, order)
            field[:, some] = np.einsum("lnj,npj->lp", self.waves, waves, optimize=True)
        if within.any():
            centre = nearest[within]
            total = self._inside(points[within] - self.centres[centre], centre)
            field[:, within] = total - self.light.field(k, points[within])
        return field

    def _inside(self, offset: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Total field at an offset float64[P, 2] from the centres of the given numbers int[P], complex128[L, P]."""
        n = self.cylinder.orders[:, None]
        r = np.hypot(*offset.T)
        regular = jv(n, self.cylinder.index * self.cylinder.wavenumber * r) * np.exp(1j * n * np.arctan2(*offset.T))
        return np.einsum("lnp,np->lp", self.waves[:, :, centre] * self.cylinder.inner[:, None], regular)

    def extinction(self) -> np.ndarray:
        """Power taken from each light, float64[L], from the work that it does on every cylinder.

        -(4 / k) Re sum_jn a_jn* b_jn; for a plane wave the optical theorem, -sqrt(8 pi / k) Re[e^{i pi / 4} u(i)].
        """
        k = self.cylinder.wavenumber
        driven = self.light.regular(k, self.centres, self.cylinder.order).conj() * self.waves
        return -4 / k * driven.sum(axis=(1, 2)).real


def scatter(cylinder: Cylinder, centres: np.ndarray, light: Light) -> Scattered:
    """Solve the coupled system of equal cylinders at ``centres`` float64[N, 2], for all lights at once.

    Dense: two matrices of ``16 (N (2M + 1))^2`` bytes, 144 MB each for 3000 isotropic cylinders. Raise a `RuleError` if
    two cylinders overlap, or a line source lies in one.
    """
    centres = _planar("centres", centres)
    k, order, number = cylinder.wavenumber, cylinder.order, len(centres)
    _refuse_overlap(cylinder, centres, light)
    t = cylinder.t_matrix
    driven = light.regular(k, centres, order)
    lights = len(driven)
    if not number:
        return Scattered(cylinder, centres, light, driven)
    right = (t[:, None] * driven).reshape(lights, -1).T
    waves = np.linalg.solve(_system(k, t, centres, order), right)  # NumPy's, for SciPy's holds other threads up
    return Scattered(cylinder, centres, light, np.ascontiguousarray(waves.T).reshape(lights, 2 * order + 1, number))


def _system(k: float, t: np.ndarray, centres: np.ndarray, order: int) -> np.ndarray:
    """Matrix of 1 - T G, complex128[(2M + 1) N, (2M + 1) N], unknowns by order, then cylinder."""
    number, width = len(centres), 2 * order + 1
    matrix = np.zeros((width, number, width, number), np.complex128)
    first, second = np.triu_indices(number, 1)
    pairs = outgoing(k, centres[first] - centres[second], 2 * order)
    for p in range(-2 * order, 2 * order + 1):
        half = pairs[p + 2 * order]
        translation = np.zeros((number, number), np.complex128)
        translation[first, second] = half  # to the first, from the second: psi_p(r_first - r_second)
        translation[second, first] = half if p % 2 == 0 else -half
        for n in range(max(0, -p), min(width, width - p)):
            np.multiply(translation, -t[n], out=matrix[n, :, n + p, :])
    matrix = matrix.reshape(width * number, -1)
    matrix[np.diag_indices(len(matrix))] += 1
    return matrix


def outgoing(k: float, offset: np.ndarray, order: int) -> np.ndarray:
    """Outgoing waves psi_n(d) = H_n^(1)(k|d|) e^{in phi}, n = -order ... order, complex128[2 order + 1, ...].

    Upward recurrence in n, stable for H_n because Y_n dominates it. ``offset`` is float64[..., 2].
    """
    distance = np.hypot(offset[..., 0], offset[..., 1])
    kr = k * distance
    waves = np.empty((2 * order + 1, *kr.shape), np.complex128)
    hankel = [_complex(j0(kr), y0(kr))]
    if order > 0:
        hankel.append(_complex(j1(kr), y1(kr)))
    for n in range(1, order):
        hankel.append(2 * n / kr * hankel[n] - hankel[n - 1])
    waves[order] = hankel[0]
    if order > 0:
        turn = _unit_phase(offset) / distance
        phase = turn
        for n in range(1, order + 1):
            waves[order + n] = hankel[n] * phase
            waves[order - n] = (-1) ** n * hankel[n] * phase.conj()
            phase = phase * turn
    return waves


def directions_of(theta: np.ndarray) -> np.ndarray:
    """Unit vectors (sin theta, cos theta), float64[..., 2], of angles in radians."""
    return np.stack([np.sin(theta), np.cos(theta)], axis=-1)


def _unit_phase(vectors: np.ndarray) -> np.ndarray:
    """|d| e^{i phi} of vectors (x, z), phi counted from z towards x: complex128 of shape [...]."""
    return vectors[..., 1] + 1j * vectors[..., 0]


def _complex(real: np.ndarray, imaginary: np.ndarray) -> np.ndarray:
    out = np.empty(real.shape, np.complex128)
    out.real, out.imag = real, imaginary
    return out


def _source_strength(k: float) -> complex:
    return np.sqrt(np.pi * k / 2) * np.exp(0.25j * np.pi)


def _planar(field: str, vectors: np.ndarray, unit: bool = False) -> np.ndarray:
    """Check points or directions of the plane, float64[n, 2]."""
    vectors = np.asarray(vectors, dtype=np.float64)
    if vectors.ndim != 2 or vectors.shape[1] != 2 or not np.isfinite(vectors).all():
        reject(field, "finite, of shape (n, 2)", vectors)
    return unit_vectors(field, vectors) if unit else vectors


def _refuse_overlap(cylinder: Cylinder, centres: np.ndarray, light: Light) -> None:
    if not len(centres):
        return
    tree = cKDTree(centres)
    if tree.query_pairs(2 * cylinder.radius * (1 - 1e-12)):
        reject("centres", "at least two radii apart", "cylinders that overlap", "The addition theorem fails there.")
    if isinstance(light, LineSources) and len(light.points):
        nearest = float(np.min(tree.query(light.points)[0]))
        if nearest <= cylinder.radius:
            reject("LineSources.points", "outside all cylinders", nearest, "Keep them a radius clear of every centre.")
