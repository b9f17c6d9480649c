"""Edges and mirrors of a scene as the graph on which paths run, at one wavelength."""

from itertools import product
from typing import Literal

import numpy as np

from specklegen.wavetracing.edges import WELD, scene_size
from specklegen.wavetracing.facets import facets_of
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.kernels.edge_paths import MIRRORS, Graph, edge_legs
from specklegen.wavetracing.materials import ABSORBER, CONDUCTOR, DIFFUSE

Surfaces = Literal["perfect", "material"]


def graph_of(scene: Geometry, wavelength: float, surfaces: Surfaces, reflections: int, diffractions: int) -> Graph:
    """Lay out the edges and mirrors of a scene, and the legs between edges that paths may take."""
    facets, corners = facets_of(scene), scene.tree.corners
    mesh = scene.mesh[scene.order]
    rows = np.array([mesh.material.row(wavelength) for mesh in scene.meshes])
    if surfaces == "perfect":
        rows[:] = CONDUCTOR
    plane = facets.sheet[facets.facet].astype(np.int64)
    count = int(plane.max(initial=-1)) + 1
    anyone = np.zeros(count, np.int64)
    anyone[plane[::-1]] = np.arange(len(plane))[::-1]
    normal = facets.normals[facets.facet]
    planes = np.column_stack([normal[anyone], (corners[anyone, :3] * normal[anyone]).sum(axis=1)])
    ahead, solid = (normal * planes[plane, :3]).sum(axis=1) > 0, scene.solids.solid >= 0
    fronts = np.zeros((count, 2), bool)
    for side in (0, 1):
        fronts[plane[~solid | (ahead == side)], side] = True
    # Boxes of facets, by plane.
    low, high = np.full((len(facets.normals), 3), np.inf), np.full((len(facets.normals), 3), -np.inf)
    np.minimum.at(low, facets.facet, corners.reshape(-1, 3, 3).min(axis=1))
    np.maximum.at(high, facets.facet, corners.reshape(-1, 3, 3).max(axis=1))
    place = np.empty(len(scene), np.int64)
    place[scene.order] = np.arange(len(scene))
    edges = scene.edges if diffractions else scene.edges.taken(np.zeros(0, int))
    start, stop = edges.ends[:, 0], edges.ends[:, 1]
    length = np.linalg.norm(stop - start, axis=1, keepdims=True)
    both = place[np.where(edges.faces < 0, edges.faces[:, :1], edges.faces)].reshape(-1, 2)
    turns, images = _sequences(planes, np.unique(plane[~np.isin(rows[mesh, 0], (ABSORBER, DIFFUSE))]), reflections)
    graph = Graph(
        edges=np.column_stack([start, (stop - start) / length, length, edges.wedge, edges.normal, edges.inward]),
        sides=np.column_stack([plane[both], np.full(len(edges), -1)]),
        rows=mesh[both].astype(np.int32),
        planes=planes,
        fronts=fronts,
        windows=np.column_stack([low, high])[np.argsort(facets.sheet, kind="stable")],
        first_window=np.concatenate([[0], np.cumsum(np.bincount(facets.sheet, minlength=count))]).astype(np.int64),
        plane=plane,
        row=mesh.astype(np.int32),
        mesh=mesh.astype(np.int32),
        anyone=anyone,
        materials=rows.reshape(-1, 4).astype(float),
        turns=turns,
        images=images,
        legs=np.empty((0, 3), np.int64),
        raised=400 * WELD * scene_size(scene.vertices),
    )
    if diffractions < 2:
        return graph
    legs = np.empty((edge_legs(graph, graph.legs), 3), np.int64)
    edge_legs(graph, legs)
    return graph._replace(legs=legs)


def _sequences(planes: np.ndarray, mirrors: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Up to ``most`` mirrors in turn, and what they make of points; see `Graph`."""
    turns, images = [np.zeros(MIRRORS + 1, np.int64)], [np.eye(3, 4)]
    first = 0
    for level in range(1, most + 1):
        last = len(turns)
        for q, m in product(range(first, last), mirrors):
            if level == 1 or turns[q][level - 1] != m:
                turn, (*normal, distance) = turns[q].copy(), planes[m]
                turn[0], turn[level] = level, m
                turns.append(turn)
                mirror = np.eye(3) - 2 * np.outer(normal, normal)
                images.append(mirror @ images[q] + np.outer(2 * distance * np.array(normal), [0, 0, 0, 1]))
        first = last
    return np.array(turns), np.array(images)
