"""Parts of a class of one's own do the same at every door, or are refused: no file or fingerprint forgets a field."""

import numpy as np
import pytest
from own_objects import Dim
from refusals import assert_refused

from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.datasets.recipes.parts.light import Light
from specklegen.datasets.recipes.parts.material import Material

SMALL = {"camera": {"shape": [64, 64]}}


class Glowing(Light):
    """Has light of its own."""

    glow: float = 1.0


class Layered(Material):
    """Has something in front."""

    skin: float = 1.0


@pytest.mark.parametrize("field", ["light", "material"])
def test_a_further_field_is_refused_by_name(field):
    recipe = load_recipe("unknown-slab", SMALL | {"exposure": {"photons": 200.0}})
    part = {"light": Glowing(), "material": Layered(**recipe.material.model_dump(exclude_none=True))}[field]
    assert_refused(lambda: recipe.replace(**{field: part}), f"Recipe.{field} must be of a class of this library")


def test_pictures_of_ones_own_are_asked_for():
    recipe = load_recipe("unknown-slab", SMALL)
    own = recipe.replace(objects=Dim(shape=recipe.objects.shape))
    found, plain = (SpeckleGenerator(each, 3)(range(6))["object"].numpy() for each in (own, recipe))
    np.testing.assert_array_equal(found, [own.objects.image(3, "train", n) for n in range(6)])
    assert not found[:, : found.shape[1] // 2].any()
    assert plain[:, : found.shape[1] // 2].any()
