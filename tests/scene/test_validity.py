"""Numbers that are seldom meant are said first, by the plan and by verdicts; packaged recipes have none."""

import re
import warnings

import pytest

import specklegen as sg
from specklegen.datasets import load_recipe, recipe_names
from specklegen.models import recoverable
from specklegen.scene.validity import implausible, implausible_in


def slab(thickness: float, mean_free_path: float) -> sg.Slab:
    return sg.Slab(thickness=thickness, mean_free_path=mean_free_path, scatterer=sg.HenyeyGreenstein(0.9))


@pytest.mark.parametrize(
    ("medium", "light", "says"),
    [
        (slab(100.0, 0.4), {}, "the mean free path 0.4 is below the wavelength 0.5"),
        (slab(2.0, 0.5), {}, "the medium is 2 thick, 4 wavelengths"),
        (slab(100.0, 200.0), {}, "61% of the light passes the medium unscattered"),
        (slab(100.0, 10.0), {"width": 1000.0, "size": 4e-4},
         "the object, 0.0004 wide .* smaller than a speckle, 0.0005"),
        (sg.PhaseScreen(correlation_length=30.0, rms_phase=3.0), {"width": 57.0}, "covers 1.9 correlation lengths"),
    ],
)  # fmt: skip
def test_implausible_numbers(medium, light, says):
    (text,) = implausible(medium, 0.5, **light)
    assert re.search(says, text)


def test_plausible_numbers():
    assert implausible(slab(2.6, 1.0), 0.5, 1000.0, 6e-4) == []
    assert implausible(sg.PhaseScreen(correlation_length=30.0, rms_phase=3.0), 0.5, 310.0) == []


def test_packaged_recipes_are_plausible():
    for name in recipe_names():
        assert not any(implausible_in(each.probe) for each in load_recipe(name).extremes()), name


def test_a_plan_says_it_first():
    scene = sg.Scene(wavelength=0.5, medium=slab(2.0, 4.0), illumination=sg.CollimatedBeams.tilts([0.0], width=5000.0),
                     sensor=sg.FarField.grid((8, 8), 2e-5))  # fmt: skip
    first, second = sg.plan(scene, paths=1000).summary().splitlines()[:2]
    assert first == "Check units: the medium is 2 thick, 4 wavelengths."
    assert second.startswith("Check units: 61% of the light")


def test_a_verdict_says_it_first():
    recipe = load_recipe("through-slab-lab", {"material": {"thickness": 0.001, "optical_depth": 0.3}})
    with pytest.warns(sg.DoubtWarning, match="Check the units of its lengths"):
        recoverable(recipe, media=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error", sg.DoubtWarning)
        load_recipe("through-slab-lab").warn_of_implausible()
