"""Edges of a scene as arrays, laid out for the walk of beams (`specklegen.wavetracing.kernels.edge_geometry`)."""

import numpy as np

from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.kernels.edge_geometry import EdgeTable
from specklegen.wavetracing.kernels.regions import Facets


def edge_table(scene: Geometry, facets: Facets) -> EdgeTable:
    """Lay out the edges of a scene."""
    edges = scene.edges
    start, stop = edges.ends[:, 0], edges.ends[:, 1]
    length = np.linalg.norm(stop - start, axis=1)
    along = np.divide(stop - start, length[:, None], out=np.zeros_like(start), where=length[:, None] > 0)
    face, other = edges.faces.T
    place = np.argsort(scene.order)
    both = np.stack([face, np.where(other < 0, face, other)], axis=1)
    return EdgeTable(
        at=edges.at.reshape(-1, 3)[scene.order],
        edges=np.column_stack([start, along, length, edges.wedge, edges.normal, edges.inward]),
        facets=facets.facet[place[both]].astype(np.int32),
        rows=facets.material[place[both]].astype(np.int32),
    )
