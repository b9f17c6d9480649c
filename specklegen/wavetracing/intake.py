"""Meshes as they come: wound one way, without T-junctions and walls that two solids share; what was done is reported.

Sides at which exactly two faces meet tell how these are wound against each other. A closed surface that no other one
holds is wound outwards, by its signed volume; any other surface as most of its faces are: one within another may be a
cavity or a body, which its file alone knows. A vertex within a side that ends there splits the face.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from specklegen.core.display.repr import short
from specklegen.wavetracing.edges import WELD

MOST_SIDES = 50_000
"""Sides at which a face ends, above which T-junctions are not looked for."""
_ROUNDS = 12


@dataclass(frozen=True)
class Intake:
    """What was done to the faces of a scene before it was laid out.

    Attributes
    ----------
    duplicates, removed, split, turned : int
        Faces dropped as copies; faces of walls that two closed meshes share, which are gone; faces split at vertices
        on their sides; faces wound the other way.
    one_sided : int
        Surfaces with one side alone (a Moebius strip), left as they are.
    searched : bool
        Whether T-junctions were looked for: not where more than 50 000 sides have no neighbour.

    Examples
    --------
    >>> from specklegen.wavetracing import Geometry, perforated_screen
    >>> Geometry(perforated_screen([[-5, -5], [5, -5], [5, 5], [-5, 5]])).intake.turned
    0
    """

    duplicates: int
    removed: int
    split: int
    turned: int
    one_sided: int
    searched: bool

    __repr__ = short


def _sides(welded: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return of each side its pair of corners as a number, whether it runs upwards, and how many faces have it."""
    first = welded[faces].astype(np.int64)
    second = np.roll(first, -1, axis=1)
    key = (np.minimum(first, second) * (int(welded.max(initial=0)) + 1) + np.maximum(first, second)).ravel()
    _, place, count = np.unique(key, return_inverse=True, return_counts=True)
    return key, (first < second).ravel(), count[place.ravel()]


def shared_walls(vertices: np.ndarray, faces: np.ndarray, mesh: np.ndarray, welded: np.ndarray) -> np.ndarray:
    """bool[F], faces that two closed meshes have both: what lies between two solids that touch."""
    corners = np.sort(welded[faces], axis=1)
    _, place, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    twice = count[place.ravel()] == 2
    out = np.zeros(len(faces), bool)
    if not twice.any():
        return out
    solid = np.zeros(int(mesh.max()) + 1, bool)
    for m in np.unique(mesh[twice]):
        own = faces[mesh == m]
        a, b, c = (vertices[own[:, n]] - vertices[own[0, 0]] for n in range(3))
        parts = np.einsum("fi,fi->f", a, np.cross(b, c))
        solid[m] = (_sides(welded, own)[2] == 2).all() and abs(parts.sum()) > 1e-9 * np.abs(parts).sum()
    order = np.argsort(place.ravel()[twice], kind="stable")
    one, two = np.flatnonzero(twice)[order].reshape(-1, 2).T
    both = (mesh[one] != mesh[two]) & solid[mesh[one]] & solid[mesh[two]]
    out[one[both]] = out[two[both]] = True
    return out


def split_at_junctions(
    vertices: np.ndarray, faces: np.ndarray, welded: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int, bool, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Split faces at vertices within sides that end there.

    Return the faces, the row int64[F] that each comes from, how many were split, whether it was looked for, and what
    `turned_faces` needs of the sides.
    """
    row, total = np.arange(len(faces)), set()
    size = float(np.ptp(vertices, axis=0).max(initial=0)) if len(vertices) else 0.0
    tolerance = 2 * WELD * (size or 1.0)
    sides = _sides(welded, faces)
    for _ in range(_ROUNDS):
        free = np.flatnonzero(sides[2] == 1)
        if len(free) > MOST_SIDES:
            return faces, row, len(total), False, sides
        inner = _within_sides(vertices, faces, welded, free, tolerance)
        if not inner:
            break
        kept, new, source = np.ones(len(faces), bool), [], []
        for f, (side, points) in inner.items():
            kept[f] = False
            total.add(int(row[f]))
            start, stop, apex = faces[f, side], faces[f, (side + 1) % 3], faces[f, (side + 2) % 3]
            chain = [start, *points, stop]
            new += [[a, b, apex] for a, b in zip(chain, chain[1:], strict=False)]
            source += [row[f]] * (len(chain) - 1)
        faces = np.concatenate([faces[kept], np.array(new, faces.dtype)])
        row = np.concatenate([row[kept], np.array(source)])
        sides = _sides(welded, faces)
    return faces, row, len(total), True, sides


def _within_sides(vertices, faces, welded, free, tolerance) -> dict[int, tuple[int, list[int]]]:
    """Find faces with a vertex of the free sides within one of theirs: the first such side, and its points in order."""
    start, stop = faces.ravel()[free], np.roll(faces, -1, axis=1).ravel()[free]
    _, first = np.unique(welded[start], return_index=True)
    corner = start[first]
    a, along = vertices[start], vertices[stop] - vertices[start]
    length = np.linalg.norm(along, axis=1)
    if not len(free):
        return {}
    near = cKDTree(vertices[corner]).query_ball_point(a + along / 2, length / 2 + tolerance)
    count = np.array([len(each) for each in near])
    side = np.repeat(np.arange(len(free)), count)
    point = corner[np.concatenate([np.asarray(each, np.int64) for each in near])]
    unit = along[side] / np.where(length > 0, length, 1)[side, None]
    offset = vertices[point] - a[side]
    t = (offset * unit).sum(axis=1)
    off = np.linalg.norm(offset - t[:, None] * unit, axis=1)
    good = (t > tolerance) & (t < length[side] - tolerance) & (off <= tolerance)
    good &= (welded[faces[free[side] // 3]] != welded[point][:, None]).all(axis=1)  # a needle's own corner is none
    by_face: dict[int, tuple[int, list[int]]] = {}
    for n in np.flatnonzero(good)[np.lexsort([t[good], side[good]])]:
        f, which = divmod(int(free[side[n]]), 3)
        if by_face.setdefault(f, (which, []))[0] == which:
            by_face[f][1].append(int(point[n]))
    return by_face


def turned_faces(vertices: np.ndarray, faces: np.ndarray, sides: tuple) -> tuple[np.ndarray, int]:
    """bool[F], faces to be wound the other way; and the number of surfaces with one side alone."""
    count = len(faces)
    if not count:
        return np.zeros(0, bool), 0
    key, upwards, many = sides
    paired = np.flatnonzero(many == 2)
    one, two = paired[np.argsort(key[paired], kind="stable")].reshape(-1, 2).T
    same = upwards[one] == upwards[two]
    f, g = one // 3, two // 3
    # Each face twice, as it is and turned; what meets rightly is joined.
    ends = np.concatenate([f, f + count]), np.concatenate([np.where(same, g + count, g), np.where(same, g, g + count)])
    graph = coo_array((np.ones(2 * len(f)), ends), shape=(2 * count, 2 * count))
    label = connected_components(graph, directed=False)[1]
    as_is, other = label[:count], label[count:]
    surface = np.minimum(as_is, other)
    _, surface = np.unique(surface, return_inverse=True)
    turn = as_is > other
    surfaces = int(surface.max()) + 1
    one_sided = np.bincount(surface, as_is == other, surfaces) > 0
    closed = np.bincount(surface, (many.reshape(-1, 3) != 2).any(axis=1), surfaces) == 0
    corners = vertices[faces]
    low, high = np.full((surfaces, 3), np.inf), np.full((surfaces, 3), -np.inf)
    np.minimum.at(low, surface, corners.min(axis=1))
    np.maximum.at(high, surface, corners.max(axis=1))
    local = corners - low[surface][:, None]
    part = np.einsum("fi,fi->f", local[:, 0], np.cross(local[:, 1], local[:, 2])) * np.where(turn, -1, 1)
    volume, scale = np.bincount(surface, part, surfaces), np.bincount(surface, np.abs(part), surfaces)
    outwards = closed & (np.abs(volume) > 1e-9 * scale)
    for s in np.flatnonzero(outwards):
        outwards[s] = not ((low < low[s]).all(axis=1) & (high > high[s]).all(axis=1) & closed).any()
    most = 2 * np.bincount(surface, turn, surfaces) > np.bincount(surface, minlength=surfaces)
    back = np.where(outwards, volume < 0, most)
    return (turn ^ back[surface]) & ~one_sided[surface], int(one_sided.sum())
