"""Generators stay as long as what they hold fits, however many there are; a sample does not depend on it."""

import numpy as np
import pytest
import torch
from forgotten import forget
from quick_recipes import quick_recipe

from specklegen.core.memory import array_bytes
from specklegen.core.most_recent import MostRecent
from specklegen.core.random_streams import seed_words
from specklegen.datasets.recipes.generator import GENERATORS, SpeckleGenerator


@pytest.fixture(scope="module")
def recipe():
    return quick_recipe("through-slab", 300)


@pytest.fixture
def counted(monkeypatch):
    """Sample numbers of all media that are made."""
    made, plain = [], SpeckleGenerator.media

    def noted(self, numbers):
        made.extend(numbers)
        return plain(self, numbers)

    monkeypatch.setattr(SpeckleGenerator, "media", noted)
    return made


def cache(most_bytes=2**31, most=64):
    """Return a cache like that of the process, and what finds a generator in it."""
    generators = MostRecent(most_bytes, most, SpeckleGenerator.held)
    return generators, lambda key: generators.get(key, lambda: SpeckleGenerator(*key))


def keys(recipe, count):
    return [(recipe, seed_words(seed), "train", "cpu") for seed in range(count)]


def test_media_of_six_generators_in_turn_are_made_once(recipe, counted):
    (kept, found), own = cache(), keys(recipe, 6)
    first = [found(key)([0, 1])["image"] for key in own]
    once = len(counted)
    again = [found(key)([0, 1])["image"] for key in own]
    assert len(kept) == 6
    assert len(counted) == once >= 6
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))


def test_what_does_not_fit_goes_the_oldest_first(recipe, counted):
    own = keys(recipe, 3)
    one = SpeckleGenerator(*own[0])
    image = one([0])["image"]
    size = array_bytes(one.held())
    kept, found = cache(int(2.5 * size))
    for key in own:
        found(key)([0])
    assert len(kept) == 3  # the last had made nothing when it was weighed
    found((recipe, seed_words(9), "train", "cpu"))
    assert [*kept._results] == [*own[1:], (recipe, seed_words(9), "train", "cpu")]
    before = len(counted)
    assert torch.equal(found(own[0])([0])["image"], image)
    assert len(counted) == before + 1


def test_one_too_large_stays_alone_and_their_number_is_bounded(recipe):
    own = keys(recipe, 4)
    kept, found = cache(0)
    found(own[0])([0])
    assert [*kept._results] == own[:1]
    few, found = cache(most=2)
    for key in own:
        found(key)
    assert [*few._results] == own[2:]
    few.forget()
    assert not len(few)


def test_arrays_are_counted_once(recipe):
    a = np.zeros((10, 10))
    assert array_bytes([a, a[3:], {"x": a.T}]) == 800
    b = torch.zeros(10, 10)
    assert array_bytes([b, b[2:], (a, b.view(100))]) == 1200
    assert array_bytes(["text", 3, None, np.ndarray]) == 0
    held = SpeckleGenerator(recipe, 0, "train")
    before = array_bytes(held.held())
    held([0])
    media, spectra = held._media[0][0], held._spectra.get(0)
    assert array_bytes(held.held()) > before
    least = sum(t.nbytes for t in media.groups[0][1].tensors().values()) + (0 if spectra is None else spectra.nbytes)
    assert array_bytes(held.held()) >= 0.9 * least


def test_what_tests_forget_holds_them_too(recipe):
    """Else what is made anew under another context, or after another history, would be what was made before."""
    recipe.sample(0, "train", 0)
    assert len(GENERATORS) > 0
    forget()
    assert len(GENERATORS) == 0
