"""Edges of a scene as arrays, laid out for the walk of beams with UTD (`specklegen.wavetracing.kernels.edge_waves`)."""

import numpy as np

from specklegen.wavetracing.edges import normals
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.kernels.edge_waves import EdgeTable
from specklegen.wavetracing.kernels.regions import Facets


def edge_table(scene: Geometry, facets: Facets) -> EdgeTable:
    """Lay out the edges of a scene."""
    edges = scene.edges
    start, stop = edges.ends[:, 0], edges.ends[:, 1]
    length = np.linalg.norm(stop - start, axis=1)
    along = np.divide(stop - start, length[:, None], out=np.zeros_like(start), where=length[:, None] > 0)
    face, other = edges.faces.T
    inward = scene.vertices[scene.faces[face]].mean(axis=1) - start
    inward -= (inward * along).sum(axis=1, keepdims=True) * along
    size = np.linalg.norm(inward, axis=1, keepdims=True)
    inward = np.divide(inward, size, out=np.zeros_like(inward), where=size > 0)
    normal = normals(scene.vertices, scene.faces)[face]
    place = np.empty(len(scene), np.int64)
    place[scene.order] = np.arange(len(scene))
    both = np.stack([face, np.where(other < 0, face, other)], axis=1)
    at = np.full(3 * len(scene), -1, np.int32)
    sides = np.flatnonzero(scene.topology.diffracts)
    neighbour = scene.topology.neighbour[sides]
    first = (neighbour < 0) | (sides // 3 < neighbour)
    kept = length > 0
    at[sides[first][kept]] = np.flatnonzero(kept)
    return EdgeTable(
        at=at.reshape(-1, 3)[scene.order],
        edges=np.column_stack([start, along, length, edges.wedge, normal, inward]),
        facets=facets.facet[place[both]].astype(np.int32),
        rows=facets.material[place[both]].astype(np.int32),
    )
