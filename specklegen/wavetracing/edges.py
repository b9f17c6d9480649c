"""Edges of a scene: which lines diffract, and with which wedge.

A side of a triangle is a candidate where its mesh ends or has a crease. Faces of other meshes, or of the same one, may
touch it, lie on it or hold it: candidates are cut where they meet other faces (`specklegen.wavetracing.intake`), and of
each piece the widest sector of air about it is found (`specklegen.wavetracing.contacts`):

    n = angle / pi, from 1 (flat) to 2 (a half plane),

so that a block of two halves, of halves that overlap, or doubled, has the edges of one block, and a block on the ground
none where it stands. Left out are wedges within 5 degrees of a plane, unless their faces are of unlike materials.
Pieces that follow each other in a line, with the same wedge, are one edge.

Source: S. Steinberg, M. Pharr, *Wave Tracing*, section on diffraction at edges; n as in J. B. Keller, *Geometrical
theory of diffraction* (1962).
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from specklegen.core.display.repr import short
from specklegen.wavetracing.contacts import Solids, wedges_about
from specklegen.wavetracing.kernels.cone_bvh import Tree

FLAT = np.deg2rad(175.0)
"""Interior angle above which two faces make no edge."""
WELD = 1e-9
"""Distance below which vertices are one, over the size of the scene."""
GAP = 1e-6
"""Distance over the size of the scene below which two boundary edges are a gap: files of single precision make them."""
_ALIKE = 1e-6  # of directions and angles of pieces that are one edge
_SENSE = np.array([0.3117, 0.5391, 0.7824])  # along which edges run


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges that diffract.

    Attributes
    ----------
    ends : float64[E, 2, 3]
        Positions of the two ends.
    faces : int32[E, 2]
        Faces that bound the air about it; the second is -1 where a sheet ends.
    wedge : float64[E]
        n, from 1 (flat) to 2 (half plane).
    inward, normal : float64[E, 3]
        Unit vectors across the edge: into the first face, and from it into the air.
    at : int32[3 F]
        The edge at each side of a face; -1 for none.

    Examples
    --------
    >>> from specklegen.wavetracing import Geometry, perforated_screen
    >>> edges = Geometry([perforated_screen([[-5, -5], [5, -5], [5, 5], [-5, 5]])]).edges
    >>> edges.ends.shape, edges.wedge  # the rim of a sheet: four half planes
    ((4, 2, 3), array([2., 2., 2., 2.]))
    """

    ends: np.ndarray
    faces: np.ndarray
    wedge: np.ndarray
    inward: np.ndarray
    normal: np.ndarray
    at: np.ndarray

    __repr__ = short

    def __len__(self) -> int:
        return len(self.wedge)

    def taken(self, which: np.ndarray) -> "Edges":
        """Return some of the edges, by their numbers; ``at`` stays."""
        names = ("ends", "faces", "wedge", "inward", "normal")
        return Edges(**{name: getattr(self, name)[which] for name in names}, at=self.at)

    @property
    def boundary(self) -> np.ndarray:
        """bool[E], whether one face ends there."""
        return self.faces[:, 1] < 0


@dataclass(frozen=True, eq=False)
class Topology:
    """Which faces of a mesh meet at which sides.

    A side is 3 f + i: from corner i of face f to corner i + 1.

    Attributes
    ----------
    neighbour : int32[3 F]
        Face across each side; -1 where there is none, or more than one.
    interior : float64[3 F]
        Interior angle between the two faces; 0 without neighbour.
    pair : int64[3 F]
        A number for each pair of welded corners.
    """

    neighbour: np.ndarray
    interior: np.ndarray
    pair: np.ndarray

    @property
    def candidates(self) -> np.ndarray:
        """bool[3 F], whether a side may be an edge: at the end of a mesh, or at a crease."""
        return (self.neighbour < 0) | (np.abs(self.interior - np.pi) >= np.pi - FLAT)


def weld(vertices: np.ndarray, tolerance: float = WELD) -> np.ndarray:
    """Return int32[V], equal for vertices within ``tolerance`` times the scene's size of each other.

    Vertices are compared on a lattice of that pitch, shifted so that round coordinates lie away from its borders.
    """
    if not len(vertices):
        return np.empty(0, np.int32)
    lower = vertices.min(axis=0)
    size = float((vertices.max(axis=0) - lower).max())
    pitch = tolerance * (size if size > 0 else 1.0)
    cells = np.floor((vertices - lower) / pitch + 0.3819660112501051).astype(np.int64)
    # One column at a time: sorting rows of three would compare them as strings of bytes.
    order = np.lexsort(cells.T)
    changed = np.empty(len(cells), bool)
    changed[0] = False
    changed[1:] = (cells[order[1:]] != cells[order[:-1]]).any(axis=1)
    welded = np.empty(len(cells), np.int32)
    welded[order] = np.cumsum(changed)
    return welded


def scene_size(vertices: np.ndarray) -> float:
    """Largest extent of vertices along an axis; 1 for none."""
    return float(np.ptp(vertices, axis=0).max(initial=0.0)) or 1.0 if len(vertices) else 1.0


def normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return unit normals float64[F, 3] of faces, right-handed; zero for faces without area."""
    a, b, c = (vertices[faces[:, n]] for n in range(3))
    n = np.cross(b - a, c - a)
    length = np.linalg.norm(n, axis=1, keepdims=True)
    return np.divide(n, length, out=np.zeros_like(n), where=length > 0)


def topology(vertices: np.ndarray, faces: np.ndarray, welded: np.ndarray, mesh: np.ndarray) -> Topology:
    """Find the neighbours of all sides of faces int[F, 3], of ``mesh`` int32[F] and vertices numbered ``welded``."""
    count = 3 * len(faces)
    first = welded[faces].astype(np.int64)
    second = np.roll(first, -1, axis=1)
    pair = (np.minimum(first, second) * (int(welded.max(initial=0)) + 1) + np.maximum(first, second)).ravel()
    own = np.repeat(mesh, 3)
    order = np.lexsort([own, pair])
    ordered, owner = pair[order], own[order]
    starts = np.flatnonzero((np.diff(ordered, prepend=-1) != 0) | (np.diff(owner, prepend=-1) != 0))
    sizes = np.diff(starts, append=count)
    pairs = starts[sizes == 2]
    one, two = order[pairs], order[pairs + 1]
    neighbour = np.full(count, -1, np.int32)
    neighbour[one], neighbour[two] = two // 3, one // 3
    interior = np.zeros(count)
    normal = normals(vertices, faces)
    f, g = one // 3, two // 3
    # Two faces that run along their common side in the same sense have opposite orientations.
    same = first.ravel()[one] == first.ravel()[two]
    n, m = normal[f], np.where(same[:, None], -normal[g], normal[g])
    along = vertices[faces[f, (one % 3 + 1) % 3]] - vertices[faces[f, one % 3]]
    length = np.linalg.norm(along, axis=1)
    along = np.divide(along, length[:, None], out=np.zeros_like(along), where=length[:, None] > 0)
    turn = np.arctan2((np.cross(n, m) * along).sum(axis=1), (n * m).sum(axis=1))  # > 0: convex
    interior[one] = interior[two] = np.pi - turn
    return Topology(neighbour, interior, pair)


def gaps(vertices: np.ndarray, faces: np.ndarray, welded: np.ndarray, adjacency: Topology) -> int:
    """Count boundary edges with another within GAP of the scene's size, both ends, that welding has left apart."""
    sides = np.flatnonzero(adjacency.neighbour < 0)
    start, stop = faces[sides // 3, sides % 3], faces[sides // 3, (sides % 3 + 1) % 3]
    keep = welded[start] != welded[stop]
    start, stop = start[keep], stop[keep]
    if len(start) < 2:
        return 0
    reach = GAP * float(np.ptp(vertices, axis=0).max())
    p, q = vertices[start], vertices[stop]
    one, two = cKDTree((p + q) / 2).query_pairs(reach, output_type="ndarray").T
    names = np.sort(np.stack([welded[start], welded[stop]], axis=1), axis=1)
    apart = (names[one] != names[two]).any(axis=1)
    along, across = (
        np.maximum(*(np.linalg.norm(a[one] - b[two], axis=1) for a, b in pairs)) <= reach
        for pairs in (((p, p), (q, q)), ((p, q), (q, p)))
    )
    near = apart & (along | across)
    return len(np.unique(np.concatenate([one[near], two[near]])))


def segments_of(vertices: np.ndarray, faces: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Both ends of sides, float64[n, 6]."""
    return np.concatenate([vertices[corner] for corner in _corners(faces, sides)], axis=1)


def _corners(faces: np.ndarray, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices at which sides begin and end."""
    return faces.ravel()[sides], np.roll(faces, -1, axis=1).ravel()[sides]


def edges_of(vertices, faces, welded, order, adjacency: Topology, tree: Tree, solids: Solids) -> Edges:
    """Return the edges that diffract, each once; arguments are those of `specklegen.wavetracing.geometry.Geometry`."""
    sides = np.flatnonzero(adjacency.candidates)
    _, first, place = np.unique(adjacency.pair[sides], return_index=True, return_inverse=True)
    segments = segments_of(vertices, faces, sides[first])
    reach = 2 * WELD * scene_size(vertices)
    which, angle, bounds, inward, normal = wedges_about(segments, reach, tree, solids)
    start, stop, wedge, count = segments[which, :3], segments[which, 3:], angle / np.pi, len(which)
    length = np.linalg.norm(stop - start, axis=1)
    along = (stop - start) / length[:, None]
    # All run one way, so that pieces of a line agree on which face is the first.
    turn = (along @ _SENSE < 0)[:, None]
    last = np.cos(angle)[:, None] * inward + np.sin(angle)[:, None] * normal
    along, inward = np.where(turn, -along, along), np.where(turn, last, inward)
    normal = np.cross(along, inward)
    start, stop = np.where(turn, stop, start), np.where(turn, start, stop)
    bounds = np.where(turn, bounds[:, ::-1], bounds)

    # Pieces that share an end and are alike are one edge.
    ends = welded[np.stack(_corners(faces, sides[first]), axis=1)][which].ravel()
    by_end = np.argsort(ends, kind="stable")
    ends, row = ends[by_end], by_end // 2
    keys, kinds, joined = np.column_stack([along, inward, wedge]), solids.material[bounds], [np.empty((0, 2), int)]
    for shift in range(1, int(np.bincount(ends).max(initial=1))):
        one, two = row[:-shift], row[shift:]
        alike = (ends[:-shift] == ends[shift:]) & (kinds[one] == kinds[two]).all(axis=1)
        slack = _ALIKE + 4 * reach / np.minimum(length[one], length[two])
        joined.append(np.stack([one, two], axis=1)[alike & (np.abs(keys[one] - keys[two]).max(axis=1) < slack)])
    one, two = np.concatenate(joined).T
    graph = coo_array((np.ones(len(one)), (one, two)), shape=(count, count))
    label = connected_components(graph, directed=False)[1] if count else np.empty(0, int)
    _, lead = np.unique(label, return_index=True)
    low, high = ((points * along[lead][label]).sum(axis=1) for points in (start, stop))
    lowest, highest = (np.lexsort([t, label])[np.unique(np.sort(label), return_index=True)[1]] for t in (low, -high))
    number = np.full(len(segments), -1)
    number[which] = label
    at = np.full(3 * len(faces), -1, np.int32)
    at[sides] = number[place]
    bound = order[bounds[lead]]
    bound[(bound[:, 0] == bound[:, 1]) & (wedge[lead] > 2 - _ALIKE), 1] = -1
    return Edges(
        np.stack([start[lowest], stop[highest]], axis=1), bound, wedge[lead], inward[lead], normal[lead], at
    )  # fmt: skip
