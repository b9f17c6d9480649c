"""Stores of every packaged kind of recipe, and of a recipe with a user's own parts: a death loses nothing.

tests/fuzz_stores.py kills real processes at every file operation, of a recipe that costs nothing. Here one dies between
two arrays of a shard, and the recipes are real: what they keep between samples, media they share, arrays of every name.
"""

import numpy as np
import pytest
from fake_recipe import assert_same
from own_objects import Dim
from quick_recipes import quick_recipe
from small_stores import contents

from specklegen.datasets import load_recipe, recipe_names
from specklegen.datasets.loading.cache import SpeckleCache
from specklegen.datasets.store import store
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.shards import MissingSample
from specklegen.datasets.store.verify import verify

SMALL = {"camera": {"shape": [32, 32]}}
KINDS = {
    "hidden-object": ("through-slab", SMALL | {"media": 2}),
    "screens": ("double-diffuser", {}),
    "laboratory": ("through-slab-lab", {"media": 1}),
    "atlas": ("unknown-slab", {}),
    "bench": ("unknown-slab", {"bench": {"rotation": {"uniform": [-180.0, 180.0]}, "blur": 1.0, "unevenness": 0.05}}),
    "tilt-stack": ("tilt-stack", SMALL),
    "material-regression": ("material-regression", SMALL),
    "two-tilts": ("two-tilts", SMALL | {"media": 2}),
    "dynamic-slab": ("dynamic-slab", SMALL),
    "brownian": ("brownian-slab", SMALL),
    "analysed-object": ("polarised-tissue", SMALL | {"media": 1}),
    "partially-coherent": ("partially-coherent-slab", SMALL),
    "masked-light": ("masked-light-slab", SMALL),
    "coherent-object": ("coherent-digits", SMALL | {"media": 2}),
    "exposure-stack": ("lsci-slab", SMALL),
    "contrast-map": ("flow-vessel", SMALL),
    "lens-stack": ("tissue-microscope", SMALL),
}
OWN = "own objects"
QUICK = ("screens", "dynamic-slab", "partially-coherent", "masked-light", OWN)  # of a second; all passed when written
SAMPLES, SHARD = 5, 2


def recipe_of(kind):
    name, changes = KINDS.get(kind, KINDS["hidden-object"])
    recipe = quick_recipe(name, **changes)
    return recipe.replace(objects=Dim(shape=recipe.objects.shape)) if kind == OWN else recipe


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=() if kind in QUICK else pytest.mark.slow) for kind in (*KINDS, OWN)]
)
def test_a_death_between_two_arrays_loses_nothing(tmp_path, monkeypatch, kind):
    """At a place of the second shard of three; what the ledger lists is right, and the end is that of a calm run."""
    recipe = recipe_of(kind)
    whole, torn = tmp_path / "whole" / "a.zarr", tmp_path / "torn" / "a.zarr"
    options = {"samples": SAMPLES, "shard_samples": SHARD, "processes": 1}
    write, places, dies_at = store.put, [], None

    def dying(file, data, **options):
        places.append(file)
        if len(places) == dies_at:
            raise KeyboardInterrupt
        write(file, data, **options)

    monkeypatch.setattr(store, "put", dying)
    generate(recipe, folder=whole, **options)
    expected = contents(whole)
    dies_at = len(places) // 2
    places.clear()
    with pytest.raises(KeyboardInterrupt):
        generate(recipe, folder=torn, **options)
    monkeypatch.undo()
    assert not verify(torn).damaged
    cache = SpeckleCache(torn)
    for n in range(SHARD):
        assert_same(cache.numpy(n) | {"index": np.int64(n)}, recipe.sample(0, "train", n))
    with pytest.raises(MissingSample):
        cache.numpy(SAMPLES - 1)
    generate(recipe, folder=torn, **options)
    assert contents(torn) == expected


def test_every_kind_of_recipe_is_among_them():
    """A new kind has to be added above."""
    there = {type(load_recipe(name)) for name in recipe_names()}
    assert there <= {type(recipe_of(kind)) for kind in KINDS}
