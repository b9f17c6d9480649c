"""Arguments of the wrong type or size: a broken rule, not an error of Python's or NumPy's."""

import numpy as np
import pytest

import specklegen as sg
from specklegen.core.arguments import instance, real_array, real_number, whole_number
from specklegen.core.devices import checked_device
from specklegen.core.errors import RuleError, shown
from specklegen.datasets import SpeckleStream, load_recipe

DEEP: list = []
for _ in range(100_000):
    DEEP = [DEEP]
TILTS = load_recipe("tilt-stack")
SLAB = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(g=0.9))


@pytest.mark.parametrize(("call", "says"), [
    (lambda: whole_number("n", 2.0), "n must be a whole number; got 2.0."),
    (lambda: whole_number("n", True), "n must be a whole number; got True."),
    (lambda: whole_number("n", 10**6000, 0, 5), "n must be at least 0 and at most 5; got <int too long to show>."),
    (lambda: real_number("x", 10**400), "x must be a number"),
    (lambda: real_array("a", [[1], [1, 2]]), "a must be an array of numbers"),
    (lambda: instance("s", "x", sg.Scene), "s must be a Scene; got 'x'."),
    (lambda: checked_device("d", "meta"), "d must be a device that torch has here"),
    (lambda: sg.HenyeyGreenstein(0.9, 1), r"HenyeyGreenstein must be given by the names of its fields \(type, g\)"),
    (lambda: sg.HenyeyGreenstein(g=10**5000), "HenyeyGreenstein.g must be a number; got <int too long to show>."),
    (lambda: sg.PlaneWaves(directions=[[10**400, 0, 1]]), "PlaneWaves.directions must be an array of numbers"),
    (lambda: sg.PlaneWaves(directions=DEEP), "PlaneWaves.directions must be an array of numbers"),
    (lambda: sg.FarFieldGrid(shape=7, pitch=1e-3), r"FarFieldGrid.shape must be a sequence, .*; got 7"),
    (lambda: sg.Scene(wavelength=1, medium="x", illumination=1, sensor=1), "Scene.medium must be an object"),
    (lambda: sg.Scene.from_json("[1, 2]"), "Scene in JSON must be a JSON object"),
    (lambda: sg.Scene.from_json("[" * 100_000), "Scene in JSON must be nested at most 64"),
    (lambda: sg.Scene.from_json('{"a": ' + "[" * 900 + "]" * 900 + "}"), "nested at most 64"),
    (lambda: sg.Scene.from_toml("a = " + "9" * 5000), "Scene in TOML must be valid TOML"),
    (lambda: sg.plan("x"), "plan scene must be a Scene; got 'x'."),
    (lambda: sg.memory_effect("x", wavelength=0.5, tilts=[0]), "medium must be a PlaneParallel; got 'x'."),
    (lambda: sg.memory_effect(SLAB, wavelength=0.5, tilts="x"), "memory_effect tilts must be an array of numbers"),
    (lambda: TILTS.sample(0, "train", -1), "TiltStack.sample index must be at least 0 and at most .*; got -1."),
    (lambda: SpeckleStream(TILTS).loader(-1), "loader.num_workers must be at least 0; got -1."),
])  # fmt: skip
def test_a_wrong_argument_is_a_broken_rule(call, says):
    with pytest.raises(RuleError, match=says) as refused:
        call()
    assert "Input should be" not in str(refused.value)


@pytest.mark.parametrize("value", [10**6000, {"a": 10**6000}], ids=["number", "table"])
def test_a_value_of_any_size_can_be_shown(value):
    assert shown(value).endswith("too long to show>")
    assert len(shown(np.arange(10**6))) <= 120
