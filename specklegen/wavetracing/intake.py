"""Meshes as they come: duplicates dropped, sides cut where they meet other faces, and all wound one way; with a report.

Sides of one mesh at which exactly two faces meet tell how these are wound against each other. A closed surface is wound
outwards, by its signed volume; any other surface as most of its faces are. A closed surface that is no thin wall, and
that holds no other one, is a *solid*: nothing inside it diffracts. One that holds others is a room.

Why no library unites the solids: `manifold3d` (3.5.4) joins two boxes that touch where their coordinates are equal to
the last bit; turned at random, 7 of 30 such pairs stay two bodies with a slit of rounding between them. Here whatever
lies within a tolerance of a side counts as touching it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from specklegen.core.display.repr import short
from specklegen.core.errors import warn_user
from specklegen.wavetracing.contacts import cuts, winding
from specklegen.wavetracing.edges import WELD, Topology, normals, scene_size, segments_of, topology, weld
from specklegen.wavetracing.kernels import cone_bvh

MOST_SIDES = 50_000
"""Sides that end or bend, above which they are not cut at other faces."""


@dataclass(frozen=True)
class Intake:
    """Changes to the faces of a scene before its layout.

    Attributes
    ----------
    duplicates, split, turned : int
        Faces dropped as copies; faces cut where a side of theirs meets other faces; faces wound the other way.
    one_sided : int
        Surfaces with one side alone (a Moebius strip), left as they are.
    solids : int
        Closed surfaces with matter inside.
    searched : bool
        Whether contacts were looked for: not where more than 50 000 sides end or bend.

    Examples
    --------
    >>> from specklegen.wavetracing import Geometry, perforated_screen
    >>> Geometry(perforated_screen([[-5, -5], [5, -5], [5, 5], [-5, 5]])).intake.turned
    0
    """

    duplicates: int
    split: int
    turned: int
    one_sided: int
    solids: int
    searched: bool

    __repr__ = short


@dataclass(frozen=True, eq=False)
class Mended:
    """Faces of a scene as they stand.

    Attributes
    ----------
    vertices, faces, welded : float64[V, 3], int32[F, 3], int32[V]
    row : int64[F]
        The face as it was given that each comes from.
    solid : int32[F]
        The closed surface that each belongs to, -1 for none; those with a face that is a thin wall among none.
    """

    vertices: np.ndarray
    faces: np.ndarray
    welded: np.ndarray
    row: np.ndarray
    solid: np.ndarray
    adjacency: Topology
    report: Intake


def mended(vertices: np.ndarray, faces: np.ndarray, mesh: np.ndarray, welded: np.ndarray, thin: np.ndarray) -> Mended:
    """Mend faces int32[F, 3] of the meshes int32[F], some of which, bool[M], are thin walls."""
    corners = np.column_stack([np.sort(welded[faces], axis=1), mesh])
    row = _first_of_each(corners)
    faces, mesh, total = faces[row], mesh[row], len(faces)
    adjacency = topology(vertices, faces, welded, mesh)
    vertices, faces, welded, origin, searched = _cut(vertices, faces, welded, adjacency)
    split = int((np.bincount(origin, minlength=len(row)) > 1).sum())
    if len(faces) > len(row):
        row, mesh = row[origin], mesh[origin]
        adjacency = topology(vertices, faces, welded, mesh)
    turn, surface, closed, one_sided = _orientation(vertices, faces, welded, adjacency)
    faces = np.where(turn[:, None], faces[:, ::-1], faces)
    solid = np.where(closed[surface] & ~thin[mesh], surface, -1) if len(faces) else np.empty(0, np.int32)
    keep = _without_copies(welded, faces, solid)
    if turn.any() or len(keep) < len(faces):
        faces, row, mesh, solid = faces[keep], row[keep], mesh[keep], solid[keep]
        adjacency = topology(vertices, faces, welded, mesh)
    solid = _numbered(np.where(np.isin(solid, _rooms(vertices, faces, solid)), -1, solid))
    duplicates = total - len(np.unique(row))
    if duplicates:
        warn_user(f"{duplicates} duplicate triangles were dropped")
    report = Intake(duplicates, split, int(turn.sum()), one_sided, int(solid.max(initial=-1)) + 1, searched)
    return Mended(vertices, faces, welded, row, solid, adjacency, report)


def _first_of_each(rows: np.ndarray) -> np.ndarray:
    """Numbers of rows that no earlier one equals, in rising order."""
    if not len(rows):
        return np.empty(0, np.int64)
    order = np.lexsort(rows.T)  # stable: the first of its kind stays
    same = np.zeros(len(rows), bool)
    same[order[1:]] = (rows[order[1:]] == rows[order[:-1]]).all(axis=1)
    return np.flatnonzero(~same)


def _numbered(labels: np.ndarray) -> np.ndarray:
    """Labels as int32 from 0 on, without gaps; -1 stays."""
    values, place = np.unique(labels, return_inverse=True)
    return (place.ravel() - (1 if len(values) and values[0] < 0 else 0)).astype(np.int32)


def _cut(vertices, faces, welded, adjacency: Topology):
    """Cut faces where sides that end or bend meet other faces.

    Return vertices, faces, welded numbers, the row that each face comes from, and whether it was looked for.
    """
    sides, same = np.flatnonzero(adjacency.candidates), np.arange(len(faces))
    if not len(sides) or len(sides) > MOST_SIDES:
        return vertices, faces, welded, same, len(sides) <= MOST_SIDES
    _, first = np.unique(adjacency.pair[sides], return_index=True)
    segments = segments_of(vertices, faces, sides[first])
    reach = 2 * WELD * scene_size(vertices)
    which, at = cuts(segments, reach, cone_bvh.tree_over(vertices, faces)[0])
    if not len(which):
        return vertices, faces, welded, same, True
    start, step = segments[which, :3], segments[which, 3:] - segments[which, :3]
    points = start + (at / np.linalg.norm(step, axis=1))[:, None] * step
    # A vertex that is there serves; so does a new one for every side that runs through it.
    near, old = cKDTree(vertices).query(points, distance_upper_bound=1.5 * reach)
    fresh = np.isinf(near)
    number = np.where(fresh, len(vertices) + np.cumsum(fresh) - 1, old)
    vertices = np.concatenate([vertices, points[fresh]])
    groups = weld(points[fresh], 2 * reach / scene_size(points[fresh]))
    welded = np.concatenate([welded, int(welded.max()) + 1 + groups]).astype(np.int32)
    on_side: dict[tuple[int, int], list[int]] = {}
    for side, vertex in zip(sides[first][which], number, strict=True):
        one, two = (int(welded[faces[side // 3, corner % 3]]) for corner in (side, side + 1))
        inner = on_side.setdefault((min(one, two), max(one, two)), [])
        inner.insert(len(inner) if one < two else 0, int(vertex))
    new, origin = _split(faces, welded, on_side)
    return vertices, new, welded, origin, True


def _split(faces, welded, on_side):
    """Split faces at the vertices within their sides, listed from the lower welded corner to the upper one.

    Return all faces, and the row that each comes from.
    """
    corners = welded[faces]
    pairs = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1), axis=-1)
    size = int(welded.max()) + 1
    marked = np.array([one * size + two for one, two in on_side], np.int64)
    touched = np.isin(pairs[..., 0].astype(np.int64) * size + pairs[..., 1], marked).any(axis=1)
    new, origin = [], []
    for f in np.flatnonzero(touched):
        waiting = [tuple(faces[f].tolist())]
        while waiting:
            triangle = waiting.pop()
            for n in range(3):
                a, b, apex = triangle[n], triangle[n - 2], triangle[n - 1]
                one, two = welded[a], welded[b]
                inner = on_side.get((min(one, two), max(one, two)), [])
                inner = [v for v in inner if welded[v] not in (one, two, welded[apex])]
                if inner:
                    chain = [a, *(inner if one < two else inner[::-1]), b]
                    waiting += [(p, q, apex) for p, q in zip(chain, chain[1:], strict=False)]
                    break
            else:
                new.append(triangle)
                origin.append(f)
    whole = np.flatnonzero(~touched)
    faces = np.concatenate([faces[whole], np.array(new, faces.dtype).reshape(-1, 3)])
    return faces, np.concatenate([whole, np.array(origin, np.int64)])


def _orientation(vertices, faces, welded, adjacency: Topology):
    """Return bool[F], faces to be turned; the surface of each; bool[S], closed ones; how many have one side alone."""
    count = len(faces)
    if not count:
        return np.zeros(0, bool), np.zeros(0, np.int64), np.zeros(0, bool), 0
    corners = welded[faces]
    upwards = (corners < np.roll(corners, -1, axis=1)).ravel()
    one = np.flatnonzero(adjacency.neighbour >= 0)
    order = np.lexsort([np.minimum(one // 3, adjacency.neighbour[one]), adjacency.pair[one]])
    one, two = one[order].reshape(-1, 2).T
    same = upwards[one] == upwards[two]
    f, g = one // 3, two // 3
    # Each face twice, as it is and turned; what meets rightly is joined.
    ends = np.concatenate([f, f + count]), np.concatenate([np.where(same, g + count, g), np.where(same, g, g + count)])
    graph = coo_array((np.ones(2 * len(f)), ends), shape=(2 * count, 2 * count))
    label = connected_components(graph, directed=False)[1]
    as_is, other = label[:count], label[count:]
    _, surface = np.unique(np.minimum(as_is, other), return_inverse=True)
    turn = as_is > other
    surfaces = int(surface.max()) + 1
    one_sided = np.bincount(surface, as_is == other, surfaces) > 0
    points = vertices[faces]
    local = points - points[np.unique(surface, return_index=True)[1], 0][surface][:, None]
    part = np.einsum("fi,fi->f", local[:, 0], np.cross(local[:, 1], local[:, 2])) * np.where(turn, -1, 1)
    volume, scale = np.bincount(surface, part, surfaces), np.bincount(surface, np.abs(part), surfaces)
    open_ = np.bincount(surface, (adjacency.neighbour.reshape(-1, 3) < 0).any(axis=1), surfaces) > 0
    closed = ~open_ & ~one_sided & (np.abs(volume) > 1e-9 * scale)
    most = 2 * np.bincount(surface, turn, surfaces) > np.bincount(surface, minlength=surfaces)
    back = np.where(closed, volume < 0, most)
    return (turn ^ back[surface]) & ~one_sided[surface], surface, closed, int(one_sided.sum())


def _without_copies(welded, faces, solid):
    """Numbers of the faces that are no copies of an earlier one, or of a solid's, with matter on the same side."""
    corners = np.sort(welded[faces], axis=1)
    _, place, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    twice = np.flatnonzero(count[place.ravel()] > 1)
    if not len(twice):
        return np.arange(len(faces))
    first = welded[faces[twice]]
    odd = (first[:, 0] > first[:, 1]).astype(int) + (first[:, 1] > first[:, 2]) + (first[:, 0] > first[:, 2])
    side = np.where(solid[twice] >= 0, odd % 2, 2)
    drop, rank = np.zeros(len(faces), bool), np.lexsort([twice, side == 2, place.ravel()[twice]])
    kept: dict[int, set[int]] = {}
    for n in rank:
        sides = kept.setdefault(int(place.ravel()[twice[n]]), set())
        if int(side[n]) in sides or (side[n] == 2 and sides):
            drop[twice[n]] = True
        sides.add(int(side[n]))
    return np.flatnonzero(~drop)


def _rooms(vertices, faces, solid) -> list[int]:
    """Closed surfaces that hold another one, all of it."""
    labels = np.unique(solid[solid >= 0])
    corners = [vertices[faces[solid == label]] for label in labels]
    low, high = (np.array([op(c.reshape(-1, 3), axis=0) for c in corners]).reshape(-1, 3) for op in (np.min, np.max))
    reach, rooms = 2 * WELD * scene_size(vertices), []
    for n, label in enumerate(labels):
        within = (low >= low[n] - reach).all(axis=1) & (high <= high[n] + reach).all(axis=1)
        within[n] = False
        for m in np.flatnonzero(within):
            apart = normals(corners[m].reshape(-1, 3), np.arange(3 * len(corners[m])).reshape(-1, 3))
            if (winding(corners[m].mean(axis=1) - 32 * reach * apart, corners[n]) > 0.5).all():
                rooms.append(int(label))
                break
    return rooms
