"""Plane facets of a scene, their borders and their holes, laid out for the walk of beams.

A facet is what triangles that meet in a plane make together. Its border is made of the sides at which it ends. Sides
that share corners are one loop; a loop that runs clockwise about the facet's normal is a hole in it, and where every
side of it is an edge, an opening for light.
"""

from weakref import WeakKeyDictionary

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.kernels.regions import Facets

_FOUND: WeakKeyDictionary[Geometry, Facets] = WeakKeyDictionary()
_PLANE = 1e-7  # radians between triangles of one facet


def facets_of(scene: Geometry) -> Facets:
    """Facets, borders and holes of a scene, found once for as long as it lives."""
    if scene not in _FOUND:
        _FOUND[scene] = _facets_of(scene)
    return _FOUND[scene]


def _facets_of(scene: Geometry) -> Facets:
    found, faces = scene.topology, scene.faces
    count = len(faces)
    neighbour = found.neighbour
    own = np.repeat(np.arange(count), 3)
    level = (neighbour >= 0) & (np.abs(found.interior - np.pi) < _PLANE)
    level &= scene.mesh[neighbour] == scene.mesh[own]
    graph = coo_array((np.ones(level.sum()), (own[level], neighbour[level])), shape=(count, count))
    facets, facet = connected_components(graph, directed=False) if count else (0, np.empty(0, np.int32))
    border = np.flatnonzero((neighbour < 0) | (facet[neighbour] != facet[own]))
    border = border[np.argsort(facet[own[border]], kind="stable")]
    edge = found.diffracts[border]
    start, stop = faces.ravel()[border], np.roll(faces, -1, axis=1).ravel()[border]
    ends = np.concatenate([scene.vertices[start], scene.vertices[stop]], axis=1)
    of = facet[own[border]]

    a, b, c = (scene.vertices[faces[:, n]] for n in range(3))
    vector = np.cross(b - a, c - a)
    normals = np.zeros((facets, 3))
    np.add.at(normals, facet, vector)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)

    # Loops: sides of one facet that share a welded corner.
    welded = scene.welded.astype(np.int64)
    size = int(welded.max(initial=0)) + 1
    first, last = of * size + welded[start], of * size + welded[stop]
    names, place = np.unique(np.concatenate([first, last]), return_inverse=True)
    one, two = place[: len(border)], place[len(border) :]
    ring = coo_array((np.ones(len(border)), (one, two)), shape=(len(names), len(names)))
    rings, label = connected_components(ring, directed=False) if len(border) else (0, np.empty(0, np.int32))
    label = label[one] if len(border) else label
    origin = scene.vertices[faces[:, 0]][np.unique(facet, return_index=True)[1]] if count else np.empty((0, 3))
    p, q = ends[:, :3] - origin[of], ends[:, 3:] - origin[of]
    area = np.bincount(label, (np.cross(p, q) * normals[of]).sum(axis=1), rings)
    open_ring = (area < 0) & (np.bincount(label, ~edge, rings) == 0)

    hole_sides = np.flatnonzero(open_ring[label])
    hole_sides = hole_sides[np.lexsort([label[hole_sides], of[hole_sides]])]
    ring_of, index = np.unique(label[hole_sides], return_index=True)
    ring_of = ring_of[np.argsort(index)]
    number = np.full(rings, -1, np.int32)
    number[ring_of] = np.arange(len(ring_of))
    loop = np.full(3 * count, -1, np.int32)
    loop[border[hole_sides]] = number[label[hole_sides]]
    facet_of_hole = of[hole_sides][np.sort(index)]

    places = scene.order
    back = np.empty(count, np.int32)
    back[places] = np.arange(count, dtype=np.int32)
    across = np.where(neighbour >= 0, back[neighbour] if count else 0, -1)
    across = np.where(found.diffracts, across, -2).astype(np.int32)
    whole = np.bincount(of, ~edge, facets) == 0
    return Facets(
        facet=facet[places].astype(np.int32),
        across=across.reshape(-1, 3)[places],
        loop=loop.reshape(-1, 3)[places],
        normals=normals,
        whole=whole,
        rims=_starts(of, facets),
        rim_ends=np.ascontiguousarray(ends),
        holes=_starts(facet_of_hole, facets),
        loops=_starts(number[label[hole_sides]], len(ring_of)),
        loop_ends=np.ascontiguousarray(ends[hole_sides]),
        material=scene.mesh[places].astype(np.int32),
    )


def _starts(groups: np.ndarray, count: int) -> np.ndarray:
    """Where each of ``count`` groups begins, of members sorted by group; int64[count + 1]."""
    return np.concatenate([[0], np.cumsum(np.bincount(groups, minlength=count))]).astype(np.int64)
