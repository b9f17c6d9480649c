"""Sound bytes in the wrong place: shards of another seed, of another number, of another data set."""

import json
import shutil
import tracemalloc

import google_crc32c
import numpy as np
import pytest
from fake_recipe import FakeRecipe, assert_same
from numcodecs import Blosc
from small_stores import assert_holds, contents, make

from specklegen.core.errors import RuleError
from specklegen.datasets.loading.cache import SpeckleCache
from specklegen.datasets.store import metadata
from specklegen.datasets.store.filling import GenerationError
from specklegen.datasets.store.shards import DamagedShard, ForeignShard, ShardFiles
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
            with pytest.raises(DamagedShard, match="verify FOLDER --repair"):
                cache.numpy(n)
        else:
            assert_same(cache.numpy(n) | {"index": np.int64(n)}, FakeRecipe().sample(0, "train", n))
    assert verify(folder).damaged == tuple(shards)
    verify(folder, repair=FakeRecipe())
    assert_holds(folder, FakeRecipe(), 22)


@pytest.mark.parametrize(
    "other", [{"seed": 1}, {"recipe": FakeRecipe(thickness=1.0)}, {"split": "test"}], ids=["seed", "recipe", "split"]
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


def test_generate_refuses_a_store_whose_shards_are_foreign(tmp_path):
    """The ledger, copied along, lists them: it is not enough to count what it lists."""
    make(tmp_path / "a.zarr", shard_range=(0, 2))
    make(tmp_path / "b.zarr", shard_range=(1, 2), seed=1)
    merge(tmp_path / "b.zarr", tmp_path / "a.zarr")
    with pytest.raises(GenerationError, match="3 shards of .* differ.*\n.*sample 10 of seed 1.*verify FOLDER"):
        make(tmp_path / "a.zarr")
    verify(tmp_path / "a.zarr", repair=FakeRecipe())
    assert make(tmp_path / "a.zarr")["done"] == 22


def resealed(folder, change):
    """Write a store's record and files anew, as a stranger may: every hash is right."""
    there = metadata.read(folder)
    made = change(there)
    made.write(folder)
    made.write_arrays(folder, made.samples)


@pytest.mark.parametrize("samples", [10**12, 10**30])
def test_more_samples_than_anybody_can_go_through_are_refused(tmp_path, samples):
    make(tmp_path / "a.zarr")
    resealed(tmp_path / "a.zarr", lambda there: there.replace(samples=samples, room=samples))
    with pytest.raises(RuleError, match="store metadata .samples. must be at least 1 and at most 1000000000"):
        SpeckleCache(tmp_path / "a.zarr")
    with pytest.raises(RuleError, match="generate.samples .samples. must be"):
        make(tmp_path / "b.zarr", samples=samples)
    assert not (tmp_path / "b.zarr").exists()


@pytest.mark.parametrize("rows", [0, 10**12, "5"])
def test_shards_of_no_size_are_refused(tmp_path, rows):
    make(tmp_path / "a.zarr")

    def change(there):
        group = there.files["zarr.json"]
        said = group | {"attributes": group["attributes"] | {"shard_samples": rows}}
        return metadata.Metadata(there.samples, there.room, there.files | {"zarr.json": said})

    made = change(metadata.read(tmp_path / "a.zarr"))
    made.write(tmp_path / "a.zarr")
    (tmp_path / "a.zarr/zarr.json").write_text(json.dumps(made.files["zarr.json"]))
    with pytest.raises(RuleError, match="store metadata"):
        SpeckleCache(tmp_path / "a.zarr")


def test_a_chunk_that_unpacks_to_more_is_refused_before_it_is_unpacked(tmp_path):
    """A kilobyte of zeros, packed: the header says how long it becomes, and nothing is allocated."""
    bomb = Blosc(cname="zstd").encode(bytes(2**26))
    assert len(bomb) < 2**20
    chunk = bomb + google_crc32c.value(bomb).to_bytes(4, "little")
    index = np.array([[0, len(chunk)]], "<u8").tobytes()
    file = tmp_path / "c/0/0/0"
    file.parent.mkdir(parents=True)
    file.write_bytes(chunk + index + google_crc32c.value(index).to_bytes(4, "little"))
    files = ShardFiles(tmp_path, (8, 8), np.dtype(np.uint16), 1, compressed=True)
    tracemalloc.start()
    with pytest.raises(ForeignShard, match="of the wrong size"):
        files.read(0)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 2**24
