"""Paths of light that a slab sends straight back, with every one of their scatterings.

A wide beam falls along the axis, and what leaves against it is seen place by place. Light moves sideways alike from
everywhere, so that the same paths serve every place of the face: each is counted where it leaves. Photons are walked
in lock step; at each of its scatterings b one might leave, with

    w = albedo p(w_(b-1) . v) e^(-z_b / l),    v = (0, 0, -1)

and which of these ways are kept is left to chance, in proportion to w where it is small (roulette: no bias). Banks of
the engine (:mod:`specklegen.paths.bank`) hold sums over the scatterings of a path; where scatterers move in a part of
the medium alone, these would have to be traced anew for every part.
"""

from dataclasses import dataclass

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed, seed_words
from specklegen.core.values import read_only, remembered
from specklegen.paths.proposal import default_max_order
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import Scatterer

PART = 4096
"""Photons in lock step; each part has random numbers of its own."""
_ANGLES = 1 << 15  # of the table by which angles are drawn
_SPREAD = 1e-4  # radians, from which on its nodes are spaced geometrically: closer than any lobe is wide


@dataclass(frozen=True)
class VertexPaths:
    """N paths that leave a slab against the axis, and their V scatterings, path after path.

    Attributes
    ----------
    weight : float64[N]
        Intensity that each stands for.
    path : int64[V]
        Whose scattering it is.
    place : float64[V, 2]
        Lateral, from where the path leaves the face; the slab's unit of length.
    depth : float64[V]
        Below the face.
    turn : float64[V, 3]
        w_(b-1) - w_b, the directions before and behind.
    part : int64[N]
        Part of the photons that each is of; parts are independent.
    """

    weight: np.ndarray
    path: np.ndarray
    place: np.ndarray
    depth: np.ndarray
    turn: np.ndarray
    part: np.ndarray

    def __len__(self) -> int:
        return len(self.weight)

    @property
    def drop(self) -> np.ndarray:
        """1 - cos of the angle of each scattering, float64[V]."""
        return np.square(self.turn).sum(axis=1) / 2


@remembered(16)
def vertex_paths(slab: Slab, photons: int, kept: int, seed: Seed) -> VertexPaths:
    """Walk ``photons`` photons into a slab, and keep about ``kept`` of their ways back.

    Parameters
    ----------
    slab
        Homogeneous, of faces that do not reflect; its motion does not matter.
    photons, kept
        Paths kept are some more where few weights are large.
    seed
        Of all of them.
    """
    if not slab.faces.matched:
        reject("vertex_paths slab", "of index-matched faces", slab.faces, "Leave faces out.")
    words, level, parts = seed_words(seed), 0.0, []
    for part in range(-(-photons // PART)):
        count = min(PART, photons - part * PART)
        rng = np.random.Generator(np.random.Philox(np.random.SeedSequence((*words, part))))
        walked = _walk(slab, count, rng)
        if not level:
            level = _level(walked.weight, kept * count / photons)
        parts.append(_thinned(walked, level, rng, part))
    whole = _joined(parts, slab.mean_free_path)
    if not whole.weight.sum() > 0:
        reject("vertex_paths photons", "enough that some light returns", photons, "None does.")
    return whole


@dataclass(frozen=True)
class _Walk:
    """Scatterings of photons in the order of photons, then of scatterings; lengths in mean free paths."""

    photon: np.ndarray
    order: np.ndarray
    point: np.ndarray
    before: np.ndarray
    weight: np.ndarray


def _walk(slab: Slab, count: int, rng: np.random.Generator) -> _Walk:
    """Photons until all have left or been absorbed; every scattering may send them back along the axis."""
    depth, most = slab.optical_depth, default_max_order(slab)
    angles, kinds = _Angles.of(slab.scatterer), []
    number = np.arange(count)
    point, way = np.zeros((count, 3)), np.tile([0.0, 0.0, 1.0], (count, 1))
    for order in range(most):
        point = point + rng.standard_exponential(len(number))[:, None] * way
        inside = (point[:, 2] > 0) & (point[:, 2] < depth)
        number, point, way = number[inside], point[inside], way[inside]
        if not len(number):
            break
        weight = slab.albedo * angles.density(-way[:, 2]) * np.exp(-point[:, 2])
        kinds.append((number, np.full(len(number), order), point, way, weight))
        kept = rng.random(len(number)) < slab.albedo
        number, point, way = number[kept], point[kept], way[kept]
        way = _turned(way, angles.draw(rng.random(len(number))), 2 * np.pi * rng.random(len(number)))
    if not kinds:
        kinds = [(number, number, point, way, np.zeros(len(number)))]
    whole = [np.concatenate(rows) for rows in zip(*kinds, strict=True)]
    by_photon = np.argsort(whole[0], kind="stable")
    return _Walk(*(rows[by_photon] for rows in whole))


def _level(weight: np.ndarray, wanted: float) -> float:
    """Weight below which ways are left to chance, so that ``wanted`` of them are kept: sum min(1, w / level)."""
    ordered = np.sort(weight)[::-1]
    left = ordered[::-1].cumsum()[::-1]  # of those from each on
    kept = np.arange(len(ordered)) + left / np.maximum(ordered, 1e-300)  # with that one's weight as the level
    place = int(np.searchsorted(kept, wanted))
    if place == 0 or place >= len(ordered):
        return float(ordered.sum() / max(wanted, 1.0)) if place == 0 else float(max(ordered[-1], 1e-300))
    return float(left[place] / max(wanted - place, 1e-9))


def _thinned(walk: _Walk, level: float, rng: np.random.Generator, part: int) -> VertexPaths:
    """Ways back that are kept, each with its scatterings up to there."""
    chosen = np.flatnonzero(rng.random(len(walk.weight)) * level < walk.weight)
    orders = walk.order[chosen] + 1
    path = np.repeat(np.arange(len(chosen)), orders)
    last = np.cumsum(orders)
    back = np.repeat(last, orders) - 1 - np.arange(len(path))  # scatterings still to come
    at = np.repeat(chosen, orders) - back
    behind = np.where(back[:, None] > 0, walk.before[np.minimum(at + 1, len(walk.before) - 1)], [0.0, 0.0, -1.0])
    leaves = np.repeat(walk.point[chosen, :2], orders, axis=0)
    return VertexPaths(np.maximum(walk.weight[chosen], level), path, walk.point[at, :2] - leaves, walk.point[at, 2],
                       walk.before[at] - behind, np.full(len(chosen), part))  # fmt: skip


def _joined(parts: list[VertexPaths], length: float) -> VertexPaths:
    """One after the other, in the slab's unit of length."""
    first = np.cumsum([0, *map(len, parts)])
    path = np.concatenate([each.path + n for each, n in zip(parts, first, strict=False)])
    whole = lambda name: np.concatenate([getattr(each, name) for each in parts])  # noqa: E731
    lengths = (length * whole(name) for name in ("place", "depth"))
    return VertexPaths(*map(read_only, (whole("weight"), path, *lengths, whole("turn"), whole("part"))))


@dataclass(frozen=True)
class _Angles:
    """A phase function on nodes: cosines, density per steradian and distribution at them, float64[n]."""

    cos: np.ndarray
    value: np.ndarray
    below: np.ndarray

    @classmethod
    def of(cls, scatterer: Scatterer) -> "_Angles":
        """Tabulate a scatterer or several, whose intensities add."""
        half = _ANGLES // 2
        theta = np.concatenate([[0.0], np.geomspace(_SPREAD, np.pi / 2, half), np.linspace(np.pi / 2, np.pi, half)[1:]])
        cos = np.cos(theta)
        kinds = [share * np.square(np.abs(kind.amplitude(cos))) for kind, share in scatterer.components]
        value = np.sum(kinds, axis=0)
        steps = 2 * np.pi * (value[1:] + value[:-1]) / 2 * -np.diff(cos)
        below = np.concatenate([[0.0], np.cumsum(steps)])
        return cls(cos, value / below[-1], below / below[-1])

    def density(self, cos: np.ndarray) -> np.ndarray:
        """Share of the light scattered by these cosines, per steradian."""
        return np.interp(-cos, -self.cos, self.value)

    def draw(self, uniform: np.ndarray) -> np.ndarray:
        """Cosines by uniform numbers."""
        return np.interp(uniform, self.below, self.cos)


def _turned(way: np.ndarray, cos: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Directions float64[n, 3] turned by angles of these cosines, about themselves by an azimuth."""
    sine = np.sqrt(np.maximum(0.0, 1 - cos**2))
    across = np.sqrt(np.maximum(0.0, 1 - way[:, 2] ** 2))
    steep = across < 1e-9  # along the axis any frame will do
    over = 1 / np.where(steep, 1.0, across)
    x, y, z = way.T
    first = np.stack([np.where(steep, 1.0, x * z * over), np.where(steep, 0.0, y * z * over), -across], 1)
    second = np.stack([np.where(steep, 0.0, -y * over), np.where(steep, np.sign(z), x * over), 0 * x], 1)
    turned = cos[:, None] * way + (sine * np.cos(azimuth))[:, None] * first + (sine * np.sin(azimuth))[:, None] * second
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)
