"""Lit parts of edges against rays: no ray sees an edge in what is said to be dark, and most that is dark is known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from wavetracing.solids import box

from specklegen.wavetracing import Geometry, Mesh, PointEmitter
from specklegen.wavetracing.coherent_ray_sums import PathSearch
from specklegen.wavetracing.kernels.edge_paths import views_of

SAMPLES = np.linspace(0.003, 0.997, 80)
GROUND = Mesh([[-60, -60, 0], [60, -60, 0], [60, 60, 0], [-60, 60, 0.0]], [[0, 1, 2], [0, 2, 3]])


def town(seed):
    """Nine blocks on the ground or turned in the air, and a point between them."""
    rng = np.random.default_rng(seed)
    meshes = [GROUND]
    for x in (-20, 0, 20):
        for y in (-20, 0, 20):
            size, turned = rng.uniform(6, 14, 3), rng.random() < 0.3
            block = box(size, (0, 0, 0 if turned else size[2] / 2))
            turn = Rotation.random(random_state=rng).as_matrix() if turned else np.eye(3)
            meshes.append(Mesh(block.vertices @ turn.T + [x, y, 20.0 * turned], block.faces))
    return Geometry(meshes), np.array([10.0, rng.uniform(-20, 20), rng.uniform(2, 12)])


def seen_by_rays(scene, graph, point, turn):
    """bool[E, 80], whether rays see samples of all edges, straight or by one mirror."""
    edges = graph.edges
    ends = (edges[:, None, :3] + (SAMPLES * edges[:, 6:7])[:, :, None] * edges[:, None, 3:6]).reshape(-1, 3)
    if turn[0] == 0:
        return (scene.ray(np.tile(point, (len(ends), 1)), ends - point)[0] > 1 - 1e-6).reshape(len(edges), -1)
    *normal, away = graph.planes[turn[1]]
    image = point - 2 * (point @ normal - away) * np.array(normal)
    height, depth = ends @ normal - away, image @ normal - away
    way, part = image - ends, np.where(height == depth, 0, height / np.where(height == depth, 1, height - depth))
    distance, face = scene.ray(ends + 1e-7 * way, way)
    plane = np.full(int(scene.number.max()) + 2, -1)  # of each face, and of none
    plane[scene.number[scene.order]] = graph.plane
    on_mirror = (height * depth < 0) & (np.abs(distance + 1e-7 - part) < 1e-6) & (plane[face] == turn[1])
    met = ends + part[:, None] * way
    free = scene.ray(np.tile(point, (len(ends), 1)), met - point)[0] > 1 - 1e-6
    return (on_mirror & free).reshape(len(edges), -1)


@pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")
@pytest.mark.parametrize("seed", [1, 2, pytest.param(3, marks=pytest.mark.slow)])
def test_rays_see_lit_parts_only(seed):
    """No ray that sees an edge is lost; parts 1 % shorter lose some; 8 of 10 dark edges are known."""
    scene, point = town(seed)
    search = PathSearch("coherent_rays", scene, PointEmitter(point, 0.1), 1, 1, "perfect", 60.0)
    graph, seen = search.graph, search.seen(point[None])[0]
    views = views_of(point, seen, graph, scene.tree)
    low, high = np.full((2, len(graph.edges), len(graph.turns)), [[[1.0]], [[0.0]]])
    edge = np.repeat(np.arange(len(graph.edges)), np.diff(views.first))
    for part, column in ((low, 3), (high, 4)):
        part[edge, views.turn[: len(edge), 0]] = views.polar[: len(edge), column]
    at = (SAMPLES * graph.edges[:, 6:7])[:, None]
    there = np.stack([seen_by_rays(scene, graph, point, turn) for turn in graph.turns], axis=1)
    low, high = low[..., None], high[..., None]
    within = 0.01 * (high - low)
    assert there.sum() > 500
    assert not (there & ((at < low) | (at > high))).any()
    assert (there & ((at < low + within) | (at > high - within))).sum() > 10
    dark, known = ~there.any(axis=2), (low > high)[..., 0]
    assert (known & dark).sum() > 0.8 * dark.sum()
