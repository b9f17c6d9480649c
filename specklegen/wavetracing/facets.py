"""Plane facets of a scene, their borders and their holes, laid out for the walk of beams.

A facet is what triangles that meet in a plane make together. Its border is made of the sides at which it ends. Sides
that share corners are one loop; a loop that runs clockwise about the facet's normal is a hole in it, and where every
side of it is an edge, an opening for light.
"""

from weakref import WeakKeyDictionary

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from specklegen.wavetracing.emitters import Emitter, GaussianLaser
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.kernels.edge_geometry import EdgeTable
from specklegen.wavetracing.kernels.regions import Facets, Openings

_FOUND: WeakKeyDictionary[Geometry, Facets] = WeakKeyDictionary()
_PLANE = 1e-7  # radians between triangles of one facet, and facets of one sheet
MOST_EDGES = 64
"""Edges of an opening that the exact sampler of patterns takes; its work grows with their square. Others, by grids."""


def facets_of(scene: Geometry) -> Facets:
    """Facets, borders and holes of a scene, found once for as long as it lives."""
    if scene not in _FOUND:
        _FOUND[scene] = _facets_of(scene)
    return _FOUND[scene]


def _facets_of(scene: Geometry) -> Facets:
    topology, faces = scene.topology, scene.faces
    count = len(faces)
    neighbour = topology.neighbour
    own = np.repeat(np.arange(count), 3)
    level = (neighbour >= 0) & (np.abs(topology.interior - np.pi) < _PLANE)
    level &= scene.mesh[neighbour] == scene.mesh[own]
    graph = coo_array((np.ones(level.sum()), (own[level], neighbour[level])), shape=(count, count))
    facets, facet = connected_components(graph, directed=False) if count else (0, np.empty(0, np.int32))
    border = np.flatnonzero((neighbour < 0) | (facet[neighbour] != facet[own]))
    border = border[np.argsort(facet[own[border]], kind="stable")]
    edge = scene.edges.at[border] >= 0
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
    # Sides of a hole's border, those of the faces across them too.
    corners = welded[faces]
    ahead = np.roll(corners, -1, axis=1)
    pair = (np.minimum(corners, ahead) * size + np.maximum(corners, ahead)).ravel()
    beside = np.isin(pair, pair[border[hole_sides]])
    facet_of_hole = of[hole_sides][np.sort(index)]

    places = scene.order
    holes = len(ring_of)
    first_loop = _starts(number[label[hole_sides]], holes)
    loop_ends = np.ascontiguousarray(ends[hole_sides])
    first_rim, count_rim = _starts(of, facets), np.bincount(of, minlength=facets)
    thin = np.bincount(number[label[hole_sides]], neighbour[border[hole_sides]] >= 0, holes) == 0
    whole = np.bincount(of, ~edge, facets) == 0
    rim = np.bincount(of, np.linalg.norm(ends[:, 3:] - ends[:, :3], axis=1), facets)
    breadth = np.divide(length[:, 0], rim, out=np.zeros(facets), where=length[:, 0] > 0)
    return Facets(
        facet=facet[places].astype(np.int32),
        beside=beside.reshape(-1, 3)[places],
        normals=normals,
        whole=whole,
        sheet=_sheets(normals, origin),
        breadth=np.where(count_rim <= MOST_EDGES, breadth, np.inf),
        rims=first_rim,
        rim_ends=np.ascontiguousarray(ends),
        rim_edges=np.where(neighbour[border] < 0, 2, edge).astype(np.int8),
        holes=_starts(facet_of_hole, facets),
        loops=first_loop,
        loop_ends=loop_ends,
        thin=thin,
        material=scene.mesh[places].astype(np.int32),
    )


def _sheets(normals: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Numbers int32[F] of the planes that facets lie in, whichever way they face."""
    if not len(normals):
        return np.empty(0, np.int32)
    middle = origin.mean(axis=0)
    reach = float(np.abs(origin - middle).max()) or 1.0
    axis = np.abs(normals).argmax(axis=1)
    turned = normals * np.where(np.take_along_axis(normals, axis[:, None], axis=1) < 0, -1.0, 1.0)
    height = ((origin - middle) * turned).sum(axis=1) / reach
    pairs = cKDTree(np.column_stack([turned, height])).query_pairs(_PLANE, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(normals), len(normals)))
    return connected_components(graph, directed=False)[1].astype(np.int32)


_COHERENT = 3.3
"""Coherence widths sigma_g beyond which fringes are below .5 %: exp(-3.3^2 / 2)."""


def openings_of(facets: Facets, table: EdgeTable, emitter: Emitter) -> Openings:
    """Group the holes of each facet that lie as near to each other as the light is coherent."""
    reach = _COHERENT * emitter.coherence
    holes, ends = len(facets.loops) - 1, facets.loop_ends
    number = np.diff(facets.loops)
    facet = np.repeat(np.arange(len(facets.normals)), np.diff(facets.holes))
    of = np.repeat(np.arange(holes), number)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(of, values[:, n], holes) for n in range(3)], axis=1) / number[:, None]

    centre = mean(ends[:, :3])
    radius = np.zeros(holes)
    np.maximum.at(radius, of, np.linalg.norm(ends[:, :3] - centre[of], axis=1))
    if not holes:
        pairs = np.empty((0, 2), np.int64)
    elif np.isinf(reach):
        pairs = np.stack([np.arange(holes), facets.holes[facet]], axis=1)
    else:
        pairs = cKDTree(centre).query_pairs(reach + 2 * radius.max(), output_type="ndarray")
        one, two = pairs.T
        apart = np.linalg.norm(centre[one] - centre[two], axis=1) - radius[one] - radius[two]
        pairs = pairs[(facet[one] == facet[two]) & (apart <= reach)]
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(holes, holes))
    count, label = connected_components(graph, directed=False) if holes else (0, np.empty(0, np.int32))
    a, b = ends[:, :3] - centre[of], ends[:, 3:] - centre[of]
    area = np.linalg.norm(mean(np.cross(a, b)) * number[:, None], axis=1) / 2
    length = np.bincount(of, np.linalg.norm(b - a, axis=1), holes)
    breadth = np.zeros(count)
    np.maximum.at(breadth, label, 2 * area / length)
    dark = np.bincount(label[of], ~emitter.lights(ends[:, :3]), count)
    even = (dark == 0) | (emitter.beam_radius >= breadth)
    even &= not isinstance(emitter, GaussianLaser)
    even &= np.bincount(label, number, count) <= MOST_EDGES
    # An edge borders a hole if either of its faces does.
    bare = np.ones(len(table.edges), bool)
    bare[table.at[(table.at >= 0) & facets.beside]] = False
    return Openings(
        of=label.astype(np.int32),
        starts=_starts(np.sort(label), count),
        members=np.argsort(label, kind="stable").astype(np.int64),
        even=even,
        balls=np.column_stack([centre, radius * (1 + 1e-9)]),
        screens=np.unique(facet).astype(np.int64),
        outer=np.flatnonzero(bare & (table.edges[:, 6] > 0)),
        bare=bare,
    )


def _starts(groups: np.ndarray, count: int) -> np.ndarray:
    """Return the start of each of ``count`` groups, of members sorted by group; int64[count + 1]."""
    return np.concatenate([[0], np.cumsum(np.bincount(groups, minlength=count))]).astype(np.int64)
