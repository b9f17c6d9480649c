"""Triangle meshes: arrays of vertices and faces with a material, checked when they are made."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import finite_numbers, positive_number, real_array
from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.core.values import Value
from specklegen.wavetracing.materials import Absorber, Material


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of one material.

    Attributes
    ----------
    vertices : float64[V, 3]
        Positions (a length), finite.
    faces : int32[F, 3]
        Vertex numbers, counter-clockwise seen from outside where the mesh is closed.
    material
        What the surface does with light; by default an :class:`Absorber`.

    Raises
    ------
    RuleError
        For a vertex that is not finite (it would be met by every cone), or a number that no vertex has.

    Examples
    --------
    >>> from specklegen.wavetracing import Conductor, Mesh
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], Conductor())
    >>> triangle.faces.shape
    (1, 3)
    """

    vertices: np.ndarray
    faces: np.ndarray
    material: Material = field(default_factory=Absorber)

    __repr__ = short

    def __post_init__(self) -> None:
        if not isinstance(self.material, Value):
            reject("Mesh.material", "a material, such as Absorber()", self.material)
        vertices = real_array("Mesh.vertices", self.vertices).copy()
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            reject("Mesh.vertices", "an array float64[V, 3]", vertices.shape)
        if not np.isfinite(vertices).all():
            bad = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
            reject("Mesh.vertices", "finite everywhere", vertices[bad], f"See vertex {bad}; repair or drop its faces.")
        faces = finite_numbers("Mesh.faces", self.faces)
        if faces.ndim != 2 or faces.shape[1] != 3 or not np.issubdtype(faces.dtype, np.integer):
            reject("Mesh.faces", "an integer array [F, 3]", f"{faces.dtype}{list(faces.shape)}")
        wrong = (faces < 0) | (faces >= len(vertices))
        if wrong.any():
            bad = int(np.flatnonzero(wrong.any(axis=1))[0])
            reject("Mesh.faces", f"vertex numbers from 0 to {len(vertices) - 1}", faces[bad], f"See face {bad}.")
        faces = np.array(faces, dtype=np.int32)
        vertices.flags.writeable = faces.flags.writeable = False
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of the arrays and the material, in hexadecimal."""
        digest = hashlib.sha256()
        for array in (self.vertices, self.faces):
            digest.update(str(array.shape).encode() + np.ascontiguousarray(array).tobytes())
        digest.update(self.material.canonical_json().encode())
        return digest.hexdigest()

    def placed(self, shift: Sequence[float] = (0, 0, 0), rotation: np.ndarray | None = None) -> "Mesh":
        """Return the mesh turned by ``rotation`` float64[3, 3] (proper), then moved by ``shift``.

        Raises
        ------
        RuleError
            For a matrix that is not a proper rotation.
        """
        turn = np.eye(3) if rotation is None else proper_rotation("Mesh.placed rotation", rotation)
        return Mesh(self.vertices @ turn.T + np.asarray(shift, float), self.faces, self.material)


def proper_rotation(field: str, rotation: ArrayLike) -> np.ndarray:
    """Return a rotation as float64[3, 3]; refuse what is none."""
    turn = real_array(field, rotation)
    if turn.shape != (3, 3) or not np.abs(turn @ turn.T - np.eye(3)).max() <= 1e-9 or np.linalg.det(turn) < 0:
        reject(field, "a proper rotation float64[3, 3]", turn)
    return turn


def load_mesh(path: str | Path, scale: float = 1.0, material: Material | None = None) -> Mesh:
    """Read a mesh from a file (PLY, OBJ, STL, OFF, GLB), its vertices times ``scale``; needs the extra ``mesh``.

    Nothing is repaired or dropped: a vertex that is not finite is refused, double vertices are welded by `Geometry`.

    Parameters
    ----------
    path
        Of the file, whose suffix says what it is.
    scale
        What vertices are multiplied by, such as 0.001 from millimetres to metres; 1 by default.
    material
        Of every face; by default an :class:`Absorber`.

    Raises
    ------
    RuleError
        For a scale that is not positive and finite, a file without triangles, or a bad vertex or index.

    Examples
    --------
    >>> import tempfile
    >>> from specklegen.wavetracing import load_mesh
    >>> with tempfile.NamedTemporaryFile("w", suffix=".obj") as file:
    ...     for line in ("v 0 0 0", "v 1 0 0", "v 0 1 0", "f 1 2 3"):
    ...         print(line, file=file, flush=True)
    ...     load_mesh(file.name, scale=1000.0).faces.shape
    (1, 3)
    """
    import trimesh

    scale = positive_number("load_mesh scale", scale)
    if not isinstance(path, str | Path) or not Path(path).is_file():
        reject("load_mesh path", "a file", path)
    # process=True would drop vertices that are NaN, and say nothing.
    found = trimesh.load(str(path), process=False, force="mesh")
    faces = np.asarray(getattr(found, "faces", np.empty((0, 3), np.int64)))
    if not len(faces):
        reject("load_mesh path", "a file that holds triangles", str(path))
    return Mesh(np.asarray(found.vertices) * scale, faces, material or Absorber())


def perforated_screen(
    outline: np.ndarray, holes: Sequence[np.ndarray] = (), material: Material | None = None
) -> Mesh:
    """Return an infinitely thin screen with holes, in the plane z = 0, normal along +z; needs the extra ``mesh``.

    Parameters
    ----------
    outline : float64[n, 2]
        Corners of the outer border, in either sense.
    holes
        Corners of each hole, float64[m, 2]; inside the outline and apart from each other.
    material
        By default an :class:`Absorber`.

    Raises
    ------
    RuleError
        For polygons that cross themselves or each other, or that have no area.

    Examples
    --------
    >>> from specklegen.wavetracing import perforated_screen
    >>> outline, slit = [[-50, -50], [50, -50], [50, 50], [-50, 50]], [[-1, -6], [1, -6], [1, 6], [-1, 6]]
    >>> perforated_screen(outline, [slit]).faces.shape
    (8, 3)
    """
    import shapely

    def corners(name: str, given: np.ndarray) -> np.ndarray:
        points = real_array(f"perforated_screen {name}", given)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3 or not np.isfinite(points).all():
            reject(name, "at least three finite corners, float64[n, 2]", points)
        points = points[:-1] if (points[0] == points[-1]).all() else points
        if len(points) < 3:
            reject(name, "at least three different corners", points)
        return points

    if isinstance(holes, str) or not np.iterable(holes):
        reject("perforated_screen holes", "a sequence of polygons", holes)
    rings = [corners("outline", outline), *(corners(f"holes[{n}]", hole) for n, hole in enumerate(holes))]
    shape = shapely.Polygon(rings[0], rings[1:])
    if not shape.is_valid or not shape.area > 0:
        reject("perforated_screen", "an outline with holes inside and apart", shapely.is_valid_reason(shape))
    # Delaunay triangles stay near their holes; slivers across the screen would lie in the cone of every beam.
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shape))
    triangles = np.array([shapely.get_coordinates(part)[:3] for part in parts])
    points, where = np.unique(triangles.reshape(-1, 2), axis=0, return_inverse=True)
    faces = where.reshape(-1, 3)
    a, b, c = (points[faces[:, n]] for n in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    faces[area < 0] = faces[area < 0][:, ::-1]
    return Mesh(np.column_stack([points, np.zeros(len(points))]), faces, Absorber() if material is None else material)
