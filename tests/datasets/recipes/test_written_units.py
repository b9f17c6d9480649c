"""Recipes with units and in pixels are those in plain numbers; what is no unit is refused by what was written."""

import math
from pathlib import Path

import pytest

from specklegen.core.errors import RuleError
from specklegen.core.units import LENGTH, RADIAN, SINE, quantity
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.multi_image import DynamicSlab
from specklegen.datasets.recipes.parts.viewing import LEAST_PIXELS
from specklegen.datasets.recipes.recipe_files import RecipeFile, recipe_table
from specklegen.datasets.recipes.registry import recipe_schema
from specklegen.datasets.recipes.written_units import plain
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
    ("text", "value", "powers"),
    [("5 mm", 5e-3, (1, 0, 0)), ("3.45um", 3.45e-6, (1, 0, 0)), (" 1e2 nm ", 1e-7, (1, 0, 0)),
     (".5 cm", 5e-3, (1, 0, 0)), ("-2 m", -2.0, (1, 0, 0)), ("7 μm", 7e-6, (1, 0, 0)), ("5 mm2", 5e-6, (2, 0, 0)),
     ("3 um^2/s", 3e-12, (2, -1, 0)), ("200 µm/ms", 0.2, (1, -1, 0)), ("2 / mm", 2e3, (-1, 0, 0)),
     ("4 cm-1", 4e2, (-1, 0, 0)), ("5 ms", 5e-3, (0, 1, 0)), ("0.8 deg", math.radians(0.8), (0, 0, 1)),
     ("2 mrad", 0.002, (0, 0, 1)), ("5 Hz", 5.0, (0, -1, 0))],
)  # fmt: skip
def test_quantities(text, value, powers):
    read = quantity(text)
    assert read.value == pytest.approx(value, rel=1e-12)
    assert (read.length, read.time, read.angle) == powers


@pytest.mark.parametrize("text", ["5", "mm", "5 mm 3 mm", "5 /", "5 parsec", "", "5deg4x"])
def test_texts_that_are_no_quantities(text):
    assert quantity(text) is None


def test_numbers_are_rounded_to_those_that_people_write():
    assert quantity("0.532 um").number(LENGTH, 1e-3) == 0.000532
    assert quantity("0.8 deg").number(SINE, 1e-6) == math.sin(math.radians(0.8))
    assert quantity("0.8 deg").number(RADIAN, 1e-6) == math.radians(0.8)


def test_units_are_the_same_recipe():
    written, plain = (load_recipe("ground-glass", GLASS | {"lab": lab}) for lab in (LAB, MICROMETRES))
    assert written.fingerprint() == plain.fingerprint()
    assert written.lab.profile == "disc"
    assert LabSetup(**LAB) == LabSetup(**MICROMETRES)
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
    lab = {name: each for name, each in MICROMETRES.items() if name != "wavelength"}
    speed = {"dynamics": {"diffusion": {"uniform": [1.0, 4.0]}, "tau0": None, "correlation_time": None}}
    base = RecipeFile(recipe_table("brownian-slab") | speed)
    file = RecipeFile({"lab": lab | {"wavelength": 532e-6}}, (base,))
    assert plain(file, DynamicSlab).table["dynamics"]["diffusion"] == {"uniform": [1e-6, 4e-6]}


def users_file(tmp_path, text: str):
    (tmp_path / "mine.toml").write_text(text)
    return load_recipe(tmp_path / "mine.toml")


BENCH = """
[lab]
wavelength = "532 nm"
object_distance = "200 mm"
object_extent = "0.3 mm"
aperture = "5 mm"
focal_length = "100 mm"
pixel_pitch = "3.45 um"
pixels = [256, 256]
"""


@pytest.mark.parametrize(("recipe", "material", "field", "right"), [
    ("through-slab", 'preset = "brain"\nthickness = {}', "material.thickness", '"0.5 mm"'),
    ("through-slab", "optical_depth = 10.0\nthickness = {}", "material.thickness", '"0.5 mm"'),
    ("double-diffuser", 'screens = [{{ type = "GroundGlass", angle = 0.2 }}, {{ type = "GroundGlass", angle = 0.2 }}]\n'
     "gaps = [{}]", "material.gaps.0", '"0.5 mm"'),
])  # fmt: skip
def test_a_bare_length_beside_a_laboratory_with_units(tmp_path, recipe, material, field, right):
    """It was silently taken as micrometres."""
    text = f'inherits = "{recipe}"\nname = "mine"\n{BENCH}[material]\n{material}\n'
    with pytest.raises(RuleError, match=f'{field} must be written with its unit, such as "0.5 mm"'):
        users_file(tmp_path, text.format(0.5))
    loaded = users_file(tmp_path, text.format(right))
    assert (loaded.material.gaps[0] if "gaps" in material else loaded.material.thickness) == 500.0


def test_a_laboratory_that_changes_one_field(tmp_path):
    base = load_recipe("through-slab-lab")  # in millimetres
    written = users_file(tmp_path, 'inherits = "through-slab-lab"\n[lab]\nwavelength = "633 nm"\n')
    assert written.lab.wavelength == 0.633
    assert (written.lab.object_distance, written.material.thickness) == (200e3, 100.0)
    focal = users_file(tmp_path, 'inherits = "through-slab-lab"\n[lab]\nfocal_length = 100.0\n')
    assert (focal.lab.focal_length, focal.lab.camera_distance) == (100.0, None)
    assert focal.lab.object_distance == base.lab.object_distance
    text = 'inherits = "through-slab-lab"\nunset = ["exposure"]\n[lab]\nunset = ["bandwidth"]\n'
    unset = users_file(tmp_path, text)
    assert unset.lab.bandwidth == 0
    assert unset.exposure is None
    with pytest.raises(RuleError, match="lab.unset must be a list of inherited fields"):
        users_file(tmp_path, 'inherits = "through-slab-lab"\n[lab]\nunset = ["focal_length"]\n')


def test_a_file_with_units_is_changed_by_units_alone(tmp_path):
    """A bare number would be micrometres, or else the unit of whoever reads it."""
    users_file(tmp_path, f'inherits = "through-slab"\n{BENCH}[material]\nthickness = "0.5 mm"\n')
    heir = 'inherits = "mine.toml"\n[material]\nthickness = {}\n'
    for number, says in (("700.0", "material.thickness must be written with its unit, since "), ('"0.7 mm"', None)):
        (tmp_path / "heir.toml").write_text(heir.format(number))
        if says is None:
            assert load_recipe(tmp_path / "heir.toml").material.thickness == 700.0
        else:
            with pytest.raises(RuleError, match=says):
                load_recipe(tmp_path / "heir.toml")


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


def test_the_least_grain_is_one_number_in_page_schema_and_error():
    schema = recipe_schema("hidden-object")["$defs"]["CameraGrid"]["properties"]["pixels_per_grain"]
    assert schema["minimum"] == LEAST_PIXELS == 1.6
    page = (Path(__file__).parents[3] / "docs/recipes.md").read_text()
    assert f"# camera pixels; at least {LEAST_PIXELS:g}\n" in page


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"lab": LAB | {"aperture": "5 s"}}, "lab.aperture must be a length in nm, .*5 s"),
        ({"lab": LAB | {"aperture": 5.0}},
         'lab.aperture must be written with its unit, such as "5 mm", as lab.wavelength = "532 nm" has'),
        ({"lab": LAB | {"pixel_pitch": "65 um"}}, r'must be at most .* Written: .*lab.pixel_pitch = "65 um"'),
        ({"window": {"width": "5 deg"}}, "window.width must be a length in nm"),
        ({"field": {"pitch": "5 mm"}}, "field.pitch must be a direction sine, or an angle in rad"),
        ({"material": {"optical_depth": "1 mm"}}, "material.optical_depth must be a plain number"),
        ({"material": {"g": {"uniform": ["0.8 um", 0.9]}}}, "material.g.uniform.0 must be a plain number"),
        ({"material": {"albedo": "1 deg"}}, "material.albedo must be a plain number"),
        ({"material": {"screens": [{"type": "GroundGlass", "angle": {"uniform": ["1 mm", "2 mm"]}}]}},
         "angle.uniform.0 must be a direction sine, or an angle"),
        ({"pixels": {"grain": 3.0, "shape": [64, 64]}}, "Pixels.object_pixel must be given"),
        ({"pixels": {"grain": 1.59, "object_pixel": 1.0, "shape": [64, 64]}}, "Pixels.grain must be at least 1.6"),
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
