"""Sound bytes in the wrong place: shards of another seed, of another number, of another data set."""

import shutil

import numpy as np
import pytest
from fake_recipe import FakeRecipe, assert_same
from small_stores import assert_holds, contents, make

from specklegen.datasets.loading.cache import SpeckleCache
from specklegen.datasets.store.shards import DamagedShard
from specklegen.datasets.store.verify import verify

KEYS = ("image", "field", "object", "level", "parameters", "index", "seed", "seal")


def merge(source, folder):
    """Copy what ``folder`` does not have, as ``cp -rn`` does."""
    for file in sorted(source.rglob("*")):
        target = folder / file.relative_to(source)
        if file.is_file() and not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, target)


def files_of(folder, shard, key):
    """The files of one array that belong to a shard."""
    place = folder / key / "c" / str(shard)
    return [place] if place.is_file() else [file for file in place.rglob("*") if file.is_file()]


def assert_right_or_refused(folder, shards):
    """Require that the samples of these shards raise and all others are theirs; that verify finds and mends them."""
    cache = SpeckleCache(folder)
    for n in range(22):
        if n // 5 in shards:
            with pytest.raises(DamagedShard, match="verify --repair"):
                cache.numpy(n)
        else:
            assert_same(cache.numpy(n) | {"index": np.int64(n)}, FakeRecipe().sample(0, "train", n))
    assert verify(folder).damaged == tuple(shards)
    verify(folder, repair=FakeRecipe())
    assert_holds(folder, FakeRecipe(), 22)


@pytest.mark.parametrize(
    "other",
    [{"seed": 1}, {"recipe": FakeRecipe(thickness=1.0)}, {"split": "test"}],
    ids=["seed", "recipe", "split"],
)
def test_two_halves_of_different_data_sets_merged_by_copying(tmp_path, other):
    make(tmp_path / "a.zarr", shard_range=(0, 2))
    make(tmp_path / "b.zarr", shard_range=(1, 2), **other)
    merge(tmp_path / "b.zarr", tmp_path / "a.zarr")
    assert_right_or_refused(tmp_path / "a.zarr", [2, 3, 4])


def test_two_halves_of_one_data_set_merged_by_copying_are_the_whole(tmp_path):
    make(tmp_path / "a.zarr", shard_range=(0, 2))
    make(tmp_path / "b.zarr", shard_range=(1, 2))
    merge(tmp_path / "b.zarr", tmp_path / "a.zarr")
    make(tmp_path / "c.zarr")
    assert contents(tmp_path / "a.zarr") == contents(tmp_path / "c.zarr")
    assert verify(tmp_path / "a.zarr").sound


def test_halves_of_different_shard_sizes_merged_by_copying(tmp_path):
    make(tmp_path / "a.zarr", shard_range=(0, 2))
    make(tmp_path / "b.zarr", samples=30, shard_samples=6)
    merge(tmp_path / "b.zarr", tmp_path / "a.zarr")
    assert_right_or_refused(tmp_path / "a.zarr", [2, 3, 4])


@pytest.mark.parametrize(
    "keys", [*[(key,) for key in KEYS if key != "seed"], KEYS, (*KEYS, "checksum", "valid")], ids="+".join
)
def test_two_exchanged_shards(tmp_path, keys):
    """One array's files, all of them, or the checksums too: found by verify, and never read."""
    folder = tmp_path / "a.zarr"
    make(folder)
    for key in keys:
        for one, two in zip(files_of(folder, 1, key), files_of(folder, 2, key), strict=True):
            first, second = one.read_bytes(), two.read_bytes()
            one.write_bytes(second)
            two.write_bytes(first)
    assert_right_or_refused(folder, [1, 2])
