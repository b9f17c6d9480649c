"""Media made of boxes in two or three dimensions: extinction, free flights and random walks, in plain NumPy.

A medium is a list of axis-parallel boxes, each with its own extinction, albedo and mixture of particles; between
them is vacuum. One box, layers, voxels and a slab (a box without sides) are the same thing here. Collisions are
drawn by delta tracking, transmittances from the exact chord of every box. Positions and directions are
float64[..., d], d = 2 or 3, the last axis the optical one.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

SOLID_ANGLE = {2: 2 * np.pi, 3: 4 * np.pi}


@dataclass(frozen=True)
class Particle:
    """A kind of particle.

    Attributes
    ----------
    amplitude : callable
        s(cos theta), real or complex, with the integral of |s|^2 over all directions equal to 1.
    cosines : callable
        (rng, n) -> float64[n], cosines of scattering angles drawn from |s|^2.
    """

    amplitude: Callable[[np.ndarray], np.ndarray]
    cosines: Callable[[np.random.Generator, int], np.ndarray]


def henyey_greenstein(g: float, dimension: int) -> Particle:
    """Henyey and Greenstein's particle with s = +sqrt(rho).

    ``rho = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2))``, and in two dimensions
    ``(1 - g^2) / (2 pi (1 + g^2 - 2 g cos))``; both by inversion.
    """

    def amplitude(cos):
        return np.sqrt((1 - g**2) / (SOLID_ANGLE[dimension] * (1 + g**2 - 2 * g * cos) ** (dimension / 2)))

    def cosines(rng, n):
        u = rng.random(n)
        if dimension == 2:
            return np.cos(2 * np.arctan((1 - g) / (1 + g) * np.tan(np.pi * (u - 0.5))))
        return 1 - 2 * u if g == 0 else (1 + g**2 - ((1 - g**2) / (1 - g + 2 * g * u)) ** 2) / (2 * g)

    return Particle(amplitude, cosines)


def particle_by_rejection(amplitude: Callable[[np.ndarray], np.ndarray], peak: float, dimension: int) -> Particle:
    """Particle of any amplitude: directions uniform, kept with probability |s|^2 / peak, peak at least max |s|^2."""

    def cosines(rng, n):
        kept = np.empty(0)
        while len(kept) < n:
            u = rng.random(2 * n + 64)
            cos = np.cos(2 * np.pi * u) if dimension == 2 else 1 - 2 * u
            kept = np.concatenate([kept, cos[peak * rng.random(len(cos)) < np.abs(amplitude(cos)) ** 2]])
        return kept[:n]

    return Particle(amplitude, cosines)


@dataclass(frozen=True)
class Medium:
    """C boxes that do not overlap, K kinds of particles.

    Attributes
    ----------
    lower, upper : float64[C, d]
        Corners. Infinite sides are allowed where paths are started in a finite region.
    extinction, albedo : float64[C]
        sigma_t per unit length, and the share of collisions that scatter.
    shares : float64[C, K]
        Shares of sigma_s; rows add to 1.
    """

    lower: np.ndarray
    upper: np.ndarray
    extinction: np.ndarray
    albedo: np.ndarray
    particles: tuple[Particle, ...]
    shares: np.ndarray

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return self.lower.shape[1]

    def cells(self, x: np.ndarray) -> np.ndarray:
        """Index of the box that holds each point, int64[n]; -1 in vacuum."""
        index = np.full(len(x), -1)
        for cell, (lower, upper) in enumerate(zip(self.lower, self.upper, strict=True)):
            index[((x >= lower) & (x <= upper)).all(axis=-1)] = cell
        return index

    def optical_depth(self, x: np.ndarray, w: np.ndarray, length: np.ndarray | float) -> np.ndarray:
        """Integral of sigma_t from x float64[n, d] along w float64[..., n, d] over the length: float64[..., n]."""
        parts = (chord(lower, upper, x, w, length) for lower, upper in zip(self.lower, self.upper, strict=True))
        return sum((sigma * part for sigma, part in zip(self.extinction, parts, strict=True)), np.zeros(()))


def box(
    lower, upper, *, extinction: float, albedo: float = 1.0, particles: tuple[Particle, ...], shares=(1.0,)
) -> Medium:
    """One homogeneous box."""
    corners = np.atleast_2d(np.asarray(lower, float)), np.atleast_2d(np.asarray(upper, float))
    return Medium(*corners, np.array([extinction]), np.array([albedo]), particles, np.atleast_2d(shares))


def chord(lower: np.ndarray, upper: np.ndarray, x: np.ndarray, w: np.ndarray, length) -> np.ndarray:
    """Length inside one box of the segment from x along the unit vector w, float64[..., n]."""
    near, far, missed = 0.0, length, False
    for below, above, start, way in zip(lower, upper, x.T, np.moveaxis(w, -1, 0), strict=True):  # short rows are slow
        parallel = way == 0
        first, second = ((side - start) / np.where(parallel, 1.0, way) for side in (below, above))
        near = np.maximum(near, np.where(parallel, -np.inf, np.minimum(first, second)))
        far = np.minimum(far, np.where(parallel, np.inf, np.maximum(first, second)))
        missed = missed | parallel & ((start < below) | (start > above))
    return np.where(missed, 0.0, np.clip(far - near, 0, None))


def subpaths(medium: Medium, region: tuple[np.ndarray, np.ndarray], paths: int, rng: np.random.Generator) -> Iterator:
    """Walk all paths at once; yield (B, path, x1, omega_1, x_B, omega_(B-1), throughput) of those still going.

    First vertices are uniform in the region (lower, upper), first directions uniform over all directions. path is
    int64[n]; throughput float64[n] is the product of the albedos at collisions 2 to B; omega_0 is omega_1, and unused.
    """
    path = np.arange(paths)
    x1 = rng.uniform(*region, (paths, medium.dimension))
    path, x1 = _rows(medium.cells(x1) >= 0, path, x1)
    forward = np.eye(medium.dimension)[[-1] * len(path)]
    uniform = np.cos(2 * np.pi * rng.random(len(path))) if medium.dimension == 2 else 1 - 2 * rng.random(len(path))
    w1 = deflect(forward, uniform, rng)
    x, w, throughput = x1, w1, np.ones(len(path))
    order = 1
    while len(path):
        yield order, path, x1, w1, x, w, throughput
        if order > 1:
            kinds = draw_kinds(medium, medium.cells(x), rng)
            cos = np.empty(len(path))
            for kind, particle in enumerate(medium.particles):
                cos[kinds == kind] = particle.cosines(rng, int((kinds == kind).sum()))
            w = deflect(w, cos, rng)
        x = free_flight(medium, x, w, rng)
        path, x1, w1, x, w, throughput = _rows(~np.isnan(x[:, 0]), path, x1, w1, x, w, throughput)
        throughput = throughput * medium.albedo[medium.cells(x)]
        path, x1, w1, x, w, throughput = _rows(throughput > 0, path, x1, w1, x, w, throughput)
        order += 1


def free_flight(medium: Medium, x: np.ndarray, w: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Next collision from x along w by delta tracking, float64[n, d]; NaN for paths that leave."""
    majorant = medium.extinction.max()
    lower, upper = medium.lower.min(axis=0), medium.upper.max(axis=0)
    arrived = np.full_like(x, np.nan)
    going = np.arange(len(x))
    position = x.copy()
    while len(going):
        position[going] += w[going] * rng.exponential(1 / majorant, (len(going), 1))
        going = going[((position[going] >= lower) & (position[going] <= upper)).all(axis=1)]
        cell = medium.cells(position[going])
        real = rng.random(len(going)) * majorant < np.where(cell >= 0, medium.extinction[cell], 0.0)
        arrived[going[real]] = position[going[real]]
        going = going[~real]
    return arrived


def draw_kinds(medium: Medium, cells: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Kind of particle at collisions in the given boxes, int64[n]."""
    bounds = np.cumsum(medium.shares, axis=1)[cells, :-1]
    return (rng.random(len(cells))[:, None] >= bounds).sum(axis=1)


def deflect(w: np.ndarray, cos: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Turn directions float64[n, d] by angles of the given cosine, to a random side or azimuth."""
    sin = np.sqrt(np.clip(1 - cos**2, 0, None))
    if w.shape[1] == 2:
        across = np.stack([w[:, 1], -w[:, 0]], axis=1) * rng.choice((-1.0, 1.0), len(w))[:, None]
    else:
        azimuth = 2 * np.pi * rng.random(len(w))[:, None]
        helper = np.where(np.abs(w[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
        first = np.cross(w, helper)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        across = first * np.cos(azimuth) + np.cross(first, w) * np.sin(azimuth)
    turned = across * sin[:, None] + w * cos[:, None]
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def _rows(keep: np.ndarray, *arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(array[keep] for array in arrays)
