"""The cache behind a stream: the bits of a stream without, each sample rendered once, whatever fails."""

import errno
import itertools
import os
import pickle
import warnings

import numpy as np
import pytest
import torch
from fake_recipe import FakeRecipe, assert_same
from quick_recipes import quick_recipe
from small_stores import TIMEOUT, Forked, contents, make

from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.datasets import SpeckleCache, SpeckleStream
from specklegen.datasets.store import locks, store
from specklegen.datasets.store.info import info
from specklegen.datasets.store.places import stored_bytes
from specklegen.datasets.store.verify import verify


def logged(tmp_path, **settings):
    return FakeRecipe(log=str(tmp_path / "log"), **{"samples": 50} | settings)


def rendered(tmp_path):
    """Take the numbers of the samples that were rendered since the last call."""
    file = tmp_path / "log"
    lines = file.read_text().splitlines() if file.exists() else []
    file.unlink(missing_ok=True)
    return sorted(int(line.split()[1]) for line in lines)


def assert_batches(stream, plain, epochs=1):
    for epoch in range(epochs):
        stream.set_epoch(epoch)
        plain.set_epoch(epoch)
        for a, b in zip(stream, plain, strict=True):
            assert_same(a, b)


@pytest.mark.parametrize(("batch_size", "world"), [(8, 1), (7, 3), (1, 2), (50, 1)])
def test_each_sample_is_rendered_once_with_the_same_bits(tmp_path, batch_size, world):
    """Two epochs of every rank, and again: batches that fill no shard, and shards of several ranks."""
    places = [{"rank": rank, "world": world, "batch_size": batch_size} for rank in range(world)]
    streams = [SpeckleStream(logged(tmp_path), cache=tmp_path / "a.zarr", **place) for place in places]
    assert set(rendered(tmp_path)) == {0}, "for the names of its parameters"
    for stream, place in zip(streams, places, strict=True):
        assert_batches(stream, SpeckleStream(FakeRecipe(samples=50), **place), epochs=2)
    assert rendered(tmp_path) == [*range(100)]
    assert verify(tmp_path / "a.zarr").sound
    assert info(tmp_path / "a.zarr")["done"] == 100
    for stream, place in zip(streams, places, strict=True):
        again = SpeckleStream(logged(tmp_path), cache=tmp_path / "a.zarr", **place)
        for reader in (stream, pickle.loads(pickle.dumps(again))):
            assert_batches(reader, SpeckleStream(FakeRecipe(samples=50), **place), epochs=2)
    assert rendered(tmp_path) == []


def test_a_full_cache_has_the_bytes_of_generate(tmp_path):
    list(SpeckleStream(FakeRecipe(samples=22), cache=tmp_path / "a.zarr", batch_size=16))
    make(tmp_path / "b.zarr", FakeRecipe(samples=22), shard_samples=16)
    assert contents(tmp_path / "a.zarr") == contents(tmp_path / "b.zarr")


def test_a_store_of_generate_is_read_and_filled_up(tmp_path):
    make(tmp_path / "a.zarr", samples=13, dtype="float32")
    stream = SpeckleStream(logged(tmp_path), cache=tmp_path / "a.zarr", batch_size=8)
    assert_batches(stream, SpeckleStream(FakeRecipe(samples=50), batch_size=8))
    assert rendered(tmp_path) == [*range(13, 50)]
    assert make(tmp_path / "a.zarr", samples=60, dtype="float32")["rendered"] == 10
    cache = SpeckleCache(tmp_path / "a.zarr")
    assert_same(cache.numpy(57) | {"index": np.int64(57)}, FakeRecipe().sample(0, "train", 57))


@pytest.mark.parametrize(
    ("recipe", "options", "words"),
    [(FakeRecipe(thickness=999.0), {}, r"recipe\.medium\.thickness"), (FakeRecipe(), {"seed": 1}, r"seed \(0 there"),
     (FakeRecipe(), {"split": "test"}, "split"), (FakeRecipe(data_version=2), {}, "data_version")],
)  # fmt: skip
def test_another_data_set_is_refused_by_name(tmp_path, recipe, options, words):
    SpeckleStream(FakeRecipe(), cache=tmp_path / "a.zarr")
    with pytest.raises(RuleError, match=words):
        SpeckleStream(recipe, cache=tmp_path / "a.zarr", **options)


def test_a_limit_without_a_cache_is_refused():
    with pytest.raises(RuleError, match="cache_limit must be left out"):
        SpeckleStream(FakeRecipe(), cache_limit=1000)


def test_workers_and_a_resumed_loader_share_it(tmp_path):
    recipe = logged(tmp_path)
    plain = [*SpeckleStream(FakeRecipe(samples=50), batch_size=8).loader()]
    loader = SpeckleStream(recipe, cache=tmp_path / "a.zarr", batch_size=8).loader(num_workers=2)
    before = [*itertools.islice(loader, 3)]
    state = loader.state_dict()
    del loader
    loader = SpeckleStream(recipe, cache=tmp_path / "a.zarr", batch_size=8).loader()
    loader.load_state_dict(state)
    for a, b in zip([*before, *loader], plain, strict=True):
        assert_same(a, b)
    assert set(rendered(tmp_path)) == {*range(50)}
    assert verify(tmp_path / "a.zarr").sound


def trained(folder, size):
    """Two epochs, in which nothing is warned of."""
    warnings.simplefilter("error")
    torch.set_num_threads(1)
    stream = SpeckleStream(FakeRecipe(samples=50, seconds=0.001), cache=folder, batch_size=size)
    for epoch in (0, 1):
        stream.set_epoch(epoch)
        assert len([*stream]) > 0


def test_trainings_at_once_and_one_that_is_killed_lose_nothing(tmp_path):
    started = [Forked(target=trained, args=(tmp_path / "a.zarr", size)) for size in (8, 5, 7)]
    for each in started:
        each.start()
    while not (tmp_path / "a.zarr/valid/c/1").exists() and started[2].is_alive():
        pass
    started[2].kill()
    assert [each.wait(TIMEOUT) for each in started[:2]] == [0, 0]
    started[2].wait(TIMEOUT)
    assert verify(tmp_path / "a.zarr").sound
    stream = SpeckleStream(logged(tmp_path), cache=tmp_path / "a.zarr", batch_size=8)
    assert_batches(stream, SpeckleStream(FakeRecipe(samples=50), batch_size=8), epochs=2)
    assert rendered(tmp_path) == []


def test_a_full_disk_ends_the_writing_and_not_the_training(tmp_path, monkeypatch):
    stream = SpeckleStream(logged(tmp_path), cache=tmp_path / "a.zarr", batch_size=8)
    write, left = store.put, iter(range(20))

    def filling(file, data, **options):
        if next(left, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(file, data, **options)

    monkeypatch.setattr(store, "put", filling)
    with pytest.warns(DoubtWarning, match="No further samples are cached in .*No space left") as told:
        assert_batches(stream, SpeckleStream(FakeRecipe(samples=50), batch_size=8), epochs=2)
    assert len(told) == 1
    monkeypatch.undo()
    assert verify(tmp_path / "a.zarr").sound
    again = SpeckleStream(logged(tmp_path), cache=tmp_path / "a.zarr", batch_size=8)
    assert_batches(again, SpeckleStream(FakeRecipe(samples=50), batch_size=8), epochs=2)


def test_a_limit_ends_the_writing_and_not_the_training(tmp_path):
    SpeckleStream(FakeRecipe(samples=50), cache=tmp_path / "a.zarr", batch_size=8)
    limit = stored_bytes(tmp_path / "a.zarr") + 30_000
    stream = SpeckleStream(logged(tmp_path), cache=tmp_path / "a.zarr", batch_size=8, cache_limit=limit)
    with pytest.warns(DoubtWarning, match=f"cache_limit = {limit} bytes"):
        assert_batches(stream, SpeckleStream(FakeRecipe(samples=50), batch_size=8), epochs=2)
    assert 8 <= info(tmp_path / "a.zarr")["done"] < 50
    assert stored_bytes(tmp_path / "a.zarr") <= limit
    again = SpeckleStream(FakeRecipe(samples=50), cache=tmp_path / "a.zarr", batch_size=8, cache_limit=0)
    with pytest.warns(DoubtWarning, match="cache_limit = 0"):
        assert_batches(again, SpeckleStream(FakeRecipe(samples=50), batch_size=8))


@pytest.mark.parametrize("damage", ["byte", "gone", "ledger"])
def test_a_damaged_sample_is_rendered_and_written_anew(tmp_path, damage):
    list(SpeckleStream(FakeRecipe(samples=50), cache=tmp_path / "a.zarr", batch_size=8))
    file = tmp_path / "a.zarr" / ("valid/c/1" if damage == "ledger" else "image/c/1/0/0")
    if damage == "gone":
        file.unlink()
    else:
        data = bytearray(file.read_bytes())
        data[3] ^= 1
        file.write_bytes(data)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = SpeckleStream(logged(tmp_path), cache=tmp_path / "a.zarr", batch_size=8)
        assert_batches(again, SpeckleStream(FakeRecipe(samples=50), batch_size=8))
    assert 0 < len(rendered(tmp_path)) <= 17
    assert verify(tmp_path / "a.zarr").sound
    assert info(tmp_path / "a.zarr")["done"] == 50


def test_another_process_made_room_and_wrote_into_the_same_shard(tmp_path):
    """Its samples stay, though this one opened the store when it had no room for them."""
    make(tmp_path / "a.zarr", samples=8, shard_range=(0, 2))
    first = SpeckleStream(logged(tmp_path, samples=8), cache=tmp_path / "a.zarr", batch_size=8)
    make(tmp_path / "a.zarr", samples=22)
    (tmp_path / "a.zarr/valid/c/0").unlink()
    assert_batches(first, SpeckleStream(FakeRecipe(samples=8), batch_size=8))
    cache = SpeckleCache(tmp_path / "a.zarr")
    for n in range(22):
        assert_same(cache.numpy(n) | {"index": np.int64(n)}, FakeRecipe().sample(0, "train", n))
    assert verify(tmp_path / "a.zarr").sound


def test_without_locks_whole_shards_alone_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(locks, "fcntl", None)
    stream = SpeckleStream(logged(tmp_path), cache=tmp_path / "a.zarr", batch_size=16)
    assert_batches(stream, SpeckleStream(FakeRecipe(samples=50), batch_size=16))
    assert info(tmp_path / "a.zarr")["done"] == 50
    stream = SpeckleStream(logged(tmp_path), seed=1, cache=tmp_path / "b.zarr", batch_size=12)
    assert_batches(stream, SpeckleStream(FakeRecipe(samples=50), seed=1, batch_size=12))
    assert info(tmp_path / "b.zarr")["done"] == 2, "of 12 samples a batch, half a shard, the last batch alone"
    assert verify(tmp_path / "b.zarr").sound


def test_an_address_is_a_cache_too(tmp_path, request):
    fsspec, upath = pytest.importorskip("fsspec"), pytest.importorskip("upath", reason="needs the extra remote")
    place = upath.UPath(f"memory://{request.node.name}/a.zarr")
    stream = SpeckleStream(logged(tmp_path), cache=place, batch_size=7)
    assert_batches(stream, SpeckleStream(FakeRecipe(samples=50), batch_size=7))
    rendered(tmp_path)
    again = SpeckleStream(logged(tmp_path), cache=str(place), batch_size=10)
    assert_batches(again, SpeckleStream(FakeRecipe(samples=50), batch_size=10))
    assert rendered(tmp_path) == []
    assert verify(place).sound
    fsspec.filesystem("memory").rm(f"/{request.node.name}", recursive=True)


@pytest.mark.parametrize("error", [type("EndpointConnectionError", (Exception,), {}), ConnectionRefusedError])
def test_an_address_that_gives_no_answer_ends_the_writing_and_not_the_training(monkeypatch, request, error):
    fsspec, upath = pytest.importorskip("fsspec"), pytest.importorskip("upath", reason="needs the extra remote")
    place, system = upath.UPath(f"memory://{request.node.originalname}/a.zarr"), fsspec.get_filesystem_class("memory")
    plain, read = SpeckleStream(FakeRecipe(samples=16), batch_size=4), system.cat_file
    for answers in (3, 40, 60):
        stream, left = SpeckleStream(FakeRecipe(samples=16), cache=place, batch_size=4), iter(range(answers))

        def lost(self, *words, left=left, **options):
            if next(left, None) is None:
                raise error("Could not connect")
            return read(self, *words, **options)

        with monkeypatch.context() as patch:
            patch.setattr(system, "cat_file", lost)
            with pytest.warns(DoubtWarning, match="No further samples are cached.*Could not"):
                assert_batches(stream, plain, epochs=2)
        assert verify(place).sound
    place.fs.rm(f"/{request.node.originalname}", recursive=True)


@pytest.mark.parametrize("split", ["train", "validation"])
def test_a_recipe_of_the_gallery_keeps_its_bits(tmp_path, split):
    recipe = quick_recipe("through-slab", samples={"train": 6, "validation": 6})
    for _ in range(2):
        stream = SpeckleStream(recipe, split=split, cache=tmp_path / "a.zarr", batch_size=4)
        assert_batches(stream, SpeckleStream(recipe, split=split, batch_size=4))
