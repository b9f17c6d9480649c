"""Arguments of the stream and the store that are of a wrong type or out of range: a broken rule that names them."""

import warnings

import numpy as np
import pytest
from fake_recipe import FakeRecipe

from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.datasets import SpeckleCache, SpeckleStream
from specklegen.datasets.loading.export import export
from specklegen.datasets.store import creation
from specklegen.datasets.store.card import card
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.store import Store


class EvilNames(FakeRecipe):
    """A recipe whose names would leave their places in a card or a table."""

    def sample(self, seed, split, index):
        sample = super().sample(seed, split, index)
        return sample | {"parameters": sample["parameters"] | {"=1+1": 0.0, "a|b`c\n# x": 0.0}}

    def batch(self, seed, split, indices):
        samples = [self.sample(seed, split, index) for index in indices]
        batch = {key: np.stack([s[key] for s in samples]) for key in samples[0] if key != "parameters"}
        names = samples[0]["parameters"]
        return batch | {"parameters": {n: np.array([s["parameters"][n] for s in samples]) for n in names}}


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> SpeckleCache:
    folder = tmp_path_factory.mktemp("store") / "a.zarr"
    generate(FakeRecipe(), samples=4, folder=folder, processes=1)
    return SpeckleCache(folder)


def test_the_last_sample_has_a_name_of_its_own(cache):
    assert cache.numpy(-1)["index"] == cache[-1]["index"] == 3


@pytest.mark.parametrize("index", [1.5, "x", None, True])
def test_an_index_is_a_whole_number(cache, index):
    for read in (cache.numpy, cache.__getitem__):
        with pytest.raises(RuleError, match="SpeckleCache index must be a whole number"):
            read(index)


@pytest.mark.parametrize("index", [4, -5, 2**70, -(2**63)])
def test_a_sample_that_cannot_be_is_an_index_error(cache, index):
    for read in (cache.numpy, cache.__getitem__):
        with pytest.raises((IndexError, RuleError)):
            read(index)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda folder: generate(FakeRecipe(), samples=2.5, folder=folder), "generate.samples must be a whole number"),
        (lambda folder: generate(FakeRecipe(), samples="x", folder=folder), "generate.samples must be a whole number"),
        (lambda folder: SpeckleStream(FakeRecipe(), seed=[1, 2]), "SpeckleStream.seed must be a whole number"),
        (lambda folder: SpeckleStream(FakeRecipe(), batch_size=2.5), "SpeckleStream.batch_size must be a whole number"),
        (lambda folder: SpeckleStream(FakeRecipe()).set_epoch(2**63), "SpeckleStream.epoch must be at least 0 and at"),
        (lambda folder: SpeckleStream(FakeRecipe()).set_epoch(1.5), "SpeckleStream.epoch must be a whole number"),
        (lambda folder: SpeckleStream("through-slab"), "SpeckleStream.recipe must be a recipe"),
    ],
)
def test_a_wrong_argument_is_named(tmp_path, call, says):
    with pytest.raises(RuleError, match=says):
        call(tmp_path / "a.zarr")
    assert not (tmp_path / "a.zarr").exists()


def test_only_what_is_there_is_exported(cache, tmp_path):
    with pytest.raises(RuleError, match=r"export.samples must be at least 0 and at most 3; got 4. The store has 4."):
        export(cache.folder, tmp_path, samples=range(10**18))


def test_names_stay_in_their_places(tmp_path):
    """A formula in a table, a bar, a backquote and a new line in a card."""
    folder = tmp_path / "a.zarr"
    generate(EvilNames(), samples=2, folder=folder, processes=1)
    written = card(Store(folder))
    assert "\n# x" not in written
    assert "a|b`c" not in written
    export(folder, tmp_path / "npy")
    assert "'=1+1" in (tmp_path / "npy" / "samples.csv").read_text().splitlines()[0]


def test_a_store_names_the_libraries_that_it_was_begun_with(cache):
    assert {"numpy", "torch", "numba"} <= Store(cache.folder).attributes["libraries"].keys()


def test_a_store_that_grows_with_other_libraries_says_so(tmp_path, monkeypatch, recwarn):
    folder = tmp_path / "a.zarr"
    generate(FakeRecipe(), samples=4, folder=folder, processes=1)
    now = Store(folder).attributes["libraries"]
    monkeypatch.setattr(creation, "library_versions", lambda: now | {"numpy": "99.0"})
    generate(FakeRecipe(), samples=4, folder=folder, processes=1)  # nothing is added
    assert not [w for w in recwarn if "other libraries" in str(w.message)]
    with pytest.warns(DoubtWarning, match=rf"other libraries: numpy {now['numpy']} is now 99\.0\. .*last bits"):
        generate(FakeRecipe(), samples=6, folder=folder, processes=1)


def test_a_full_store_answers_without_a_plan(tmp_path, monkeypatch):
    """Planning takes seconds; nothing is added, so nothing need be planned. What is missing asks for it again."""
    folder = tmp_path / "a.zarr"
    generate(FakeRecipe(), samples=4, folder=folder, processes=1)
    monkeypatch.setattr(creation, "rendering_note", lambda recipe: "planned otherwise")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert generate(FakeRecipe(), samples=4, folder=folder, processes=1)["rendered"] == 0
        assert generate(FakeRecipe(), samples=3, folder=folder, processes=1)["rendered"] == 0
    with pytest.warns(DoubtWarning, match='is now "planned otherwise"'):
        generate(FakeRecipe(), samples=5, folder=folder, processes=1)
