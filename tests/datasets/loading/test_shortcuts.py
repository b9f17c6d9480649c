"""A recipe makes its stream and its store; names that moved are found in their old place, with a warning."""

import numpy as np
import pytest
import torch

import specklegen.models
from specklegen.datasets import SpeckleStream, generate, load_recipe

SMALL = {"material": {"kernel_paths": 500}, "camera": {"shape": [32, 32]}}


def test_a_recipe_makes_its_stream():
    recipe = load_recipe("through-slab", SMALL)
    batch = next(iter(recipe.stream(3, "test", batch_size=2, drop_last=True)))
    same = next(iter(SpeckleStream(recipe, 3, "test", 2)))
    assert torch.equal(batch["image"], same["image"])


def test_a_recipe_fills_and_opens_its_store(tmp_path):
    recipe = load_recipe("through-slab", SMALL | {"samples": {"train": 2, "validation": 1, "test": 1}})
    cache = recipe.store(tmp_path / "a.zarr", seed=3, processes=1)
    assert len(cache) == 2
    assert np.array_equal(cache.numpy(1)["image"], recipe.sample(3, "train", 1)["image"])
    assert generate(recipe, 3, samples=2, folder=tmp_path / "a.zarr", processes=1)["rendered"] == 0


def test_a_name_that_moved_says_where_it_is():
    with pytest.warns(DeprecationWarning, match="reconstruct_and_assess is now specklegen.models.reconstruct") as said:
        assert specklegen.models.reconstruct_and_assess is specklegen.models.reconstruct
    assert said[0].filename == __file__
    assert "reconstruct_and_assess" not in dir(specklegen.models)
