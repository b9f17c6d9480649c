"""Boxes and voxels in recipes: planned as they are rendered, the engine's fields, and a mean of 1."""

import numpy as np
import pytest
from refusals import assert_refused
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.parts.sampler import NUMBERS
from specklegen.datasets.recipes.registry import KINDS
from specklegen.paths.pilot import mean_intensity

TABLE = {"name": "boxes",
         "material": {"wavelength": 0.5, "thickness": 10.0, "optical_depth": 2.0, "g": 0.5, "kernel_paths": 400},
         "outline": {"width": 10.0}, "window": {"width": 8.0}, "camera": {"shape": [6, 6]},
         "tilts": {"count": 2, "step": 0.01}}  # fmt: skip
CASES = {
    "box, far": {}, "box, near": {"camera": {"shape": [6, 6], "distance": 20.0}},
    "voxels, far": {"outline": {"width": 10.0, "voxels": [2, 3, 4], "contrast": 0.8}},
    "fog in voxels, near, unpolarised": {
        "outline": {"width": 10.0, "voxels": [2, 2, 2]}, "camera": {"shape": [6, 6], "distance": 5.0},
        "material": {**TABLE["material"], "scatterer": {"type": "VonMisesFisher", "concentration": 3.0}},
        "light": {"polarised": False},
    },
}  # fmt: skip


def recipe_of(**changes):
    return KINDS["volume-stack"](**(TABLE | changes))


@pytest.mark.parametrize("name", CASES)
def test_volumes_run_as_planned(name):
    """The plan, the sample and the store's note name path sums; fields are those of the engine, over their mean."""
    recipe = recipe_of(**CASES[name])
    (made,) = recipe.plans()
    assert made.sampler == "paths"
    assert "Cost:        about" in made.explain()
    sample = recipe.sample(4, "test", 1)
    assert sample["parameters"]["sampler"] == NUMBERS["paths"]
    assert "path sums" in recipe.rendering_note
    ready = recipe.prepare(4, "test", 1)
    scene, unit = ready.imaging.sampler.scene, ready.imaging.unit
    fields = [sg.render(scene, paths=400, seed=seed, sampler="paths").field for seed in ready.seen.seeds]
    expected = np.mean([np.square(np.abs(field)) for field in fields], axis=0) / unit
    np.testing.assert_allclose(sample["stack"], expected, rtol=1e-5)
    assert sample["stack"].shape == (2, 6, 6)
    assert sample["parameters"]["expected_contrast"] == len(fields) ** -0.5


def test_a_near_camera_stands_behind_the_box():
    """Three pixels a grain wavelength sqrt(d^2 + (w / 2)^2) / w, about the axis, d behind the exit face."""
    points = recipe_of(**CASES["box, near"]).extremes()[0].full.sensor.points
    assert (points[..., 2] == 30.0).all()
    np.testing.assert_allclose(points[..., :2].mean((0, 1)), 0, atol=1e-12)
    np.testing.assert_allclose(np.diff(points[0, :, 0]), 0.5 * np.hypot(20.0, 5.0) / 10.0 / 3, rtol=1e-12)


def test_voxels_have_the_density_that_is_asked_for():
    """Over 200 media the mean is the material's, the spread the contrast; 2 % more contrast is caught."""
    recipe = recipe_of(media=None, outline={"width": 10.0, "voxels": [16, 16, 16], "contrast": 0.3})
    rng = np.random.default_rng(0)
    slab = recipe.material.extremes()[0]
    media = [recipe.outline.medium(slab, 10.0, 0.3, rng) for _ in range(200)]
    density = np.stack([medium.extinction.ravel() for medium in media]) * slab.mean_free_path
    assert_mean(density.mean(axis=1), 1.0)
    assert_mean(np.square(density - 1).mean(axis=1), 0.3**2)
    refute_mean(np.square(density - 1).mean(axis=1), (1.02 * 0.3) ** 2)


def test_the_mean_is_that_of_the_covariance():
    """Intensities of the covariance engine at the same views; 20 % more is caught."""
    scene = recipe_of(**CASES["voxels, far"]).extremes()[0].full
    views = np.array([0, 14, 35])
    flat = scene.sensor.directions.reshape(-1, 3)[views]
    made = sg.plan(scene, paths=400, sampler="paths", reverse=False)
    value, error = mean_intensity(made.chosen.pilot.tracer, False, views, 1, 8000)  # noqa: FBT003
    found = sg.covariance(scene.replace(sensor=sg.FarField(directions=flat)), paths=8000, seed=2, reverse=False)
    powers = np.real(np.diag(found.value.reshape(6, 6)))
    spread = np.real(np.diag(found.standard_error.reshape(6, 6))).mean()  # all from the same paths
    assert_z(value, powers.mean(), np.hypot(error, spread))
    refute_z(1.2 * value, powers.mean(), np.hypot(error, spread))


@pytest.mark.slow
def test_stacks_have_mean_one():
    """Of 60 media of voxels; with means half as large it is caught."""
    recipe = recipe_of(**CASES["voxels, far"])
    means = np.array([recipe.sample(0, "train", n)["stack"].mean() for n in range(60)])
    slack = recipe.sample(0, "train", 0)["parameters"]["mean_error"] ** 2  # of a quotient by an estimate
    assert_mean(means, 1.0, slack=slack)
    refute_mean(means / 2, 1.0, slack=slack)


@pytest.mark.parametrize(("changes", "words"), [
    ({"light": {"bandwidth": 1e-4}}, r"Recipe\.light\.bandwidth must be left out"),
    ({"exposure": {"photons": 1e3}}, r"Recipe\.exposure must be left out"),
    ({"outline": {"width": -1.0}}, r"Outline\.width must be"),
    ({"camera": {"shape": [6, 6], "distance": 0.0}}, r"distance\s+must be|distance"),
])  # fmt: skip
def test_what_volumes_do_not_have_is_refused(changes, words):
    assert_refused(lambda: recipe_of(**changes), words)


def test_the_stationary_sampler_and_a_distance_of_slabs_are_refused():
    assert_refused(lambda: recipe_of(sampler="stationary").plans(), "the medium is a Box")
    assert_refused(lambda: load_recipe("tilt-stack", {"camera": {"distance": 50.0}}), "distance")
