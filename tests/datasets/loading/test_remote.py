"""Stores read from another file system: the same samples, the same refusals."""

import pickle
import sys

import numpy as np
import pytest
from fake_recipe import FakeRecipe, assert_same
from small_stores import make

from specklegen.core.errors import RuleError
from specklegen.datasets import SpeckleCache
from specklegen.datasets.store.shards import DamagedShard, MissingSample

fsspec = pytest.importorskip("fsspec")
upath = pytest.importorskip("upath", reason="needs the extra remote")


@pytest.fixture
def there(tmp_path, request):
    """A store of 22 samples in memory, and the same folder here."""
    folder = tmp_path / "a.zarr"
    make(folder)
    system, name = fsspec.filesystem("memory"), f"/{request.node.name}.zarr"
    system.put(str(folder), name, recursive=True)
    yield folder, f"memory:/{name}", system
    system.rm(name, recursive=True)


def test_a_store_in_memory_holds_the_same_samples(there):
    folder, address, _ = there
    here, far = SpeckleCache(folder), SpeckleCache(address)
    assert len(far) == len(here) == 22
    for n in range(22):
        assert_same(far.numpy(n) | {"index": np.int64(n)}, here.numpy(n) | {"index": np.int64(n)})
    again = pickle.loads(pickle.dumps(far))
    assert_same(again.numpy(7) | {"index": np.int64(7)}, here.numpy(7) | {"index": np.int64(7)})


def test_an_address_of_this_machine_is_its_folder(there):
    folder, _, _ = there
    assert SpeckleCache(f"file://{folder}").folder == folder
    assert SpeckleCache(upath.UPath(folder)).folder == folder


def test_what_is_missing_or_damaged_far_away_is_refused_too(there):
    folder, address, system = there
    name = address.removeprefix("memory:/")
    (shard,) = [file for file in system.find(f"{name}/{SpeckleCache(folder).keys[0]}/c") if "/c/1/" in file]
    data = bytearray(system.cat_file(shard))
    data[3] ^= 1
    system.pipe_file(shard, bytes(data))
    with pytest.raises(DamagedShard):
        SpeckleCache(address).numpy(5)
    system.rm(shard)
    with pytest.raises(MissingSample):
        SpeckleCache(address).numpy(5)
    SpeckleCache(address).numpy(0)
    with pytest.raises(RuleError, match="a folder that holds a store"):
        SpeckleCache("memory://nothing-here.zarr")


def test_a_far_store_renders_what_is_missing(tmp_path):
    folder = tmp_path / "b.zarr"
    make(folder, shard_range=(0, 2))
    system = fsspec.filesystem("memory")
    system.put(str(folder), "/b.zarr", recursive=True)
    cache = SpeckleCache("memory://b.zarr", missing="render", recipe=FakeRecipe())
    assert_same(cache.numpy(21) | {"index": np.int64(21)}, FakeRecipe().sample(0, "train", 21))
    system.rm("/b.zarr", recursive=True)


def test_without_the_extra_an_address_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "upath", None)
    with pytest.raises(RuleError, match=r"specklegen-torch\[remote\]"):
        SpeckleCache("memory://a.zarr")
