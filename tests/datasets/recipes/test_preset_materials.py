"""Recipes whose material has a name."""

import numpy as np
import pytest
from refusals import assert_refused

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.volume_stack import VolumeStack

TOML = """
name = "phantom"
kind = "tilt-stack"
media = "new"
[material]
preset = { name = "intralipid", wavelength = 0.633, dilution = { uniform = [0.03, 0.06] } }
thickness = 1000.0
kernel_paths = 2000
[window]
width = 60000.0
[camera]
shape = [16, 16]
pixels_per_grain = 3.0
[tilts]
count = 2
step = 1e-5
"""


@pytest.fixture(scope="module")
def phantom(tmp_path_factory):
    file = tmp_path_factory.mktemp("preset") / "phantom.toml"
    file.write_text(TOML)
    return file


def changed(phantom, **material):
    return load_recipe(phantom, {"material": material})


def test_a_named_material_is_planned_rendered_and_known_again(phantom):
    recipe = load_recipe(phantom)
    sample = recipe.sample(0, "train", 3)
    told = sample["parameters"]
    material = sg.materials.get("intralipid", 0.633, dilution=told["preset_dilution"])
    assert 0.03 <= told["preset_dilution"] <= 0.06
    assert told["mean_free_path"] == pytest.approx(material.mean_free_path, rel=1e-12)
    assert told["wavelength"] == recipe.wavelength == material.wavelength
    assert recipe.material.slab_of(told) == material.slab(told["thickness"])
    assert sample["stack"].mean() == pytest.approx(1, abs=0.5)
    assert recipe.material.varies
    np.testing.assert_array_equal(sample["stack"], load_recipe(phantom).sample(0, "train", 3)["stack"])
    assert type(recipe)(**recipe.model_dump(mode="json", exclude_none=True)).fingerprint() == recipe.fingerprint()


def test_a_family_of_lobes_is_named_or_drawn(phantom):
    table = load_recipe(phantom).model_dump(mode="json", exclude_none=True)

    def of(lobe):
        preset = {"name": "skin", "wavelength": 0.8, "lobe": lobe}
        return type(load_recipe(phantom))(**table | {"material": table["material"] | {"preset": preset}})

    named, any_of_both = of("von-mises-fisher"), of("range")
    assert {slab.scatterer.type for slab in named.material.extremes()} == {"VonMisesFisher"}
    assert {slab.scatterer.type for slab in any_of_both.material.extremes()} == {"HenyeyGreenstein", "VonMisesFisher"}
    rng = np.random.default_rng(0)
    drawn = [any_of_both.material.realized(rng, "train") for _ in range(6)]
    assert {each.drawn["preset_lobe"] for each in drawn} == {0.0, 1.0}
    for each in drawn:
        told = {"thickness": each.slab.thickness, **each.drawn}
        assert any_of_both.material.slab_of(told) == each.slab
    stored = any_of_both.model_dump(mode="json", exclude_none=True)
    assert type(any_of_both)(**stored).fingerprint() == any_of_both.fingerprint()
    assert_refused(lambda: of("gaussian"), 'lobe must be one of "henyey-greenstein", "von-mises-fisher"')


def test_a_preset_takes_the_place_of_a_slab_that_is_inherited():
    recipe = load_recipe("two-tilts", {"material": {"preset": {"name": "skin", "wavelength": 0.8}, "thickness": 500.0}})
    assert recipe.material.extremes() == [sg.materials.get("skin", 0.8).slab(500.0)]


def test_faces_are_those_of_air_unless_they_are_matched(phantom):
    faces = load_recipe(phantom).material.extremes()[0].faces
    assert faces == sg.Faces(inside=faces.inside, outside=1.0)
    assert faces.inside == pytest.approx(1.332, abs=1e-3)
    matched = changed(phantom, outside="matched")
    assert matched.material.extremes()[0].faces.matched
    assert matched.fingerprint() != load_recipe(phantom).fingerprint() == changed(phantom, outside=1.0).fingerprint()
    table = matched.model_dump(mode="json", exclude_none=True)
    table["material"]["outside"] = None  # as stores have it that were made before
    assert type(matched)(**table) == matched


def test_range_is_that_of_the_literature(phantom):
    lean = {"preset": {"name": "skin", "wavelength": 0.8, "a": "range", "dilution": None}}
    assert_refused(lambda: changed(phantom, **lean), "given by numbers of a, b, g")
    table = load_recipe(phantom).model_dump(mode="json", exclude_none=True)
    table["material"] = table["material"] | {"preset": {"name": "skin", "wavelength": 0.8, "a": "range"}}
    recipe = type(load_recipe(phantom))(**table)
    depths = sorted(slab.optical_depth / slab.thickness for slab in recipe.material.extremes())
    assert depths[-1] / depths[0] == pytest.approx(59.7 / 32.3, rel=1e-2)


@pytest.mark.parametrize(("preset", "says"), [
    ({"name": "skim", "wavelength": 0.6}, 'must be one of "bone", "brain"'),
    ({"name": "skin"}, "wavelength = 0.633"),
    ({"name": "skin", "wavelength": 0.8, "water": "range"}, "one refractive index"),
    ({"name": "skin", "wavelength": 1.1}, "absorption must be given outside"),
    ({"name": "skin", "wavelength": 1.1, "absorption": "range"}, "absorption must be given outside"),
    ({"name": "skin", "wavelength": 0.6, "absorption": "range"}, "absorption must be a number.*blood, oxygenation"),
    ({"name": "skin", "wavelength": 0.6, "absorption": 0.1, "blood": 0.1}, "absorption must be left out if blood"),
    ({"name": "ground-glass", "wavelength": 0.6}, "Write a ground glass as screens"),
])  # fmt: skip
def test_what_is_no_bulk_is_refused_with_the_remedy(phantom, preset, says):
    table = load_recipe(phantom).model_dump(mode="json", exclude_none=True)
    table["material"] = table["material"] | {"preset": preset}
    assert_refused(lambda: type(load_recipe(phantom))(**table), says)


def test_boxes_are_made_of_numbers(phantom):
    table = load_recipe(phantom).model_dump(mode="json", exclude_none=True)
    table |= {"kind": "volume-stack", "outline": {"width": 40.0}}
    assert_refused(lambda: VolumeStack(**table), "where the kind is volume-stack")
