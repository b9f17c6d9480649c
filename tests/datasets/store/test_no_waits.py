"""What may rightly be absent is not waited for: no sleep where a store, a cache or a run is opened without it."""

import time
from typing import Any

import numpy as np
import own_bucket  # noqa: F401
import pytest
from fake_recipe import FakeRecipe
from PIL import Image
from small_runs import DATA, HELD_OUT, SETTINGS, TINY
from small_stores import make
from upath import UPath

from specklegen import disk_cache
from specklegen.core.cached_results import cached_result
from specklegen.datasets import SpeckleCache, SpeckleStream, load_recipe
from specklegen.datasets.recipes.recipe_files import merged
from specklegen.datasets.store import file_names
from specklegen.datasets.store.info import info
from specklegen.datasets.store.verify import verify
from specklegen.models import train


@pytest.fixture
def sleeps(monkeypatch):
    """Seconds of every sleep."""
    seconds: list[float] = []
    monkeypatch.setattr(time, "sleep", lambda wait: seconds.append(wait) if wait else None)
    return seconds


@pytest.mark.filterwarnings("ignore:UPath")  # which has no tests of this protocol
@pytest.mark.parametrize("address", [False, True])
def test_nothing_is_waited_for_in_a_store(tmp_path, sleeps, address):
    place: Any = UPath(f"bucket://{tmp_path}/a.zarr") if address else tmp_path / "a.zarr"
    make(place, samples=13)
    make(place)
    assert not (place / "valid" / "names.json").exists()
    cache = SpeckleCache(place)
    assert len([cache.numpy(n) for n in range(len(cache))]) == 22
    assert verify(place).sound
    assert info(place)["done"] == 22
    list(cache.shuffled(seed=0, batch_size=4))
    assert not sleeps


def test_nothing_is_waited_for_in_a_store_that_is_not_full(tmp_path, sleeps):
    make(tmp_path / "a.zarr", shard_range=(1, 3))
    cache = SpeckleCache(tmp_path / "a.zarr")
    assert info(tmp_path / "a.zarr")["done"] < len(cache)
    assert verify(tmp_path / "a.zarr").unfinished
    assert not sleeps


def test_nothing_is_waited_for_behind_a_stream(tmp_path, sleeps):
    for _ in range(2):
        list(SpeckleStream(FakeRecipe(samples=50), cache=tmp_path / "a.zarr", batch_size=8))
    make(tmp_path / "part.zarr", samples=50, shard_range=(1, 3))
    list(SpeckleStream(FakeRecipe(samples=50), cache=tmp_path / "part.zarr", batch_size=8))
    assert not sleeps


def test_nothing_is_waited_for_in_a_run_or_in_the_cache_on_disk(tmp_path, sleeps, monkeypatch):
    monkeypatch.setenv(disk_cache.SETTING, str(tmp_path / "cache"))
    for _ in range(2):
        assert cached_result(float, ("half",), lambda: 0.5) == 0.5
    train(SETTINGS, DATA, HELD_OUT, tmp_path / "run", stop_after=1)
    train(SETTINGS, DATA, HELD_OUT, tmp_path / "run", stop_after=1)
    assert not sleeps


def test_a_store_whose_samples_name_files_waits_for_the_names(tmp_path, sleeps):
    """The oracle: the count sees a wait where one is due, and only there."""
    (tmp_path / "pictures").mkdir()
    for n in range(8):
        pixels = np.full((12, 12), 30 * n, np.uint8)
        pixels[n:, n:] = 255
        Image.fromarray(pixels).save(tmp_path / "pictures" / f"{n}.png")
    changes = merged(TINY, {"objects": {"type": "Folder", "path": str(tmp_path / "pictures")}})
    recipe = load_recipe("through-slab", changes)
    make(tmp_path / "a.zarr", recipe, samples=2)
    cache = SpeckleCache(tmp_path / "a.zarr")
    assert cache.numpy(0)["image"].any()
    assert not sleeps
    (tmp_path / "a.zarr" / "valid" / "names.json").unlink()
    assert file_names.read(tmp_path / "a.zarr") == ()
    assert sum(sleeps) == pytest.approx(0.254)
