"""The algorithms of [Bar19] for any medium of boxes, transcribed to NumPy with the corrections of docs/physics.md.

    C_pq = E[ W a_p a_q* ]                                         Algorithms 1 and 3 (mixtures of particles)
    u_p  = N^(-1/2) sum over paths and B of z sqrt(W) a_p,    z = e^(2 pi i zeta)        Algorithms 2 and 4

for pairs p of a light and a view, in two or three dimensions; lights and views may be far or near, inside or
outside the medium. As printed, first vertices are uniform in a region (by default the whole medium) and first
directions uniform; every vertex is connected. Corrected: W carries 1/p_omega for B >= 2; single scattering has
sqrt(V), not sqrt(V/2), is never doubled and has one particle, while the particles at both ends of a longer path are
independent; near points take the direction at the vertex that they are connected to; the balance heuristic has the
ratio of extinctions, and no share for paths that would start outside the region. C and u are of u - m.

Source: Bar, Alterman, Gkioulekas, Levin, *A Monte Carlo framework for rendering speckle statistics in scattering media*
(ACM TOG 38, 2019): algorithms 1 to 4; Eqs. 13-17; Eq. 38; Eqs. 42-45.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from specklegen.oracles.box_media import SOLID_ANGLE, Medium, box, draw_kinds, henyey_greenstein, subpaths
from specklegen.scene.media import Slab


@dataclass(frozen=True)
class Far:
    """Plane waves e^(ik i.x), or far-field sensors e^(-ik v.x): directions of travel float64[P, d]."""

    directions: np.ndarray

    @property
    def count(self) -> int:
        """Number of directions."""
        return len(self.directions)


@dataclass(frozen=True)
class Beams(Far):
    """Collimated beams through the plane z = face, unit irradiance per area of that plane at every tilt.

    directions float64[P, d], z > 0; the window is a square (an interval) of full side ``width`` centred on the axis,
    carried straight along each direction.
    """

    width: float
    face: float = 0.0


@dataclass(frozen=True)
class Near:
    """Point sources or sensors, e^(ikr) / r^((d - 1)/2): positions float64[P, d]."""

    positions: np.ndarray

    @property
    def count(self) -> int:
        """Number of positions."""
        return len(self.positions)


@dataclass(frozen=True)
class Setup:
    """A medium, lights and views.

    Attributes
    ----------
    medium, wavelength
        The wavelength is that inside the medium.
    matched : bool
        False: P = T V pairs, light by light. True: P = T = V pairs (light p, view p).
    region : (float64[d], float64[d]) or None
        Box in which first vertices are drawn; it must hold every lit scatterer. Default: all of the medium.
    """

    medium: Medium
    wavelength: float
    lights: Far | Near
    views: Far | Near
    matched: bool = False
    region: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def start(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the region of first vertices."""
        return self.region or (self.medium.lower.min(axis=0), self.medium.upper.max(axis=0))

    @property
    def pairs(self) -> int:
        """P."""
        return self.lights.count if self.matched else self.lights.count * self.views.count


def slab_setup(
    slab: Slab, *, wavelength: float, width: float, lights: np.ndarray, views: np.ndarray, matched: bool = False
) -> Setup:
    """Return a Henyey-Greenstein slab under square beams: a box without sides.

    Paths start in the square column that holds the footprints of all beams at every depth.

    Parameters
    ----------
    slab, wavelength
        The wavelength is that inside the medium.
    width
        Full side of the beams on the face z = 0.
    lights, views, matched
        Directions of travel float64[T, 3] and float64[V, 3]; as in ``Setup``.
    """
    medium = box((-np.inf, -np.inf, 0), (np.inf, np.inf, slab.thickness), extinction=slab.extinction,
                 albedo=slab.albedo, particles=(henyey_greenstein(slab.scatterer.g, 3),))  # fmt: skip
    half = width / 2 + slab.thickness * float(np.abs(lights[:, :2] / lights[:, 2:]).max())
    region = np.array([-half, -half, 0]), np.array([half, half, slab.thickness])
    return Setup(medium, wavelength, Beams(lights, width), Far(views), matched, region)


class Contributions(NamedTuple):
    """Connections of one order: path numbers int64[n], weights W float64[n], amplitudes a complex128[P, n]."""

    order: int
    path: np.ndarray
    weight: np.ndarray
    amplitude: np.ndarray


def covariance(setup: Setup, paths: int, rng: np.random.Generator, *, reverse: bool = False) -> np.ndarray:
    """C_pq = E[u_p u_q*] - m_p m_q* by Algorithm 3, complex128[P, P]."""
    total = np.zeros((setup.pairs, setup.pairs), np.complex128)
    for part in contributions(setup, paths, rng, reverse=reverse):
        total += (part.weight * part.amplitude) @ part.amplitude.conj().T
    return total / paths


def intensity(setup: Setup, paths: int, rng: np.random.Generator, *, reverse: bool = False) -> np.ndarray:
    """Diagonal of C, single and multiple scattering apart, float64[2, P]."""
    total = np.zeros((2, setup.pairs))
    for part in contributions(setup, paths, rng, reverse=reverse):
        total[int(part.order > 1)] += np.square(np.abs(part.amplitude)) @ part.weight
    return total / paths


def fields(
    setup: Setup, paths: int, realizations: int, rng: np.random.Generator, *, reverse: bool = False
) -> np.ndarray:
    """Fields u - m by Algorithm 4, complex128[realizations, P], each from ``paths`` paths of its own."""
    field = np.zeros((realizations, setup.pairs), np.complex128)
    for part in contributions(setup, paths * realizations, rng, reverse=reverse, drawn=True):
        phase = np.exp(2j * np.pi * rng.random(len(part.path)))  # one for all pairs: their correlation
        field += add_up(part.path, phase * np.sqrt(part.weight) * part.amplitude, paths, realizations)
    return field / np.sqrt(paths)


def add_up(path: np.ndarray, values: np.ndarray, paths: int, realizations: int) -> np.ndarray:
    """Sum values [P, n] over the paths of each realization, complex128[realizations, P]."""
    total = np.zeros((realizations, len(values)), np.complex128)
    np.add.at(total, path // paths, values.T)
    return total


def contributions(
    setup: Setup, paths: int, rng: np.random.Generator, *, reverse: bool, drawn: bool = False
) -> Iterator[Contributions]:
    """Yield all connections, order by order.

    Where particles are mixed: every kind at each end in turn, weighted by its share (Algorithm 3), or one kind per
    end drawn by its share (``drawn``, Algorithm 4).
    """
    medium, (lower, upper) = setup.medium, setup.start
    volume, solid_angle = float(np.prod(upper - lower)), SOLID_ANGLE[medium.dimension]
    for order, path, x1, w1, xb, wb, throughput in subpaths(medium, setup.start, paths, rng):
        first, last = medium.cells(x1), medium.cells(xb)
        scattering = medium.albedo[first] * medium.extinction[first] * throughput
        if order == 1:
            for kind, share in _kinds(medium, first, rng, drawn):
                yield Contributions(1, path, scattering * volume * share, _single(setup, x1, kind))
            continue
        density = np.full(len(path), 1 / (solid_angle * volume))
        if reverse:
            startable = ((xb >= lower) & (xb <= upper)).all(axis=1)
            density += startable / (solid_angle * volume) * medium.extinction[first] / medium.extinction[last]
        for kind1, share1 in _kinds(medium, first, rng, drawn):
            for kindb, shareb in _kinds(medium, last, rng, drawn):
                amplitude = _multiple(setup, x1, w1, kind1, xb, wb, kindb)
                if reverse:
                    amplitude += _multiple(setup, xb, -wb, kindb, x1, -w1, kind1)
                yield Contributions(order, path, scattering / density * share1 * shareb, amplitude)


def _kinds(medium: Medium, cells: np.ndarray, rng: np.random.Generator, drawn: bool) -> list:
    """Kinds of particles int64[n] at collisions in these boxes, each with its weight float64[n]."""
    if drawn:
        return [(draw_kinds(medium, cells, rng), np.ones(len(cells)))]
    return [(np.full(len(cells), kind), medium.shares[cells, kind]) for kind in range(len(medium.particles))]


def _single(setup: Setup, x: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Amplitude a = A_i B_v s(i.v) of one vertex, complex128[P, n]."""
    to_light, a = _connect(setup, setup.lights, x, -1.0)
    to_view, b = _connect(setup, setup.views, x, 1.0)
    if not setup.matched:
        to_light, to_view = to_light[:, None], to_view[None]
    cos = -(to_light * to_view).sum(axis=-1).reshape(-1, len(x))
    return _join(setup, a, b) * _amplitude(setup.medium, kind, cos)


def _multiple(setup: Setup, x1, w1, kind1, xb, wb, kindb) -> np.ndarray:
    """Amplitude a = A_i(x1, omega_1) B_v(x_B, omega_(B-1)), complex128[P, n]."""
    to_light, a = _connect(setup, setup.lights, x1, -1.0)
    to_view, b = _connect(setup, setup.views, xb, 1.0)
    a = a * _amplitude(setup.medium, kind1, -(to_light * w1).sum(axis=-1))
    b = b * _amplitude(setup.medium, kindb, (to_view * wb).sum(axis=-1))
    return _join(setup, a, b)


def _join(setup: Setup, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a * b if setup.matched else (a[:, None] * b[None]).reshape(-1, a.shape[-1])


def _connect(setup: Setup, end: Far | Near, x: np.ndarray, sign: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors from x [n, d] to the lights (sign -1) or views (+1), [P, n, d], and b tau xi, complex128[P, n]."""
    k = 2 * np.pi / setup.wavelength
    if isinstance(end, Near):
        gap = end.positions[:, None] - x
        r = np.linalg.norm(gap, axis=-1)
        out = gap / r[..., None]
        tau = np.exp(-0.5 * setup.medium.optical_depth(x, out, r))
        return out, tau * np.exp(1j * k * r) / r ** ((x.shape[1] - 1) / 2)
    out = np.broadcast_to(sign * end.directions[:, None], (len(end.directions), *x.shape))
    amplitude = np.exp(-0.5 * setup.medium.optical_depth(x, out, np.inf) - 1j * k * (out * x).sum(axis=-1))
    if isinstance(end, Beams):
        along = end.directions[:, None, -1]
        back = (x[:, -1] - end.face) / along
        window = x[:, :-1] - back[..., None] * end.directions[:, None, :-1]  # where the ray through x enters
        amplitude = amplitude * (np.abs(window) <= end.width / 2).all(axis=-1) / np.sqrt(along)
    return out, amplitude


def _amplitude(medium: Medium, kinds: np.ndarray, cos: np.ndarray) -> np.ndarray:
    """s(cos) of the kind of particle at each of n vertices, complex128[P, n]."""
    s = np.empty(cos.shape, np.complex128)
    for kind, particle in enumerate(medium.particles):
        s[:, kinds == kind] = particle.amplitude(cos[:, kinds == kind])
    return s
