"""Drawn slabs are looked up in the atlas where a recipe does not say how their memory effect is found."""

import pytest

from specklegen.datasets import load_recipe, recipe_names
from specklegen.datasets.recipes.parts.material import Estimator, Material

DRAWN = {"g": {"uniform": [0.7, 0.9]}}


@pytest.mark.parametrize("name", ["through-slab", "two-tilts"])
def test_drawn_slabs_are_looked_up(name):
    drawn = load_recipe(name, {"material": DRAWN})
    assert drawn.material.kernel == "atlas"
    assert drawn == load_recipe(name, {"material": DRAWN | {"kernel": "atlas"}})
    assert drawn.fingerprint() != load_recipe(name, {"material": DRAWN | {"kernel": "estimate"}}).fingerprint()


@pytest.mark.parametrize(("name", "material"), [
    ("through-slab", {}), ("through-slab", DRAWN | {"kernel": "estimate"}),
    ("through-slab", DRAWN | {"faces": {"inside": 1.33}}),
    ("through-slab", {"scatterer": {"type": "VonMisesFisher", "concentration": {"uniform": [20.0, 40.0]}}}),
    ("through-slab-lab", DRAWN),  # light of a band
    ("dynamic-slab", DRAWN),
    ("polarised-tissue", DRAWN), ("masked-light-slab", DRAWN),
])  # fmt: skip
def test_others_are_estimated(name, material):
    recipe = load_recipe(name, {"material": material})
    assert recipe.material.kernel == "estimate"
    assert type(recipe).model_validate_json(recipe.model_dump_json(by_alias=True)).material.kernel == "estimate"


def test_packaged_recipes_say_what_they_said():
    """Their pixels are kept: what is drawn names the atlas, and the rest is estimated."""
    for recipe in map(load_recipe, recipe_names()):
        if type(recipe.material) is Material:
            assert recipe.material.varies == (recipe.material.kernel == "atlas"), recipe.name


def test_a_sample_is_of_the_atlas():
    recipe = load_recipe("through-slab", {"material": DRAWN, "media": "new"})
    explicit = load_recipe("through-slab", {"material": DRAWN | {"kernel": "atlas"}, "media": "new"})
    one, other = (each.batch(0, "train", [3]) for each in (recipe, explicit))
    assert one["parameters"]["estimator"].tolist() == [Estimator.ATLAS]
    assert (one["image"] == other["image"]).all()
