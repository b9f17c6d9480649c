"""Sides of triangles against all triangles of a scene: where to cut them, and which faces stand about them.

About a piece of a side, each face that holds it ends there or goes through it: one half plane or two. Between two
neighbouring half planes is a *sector*, of matter or of air. A sector of air wider than pi is a wedge that diffracts.
So edges within a wall, on the floor, between houses that touch, or in a corner are none, however the faces are cut,
doubled or wound. Matter is what a closed surface has behind its faces, and all of its inside.
"""

from typing import NamedTuple

import numpy as np

from specklegen.wavetracing.kernels import contacts
from specklegen.wavetracing.kernels.cone_bvh import Tree

_ASIDE = 16  # in tolerances: how far from a side one looks for a face
_LEVEL = 1e-6  # radians between half planes that are one
_FLAT = 1e-12  # of doubled area over squared length, below which a triangle has no plane


class Solids(NamedTuple):
    """Closed surfaces with matter inside, and materials, by place in the leaves of the hierarchy.

    Attributes
    ----------
    solid, material : int[n]
        The solid of each place, -1 for none; a number for each material.
    flat : float
        Radians from pi within which a wedge is no edge.
    """

    solid: np.ndarray
    material: np.ndarray
    flat: float


def _near(segments: np.ndarray, reach: float, tree: Tree) -> tuple[np.ndarray, ...]:
    """Segments and triangles near each other: numbers of both, corners float64[*, 3, 3], unit normals or 0."""
    room = 16 * len(segments)
    while True:
        pairs = np.empty((room, 2), np.int64)
        count = contacts.neighbours(segments, reach, tree, pairs)
        if count <= room:
            break
        room = count
    which, place = pairs[:count].T
    corners = tree.corners[place].reshape(-1, 3, 3)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(a, b)
    size = np.linalg.norm(normal, axis=1)
    plane = size > _FLAT * np.maximum((a * a).sum(axis=1), (b * b).sum(axis=1))
    return which, place, corners, np.where(plane, 1 / np.where(plane, size, 1), 0)[:, None] * normal


def _inside(corners: np.ndarray, normal: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Depth to which vectors float64[N, 3, 3], one from each corner, enter triangles across a side; float64[N, 3]."""
    side = np.roll(corners, -1, axis=1) - corners
    size = np.maximum(np.linalg.norm(side, axis=2), 1e-300)
    return (np.cross(normal[:, None], side) * vectors).sum(axis=2) / size


def cuts(segments: np.ndarray, reach: float, tree: Tree) -> tuple[np.ndarray, np.ndarray]:
    """Return where segments float64[n, 6] run into other faces or leave them: their numbers, and lengths along them."""
    which, _, corners, normal = _near(segments, reach, tree)
    start, step = segments[which, :3], segments[which, 3:] - segments[which, :3]
    length = np.linalg.norm(step, axis=1)
    along = step / length[:, None]
    first = ((start - corners[:, 0]) * normal).sum(axis=1)
    last = first + length * (along * normal).sum(axis=1)
    level = np.maximum(np.abs(first), np.abs(last)) <= reach
    through = (first * last < 0) & (np.minimum(np.abs(first), np.abs(last)) > reach)
    # In its plane a segment is clipped by the sides; across it there is one point.
    at, rate = (_inside(corners, normal, v) for v in (start[:, None] - corners, np.repeat(along[:, None], 3, axis=1)))
    t = length * np.divide(first, first - last, out=np.zeros_like(first), where=through)
    through &= (at + t[:, None] * rate >= -reach).all(axis=1)
    beside = np.abs(rate) * length[:, None] <= reach
    cut = np.divide(-at, rate, out=np.zeros_like(at), where=~beside)
    low = np.where(~beside & (rate > 0), cut, 0).max(axis=1)
    high = np.where(~beside & (rate < 0), cut, np.inf).min(axis=1)
    level &= (~beside | (at >= -reach)).all(axis=1) & (high > low) & normal.any(axis=1)
    which = np.concatenate([which[level], which[level], which[through]])
    t = np.concatenate([low[level], high[level], t[through]])
    inner = (t > 2 * reach) & (t < np.linalg.norm(segments[which, 3:] - segments[which, :3], axis=1) - 2 * reach)
    order = np.lexsort([t[inner], which[inner]])
    which, t = which[inner][order], t[inner][order]
    apart = (np.diff(which, prepend=-1) != 0) | (np.diff(t, prepend=0) > reach)
    return which[apart], t[apart]


def winding(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the winding number float64[P] of a surface of triangles about points: solid angles over 4 pi.

    Source: A. Van Oosterom, J. Strackee, IEEE Trans. Biomed. Eng. 30, 125 (1983).
    """
    a, b, c = (corners[None, :, n] - points[:, None] for n in range(3))
    x, y, z = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    below = x * y * z + (a * b).sum(axis=2) * z + (a * c).sum(axis=2) * y + (b * c).sum(axis=2) * x
    return np.arctan2((a * np.cross(b, c)).sum(axis=2), below).sum(axis=1) / (2 * np.pi)


def wedges_about(segments: np.ndarray, reach: float, tree: Tree, solids: Solids) -> tuple[np.ndarray, ...]:
    """Return the wedges of air about segments float64[n, 6], pieces about which nothing changes.

    Numbers int[W] of the segments, exterior angles float64[W], places int[W, 2] of the faces that bound them, and
    unit vectors float64[W, 3] into the first face, and from it into the air.
    """
    middle, step = (segments[:, :3] + segments[:, 3:]) / 2, segments[:, 3:] - segments[:, :3]
    length = np.linalg.norm(step, axis=1)
    along = step / np.where(length > 0, length, 1)[:, None]
    which, place, corners, normal = _near(np.hstack([middle - reach * along, middle + reach * along]), reach, tree)
    off = np.abs(((middle[which] - corners[:, 0]) * normal).sum(axis=1))
    off += np.abs((step[which] * normal).sum(axis=1)) / 2
    into = np.cross(normal, along[which])
    halves = []
    for side in (1, -1):
        beside = (middle[which] + _ASIDE * reach * side * into)[:, None] - corners
        there = (_inside(corners, normal, beside) >= -reach).all(axis=1) & (off <= 2 * reach) & normal.any(axis=1)
        halves.append((which[there], place[there], side * into[there], np.full(there.sum(), side)))
    which, place, into, sense = (np.concatenate(part) for part in zip(*halves, strict=True))
    # Angles from the first half plane of each segment; normals of sense 1 look where the angle grows.
    first = np.full(len(segments), -1)
    first[which[::-1]] = np.arange(len(which))[::-1]
    one = into[first[which]]
    angle = np.arctan2((np.cross(one, into) * along[which]).sum(axis=1), (one * into).sum(axis=1))
    order = np.lexsort([angle, which])
    which, place, into, sense, angle = which[order], place[order], into[order], sense[order], angle[order]
    begins = np.diff(which, prepend=-1) != 0
    after = np.arange(1, len(which) + 1)
    ends = np.append(begins[1:], True) if len(which) else begins
    after[ends] = np.flatnonzero(begins)
    gap = angle[after] - angle + 2 * np.pi * ends
    # Half planes that coincide: which sides of theirs are matter, and whose fronts look where the angle grows or falls.
    label = np.cumsum(begins | (np.roll(gap, 1) >= _LEVEL)) - 1
    wrapped = ends & (gap < _LEVEL)
    label = np.where(np.isin(label, label[wrapped]), label[after][ends][np.cumsum(begins) - 1], label)
    solid, count = solids.solid[place], len(which) + 1
    behind, before = (np.bincount(label, (solid >= 0) & (sense == s), count) > 0 for s in (-1, 1))
    ahead, back = (_first(label, sense != s, count) for s in (1, -1))
    open_ = (gap >= np.pi - solids.flat) & ~behind[label] & ~before[label[after]]
    bounds = np.stack([place[ahead[label]], place[back[label[after]]]], axis=1)
    kinds = solids.material[bounds]
    open_ &= (gap > np.pi + solids.flat) | (kinds[:, 0] != kinds[:, 1])
    at = middle[which]
    for s in range(int(solids.solid.max(initial=-1)) + 1):
        own = tree.corners[solids.solid == s].reshape(-1, 3, 3)
        within = open_ & (at > own.min(axis=(0, 1))).all(axis=1) & (at < own.max(axis=(0, 1))).all(axis=1)
        within[within] = ~np.isin(which[within], which[solid == s])
        open_[within] = np.abs(winding(at[within], own)) < 0.5
    which, into = which[open_], into[open_]
    return which, gap[open_], bounds[open_], into, np.cross(along[which], into)


def _first(label: np.ndarray, late: np.ndarray, count: int) -> np.ndarray:
    """Number of the first row of each label that is not late, or of its first one; int[count]."""
    order = np.lexsort([late, label])[::-1]
    out = np.zeros(count, int)
    out[label[order]] = order
    return out
