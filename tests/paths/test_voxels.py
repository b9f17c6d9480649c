"""Voxel grids: equal voxels are a box, layers balance, empty and very dense voxels, rays along edges and corners."""

import numpy as np
import pytest
from scenes import flat_box, views
from volume_batches import assert_same, engine_batches, oracle_batches
from zscore import assert_mean, refute_mean

import specklegen as sg
from specklegen.kernels.volume import (
    GRID,
    HOMOGENEOUS,
    LAYERS,
    chord,
    free_flight,
    is_homogeneous,
    is_layered,
    optical_depth,
)
from specklegen.oracles.box_algorithms import Far, Setup
from specklegen.oracles.box_media import Medium, henyey_greenstein
from specklegen.paths.layout import volume_of

ISOTROPIC = (sg.Isotropic(),)


def grid(extinction, half=5.0, scatterers=ISOTROPIC, **more):
    extinction = np.asarray(extinction, dtype=float)
    d = extinction.ndim
    return sg.VoxelGrid(lower=[-half] * d, upper=[half] * d, extinction=extinction, scatterers=scatterers, **more)


def flat(medium, lights=(0,), degrees=(0, 45, 180)):
    return flat_box(lights, views(degrees)).replace(medium=medium)


def test_equal_voxels_are_a_box():
    """A18."""
    whole = flat_box([0, 45], views([0, 45, 180]), half=5.0, mean_free_path=5.0)
    parts = whole.replace(medium=grid(np.full((4, 7), 0.2)))
    ours, theirs = (engine_batches(s, 150, reverse=True, seed=n) for n, s in enumerate((whole, parts), 1))
    assert_same(ours, theirs)


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [False, True])
def test_layers_against_the_literal_algorithms(reverse):
    """A18: extinction, albedo and anisotropy differ; the balance weight has the ratio of extinctions."""
    kinds = (0.7, 0.0)
    medium = grid([[0.1], [0.3]], albedo=np.array([[1.0], [0.7]]), material=np.array([[0], [1]]),
                  scatterers=(sg.HenyeyGreenstein(g=0.7), sg.Isotropic()))  # fmt: skip
    literal = Medium(np.array([[-5.0, -5], [-5, 0]]), np.array([[5.0, 0], [5, 5]]), np.array([0.1, 0.3]),
                     np.array([1.0, 0.7]), tuple(henyey_greenstein(g, 2) for g in kinds), np.eye(2))  # fmt: skip
    scene = flat(medium, (0, 10), (0, 50, 180))
    setup = Setup(literal, 1.0, Far(scene.lights), Far(scene.views))
    assert_same(engine_batches(scene, 200, reverse=reverse), oracle_batches(setup, 300, reverse=reverse))


def random_rays(n, dimension, rng):
    start = rng.uniform(-4.9, 4.9, (n, 3))
    w = rng.normal(size=(n, 3))
    if dimension == 2:
        start[:, 1] = w[:, 1] = 0.0
    return start, w / np.linalg.norm(w, axis=1, keepdims=True)


def crossed(volume, x, w):
    near, far = chord(volume.bounds, *x, *w)
    return optical_depth(volume.bounds, volume.cells, volume.extinction, *x, *w, near, far)


@pytest.mark.parametrize("dimension", [2, 3])
def test_traversal_is_the_sum_of_chords(dimension):
    """Every voxel as a box of its own; rays through corners, along edges and faces too."""
    rng = np.random.default_rng(1)
    shape = (3, 4) if dimension == 2 else (3, 4, 2)
    medium = grid(rng.uniform(0, 1, shape) * (rng.random(shape) > 0.3))
    volume = volume_of(medium, dimension)
    index = np.indices(shape).reshape(dimension, -1).T[:, ::-1]
    size = 10.0 / np.array(shape[::-1])
    literal = Medium(-5 + index * size, -5 + (index + 1) * size, medium.extinction.ravel(), np.ones(len(index)),
                     (henyey_greenstein(0.0, dimension),), np.ones((len(index), 1)))  # fmt: skip
    start, w = random_rays(60, dimension, rng)
    keep = [0, 2] if dimension == 2 else [0, 1, 2]
    expected = [literal.optical_depth(x[None, keep], v[None, keep], np.inf)[0] for x, v in zip(start, w, strict=True)]
    found = [crossed(volume, x, v) for x, v in zip(start, w, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rays_along_edges_and_through_corners_end(sign):
    """With equal voxels any of the voxels that meet there may be charged: the depth is that of the box."""
    volume = volume_of(grid(np.full((4, 4, 4), 0.2)), 3)
    diagonal = sign * np.ones(3) / np.sqrt(3)
    face = sign * np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    for w, length in (
        (diagonal, np.sqrt(75)), (face, np.sqrt(50)), (sign * np.array([0.0, 0.0, 1.0]), 5.0),
        (sign * np.array([1e-320, 0.0, 1.0]), 5.0), (sign * np.array([0.0, -0.0, 1.0]), 5.0),
    ):  # fmt: skip
        assert crossed(volume, np.zeros(3), w) == pytest.approx(0.2 * length, rel=1e-14)
    assert crossed(volume, np.full(3, 5.0), np.array([0.0, 0.0, sign])) == pytest.approx(2.0 if sign < 0 else 0.0)


def test_delta_tracking_survives_as_transmittance():
    """A18: Woodcock, traversal and, in the box, the formula; a dense corner is near the ray but not on it."""
    extinction = np.full((8, 8, 8), 0.05)
    extinction[6:, 6:, 6:] = 50.0
    extinction[2, 4, 4] = 1.0
    medium = grid(extinction)
    volume = volume_of(medium, 3)
    x, w = np.array([0.1, 0.1, -4.9]), np.array([0.01, 0.02, np.sqrt(1 - 5e-4)])
    n = 6400
    firsts = np.random.default_rng(5).random((n, 2))
    passed = np.array(
        [
            np.isinf(
                free_flight(volume.bounds, volume.cells, volume.extinction, volume.majorant, volume.per_length,
                            (*x, *w), *firsts[p], (np.uint64(3), np.uint64(4), np.uint64(0)), np.uint64(p),
                            np.uint64(16))[0]
            )
            for p in range(n)
        ]
    ).astype(float)  # fmt: skip
    expected = np.exp(-crossed(volume, x, w))
    assert_mean(passed, expected)
    refute_mean(passed, expected * 1.3)


def test_empty_voxels_scatter_nothing():
    for sensor in (views([0, 180]), sg.NearField(points=[[0.0, 0.0], [0.0, 9.0]])):
        scene = flat(grid(np.zeros((2, 3)))).replace(sensor=sensor)
        assert not sg.covariance(scene, paths=64, reverse=True).value.any()


def test_each_kind_of_cells_has_a_type_of_its_own():
    """By which kernels are compiled for one of them; a single voxel is a grid, and walked as one."""
    scatterer = sg.Isotropic()
    layers = [sg.Layer(thickness=5.0, mean_free_path=each, scatterer=scatterer) for each in (5.0, 2.5)]
    alike = [sg.Layer(thickness=5.0, mean_free_path=5.0, scatterer=scatterer)] * 2
    box = sg.Box(lower=[-5.0] * 3, upper=[5.0] * 3, mean_free_path=5.0, scatterer=scatterer)
    kinds = {
        HOMOGENEOUS: [box, sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=scatterer), sg.Layers(layers=alike)],
        LAYERS: [sg.Layers(layers=layers)], GRID: [grid(np.full((1, 1, 1), 0.2)), grid(np.full((2, 1, 3), 0.2))],
    }  # fmt: skip
    for kind, media in kinds.items():
        for medium in media:
            cells = volume_of(medium, 3).cells
            assert cells.dtype == kind
            assert (is_homogeneous(cells), is_layered(cells)) == (kind is HOMOGENEOUS, kind is LAYERS)
    start, w = random_rays(20, 3, np.random.default_rng(2))
    volumes = [volume_of(medium, 3) for medium in kinds[GRID]]
    depths = np.array([[crossed(volume, x, v) for x, v in zip(start, w, strict=True)] for volume in volumes])
    ends = np.array([chord(volumes[0].bounds, *x, *v) for x, v in zip(start, w, strict=True)])
    np.testing.assert_allclose(depths, [0.2 * (ends[:, 1] - ends[:, 0])] * 2, rtol=1e-13)
