"""Recipes whose material is in layers."""

import numpy as np
import pytest
from refusals import assert_refused
from zscore import assert_z

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.parts.layered_material import LayerDraws

TOML = """
name = "skin"
kind = "tilt-stack"
media = "new"
[material]
wavelength = 0.5
kernel_paths = 2000
[[material.layers]]
thickness = 20.0
mean_free_path = 10.0
g = 0.8
[[material.layers]]
thickness = { uniform = [40, 80] }
mean_free_path = 40.0
scatterer = { type = "VonMisesFisher", concentration = { uniform = [5, 10] } }
albedo = 0.99
[window]
width = 6000.0
[camera]
shape = [16, 16]
pixels_per_grain = 3.0
[tilts]
count = 2
step = 1e-4
"""


@pytest.fixture(scope="module")
def skin(tmp_path_factory):
    file = tmp_path_factory.mktemp("layers") / "skin.toml"
    file.write_text(TOML)
    return file


def test_layers_are_drawn_rendered_and_known_again(skin):
    recipe = load_recipe(skin)
    sample = recipe.sample(0, "train", 3)
    told = sample["parameters"]
    layers = recipe.material.slab_of(told)
    assert isinstance(layers, sg.Layers)
    assert 40 <= told["layer_1_thickness"] <= 80
    assert told["thickness"] == layers.thickness == 20 + told["layer_1_thickness"]
    assert told["optical_depth"] == layers.optical_depth
    assert layers.layers[1].scatterer == sg.VonMisesFisher(told["layer_1_scatterer_concentration"])
    assert layers.layers[1].albedo == 0.99
    assert sample["stack"].mean() == pytest.approx(1, abs=0.5)
    assert recipe.material.varies
    assert len(recipe.material.extremes()) == 4
    np.testing.assert_array_equal(sample["stack"], load_recipe(skin).sample(0, "train", 3)["stack"])
    assert type(recipe)(**recipe.model_dump(mode="json", exclude_none=True)).fingerprint() == recipe.fingerprint()


@pytest.mark.parametrize(("layer", "field"), [
    ({"thickness": 0.0, "mean_free_path": 1.0, "g": 0.0}, "layers.thickness"),
    ({"thickness": 1.0, "mean_free_path": 1.0}, "given g or scatterer"),
    ({"thickness": 1.0, "mean_free_path": 1.0, "g": 1.0}, "layers.g"),
    ({"thickness": 1.0, "mean_free_path": 1.0, "g": 0.5, "albedo": 1.5}, "layers.albedo"),
])  # fmt: skip
def test_bad_layers_are_named(skin, layer, field):
    table = load_recipe(skin).model_dump(mode="json", exclude_none=True)
    table["material"]["layers"] = [layer]
    assert_refused(lambda: type(load_recipe(skin))(**table), field)


@pytest.mark.slow
def test_layers_that_let_no_path_through_are_refused(skin):
    table = load_recipe(skin).model_dump(mode="json", exclude_none=True)
    table["material"]["layers"] = [{"thickness": 40.0, "mean_free_path": 1.0, "g": 0.0, "albedo": 0.5},
                                   {"thickness": 1.0, "mean_free_path": 1.0, "g": 0.0, "albedo": 0.6}]  # fmt: skip
    assert_refused(lambda: type(load_recipe(skin))(**table).sample(0, "train", 3), "enough that light crosses")


def refracting(skin, **changes):
    """The same with layers of indices of their own, one of them drawn."""
    table = load_recipe(skin).model_dump(mode="json", exclude_none=True)
    table["material"]["layers"][0]["index"] = 1.4
    table["material"]["layers"][1]["index"] = {"uniform": [1.1, 1.5]}
    return type(load_recipe(skin))(**{**table, **changes})


def test_layers_that_refract_are_drawn_by_the_stationary_sampler(skin):
    recipe = refracting(skin)
    assert {made.sampler for made in recipe.plans()} == {"stationary"}
    sample = recipe.sample(0, "train", 3)
    told = sample["parameters"]
    assert 1.1 <= told["layer_1_index"] <= 1.5
    layers = recipe.material.slab_of(told)
    assert layers.indices == (1.4, told["layer_1_index"])
    np.testing.assert_array_equal(sample["stack"], refracting(skin).batch(0, "train", [1, 3])["stack"][1])
    curve = sg.memory_effect(layers, wavelength=0.5, tilts=[0.003], paths=20_000)
    value, _, error = recipe.material.known(layers).correlation.intensity(2 * np.pi / 0.5 * np.sin(curve.tilts))
    assert_z(value, curve.intensity, np.hypot(error, curve.standard_error))
    assert curve.intensity < 0.95
    assert recipe.fingerprint() != load_recipe(skin).fingerprint()
    assert "index" not in load_recipe(skin).material.layers[0].canonical_json()


def test_layers_that_refract_need_an_index_and_no_lab(skin):
    with pytest.raises(sg.RuleError, match=r"Material\.layers\.index must be a refractive index"):
        LayerDraws(thickness=1.0, mean_free_path=1.0, g=0.5, index={"uniform": [0.01, 1.0]})
    table = refracting(skin).model_dump(mode="json", exclude_none=True)
    lab = load_recipe("through-slab-lab").model_dump(mode="json", exclude_none=True)["lab"]
    for name in ("window", "camera"):
        table.pop(name)
    table["material"].pop("wavelength")
    with pytest.raises(sg.RuleError, match=r"Material\.layers\.index must be left out if there is a table lab"):
        type(load_recipe(skin))(**table, lab=lab | {"faces": "matched", "bandwidth": 0.0})
