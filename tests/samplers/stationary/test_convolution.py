"""The convolution sampler: beside the stationary one where C_I is nearly 1, found out where it is not, and refused.

Two bright pixels some way apart: the image is a pattern and the same pattern moved, so that at that lag its correlation
is C_I / 4 of the squared mean.
"""

import warnings

import numpy as np
import pytest
import torch
from refusals import assert_refused

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.parts.sampler import NUMBERS
from specklegen.memory_effects.atlas import atlas_correlation
from specklegen.samplers.stationary.convolution import PART, Complete, Convolution, scene_loss

PITCH, LAG, REALIZATIONS = 1.25e-6, 8, 300
SMALL = {"camera": {"shape": [32, 32]}, "objects": {"shape": [12, 12]}, "field": {"extent_over_range": 0.03},
         "material": {"kernel_paths": 1000}, "window": {"width": 3e5}}  # fmt: skip


def scene(thickness):
    brightness = np.zeros((1, LAG + 1))
    brightness[0, ::LAG] = 1
    slab = sg.Slab(thickness=thickness, mean_free_path=thickness / 10, scatterer=sg.HenyeyGreenstein(0.9))
    light = sg.IncoherentObject(brightness=brightness, pitch=PITCH, width=2e5)
    return sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.FarField.grid((24, 24), PITCH))


def correlation(scene, sampler, seed):
    """C_I of the lag between both pixels, from each medium: float64[realizations]."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a doubt is what is asked for
        images = sg.render(scene, sampler=sampler, realizations=REALIZATIONS, seed=seed, paths=20_000).intensity
    x = np.asarray(images, np.float64).reshape(REALIZATIONS, 24, 24)
    x = x / x.mean() - 1
    return 4 * (x[:, :, LAG:] * x[:, :, :-LAG]).mean((1, 2))


def z(found, expected):
    return (found.mean() - expected) / (found.std(ddof=1) / len(found) ** 0.5)


@pytest.mark.parametrize(("thickness", "enough"), [(100.0, True), (16000.0, False)])
def test_it_draws_what_the_stationary_sampler_draws_where_it_is_enough(thickness, enough):
    """False-alarm rate 6e-5 for each of the four z-scores below 4."""
    seen = scene(thickness)
    lost, _ = scene_loss(seen)
    exact = float(atlas_correlation(seen.slab, np.inf).intensity(np.array([seen.wavenumber * LAG * PITCH]))[0][0])
    assert lost == pytest.approx(1 - exact, abs=1e-9)
    assert (lost < 0.02) is enough
    stationary, convolution = correlation(seen, "stationary", 1), correlation(seen, "convolution", 2)
    assert abs(z(stationary, exact)) < 4
    assert abs(z(convolution, 1.0)) < 4
    if enough:  # they differ by less than the tolerance, and what is left is noise
        assert abs(z(stationary - convolution, 0.0)) < 4
    else:  # what is not within its tolerance is found out
        assert abs(z(convolution, exact)) > 6


def test_a_plan_says_whether_it_is_enough():
    plan = sg.plan(scene(100.0), sampler="convolution")
    assert plan.sampler == "convolution"
    assert isinstance(plan.chosen, Convolution)
    assert not plan.doubts
    asked = sg.plan(scene(16000.0), sampler="convolution")
    assert any("1 - C_I across the object" in doubt for doubt in asked.doubts)
    assert not sg.plan(scene(16000.0), sampler="convolution", rel_error=0.9).doubts
    tilts = scene(100.0).replace(illumination=sg.CollimatedBeams.tilts([0.0, 1e-6], width=2e5))
    assert_refused(lambda: sg.plan(tilts, sampler="convolution"), "images hidden objects")


def test_recipes_take_it_where_it_is_enough_for_all_of_their_media():
    recipe = load_recipe("through-slab", SMALL)
    assert {made.sampler for made in recipe.plans()} == {"convolution"}
    assert "convolution" in recipe.rendering_note
    batch = recipe.batch(0, "train", range(3))
    assert set(batch["parameters"]["sampler"]) == {NUMBERS["convolution"]}
    wider = load_recipe("through-slab", SMALL | {"field": {"extent_over_range": 0.5}})
    plans = wider.plans()
    assert {made.sampler for made in plans} == {"stationary"}
    assert all(not d.needed for made in plans for d in made.decisions if d.part == PART)
    strict = wider.replace(sampler="convolution", strict=True)
    assert_refused(lambda: strict.batch(0, "train", range(1)), r"Recipe\.sampler must be accurate for all media")


def test_one_pitch_before_materials_of_many_ranges_needs_modes_for_all():
    """At one end of the range convolution is enough, at the other it is not."""
    material = {"kernel_paths": 1000, "thickness": {"uniform": [100.0, 8000.0]}}
    field = {"pitch": 5e-7, "extent_over_range": None}
    recipe = load_recipe("through-slab", SMALL | {"material": material, "field": field, "media": "new"})
    lost = [scene_loss(view.probe)[0] for view in recipe.extremes()]
    assert min(lost) < 0.02 < max(lost)
    plans = recipe.plans()
    assert {made.sampler for made in plans} == {"stationary"}
    assert recipe.rendering.name == "stationary"
    assert any("other media of the recipe" in d.reason for made in plans for d in made.decisions)


def test_complete_memory_has_one_mode_of_some_of_its_media():
    even = Complete(5)
    assert len(even) == 5
    assert len(even.at(slice(1, 3))) == 2
    assert len(even.at(torch.tensor([0, 4, 2]))) == 3
    assert even(torch.rand(5, 7)).eq(1).all()
    assert even.planar(torch.rand(5, 7, 2), torch.rand(5, 7, 2)).shape == (5, 7, 2)
