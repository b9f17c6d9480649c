"""Edges of meshes: which pairs of vertices diffract, and with which wedge.

Vertices that coincide are welded, pairs of vertices are sorted, and the faces at each pair are counted:

    1 face    a boundary: a half plane, n = 2;
    2 faces   a wedge of interior angle alpha, n = 2 - alpha / pi; left out above FLAT, where it is (nearly) a plane
              or a concave corner;
    more      a boundary of each face, with a warning.

Source: S. Steinberg, M. Pharr, *Wave Tracing*, section on diffraction at edges; n as in J. B. Keller, *Geometrical
theory of diffraction* (1962).
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from specklegen.core.display.repr import short

FLAT = np.deg2rad(175.0)
"""Interior angle above which two faces make no edge."""
WELD = 1e-9
"""Distance below which vertices are one, over the size of the scene."""

GAP = 1e-6
"""Distance over the size of the scene below which two boundary edges are a gap: files of single precision make them."""


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges that diffract.

    Attributes
    ----------
    ends : float64[E, 2, 3]
        Positions of the two ends.
    faces : int32[E, 2]
        The faces that meet there; the second is -1 at a boundary.
    wedge : float64[E]
        n = 2 - alpha / pi, from 1 (flat) to 2 (half plane).

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

    __repr__ = short

    def __len__(self) -> int:
        return len(self.wedge)

    @property
    def boundary(self) -> np.ndarray:
        """bool[E], whether one face ends there."""
        return self.faces[:, 1] < 0


@dataclass(frozen=True, eq=False)
class Topology:
    """Which faces meet at which sides.

    A side is 3 f + i: from corner i of face f to corner i + 1.

    Attributes
    ----------
    neighbour : int32[3 F]
        Face across each side; -1 where there is none, or more than one.
    interior : float64[3 F]
        Interior angle between the two faces; 0 without neighbour.
    crowded : int
        Pairs of vertices at which more than two faces meet.
    """

    neighbour: np.ndarray
    interior: np.ndarray
    crowded: int

    @property
    def diffracts(self) -> np.ndarray:
        """bool[3 F], whether a side is an edge."""
        return (self.neighbour < 0) | (self.interior <= FLAT)


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


def normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return unit normals float64[F, 3] of faces, right-handed; zero for faces without area."""
    a, b, c = (vertices[faces[:, n]] for n in range(3))
    n = np.cross(b - a, c - a)
    length = np.linalg.norm(n, axis=1, keepdims=True)
    return np.divide(n, length, out=np.zeros_like(n), where=length > 0)


def topology(vertices: np.ndarray, faces: np.ndarray, welded: np.ndarray) -> Topology:
    """Find the neighbours of all sides of faces int[F, 3] whose vertices carry the numbers ``welded`` int32[V]."""
    count = 3 * len(faces)
    first = welded[faces].astype(np.int64)
    second = np.roll(first, -1, axis=1)
    key = (np.minimum(first, second) * (int(welded.max(initial=0)) + 1) + np.maximum(first, second)).ravel()
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    starts = np.flatnonzero(np.diff(ordered, prepend=-1))
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
    return Topology(neighbour, interior, int((sizes > 2).sum()))


def gaps(vertices: np.ndarray, faces: np.ndarray, welded: np.ndarray, found: Topology) -> int:
    """Count boundary edges with another within GAP of the scene's size, both ends, that welding has left apart."""
    sides = np.flatnonzero(found.neighbour < 0)
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


def edges_of(vertices: np.ndarray, faces: np.ndarray, found: Topology) -> Edges:
    """Return the edges that diffract, each once."""
    sides = np.flatnonzero(found.diffracts)
    face, other = sides // 3, found.neighbour[sides]
    once = (other < 0) | (face < other)
    sides, face, other = sides[once], face[once], other[once]
    start = faces[face, sides % 3]
    stop = faces[face, (sides % 3 + 1) % 3]
    n = np.where(other < 0, 2.0, 2.0 - found.interior[sides] / np.pi)
    return Edges(vertices[np.stack([start, stop], axis=1)], np.stack([face, other], axis=1).astype(np.int32), n)
