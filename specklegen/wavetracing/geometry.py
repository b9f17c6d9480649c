"""Meshes joined into one scene that cones and rays query.

Faces are numbered through all meshes in their order. Queries are exact: `closest` is the least depth at which any
point of any triangle lies in the cone, `collect` finds every triangle that does, and rays pass between no two welded
triangles. See `specklegen.wavetracing.kernels.cones`, `cone_bvh` and `ray_bvh` for how.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from specklegen.core.arguments import several
from specklegen.core.display.repr import summary
from specklegen.core.errors import reject, warn_user
from specklegen.core.parallel import Threads, map_blocks, slices
from specklegen.wavetracing.cones import Cone
from specklegen.wavetracing.contacts import Solids
from specklegen.wavetracing.edges import FLAT, Edges, Topology, edges_of, gaps, weld
from specklegen.wavetracing.intake import mended
from specklegen.wavetracing.kernels import cone_bvh, ray_bvh
from specklegen.wavetracing.meshes import Mesh

_RAYS = 16384  # in a block
_NEEDLE = 1e-12  # of doubled area over squared length, below which a triangle is treated as its edges


class Geometry:
    """Triangles of one or more meshes, welded, mended and in a hierarchy.

    Parameters
    ----------
    meshes
        One mesh or several.

    Attributes
    ----------
    vertices : float64[V, 3]
        Of all meshes.
    faces : int32[F, 3]
        As they stand after the intake: without duplicates, wound one way, split at T-junctions.
    number : int32[F]
        Number that each face has through all meshes as they were given; what queries return.
    mesh : int32[F]
        The mesh of each face.
    intake : Intake
        What was done to the faces.

    Raises
    ------
    RuleError
        If there is no mesh, or something else is given.

    Examples
    --------
    >>> from specklegen.wavetracing import Geometry, perforated_screen
    >>> scene = Geometry([perforated_screen([[-5, -5], [5, -5], [5, 5], [-5, 5]])])
    >>> len(scene.faces)
    2
    """

    def __init__(self, meshes: Mesh | Sequence[Mesh]) -> None:
        self.meshes = several("Geometry.meshes", meshes, Mesh)
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in self.meshes)])
        self.vertices = np.concatenate([mesh.vertices for mesh in self.meshes])
        faces = np.concatenate(
            [mesh.faces + np.int32(start) for mesh, start in zip(self.meshes, starts, strict=False)], dtype=np.int32
        )
        mesh = np.repeat(np.arange(len(self.meshes), dtype=np.int32), [len(m.faces) for m in self.meshes])
        thin = np.array([getattr(m.material, "thickness", None) is not None for m in self.meshes])
        found = mended(self.vertices, faces, mesh, weld(self.vertices), thin)
        self.vertices, self.faces, self.welded, self.intake = found.vertices, found.faces, found.welded, found.report
        self.number, self.mesh = found.row.astype(np.int32), mesh[found.row]
        self._solid, self._adjacency = found.solid, found.adjacency
        self._warn_of_slivers()
        self.tree, self.order = cone_bvh.tree_over(self.vertices, self.faces)

    def __repr__(self) -> str:
        return summary(self, vertices=self.vertices, faces=self.faces, meshes=len(self.meshes))

    def __len__(self) -> int:
        return len(self.faces)

    def _warn_of_slivers(self) -> None:
        a, b, c = (self.vertices[self.faces[:, n]] for n in range(3))
        double = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        longest = np.maximum.reduce([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))])
        flat = int((double <= _NEEDLE * longest).sum())
        if flat:
            warn_user(f"{flat} triangles have no area: they count as their edges")

    @property
    def memory(self) -> int:
        """Bytes of the arrays that queries need, those of the meshes included."""
        own = (self.vertices, self.faces, self.number, self.mesh, self.welded, self.order)
        return sum(array.nbytes for array in own + self.tree)

    @cached_property
    def topology(self) -> Topology:
        """Which faces meet at which sides; `DoubtWarning` of gaps."""
        apart = gaps(self.vertices, self.faces, self.welded, self._adjacency)
        if apart:
            warn_user(
                f"{apart} boundary edges nearly coincide with another and are not welded: light leaks between them, "
                "and both diffract; move their vertices together",
            )
        return self._adjacency

    @cached_property
    def solids(self) -> Solids:
        """Closed surfaces with matter inside, and materials, as kernels know them."""
        kinds = [mesh.material for mesh in self.meshes]
        material = np.array([kinds.index(kind) for kind in kinds], np.int32)[self.mesh[self.order]]
        return Solids(self._solid[self.order], material, float(np.pi - FLAT))

    @cached_property
    def edges(self) -> Edges:
        """Edges that diffract: wedges of air wider than 185 degrees, whose faces are rows of ``faces``."""
        return edges_of(
            self.vertices, self.faces, self.welded, self.order, self.topology, self.tree, self.solids
        )  # fmt: skip

    def closest(self, cone: Cone, near: float = 0.0, far: float = np.inf) -> tuple[float, int]:
        """Least depth in [near, far] at which the cone meets a triangle, and the triangle; (inf, -1) for none."""
        _check_depths(near, far)
        depth, place, _ = cone_bvh.closest(cone.packed(), near, far, self.tree)
        return float(depth), int(self.number[self.order[place]]) if place >= 0 else -1

    def collect(self, cone: Cone, near: float = 0.0, far: float = np.inf) -> np.ndarray:
        """Return the numbers int64[m] of all triangles that the cone meets in [near, far], in rising order."""
        _check_depths(near, far)
        out = np.empty(64, np.int64)
        while True:
            count, _ = cone_bvh.collect(cone.packed(), near, far, self.tree, out)
            if count <= len(out):
                return np.unique(self.number[self.order[out[:count]]].astype(np.int64))
            out = np.empty(count, np.int64)

    def ray(
        self, origins: np.ndarray, directions: np.ndarray, near: float = 0.0, threads: Threads = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Nearest triangle on each ray, beyond ``near``.

        Parameters
        ----------
        origins, directions : float64[..., 3]
            Broadcast against each other; directions of any length but 0.
        near : float
            What is nearer is passed over, in units of each direction's length; 0 by default.
        threads : int, optional
            Threads, by default all cores that the process may run on; the result does not depend on them.

        Returns
        -------
        distance : float64[...]
            In units of each direction's length; inf where nothing is met.
        face : int64[...]
            -1 where nothing is met.

        Raises
        ------
        RuleError
            For values that are not finite, or a direction of no length.
        """
        origins, directions = np.broadcast_arrays(np.asarray(origins, float), np.asarray(directions, float))
        if origins.ndim < 1 or origins.shape[-1] != 3:
            reject("Geometry.ray origins", "points float64[..., 3]", origins.shape)
        if not np.isfinite(origins).all() or not np.isfinite(directions).all():
            reject("Geometry.ray", "called with finite origins and directions", "a value that is not")
        if not directions.any(axis=-1).all():
            reject("Geometry.ray directions", "of positive length", np.zeros(3))
        shape = origins.shape[:-1]
        origins = np.ascontiguousarray(origins.reshape(-1, 3))
        directions = np.ascontiguousarray(directions.reshape(-1, 3))
        distance, place = np.empty(len(origins)), np.empty(len(origins), np.int64)
        everywhere = np.empty(0, np.int32)  # no facet is skipped

        def block(part: slice) -> None:
            ray_bvh.nearest_of(
                origins[part], directions[part], near, everywhere, self.tree, distance[part], place[part]
            )

        map_blocks(block, slices(len(origins), _RAYS), threads)
        face = np.where(place >= 0, self.number[self.order[place]] if len(self) else -1, -1).astype(np.int64)
        return distance.reshape(shape), face.reshape(shape)


def _check_depths(near: float, far: float) -> None:
    if np.isnan(near) or np.isnan(far) or not -np.inf < near:
        reject("cone depths near, far", "numbers, near finite", (near, far))
