"""Recipes with units and in pixels are those in plain numbers; what is no unit is refused by what was written."""

import math

import pytest

from specklegen.core.errors import RuleError
from specklegen.core.units import length_in, metres_of, sine_of
from specklegen.datasets import load_recipe
from specklegen.instrument import LabSetup

GLASS = {"material": {"screens": [{"type": "GroundGlass", "grit": 220}]}}
LAB = {
    "wavelength": "532 nm", "object_distance": "50 cm", "object_extent": "1 mm", "aperture": "5mm",
    "camera_distance": "0.2 m", "pixel_pitch": "6.5 µm", "pixels": [64, 64],
}  # fmt: skip
MICROMETRES = LAB | {
    "wavelength": 0.532, "object_distance": 5e5, "object_extent": 1000.0, "aperture": 5000.0, "camera_distance": 2e5,
    "pixel_pitch": 6.5,
}  # fmt: skip
MILLIMETRES = {name: value / 1000 if isinstance(value, float) else value for name, value in MICROMETRES.items()}


@pytest.mark.parametrize(
    ("text", "metres"),
    [("5 mm", 5e-3), ("3.45um", 3.45e-6), (" 1e2 nm ", 1e-7), (".5 cm", 5e-3), ("-2 m", -2.0), ("7 μm", 7e-6),
     ("5", None), ("5 s", None), ("mm", None), ("5 mm2", None), ("5 mm 3 mm", None), ("0.8 deg", None)],
)  # fmt: skip
def test_lengths(text, metres):
    assert metres_of(text) == (None if metres is None else pytest.approx(metres, rel=1e-12))
    assert length_in("0.532 um", 1e-3) == 0.000532  # rounded: the very number that people write


@pytest.mark.parametrize(
    ("text", "sine"), [("0.8 deg", math.sin(math.radians(0.8))), ("2 mrad", math.sin(0.002)), ("5 mm", None)]
)
def test_angles(text, sine):
    assert sine_of(text) == (None if sine is None else pytest.approx(sine, rel=1e-12))


def test_units_are_the_same_recipe():
    written, plain = (load_recipe("ground-glass", GLASS | {"lab": lab}) for lab in (LAB, MICROMETRES))
    assert written.fingerprint() == plain.fingerprint()
    assert written.lab.profile == "disc"
    assert LabSetup(**LAB) == LabSetup(**MICROMETRES)
    in_millimetres = LAB | {"wavelength": 532e-6}  # a plain number says the unit
    assert LabSetup(**in_millimetres) == LabSetup(**MILLIMETRES)
    slab = {"material": {"thickness": {"uniform": ["0.5 mm", "1 mm"]}, "wavelength": "500 nm"}, "media": "new"}
    found = load_recipe("through-slab", slab)
    assert found.material.thickness.uniform == (500.0, 1000.0)
    assert load_recipe("ground-glass", {"field": {"pitch": "0.01 mrad"}}).field.pitch == math.sin(1e-5)


def test_glass_scatters_alike_in_every_unit():
    lengths = [{"material": {"wavelength": 0.532}, "window": {"width": 5000.0}},
               {"material": {"wavelength": 532e-6}, "window": {"width": 5.0}},
               {"material": {"wavelength": "532 nm"}, "window": {"width": "5 mm"}}]  # fmt: skip
    angles = []
    for each in lengths:
        recipe = load_recipe("ground-glass", {**each, "material": each["material"] | GLASS["material"]})
        angles.append(recipe.material.extremes()[0].stack.screens[0].rms_angle(recipe.wavelength))
    for lab in (LAB, MILLIMETRES):
        recipe = load_recipe("ground-glass", GLASS | {"lab": lab})
        angles.append(recipe.material.extremes()[0].stack.screens[0].rms_angle(recipe.wavelength))
    assert angles == pytest.approx([angles[0]] * 5, rel=1e-12)


def test_a_laboratory_takes_the_lengths_of_what_it_inherits_with_it():
    base = load_recipe("through-slab")
    inside = load_recipe("through-slab", {"lab": MILLIMETRES | {"refractive_index": 1.4}})
    assert inside.material.thickness == pytest.approx(base.material.thickness / 1000, rel=1e-12)
    assert load_recipe("through-slab", {"lab": LAB}).material.thickness == base.material.thickness
    own = load_recipe("through-slab", {"lab": MILLIMETRES, "material": {"thickness": 2.0}})
    assert own.material.thickness == 2.0


def test_a_setup_in_pixels():
    told = {"pixels": {"grain": 3.6, "object_pixel": 1.5, "shape": [96, 80]}}
    found = load_recipe("through-slab", told)
    assert found.camera_shape == (96, 80)
    pitch = found.geometry.grid.pitch
    assert found.wavelength / found.window.width / pitch == pytest.approx(3.6)
    assert found.field.pitch / pitch == pytest.approx(1.5)
    assert found.window.profile == "disc"
    assert math.isinf(found.material.known(found.material.extremes()[0]).range_sine(found.wavelength))
    again = load_recipe("through-slab", {"pixels": told["pixels"] | {"profile": "gaussian"}})
    assert again.window.profile == "gaussian"


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"lab": LAB | {"aperture": "5 s"}}, 'LabSetup.aperture must be a number, or a length in nm, .*"?5 s'),
        ({"lab": LAB | {"aperture": 5.0}}, 'LabSetup.aperture must be written with its unit, such as "5 mm"'),
        ({"lab": LAB | {"pixel_pitch": "65 um"}}, r'must be at most .* Written: .*lab.pixel_pitch = "65 um"'),
        ({"window": {"width": "5 deg"}}, "window.width must be a length in nm"),
        ({"field": {"pitch": "5 mm"}}, "field.pitch must be a direction sine, or an angle in rad"),
        ({"light": {"bandwidth": "1 nm"}}, "light.bandwidth must be a number, in wavenumber"),
        ({"pixels": {"grain": 3.0, "shape": [64, 64]}}, "Pixels.object_pixel must be given"),
        ({"pixels": {"grain": 1.5, "object_pixel": 1.0, "shape": [64, 64]}}, "Pixels.grain must be at least 2"),
        ({"pixels": {"grain": 3.0, "object_pixel": 0, "shape": [64, 64]}}, "Pixels.object_pixel must be greater"),
        ({"pixels": {"grains": 3.0}}, "Pixels must be given by grain"),
        ({"pixels": 3.0}, "Recipe.pixels must be a table"),
        ({"pixels": {"grain": 3.0, "object_pixel": 1.0, "shape": [64, 64]}, "material": {"thickness": 1.0}},
         "Recipe.material must be left out, or one thin screen"),
        ({"pixels": {"grain": 3.0, "object_pixel": 1.0, "shape": [64, 64]}, "lab": LAB}, "Recipe.pixels must be left"),
    ],
)  # fmt: skip
def test_refusals(changes, told):
    base = "ground-glass" if "lab" in changes and "pixels" not in changes else "through-slab"
    material = GLASS if base == "ground-glass" else {}
    with pytest.raises(RuleError, match=told):
        load_recipe(base, material | changes)
