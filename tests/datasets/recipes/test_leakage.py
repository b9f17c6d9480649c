"""No medium, no object and (where the recipe says so) no material of one split appears in another."""

import hashlib
import itertools

import numpy as np
import pytest
from quick_recipes import packaged, quick_recipe
from refusals import assert_refused

from specklegen.datasets import load_recipe, recipe_names
from specklegen.datasets.split import SPLITS, Purpose, substream

FAST = {"material": {"kernel_paths": 1000}}
PAIRS = list(itertools.combinations(SPLITS, 2))


def digest(tensor):
    return hashlib.sha256(tensor.numpy().tobytes()).hexdigest()


def assert_disjoint(parts):
    """Parts: a set for each split."""
    for one, other in PAIRS:
        common = parts[one] & parts[other]
        assert not common, f"{len(common)} in both {one} and {other}, such as {next(iter(common))}"


def media(recipe, count=3):
    """Hashes of the fields behind the first samples of each split, of either polarisation and every frame."""
    found = {}
    for split in SPLITS:
        numbers = [recipe.medium_number(index) for index in range(count)]
        ready = [recipe.prepare(0, split, number) for number in numbers]
        seen = [one.seen for one in ready]  # paths and films behind a lens are drawn from seeds when they are lit
        found[split] = {each for one in seen for each in getattr(one, "seeds", None) or map(digest, one.drawn)}
    return found


@pytest.mark.parametrize("name", packaged())
def test_no_medium_is_in_two_splits(name):
    recipe = quick_recipe(name)
    found = media(recipe)
    assert all(len(part) >= 3 for part in found.values())
    assert_disjoint(found)


def test_no_substream_is_in_two_splits():
    """Of any purpose and any number: the split is a word of its own."""
    for purpose in Purpose:
        assert_disjoint({s: {substream(0, s, purpose, n) for n in range(500)} for s in SPLITS})


def test_a_leak_of_media_is_found(monkeypatch):
    """Power: streams that forget the split must be caught."""
    monkeypatch.setattr("specklegen.datasets.addresses.split_number", lambda _: 0)
    with pytest.raises(AssertionError, match="in both train and validation"):
        assert_disjoint(media(load_recipe("through-slab", FAST)))


def test_material_ranges_of_the_splits_do_not_meet():
    ranged = [recipe for recipe in map(load_recipe, recipe_names()) if recipe.material.by_split is not None]
    assert ranged
    for recipe in ranged:
        assert recipe.material.by_split is not None
        name = recipe.material.by_split.parameter
        drawn = {}
        for split in SPLITS:
            rng = np.random.default_rng(0)
            slabs = [recipe.material.draw(rng, split) for _ in range(300)]
            drawn[split] = [getattr(slab, name) if name != "g" else slab.scatterer.g for slab in slabs]
        for one, other in PAIRS:
            low, high = sorted([(min(drawn[s]), max(drawn[s])) for s in (one, other)])
            assert low[1] < high[0]
        assert f"{name} is drawn from train" in recipe.split_notes()


OD = "optical_depth"


@pytest.mark.parametrize(("ranges", "message"), [
    ((OD, [5, 10], [10, 12], [14, 20]), "ranges that do not overlap"),
    ((OD, [5, 10], [6, 7], [14, 20]), "ranges that do not overlap"),
    ((OD, [5, 10], [11, 12], [14, 21]), "test must be within optical_depth, 5 to 20"),
    (("colour", [5, 10], [11, 12], [14, 20]), "parameter must be one of"),
])  # fmt: skip
def test_bad_ranges_are_refused(ranges, message):
    table = dict(zip(SPLITS, ({"uniform": r} for r in ranges[1:]), strict=True)) | {"parameter": ranges[0]}
    assert_refused(lambda: load_recipe("unknown-slab", {"material": {"by_split": table}}), message)


def test_notes_say_what_is_shared():
    notes = load_recipe("unknown-slab").split_notes()
    assert "No medium of one split appears in another" in notes
    assert "No object of one split appears in another" in notes
    assert "drawn from the same ranges" in notes
    assert "object" not in load_recipe("tilt-stack").split_notes()
    assert "one material" in load_recipe("through-slab").split_notes()
