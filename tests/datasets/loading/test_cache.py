"""The cache: no sample that is not there, no damaged byte, shuffled epochs, export."""

import csv
import itertools
import os
import pickle
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
import zarr
from fake_recipe import FakeRecipe, assert_same
from skimage.io import imread
from torch.utils.data import DataLoader

from specklegen.datasets import SpeckleCache, SpeckleStream  # noqa: E402
from specklegen.datasets.loading.export import export  # noqa: E402
from specklegen.datasets.store.creation import grown  # noqa: E402
from specklegen.datasets.store.generate import _fill_here, generate  # noqa: E402
from specklegen.datasets.store.places import LocalFile  # noqa: E402
from specklegen.datasets.store.shards import DamagedShard, ForeignShard, MissingSample  # noqa: E402
from specklegen.datasets.store.store import Store  # noqa: E402

TIMEOUT = 120
SAMPLES = 48


def fill(folder, **options):
    settings = {"samples": SAMPLES, "shard_samples": 5, "processes": 1} | options
    generate(FakeRecipe(), folder=folder, **settings)
    return folder


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return fill(tmp_path_factory.mktemp("store") / "a.zarr")


def indices(batches):
    return [batch["index"].tolist() for batch in batches]


def test_samples_are_tensors_and_equal_the_stream(whole):
    cache = SpeckleCache(whole)
    assert len(cache) == SAMPLES
    assert isinstance(cache[0]["image"], torch.Tensor)
    assert cache[-1]["index"] == SAMPLES - 1
    with pytest.raises(IndexError):
        cache[SAMPLES]
    batch = next(iter(SpeckleStream(FakeRecipe(), batch_size=8)))
    assert_same(cache.batch(range(8)), batch)
    assert_same(next(iter(DataLoader(cache, batch_size=8))), batch)
    backwards = cache.batch([7, 3, 3])
    assert backwards["index"].tolist() == [7, 3, 3]


@pytest.mark.parametrize("method", ["fork", "forkserver"])
def test_workers_read_the_same(whole, method):
    cache = SpeckleCache(whole)
    cache.numpy(0)  # files are open in the parent when it forks
    loader = DataLoader(cache, batch_size=10, num_workers=2, timeout=TIMEOUT, multiprocessing_context=method)
    for batch, again in zip(loader, DataLoader(cache, batch_size=10), strict=True):
        assert_same(batch, again)


def test_a_file_is_not_closed_while_it_is_read(whole, monkeypatch):
    """One thread is about to read a part when another gives the file up; its descriptor may by then be another's."""
    files = SpeckleCache(whole).store.shard_files["image"]
    expected, part = files.read(7), LocalFile.part
    closed = []

    def slowly(self, start, length):
        if not closed:
            closed.append(True)
            other = threading.Thread(target=files.close)
            other.start()
            other.join()
        return part(self, start, length)

    monkeypatch.setattr(LocalFile, "part", slowly)
    np.testing.assert_array_equal(files.read(7), expected)
    assert closed
    assert not files._open


def test_one_cache_is_read_by_many_threads(whole, monkeypatch):
    """More shards than files that stay open, so that threads close what others have opened."""
    monkeypatch.setattr("specklegen.datasets.store.shards._OPEN_FILES", 1)
    cache = SpeckleCache(whole)
    expected = [cache.numpy(n) for n in range(SAMPLES)]

    def read(seed):
        for n in np.random.default_rng(seed).integers(SAMPLES, size=250).tolist():
            if n % 11 == 0:
                cache._reader._forget(n // cache.shard_samples)
            assert_same(cache.numpy(n), expected[n])

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(read, range(8)))


def test_pickling(whole):
    cache = SpeckleCache(whole)
    cache.numpy(3)
    assert_same(pickle.loads(pickle.dumps(cache)).numpy(3), cache.numpy(3))


def test_a_worker_does_not_read_what_the_path_leads_to_by_then(tmp_path):
    """A link is moved between opening a store and the start of the workers: they would give seed 1 for seed 0."""
    for seed in (0, 1):
        fill(tmp_path / f"{seed}.zarr", seed=seed, samples=5)
    link = tmp_path / "latest"
    link.symlink_to(tmp_path / "0.zarr")
    cache = SpeckleCache(link)
    sent = pickle.dumps(cache)
    assert_same(pickle.loads(sent)[3], cache[3])
    link.unlink()
    link.symlink_to(tmp_path / "1.zarr")
    assert cache.identity["seed"] == 0
    with pytest.raises(ForeignShard, match="was replaced since it was opened: it holds data set"):
        pickle.loads(sent)


def test_a_call_fills_the_store_that_its_link_led_to_when_it_began(tmp_path):
    """Its shards are those of one store, however often the link is moved meanwhile."""
    link = tmp_path / "latest"
    (tmp_path / "0.zarr").mkdir()
    link.symlink_to(tmp_path / "0.zarr")
    fill(tmp_path / "1.zarr", seed=1, samples=10)

    def move(done, total):  # noqa: ARG001
        link.unlink(missing_ok=True)
        link.symlink_to(tmp_path / "1.zarr")

    fill(link, samples=10, progress=move)
    for seed in (0, 1):
        cache = SpeckleCache(tmp_path / f"{seed}.zarr")
        for n in range(10):
            assert_same(cache.numpy(n), FakeRecipe().sample(seed, "train", n))


def test_a_worker_does_not_fill_another_store(tmp_path, monkeypatch):
    store = Store(fill(tmp_path / "a.zarr", samples=5))
    monkeypatch.setattr("specklegen.datasets.store.generate._job", (store, FakeRecipe(), "0" * 64))
    outcome = _fill_here(0, False)
    assert outcome.state == "failed"
    assert "was replaced since it was opened: it holds data set" in outcome.message


def test_a_sample_that_is_not_there_raises(tmp_path):
    folder = fill(tmp_path / "a.zarr", shard_range=(0, 2))
    cache = SpeckleCache(folder)
    cache.numpy(24)
    for index in (25, 47):
        with pytest.raises(MissingSample, match=f"sample {index} "):
            cache[index]
    fill(folder)
    assert cache.numpy(25)["index"] == 25, "the cache sees what was generated since"


def test_a_shard_that_was_replaced_is_opened_anew(tmp_path):
    folder = fill(tmp_path / "a.zarr", samples=8)
    grown(Store(folder), 10)
    cache = SpeckleCache(folder)
    cache[7]
    with pytest.raises(MissingSample):
        cache[9]
    fill(folder, samples=10)
    assert cache[9]["index"] == 9


def test_a_sample_that_its_shard_does_not_hold_is_missing_whatever_the_ledger_says(tmp_path):
    folder = fill(tmp_path / "a.zarr", samples=8)
    grown(Store(folder), 10)
    zarr.open_group(folder, mode="r+")["valid"][:] = True
    with pytest.raises(MissingSample, match="does not hold sample 9"):
        SpeckleCache(folder)[9]


def test_a_sample_that_is_not_there_is_rendered_when_asked(tmp_path):
    folder = fill(tmp_path / "a.zarr", shard_range=(0, 2))
    cache = SpeckleCache(folder, missing="render", recipe=FakeRecipe())
    whole = SpeckleCache(fill(tmp_path / "b.zarr"))
    assert_same(cache.batch(range(SAMPLES)), whole.batch(range(SAMPLES)))


def test_a_ledger_that_lies_is_found_out(tmp_path):
    """A file that vanished reads as zeros in zarr, without an error; here it is missing."""
    folder = fill(tmp_path / "a.zarr")
    (folder / "object/c/2/0/0").unlink()
    with pytest.raises(MissingSample):
        SpeckleCache(folder)[12]
    cache = SpeckleCache(folder, missing="render", recipe=FakeRecipe())
    np.testing.assert_array_equal(cache[12]["object"], FakeRecipe().sample(0, "train", 12)["object"])


@pytest.mark.parametrize("key", ["image", "field", "level", "parameters", "index", "valid"])
def test_no_flipped_byte_is_ever_read(tmp_path, key):
    """Every byte that belongs to a sample is under a CRC32C: flip any, and reading all samples raises."""
    folder = fill(tmp_path / "a.zarr", samples=5)
    file = next(path for path in (folder / key / "c").rglob("*") if path.is_file())
    good = file.read_bytes()
    places = np.unique(np.linspace(0, len(good) - 1, 40).astype(int))
    for place in places:
        data = bytearray(good)
        data[place] ^= 0x10
        file.write_bytes(data)
        with pytest.raises(DamagedShard):
            SpeckleCache(folder).batch(range(5))
    file.write_bytes(good)
    SpeckleCache(folder).batch(range(5))


@pytest.mark.parametrize(
    ("options", "words"),
    [({"missing": "zeros"}, "missing must be one of"), ({"missing": "render"}, "recipe must be given"),
     ({"recipe": FakeRecipe(thickness=2.0)}, "thickness")],
)  # fmt: skip
def test_bad_settings_are_named(whole, options, words):
    with pytest.raises(ValueError, match=words):
        SpeckleCache(whole, **options)


def test_no_store_there(tmp_path):
    with pytest.raises(ValueError, match="store.folder must be a folder that holds a store"):
        SpeckleCache(tmp_path / "nowhere.zarr")


@pytest.mark.parametrize("world", [1, 2])
def test_shuffled_epochs_hold_each_sample_once_in_another_order(whole, world):
    cache = SpeckleCache(whole)
    ranks = [cache.shuffled(7, seed=1, buffer_shards=2, rank=rank, world=world) for rank in range(world)]
    orders = []
    for epoch in (0, 1):
        for rank in ranks:
            rank.set_epoch(epoch)
        orders.append([n for rank in ranks for batch in indices(rank) for n in batch])
        assert sorted(orders[-1]) == list(range(SAMPLES))
    assert orders[0] != orders[1]


def test_shuffled_reading_stays_within_the_buffer(tmp_path):
    """While buffer_shards shards last, no other is read; their samples are shuffled among themselves."""
    cache = SpeckleCache(fill(tmp_path / "a.zarr", samples=50))
    order = cache.shuffled(seed=0, buffer_shards=2).order(0)
    shards = [set((order[start : start + 10] // 5).tolist()) for start in range(0, 50, 10)]
    assert [len(group) for group in shards] == [2] * 5
    assert np.count_nonzero(np.diff(order // 5)) > 12, "9 changes of shard would be no mixing at all"
    other = cache.shuffled(seed=1, buffer_shards=2).order(0)
    assert order.tolist() != other.tolist()


def test_shuffled_resume_with_another_number_of_workers(whole):
    def fresh(workers):
        batches = SpeckleCache(whole).shuffled(7, seed=2)
        batches.set_epoch(3)
        return batches.loader(num_workers=workers, timeout=TIMEOUT)

    first = fresh(2)
    head = list(itertools.islice(first, 3))
    second = fresh(0)
    second.load_state_dict(first.state_dict())
    assert indices(head) + indices(second) == indices(fresh(0))


def test_export_npy(whole, tmp_path):
    files = export(whole, tmp_path / "out", samples=[4, 40])
    assert [file.name for file in files] == ["image.npy", "field.npy", "object.npy", "level.npy", "samples.csv"]
    cache = SpeckleCache(whole)
    for row, index in enumerate((4, 40)):
        for key in ("image", "field", "object", "level"):
            array = np.load(tmp_path / "out" / f"{key}.npy")
            assert array[row].tobytes() == cache.numpy(index)[key].tobytes()
    rows = list(csv.DictReader((tmp_path / "out" / "samples.csv").open()))
    assert [int(row["index"]) for row in rows] == [4, 40]
    assert float(rows[1]["thickness"]) == cache.numpy(40)["parameters"]["thickness"]


def test_export_png(whole, tmp_path):
    export(whole, tmp_path / "out", format="png", samples=[4])
    sample = SpeckleCache(whole).numpy(4)
    np.testing.assert_array_equal(imread(tmp_path / "out/image_000004.png"), sample["image"])
    picture = imread(tmp_path / "out/field_000004.png")
    assert picture.shape == (8, 16)
    row = next(csv.DictReader((tmp_path / "out" / "samples.csv").open()))
    least, greatest = float(row["field_min"]), float(row["field_max"])
    back = least + picture / 65535 * (greatest - least)
    np.testing.assert_allclose(back[:, 8:], sample["field"][1], atol=(greatest - least) / 65535)
    assert not list((tmp_path / "out").glob("level*"))


@pytest.mark.parametrize(("options", "words"), [({"format": "tiff"}, "format"), ({"samples": []}, "samples")])
def test_export_names_bad_settings(whole, tmp_path, options, words):
    with pytest.raises(ValueError, match=f"export.{words} must be"):
        export(whole, tmp_path / "out", **options)


def test_import_stays_light():
    code = "import sys, specklegen.datasets; print(*sys.modules)"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    run = [sys.executable, "-c", code]
    loaded = subprocess.run(run, check=True, timeout=TIMEOUT, env=environment, capture_output=True, text=True).stdout
    assert "specklegen.datasets" in loaded.split()
    assert not {"torch", "zarr"} & set(loaded.split())
