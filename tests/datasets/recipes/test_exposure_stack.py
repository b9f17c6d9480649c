"""Exposures of media that move: contrast and what rests, against the engine's own correlation in time."""

import numpy as np
import pytest
from quick_recipes import quick_recipe
from refusals import assert_refused
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator

DURATIONS = (1e-5, 1e-4, 5e-4, 2e-3)


def recipe_of(material=None, **exposures):
    """Stacks of one medium: a slab of optical depth 10 and g 0 by default, tau0 a hundredth."""
    slab = {"wavelength": 0.5, "thickness": 1000.0, "optical_depth": 10.0, "g": 0.0, "kernel_paths": 20_000}
    given = {"durations": DURATIONS, "tau0": 0.01} | exposures
    sources = load_recipe("through-slab")
    return type(load_recipe("lsci-slab"))(name="one-medium", media=None, material=material or slab,
                                          window=sources.window, exposures=given,
                                          camera={"shape": [48, 48], "pixels_per_grain": 2.0})  # fmt: skip


LAYERS = {"wavelength": 0.5, "kernel_paths": 100_000, "layers": [
    {"thickness": 500.0, "mean_free_path": 100.0, "g": 0.9, "at_rest": True},
    {"thickness": 150.0, "mean_free_path": 100.0, "g": 0.9},
]}  # fmt: skip


@pytest.mark.parametrize("material", [None, LAYERS], ids=["slab", "layers"])
def test_contrast_is_what_the_engine_says(material):
    """K^2 of stacks by z-test against exposures of temporal_correlation by other paths; what rests is in all alike. The
    stacks' exposures are made of instants: K^2 may be 2 % above."""
    recipe = recipe_of(material, tau0=0.01 if material is None else 2e-4)
    batch = recipe.batch(0, "train", range(60))
    told, films = batch["parameters"], batch["stack"].astype(np.float64) - 1
    medium = recipe.material.in_motion(recipe.material.extremes()[0])
    medium = medium.replace(motion=sg.Brownian(diffusion=told["diffusion"][0])) if material is None else medium
    scale = 1.0 if material is None else told["diffusion"][0]
    curve = sg.temporal_correlation(medium, wavelength=0.5, lags=[0.0], paths=100_000, seed=9)
    expected = curve.contrast(np.array(DURATIONS) * scale)
    squares = np.square(films).mean(axis=(2, 3))
    error = np.hypot(squares.std(axis=0, ddof=1) / np.sqrt(len(squares)), 2.5 * expected.standard_error)
    assert_z(squares.mean(axis=0), expected.squared, error, degrees=59, slack=0.02 * expected.squared)
    refute_z(squares.mean(axis=0), 1.0, error, degrees=59)  # the contrast at rest
    stated = [told[f"contrast_squared_{n}"][0] for n in range(len(DURATIONS))]
    assert_z(stated, expected.squared, 2.5 * expected.standard_error, slack=0.02 * expected.squared)

    assert_mean(squares.mean(axis=1), told["expected_contrast"][0] ** 2)
    refute_mean(squares.mean(axis=1), 1.0)  # an instant's

    beside = (films[:, :-1] * films[:, 1:]).mean(axis=(2, 3))
    error = beside.std(axis=0, ddof=1) / np.sqrt(len(beside))
    assert_z(beside.mean(axis=0), told["static_share"][0] ** 2, error, degrees=59)
    assert curve.static_share == pytest.approx(told["static_share"][0], abs=0.05)  # six times what 100 000 paths leave
    if material:
        refute_z(beside.mean(axis=0), 0.0, error, degrees=59)


def test_instants_are_as_many_as_the_contrast_needs():
    found, finer = recipe_of().instants, recipe_of(tolerance=0.005).instants
    assert found[0] < 5
    assert list(found) == sorted(found)
    assert all(a <= b for a, b in zip(found, finer, strict=True))
    assert finer[-1] > found[-1] > 10, found
    fast = recipe_of(tau0={"log_uniform": [0.01, 1.0]})
    assert fast.instants == found, "the fastest decides"
    assert recipe_of(tau0=None, diffusion={"uniform": [0.1, 0.6332573978]}).instants == found


def test_the_target_is_what_was_drawn():
    batch = quick_recipe("lsci-slab").batch(0, "test", range(4))
    told = batch["parameters"]
    expected = np.stack([np.log10(told["tau0"]), told["static_share"]], -1)
    np.testing.assert_allclose(batch["target"], expected, rtol=1e-6)
    assert batch["stack"].shape == (4, 5, 64, 64)
    assert np.ptp(told["static_share"]) > 0.05
    made = SpeckleGenerator(quick_recipe("lsci-slab"), 0, "test")
    assert np.array_equal(made([3, 1])["stack"].numpy(), batch["stack"][[3, 1]])
    ready = quick_recipe("lsci-slab").prepare(0, "test", 2)
    assert np.array_equal(ready.images(np.ones((1, 1))), batch["stack"][2])
    assert ready.expected_contrast(np.ones((1, 1))) == pytest.approx(told["expected_contrast"][2])


@pytest.mark.parametrize(("changes", "says"), [
    ({"tau0": None}, "Exposures must be given by one of"), ({"diffusion": 1.0}, "Exposures must be given by one of"),
    ({"durations": []}, "durations"), ({"durations": [0.0]}, "greater than 0"),
    ({"tau0": 0.0}, "Exposures.tau0 must be greater than 0"),
])  # fmt: skip
def test_bad_input_is_named(changes, says):
    assert_refused(lambda: recipe_of(**changes), says)


def test_a_time_that_what_rests_outlasts_is_refused():
    thin = {**LAYERS, "layers": [LAYERS["layers"][0], {"thickness": 60.0, "mean_free_path": 100.0, "g": 0.0}]}
    with pytest.raises(RuleError, match="Exposures.correlation_time must be left out, since g1 stays"):
        recipe_of(thin, tau0=None, correlation_time=0.1).batch(0, "train", [0])


def test_layers_that_all_rest_are_refused():
    with pytest.raises(RuleError, match="Material.layers must be given with a layer that moves"):
        recipe_of({**LAYERS, "layers": LAYERS["layers"][:1]})
