"""Edges and mirrors of a scene as the graph on which paths run, at one wavelength."""

from itertools import product
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from specklegen.wavetracing.edges import WELD, Edges, scene_size
from specklegen.wavetracing.facets import facets_of
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.kernels.edge_paths import MIRRORS, Graph, edge_legs
from specklegen.wavetracing.materials import ABSORBER, CONDUCTOR, DIFFUSE
from specklegen.wavetracing.smooth_bodies import smooth_parts

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
    place = np.argsort(scene.order)
    smooth = smooth_parts(scene, 2 * np.pi / wavelength)
    numbers = (
        np.setdiff1d(np.arange(len(scene.edges)), scene.edges.at[smooth.sides]) if diffractions else np.zeros(0, int)
    )
    edges = scene.edges.taken(numbers)
    both = place[np.where(edges.faces < 0, edges.faces[:, :1], edges.faces)].reshape(-1, 2)
    sides, row = np.column_stack([plane[both], np.full(len(edges), -1)]), mesh[both].astype(np.int32)
    ends, wedge = edges.ends.copy(), edges.wedge.copy()
    for e, f in _thin(edges, plane[both], wavelength):
        # The air about both together, from the first face of one to the second of the other.
        ends[e], wedge[e] = (ends[e] + ends[f]) / 2, min(round(wedge[e] + wedge[f] - 1, 9), 2.0)
        sides[e], row[e, 1], numbers[f] = (sides[e, 0], sides[f, 1], sides[f, 0]), row[f, 1], -1
    whole = numbers >= 0
    start, stop = ends[:, 0], ends[:, 1]
    length = np.linalg.norm(stop - start, axis=1, keepdims=True)
    table = np.column_stack([start, (stop - start) / length, length, wedge, edges.normal, edges.inward])
    dull = np.isin(rows[mesh, 0], (ABSORBER, DIFFUSE)) | smooth.faces[scene.order]
    turns, images = _sequences(planes, np.unique(plane[~dull]), reflections)
    graph = Graph(
        edges=table[whole],
        numbers=numbers[whole],
        sides=sides[whole],
        rows=row[whole],
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
        bodies=smooth.bodies,
    )
    if diffractions < 2:
        return graph
    legs = np.empty((edge_legs(graph, graph.legs), 3), np.int64)
    edge_legs(graph, legs)
    return graph._replace(legs=legs)


def _thin(edges: Edges, planes: np.ndarray, wavelength: float) -> list[tuple[int, int]]:
    """Pairs of parallel edges with a strip of a face between them that is narrower than wavelength / 2 pi.

    Below it there is no wave from edge to edge; a wall so thin is nearly its sheet.
    """
    if not len(edges):
        return []
    step = edges.ends[:, 1] - edges.ends[:, 0]
    length = np.linalg.norm(step, axis=1)
    along, middle, angle = step / length[:, None], edges.ends.mean(axis=1), np.pi * edges.wedge[:, None]
    last = np.cos(angle) * edges.inward + np.sin(angle) * edges.normal  # into the second face
    near = cKDTree(middle).query_pairs(wavelength / 4, output_type="ndarray")
    one, two = np.concatenate([near, near[:, ::-1]]).T
    across = ((middle[two] - middle[one]) * last[one]).sum(axis=1)
    apart = np.linalg.norm(middle[two] - middle[one], axis=1)
    good = (planes[two, 0] == planes[one, 1]) & (across > 0.9 * apart) & (across < wavelength / (2 * np.pi))
    good &= ((along[one] * along[two]).sum(axis=1) > 1 - 1e-9) & (np.abs(length[one] - length[two]) < across)
    good &= edges.wedge[one] + edges.wedge[two] < 3 + 1e-6
    pairs, taken = [], set()
    for e, f in sorted(zip(one[good].tolist(), two[good].tolist(), strict=True)):
        if e not in taken and f not in taken:
            taken |= {e, f}
            pairs.append((e, f))
    return pairs


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
