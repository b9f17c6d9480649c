"""Numbers that are seldom meant are said first, by the plan and by verdicts; packaged recipes have none."""

import re
import warnings

import pytest
import tomli_w

import specklegen as sg
from specklegen.cli.commands import main
from specklegen.cli.failures import failures_told
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
    with pytest.warns(sg.DoubtWarning, match="^Check units: the medium is 0.001 thick"):
        recoverable(recipe, media=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error", sg.DoubtWarning)
        load_recipe("through-slab-lab").warn_of_implausible()


def test_a_plan_says_it_of_all_corners_of_a_recipe(tmp_path, capsys):
    lab = {"wavelength": "532 nm", "object_distance": "200 mm", "object_extent": "0.3 mm", "aperture": "5 mm",
           "focal_length": "100 mm", "pixel_pitch": "3.45 um", "pixels": [64, 64]}  # fmt: skip
    material = {"preset": "brain", "thickness": {"uniform": ["0.5 um", "0.5 mm"]}}
    (tmp_path / "mine.toml").write_text(tomli_w.dumps({"inherits": "through-slab", "lab": lab, "material": material}))
    with pytest.raises(SystemExit):
        main(["plan", str(tmp_path / "mine.toml"), "--samples", "1"])
    first, second, third, *_ = capsys.readouterr().out.splitlines()
    assert first == "Check units: the medium is 0.5 thick, 1.3 wavelengths."
    assert second == "Check units: 99% of the light passes the medium unscattered."
    assert third.startswith("Ranges:      2 corners")


def test_a_scene_that_is_refused_says_it_too():
    beams = sg.CollimatedBeams.tilts([0.0], width=57.0)
    screen = sg.PhaseScreen(correlation_length=30.0, rms_phase=3.0)
    scene = sg.Scene(wavelength=0.5, medium=screen, illumination=beams, sensor=sg.FarField.grid((8, 8), 2e-3))
    with pytest.raises(sg.RuleError, match=r"Check units: the beam covers 1.9 .* Widen the illuminated area"):
        sg.plan(scene)


def test_commands_write_a_doubt_as_a_line():
    doubt = sg.DoubtWarning("the medium is 2 thick.")
    with failures_told():
        line = warnings.formatwarning(doubt, sg.DoubtWarning, "a.py", 1)
    assert line == "warning: the medium is 2 thick.\n"
