"""Objects behind boxes, voxels and in front of cameras near slabs: the engine's fields, a mean of 1, their contrast."""

import numpy as np
import pytest
import torch
from refusals import assert_refused
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.datasets.recipes.parts.sampler import NUMBERS
from specklegen.datasets.recipes.registry import KINDS
from specklegen.datasets.recipes.volume_object import estimated_contrast

MATERIAL = {"wavelength": 0.5, "thickness": 10.0, "optical_depth": 2.0, "g": 0.5, "kernel_paths": 300}
TABLE = {"name": "objects", "material": MATERIAL, "outline": {"width": 10.0}, "window": {"width": 8.0},
         "camera": {"shape": [6, 6]}, "objects": {"type": "Glyphs", "shape": [5, 4]},
         "field": {"pitch": 0.02}}  # fmt: skip
NEAR = {"shape": [6, 6], "distance": 20.0}
CASES = {"box, far": {}, "box, near": {"camera": NEAR},
         "voxels, far, unpolarised": {"outline": {"width": 10.0, "voxels": [2, 3, 4]}, "light": {"polarised": False}},
         "slab, near": {"outline": None, "camera": NEAR}}  # fmt: skip


def recipe_of(kind="volume-object", **changes):
    return KINDS[kind](**{name: value for name, value in (TABLE | changes).items() if value is not None})


@pytest.mark.parametrize("name", CASES)
def test_objects_are_imaged_as_planned(name):
    """The plan and the sample name path sums; the image is the sum of the engine's intensities, beam by beam."""
    recipe = recipe_of(**CASES[name])
    (made,) = recipe.plans()
    assert made.sampler == "paths"
    assert "Cost:        about" in made.explain()
    sample = recipe.sample(4, "test", 1)
    assert sample["parameters"]["sampler"] == NUMBERS["paths"]
    ready = recipe.prepare(4, "test", 1)
    scene, seeds = ready.imaging.sampler.scene, ready.seen.seeds
    assert len(scene.lights) == 20
    light, found = sample["object"].astype(float).ravel(), 0.0
    for seed in seeds:
        field = sg.render(scene, paths=300, seed=seed, sampler="paths").field
        found = found + np.tensordot(light, np.square(np.abs(field)), axes=1)
    expected = found / (len(seeds) * ready.imaging.unit * light.sum())
    np.testing.assert_allclose(sample["image"], expected, rtol=2e-3)  # kept in half precision
    assert sample["image"].shape == (6, 6)


def test_images_have_mean_one_and_the_contrast_that_is_told():
    """Of 200 boxes; means a third off and the contrast of a single pixel's light are caught."""
    recipe = recipe_of()
    ready = [recipe.prepare(0, "train", n) for n in range(200)]
    light = np.ones((5, 4), np.float32)
    images = np.stack([each.images(light)[0] for each in ready])
    slack = ready[0].parameters["mean_error"] ** 2
    assert_mean(images.mean((1, 2)), 1.0, slack=slack)
    refute_mean(images.mean((1, 2)) * 1.33, 1.0, slack=slack)
    squares = np.square(images / images.mean(0) - 1).mean((1, 2))
    error = squares.std() / np.sqrt(len(squares))
    assert_z(squares.mean(), ready[0].expected_contrast(light) ** 2, error)
    refute_z(squares.mean(), 1.0, error)


def test_the_contrast_is_that_of_the_covariance():
    """From 20 000 other paths; that of a box of half the width is caught."""
    scene = recipe_of(camera={"shape": [1, 1]}).extremes()[0].full
    light = np.arange(1.0, 21.0)

    def of_covariance(box):
        found = sg.covariance(box, paths=20000, seed=7, reverse=False)
        value = found.value.reshape(20, 20)
        square = np.square(np.abs(value)) - np.square(np.abs(found.standard_error.reshape(20, 20)))
        return np.sqrt(light @ square @ light) / (light @ np.real(np.diag(value)))

    told = estimated_contrast(scene, 300).contrast(torch.from_numpy(light.reshape(1, 5, 4)))
    assert float(told) == pytest.approx(of_covariance(scene), rel=0.05)
    half = scene.replace(medium=scene.medium.replace(lower=[-2.5, -2.5, 0.0], upper=[2.5, 2.5, 10.0]))
    assert float(told) != pytest.approx(of_covariance(half), rel=0.05)


def test_a_stack_behind_a_slab_is_seen_from_near_by():
    """The plain slab under two tilts: the engine's image at the camera's points."""
    stack = {"objects": None, "field": None, "tilts": {"count": 2, "step": 0.01}}
    recipe = recipe_of("volume-stack", outline=None, camera=NEAR, **stack)
    sample, scene = recipe.sample(1, "test", 0), recipe.extremes()[0].full
    assert isinstance(scene.medium, sg.Slab)
    points = scene.sensor.points
    assert (points[..., 2] == 30.0).all()
    lit = 8.0 + 2 * 10.0
    np.testing.assert_allclose(np.diff(points[0, :, 0]), 0.5 * np.hypot(20.0, lit / 2) / lit / 3, rtol=1e-12)
    ready = recipe.prepare(1, "test", 0)
    field = sg.render(ready.imaging.sampler.scene, paths=300, seed=ready.seen.seeds[0], sampler="paths").field
    np.testing.assert_allclose(sample["stack"], np.square(np.abs(field)) / ready.imaging.unit, rtol=1e-5)
    assert "outline_width" not in sample["parameters"]


@pytest.mark.parametrize(("changes", "words"), [
    ({"field": {"extent_over_range": 0.5}}, r"ObjectField must be given by pitch alone"),
    ({"outline": None}, r"Recipe\.outline must be given where the kind is volume-object"),
    ({"exposure": {"photons": 1e3}}, r"Recipe\.exposure must be left out"),
    ({"mode_tolerance": 0.02}, r"Recipe\.mode_tolerance must be left out"),
    ({"bench": {"aperture": 1.2}}, r"Recipe\.bench must be left out"),
    ({"material": {"wavelength": 0.5, "screens": [{"type": "GroundGlass", "angle": 0.1}]}}, "by optical_depth"),
])  # fmt: skip
def test_what_volumes_do_not_have_is_refused(changes, words):
    assert_refused(lambda: recipe_of(**changes), words)


def test_the_stationary_sampler_is_refused_near_a_slab():
    with pytest.raises(ValueError, match="the sensor is in the near field"):
        recipe_of(**CASES["slab, near"], sampler="stationary").plans()
