"""Recipes of a laboratory with any material: a ground glass, a material by its name, layers; and what is refused."""

import pytest
from refusals import assert_refused

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe

MILLIMETRES = {"wavelength": 532e-6, "object_distance": 200.0, "object_extent": 0.3, "aperture": 5.0,
               "camera_distance": 100.0, "pixel_pitch": 0.005, "pixels": [24, 24], "profile": "disc"}  # fmt: skip
SMALL = {"lab": {"bandwidth": 0.0, "pixels": [24, 24], "object_extent": 0.15}}
GLASS = SMALL | {"material": {"screens": [{"type": "GroundGlass", "grit": 220}]}}
SKIN = {"lab": SMALL["lab"] | {"wavelength": 800e-6}, "material": {"preset": "skin", "thickness": 0.5}}
LAYERS = SMALL | {"material": {"layers": [{"thickness": 0.05, "mean_free_path": 0.02, "g": 0.8}]}}


def in_micrometres(lab):
    return {name: 1000 * value if isinstance(value, float) else value for name, value in lab.items()}


def test_a_ground_glass_is_the_same_in_any_unit():
    """By its grit: its roughness is known in micrometres, and the laboratory's unit by the wavelength of light."""
    one = load_recipe("through-slab-lab", GLASS)
    fine = load_recipe("ground-glass", {"lab": in_micrometres(MILLIMETRES | {"object_extent": 0.15}),
                                        "material": {"screens": [{"type": "GroundGlass", "grit": 220}]}})  # fmt: skip
    found, same = (each.material.extremes()[0].screens[0].screen for each in (one, fine))
    assert (found.rms_height, same.rms_height) == pytest.approx((3e-3, 3.0))
    labels = [each.sample(0, "train", 0)["parameters"] for each in (one, fine)]
    assert labels[0]["rms_angle"] == pytest.approx(labels[1]["rms_angle"], rel=1e-9)
    assert labels[0]["expected_contrast"] == pytest.approx(labels[1]["expected_contrast"], rel=1e-6)
    thousand = load_recipe("through-slab-lab", GLASS | {"material": {"screens": [
        {"type": "GroundGlass", "grit": 220, "unit": 1e-6}]}})  # fmt: skip
    assert thousand.material.extremes()[0].screens[0].screen.rms_height == 3.0


def test_a_preset_takes_wavelength_unit_and_faces_from_the_laboratory():
    recipe = load_recipe("through-slab-lab", SKIN)
    assert recipe.material.preset == {"wavelength": 0.8, "unit": 1e-3, "name": "skin"}
    assert recipe.lab.refractive_index == recipe.material.refractive_index == recipe.material.faces.inside
    assert recipe.wavelength == pytest.approx(800e-6 / recipe.lab.refractive_index)
    stated = load_recipe("through-slab-lab", SKIN | {"material": {
        "preset": {"name": "skin", "wavelength": 0.8, "unit": 1e-3}, "thickness": 0.5}})  # fmt: skip
    assert stated.fingerprint() == recipe.fingerprint()
    assert type(recipe).from_toml(recipe.to_toml()).fingerprint() == recipe.fingerprint()
    matched = load_recipe("through-slab-lab", SKIN | {"lab": SKIN["lab"] | {"faces": "matched"}})
    assert matched.material.faces.matched
    assert matched.fingerprint() != recipe.fingerprint()


def test_a_laboratory_replaces_what_it_inherits():
    recipe = load_recipe("ground-glass", {"lab": MILLIMETRES | {"object_extent": 0.15}})
    assert (recipe.window, recipe.camera, recipe.field, recipe.material.wavelength) == (None, None, None, None)
    assert recipe.sample(0, "train", 0)["image"].shape == (24, 24)


@pytest.mark.parametrize(("changes", "field"), [
    ({"material": GLASS["material"]}, r"Recipe\.lab\.bandwidth"),
    ({"material": LAYERS["material"]}, r"Recipe\.lab\.bandwidth"),
    (LAYERS | {"lab": SMALL["lab"] | {"refractive_index": 1.4}}, r"Lab\.faces"),
    (SKIN | {"lab": SKIN["lab"] | {"refractive_index": 1.5}}, r"Lab\.refractive_index"),
    (SKIN | {"lab": SKIN["lab"] | {"wall": 1.5}}, r"Lab\.wall"),
    (SKIN | {"material": {"preset": {"name": "skin", "wavelength": 0.81}, "thickness": 0.5}}, r"preset wavelength"),
    (SKIN | {"material": {"preset": {"name": "skin", "unit": 1e-6}, "thickness": 0.5}}, r"preset unit"),
    (GLASS | {"lab": in_micrometres(SMALL["lab"]) | {"wavelength": 532.0}}, r"LabSetup\.|Lab\."),
    ({"camera": {"shape": [24, 24]}}, r"Recipe\.lab"),
])  # fmt: skip
def test_what_cannot_be_is_refused_by_its_field(changes, field):
    assert_refused(lambda: load_recipe("through-slab-lab", changes), field)
    with pytest.raises(RuleError, match=r"Material\.preset"):
        load_recipe("through-slab", {"material": {"preset": "skin", "thickness": 500.0}})
