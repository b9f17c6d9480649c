"""Cameras so wide that a slab is darker towards their sides, against waves behind it and literal averages."""

import numpy as np
import pytest
import torch
from scenes import of_the_figures
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.memory_effects.camera import camera_nodes, estimate_camera_correlation
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.memory_effects.oblique import estimate_oblique_correlation
from specklegen.oracles.multi_slice import slice_views
from specklegen.samplers.stationary.rule import scene_stationary_error

THICKNESS, SIDE = 240.0, 192
AXIS = np.array([0.0, 0.0, 1.0])


def medium(thickness=THICKNESS):
    return sg.Slab(thickness=thickness, mean_free_path=thickness / 8, scatterer=sg.VonMisesFisher(240.0))


def recipe(folder, **fields):
    """Recipe of figures/_why.py: 64 x 64 views of 1/3 in sines, a row of 32 points of 1/6."""
    return load_recipe("through-slab", {
        "mode_tolerance": 0.001, "sampler": "stationary", "window": {"width": SIDE / 2.0}, "media": "new",
        "camera": {"shape": [64, 64], "pixels_per_grain": 2.0},
        "material": {"wavelength": 1.0, "thickness": THICKNESS, "optical_depth": 8.0, "kernel_paths": 20_000,
                     "scatterer": {"type": "VonMisesFisher", "concentration": 240.0}},
        "objects": {"type": "Folder", "shape": [1, 32], "path": str(folder)},
        "field": {"pitch": 1 / SIDE, "extent_over_range": None}, **fields,
    })  # fmt: skip


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rows")
    lit = np.zeros((1, 32), np.float32)
    lit[0, 20:] = 1.0  # aside, so that an image that is turned the wrong way is seen
    for name in "ab":
        np.save(folder / f"{name}.npy", lit)
    return folder


@pytest.fixture(scope="module")
def wide(rows):
    made = recipe(rows)
    with pytest.warns(UserWarning, match="average over the camera under an envelope"):
        assert made.rendering.chosen.by_direction
    return made


def strips(images):
    """Mean brightness of eight strips across the row over that of all, float64[n, 8]."""
    found = np.array(images).reshape(len(images), 64, 8, 8).mean((1, 3))
    return found / found.mean()


def test_an_image_is_as_bright_by_direction_as_waves_are(wide):
    drawn = np.concatenate([strips(wide.batch(seed, "train", range(60))["image"]) for seed in range(2)])
    bins = [(n, 0) for n in range(-16, -4, 3)]  # the last points of the row have the smallest sines
    views = np.arange(-32, 32)
    fields = slice_views(medium(), wavelength=1.0, pitch=2 / 3, size=288, bins=bins, realizations=10, seed=5)
    seen = []
    for field in fields:
        field[:, 0, [n for n, _ in bins]] = 0  # light that was not scattered
        seen.append(np.square(np.abs(field[:, views][:, :, views])).mean(0))
    waves = strips(seen)
    error = waves.std(0, ddof=1) / len(waves) ** 0.5
    assert_mean(drawn - waves.mean(0), 0.0, slack=0.02 + 4 * error)
    refute_mean(drawn - waves.mean(0)[::-1], 0.0, slack=0.02 + 4 * error)
    refute_mean(drawn, 1.0, slack=0.02 + 4 * error)


def test_the_average_is_that_of_all_directions():
    """|K| over all nodes, mirror images too, of ways that no program centres: 36 literal phasors about their mean."""
    half, paths = np.array([0.3, 0.2]), 6000
    q = np.array([0.05, 0.1, 0.2])
    nodes, shares = camera_nodes(half)
    assert shares.sum() == pytest.approx(1)
    literal = []
    for seed in range(8):
        total = 0.0
        for (x, y), share in zip(nodes, shares, strict=True):
            view = np.array([x, y, np.sqrt(1 - x * x - y * y)])
            one = estimate_oblique_correlation(medium(), AXIS, view, paths, (seed, 1))
            weights = one.weights / one.weights.sum()
            turned = np.deg2rad(np.arange(0, 360, 10))
            along = np.stack([np.cos(turned), np.sin(turned)]) * q[:, None, None]
            ways = one.displacement - weights @ one.displacement
            total += share * (np.exp(-1j * np.tensordot(along, ways, (1, 1))) @ weights).mean(1).real
        literal.append(total)
    made = [estimate_camera_correlation(medium(), half, paths, (seed, 2))(q) for seed in range(8)]
    error = np.hypot(np.std(made, 0, ddof=1), np.std(literal, 0, ddof=1)) / 8**0.5
    assert_z(np.mean(made, 0), np.mean(literal, 0), error, degrees=14)
    axis = [estimate_correlation(medium(), paths, (seed, 3))(q) for seed in range(8)]
    refute_z(np.mean(axis, 0), np.mean(literal, 0), error, degrees=14)


def test_a_camera_of_no_width_has_the_correlation_of_the_axis():
    q, many = np.array([0.05, 0.1, 0.2]), range(8)
    one, other = (
        np.array([estimate(seed) for seed in many])
        for estimate in (
            lambda seed: estimate_camera_correlation(medium(), np.full(2, 1e-9), 5000, (seed, 2))(q),
            lambda seed: estimate_correlation(medium(), 5000, (seed, 3))(q),
        )
    )
    error = np.hypot(one.std(0, ddof=1), other.std(0, ddof=1)) / len(many) ** 0.5
    assert_z(one.mean(0), other.mean(0), error, degrees=14)
    units = [estimate_camera_correlation(medium(), np.full(2, 1e-9), 5000, 1), estimate_correlation(medium(), 5000, 2)]
    scales = [each.weights.sum() / each.paths for each in units]
    assert scales[0] == pytest.approx(scales[1], rel=0.1)


def test_the_plan_states_what_is_left(wide):
    (view,) = wide.extremes()
    left = scene_stationary_error(view.probe, 0.02, "averaged", True, glance=False)
    plain = scene_stationary_error(view.probe, 0.02, "axial", glance=False)
    assert left.intensity < plain.intensity / 4
    assert left.correlation <= plain.correlation + 1e-9
    (made,) = wide.plans()
    assert f"{left.intensity:.2g} ±" in made.doubts[0]


def test_narrow_cameras_are_drawn_as_before(rows):
    narrow = recipe(rows, camera={"shape": [8, 8], "pixels_per_grain": 2.0}, window={"width": 9600.0},
                    field={"pitch": 1e-5, "extent_over_range": None})  # fmt: skip
    chosen = narrow.rendering.chosen
    assert (chosen.form, chosen.by_direction) == ("axial", False)


def test_media_of_many_are_those_of_one(rows):
    """Companions do not matter."""
    drawn = recipe(rows, material={"wavelength": 1.0, "thickness": {"uniform": [100.0, 240.0]},
                                   "optical_depth": 8.0, "kernel_paths": 2000,
                                   "scatterer": {"type": "VonMisesFisher", "concentration": 240.0}})  # fmt: skip
    with pytest.warns(UserWarning, match="average over the camera"):
        together = SpeckleGenerator(drawn, 3)([4, 5])["image"]
    torch.testing.assert_close(SpeckleGenerator(drawn, 3)([5])["image"][0], together[1], rtol=0, atol=0)


def test_scenes_that_ask_for_it_are_drawn_under_every_pixels_own_envelope():
    brightness = np.zeros((1, 33))
    brightness[0, ::8] = 1.0
    light = sg.IncoherentObject(brightness=brightness, pitch=1 / SIDE, width=SIDE / 2)
    scene = sg.Scene(wavelength=1.0, medium=medium(), illumination=light, sensor=sg.FarField.grid((33, 33), 1 / SIDE))
    asked = sg.plan(scene, sampler="stationary")
    assert asked.chosen.form == "averaged"
    assert asked.chosen.maps is not None
    assert sg.plan(scene).sampler == "paths"
    images = [np.array(each.image) for each in asked.chosen.prepare(1, 1).media(40)]
    sums = [np.array(each.image) for each in sg.plan(scene, sampler="paths", paths=4000).chosen.prepare(1, 1).media(40)]
    one, other = (
        np.reshape([each[:32, :32] for each in some], (40, 4, 8, 4, 8)).mean((2, 4)) for some in (images, sums)
    )
    error = np.hypot(one.std(0, ddof=1), other.std(0, ddof=1)) / 40**0.5
    assert_z(one.mean(0), other.mean(0), error, degrees=78, slack=0.03 * other.mean())


@pytest.mark.slow
def test_images_correlate_with_themselves_as_waves_do(tmp_path):
    """Lags of rows of beads within .01 of waves behind the slab; those of a wrong average are off by more."""
    by = of_the_figures("_why")
    by.keep_rows(tmp_path / "rows", 0, 101)
    at = np.array([1, 2, 5, 10, 20]) - 1
    drawn = np.array([by.lags(image)[at] for image, _ in by.of_the_stream(tmp_path / "rows", THICKNESS, 0, 400)])
    waves = np.array([
        np.mean([by.lags(image)[at] for image, _ in by.by_waves(THICKNESS, seed, 40)], axis=0) for seed in range(24)
    ])  # fmt: skip
    error = np.hypot(waves.std(0, ddof=1) / 24**0.5, drawn.std(0, ddof=1) / 20)
    assert_z(drawn.mean(0), waves.mean(0), error, degrees=23, slack=0.01)
    turned = np.array([0.702, 0.300, 0.058, 0.035, 0.023])  # the same with K whose phases are left in its average
    refute_z(turned, waves.mean(0), error, degrees=23, slack=0.01)
