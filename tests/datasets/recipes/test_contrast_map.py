"""Recipe kind "contrast-map": samples have the contrast of their targets, and bad input is named."""

import numpy as np
import pytest
from quick_recipes import quick_recipe
from refusals import assert_refused
from zscore import assert_mean, refute_mean

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe

FIXED = {"depth": 150.0, "radius": 80.0, "speed": 1500.0, "angle": 0.0, "offset": 30.0}
SMALL = {"camera": {"shape": [40, 24]}}


def recipe_of(count=20_000, **changes):
    return quick_recipe("flow-vessel", count, **SMALL | changes)


@pytest.fixture(scope="module")
def one_vessel():
    """300 samples of one vessel along the rows."""
    recipe = recipe_of(vessel=FIXED, exposures={"durations": [2e-4, 4e-3]})
    return recipe, recipe.batch(0, "train", range(300))


def test_samples_have_the_contrast_that_is_their_target(one_vessel):
    """Row by row; a target of a flow half as fast, and the mirror image, are told."""
    recipe, batch = one_vessel
    target = batch["target"]
    np.testing.assert_array_equal(target, target[:1].repeat(300, 0))
    np.testing.assert_allclose(target[0], target[0, :, :, :1].repeat(24, 2), atol=1e-6)
    stack = batch["stack"].astype(np.float64)
    assert_mean(stack.mean(axis=(1, 2, 3)), 1.0)
    found = np.square(stack - 1).mean(axis=3)
    expected = np.square(target[0, :, :, 0].astype(np.float64))
    assert_mean(found, expected)
    assert expected[1].min() < 0.5
    assert expected[1].max() > 0.75
    slower = recipe_of(vessel=FIXED | {"speed": 750.0}, exposures={"durations": [2e-4, 4e-3]})
    other = np.square(slower.batch(0, "train", [0])["target"][0, :, :, 0].astype(np.float64))
    for wrong in (expected[:, ::-1], other):
        refute_mean(found, wrong)
    told = batch["parameters"]["expected_contrast"]
    assert_mean(found.mean(axis=(1, 2)), told[0] ** 2)


def test_parameters_say_what_was_drawn(one_vessel):
    recipe, batch = one_vessel
    told = {name: float(value[0]) for name, value in batch["parameters"].items()}
    assert {name: told[f"vessel_{name}"] for name in FIXED} == FIXED
    assert told["pixel_pitch"] == pytest.approx(0.5 / (2 * 0.02 * 2.0))
    assert 0 < told["static_share"] < 0.5
    darkest = batch["target"][0, 1, :, 0].argmin()
    assert abs((darkest - 19.5) * told["pixel_pitch"] - 30.0) < 40.0, "the axis passes the middle by its offset"
    assert recipe.fingerprint() != recipe_of(vessel=FIXED | {"profile": "plug"}).fingerprint()


def test_a_camera_counts_pixels_with_an_area():
    """K^2 of counts, their noise taken off, is what the target says, .8 of that of points."""
    still = {"vessel": FIXED, "exposures": {"durations": [2e-4]}}
    camera = {"photons": 1000.0, "gain": 1.0, "read_noise": 0.0, "offset": 0.0}
    points, counted = recipe_of(**still), recipe_of(exposure=camera, **still)
    batch = counted.batch(0, "train", range(80))
    mean, told = 1000.0, float(np.square(batch["target"][0]).mean())
    assert 0.7 < told / float(np.square(points.batch(0, "train", [0])["target"]).mean()) < 0.95
    counts = batch["stack"].astype(np.float64)
    assert_mean(counts.mean(axis=(1, 2, 3)), mean)
    found = (np.square(counts - mean).mean(axis=(1, 2, 3)) - mean) / mean**2
    assert_mean(found, told)
    refute_mean(found, float(np.square(points.batch(0, "train", [0])["target"]).mean()))


def test_unpolarised_light_has_half_the_squared_contrast():
    still = {"vessel": FIXED, "exposures": {"durations": [2e-4]}}
    one, two = (recipe_of(light={"polarised": is_so}, **still).batch(0, "train", range(80)) for is_so in (True, False))
    np.testing.assert_allclose(two["target"], one["target"] * 0.5**0.5, rtol=1e-6)
    assert_mean(np.square(two["stack"] - 1.0).mean(axis=(1, 2, 3)), float(np.square(two["target"][0]).mean()))


def test_instants_are_as_many_as_the_contrast_needs():
    found = recipe_of(vessel=FIXED).instants
    assert list(found) == sorted(found)
    finer = recipe_of(vessel=FIXED, exposures={"durations": [2e-4, 1e-3, 5e-3], "tolerance": 0.002}).instants
    assert finer[-1] > found[-1]
    ranged = FIXED | {"speed": {"uniform": [10.0, 1500.0]}}
    assert recipe_of(vessel=ranged).instants == found, "the fastest decides"


@pytest.mark.parametrize(("changes", "says"), [
    ({"vessel": {"radius": 0.0}}, "Vessels.radius must be above 0"),
    ({"vessel": {"speed": -1.0}}, "Vessels.speed must be finite and at least 0"),
    ({"vessel": {"speed": 0.0}}, "Vessels.speed must be above 0, since nothing else moves"),
    ({"vessel": {"depth": 50.0}}, "Vessels.depth must be at least the largest radius"),
    ({"vessel": {"depth": 1950.0}}, "Vessels.depth must be such that the vessel lies in the tissue"),
    ({"vessel": {"profile": "square"}}, "profile"), ({"exposures": {"durations": []}}, "durations"),
    ({"window": {"width": 100.0}}, "Recipe.window must be left out"),
    ({"material": {"faces": {"inside": 1.33}}}, "Recipe.material.faces must be left out"),
    ({"light": {"bandwidth": 1e-6}}, "Recipe.light.bandwidth must be left out"), ({"aperture": 0.3}, "aperture"),
    ({"sampler": "stationary"}, "sampler"),
])  # fmt: skip
def test_bad_input_is_named(changes, says):
    assert_refused(lambda: load_recipe("flow-vessel", changes), says)


def test_too_many_instants_are_refused():
    with pytest.raises(RuleError, match="ExposureTimes.durations must be made of at most 1024 instants"):
        recipe_of(vessel=FIXED, exposures={"durations": [10.0], "tolerance": 1e-4}).sample(0, "train", 0)
