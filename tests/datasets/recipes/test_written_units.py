"""Recipes with units and in pixels are those in plain numbers; what is no unit is refused by what was written."""

import math

import pytest

from specklegen.core.errors import RuleError
from specklegen.core.units import length_in, metres_of, sine_of
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.recipe_files import changed
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


@pytest.mark.parametrize(
    ("name", "length"),
    [("screen-stack", lambda recipe: recipe.material.extremes()[0].stack.screens[0].correlation_length),
     ("moving-diffuser", lambda recipe: recipe.dynamics.velocities[0][0].log_uniform[1])],
)  # fmt: skip
def test_screens_and_their_velocities_come_along(name, length):
    """They kept their numbers, and became a thousand times as coarse and as fast."""
    base = load_recipe(name, {"lab": MICROMETRES})
    assert length(load_recipe(name, {"lab": MILLIMETRES})) == pytest.approx(length(base) / 1000, rel=1e-12)


def test_a_laboratory_in_the_place_of_one_in_another_unit():
    """All of the material's lengths, and those of the laboratory that nobody states anew."""
    base = load_recipe("through-slab-lab")  # in millimetres
    found = load_recipe("through-slab-lab", {"lab": {"wavelength": 0.532, "object_distance": 1e5}})
    assert found.material.thickness == 1000 * base.material.thickness
    assert (found.lab.object_distance, found.lab.camera_distance, found.lab.pixel_pitch) == (1e5, 1e5, 5.0)
    assert found.lab.bandwidth == 1000 * base.lab.bandwidth
    again = load_recipe("through-slab-lab", {"lab": {"wavelength": 0.000633}})
    assert again.material.thickness == base.material.thickness
    assert again.lab.object_distance == base.lab.object_distance


def test_characters_that_are_held_out_are_no_length():
    found = load_recipe("one-angular-size", {"objects": {"test": "5deg", "validation": "7r"}})
    assert found.objects.test == "5deg"


def test_diffusion_is_a_length_squared():
    base = {"material": {"wavelength": 0.5}, "dynamics": {"diffusion": {"uniform": [1.0, 4.0]}, "tau0": 1.0}}
    found = changed(base, {"lab": {"wavelength": 500e-6}})
    assert found["dynamics"] == {"diffusion": {"uniform": [1e-6, 4e-6]}, "tau0": 1.0}


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
        ({"material": {"optical_depth": "1 mm"}}, "material.optical_depth must be a plain number"),
        ({"material": {"g": {"uniform": ["0.8 um", 0.9]}}}, "material.g.uniform must be a plain number"),
        ({"material": {"albedo": "1 deg"}}, "material.albedo must be a plain number"),
        ({"material": {"screens": [{"type": "GroundGlass", "angle": {"uniform": ["1 mm", "2 mm"]}}]}},
         "angle.uniform must be a direction sine, or an angle"),
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
