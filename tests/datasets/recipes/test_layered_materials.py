"""Recipes whose material is in layers."""

import numpy as np
import pytest

import specklegen as sg
from specklegen.datasets import load_recipe

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


@pytest.mark.parametrize(
    ("layer", "field"),
    [
        ({"thickness": 0.0, "mean_free_path": 1.0, "g": 0.0}, "layers.thickness"),
        ({"thickness": 1.0, "mean_free_path": 1.0}, "given g or scatterer"),
        ({"thickness": 1.0, "mean_free_path": 1.0, "g": 1.0}, "layers.g"),
        ({"thickness": 1.0, "mean_free_path": 1.0, "g": 0.5, "albedo": 1.5}, "layers.albedo"),
    ],
)
def test_bad_layers_are_named(skin, layer, field):
    table = load_recipe(skin).model_dump(mode="json", exclude_none=True)
    table["material"]["layers"] = [layer]
    with pytest.raises(sg.RuleError, match=field):
        type(load_recipe(skin))(**table)


def test_layers_that_let_no_path_through_are_refused(skin):
    table = load_recipe(skin).model_dump(mode="json", exclude_none=True)
    table["material"]["layers"] = [
        {"thickness": 40.0, "mean_free_path": 1.0, "g": 0.0, "albedo": 0.5},
        {"thickness": 1.0, "mean_free_path": 1.0, "g": 0.0, "albedo": 0.6},
    ]
    with pytest.raises(sg.RuleError, match="enough that light crosses"):
        type(load_recipe(skin))(**table).sample(0, "train", 3)
