"""The store: what is written is read, by plain readers too; growing, refusing."""

import os
import subprocess
import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import xarray
import zarr
from fake_recipe import FakeRecipe
from scenes import ROOT
from small_stores import TIMEOUT, assert_holds, contents, make
from zarr.core.codec_pipeline import BatchedCodecPipeline
from zarr.registry import register_pipeline

from specklegen.datasets.loading.cache import SpeckleCache
from specklegen.datasets.sample_schema import ArraySpec, stored_arrays
from specklegen.datasets.store import encoding, store
from specklegen.datasets.store.filling import GenerationError
from specklegen.datasets.store.identity import differences, fingerprint, identity
from specklegen.datasets.store.info import info
from specklegen.datasets.store.layout import default_shard_samples
from specklegen.datasets.store.verify import verify


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_samples_come_back_to_the_bit(tmp_path, dtype):
    result = make(tmp_path / "a.zarr", dtype=dtype, seed=3, split="test")
    assert (result["done"], result["total"], result["shards"]) == (22, 22, 5)
    assert result["arrays"]["image"]["dtype"] == dtype
    assert result["arrays"]["object"]["dtype"] == "float32"
    assert_holds(tmp_path / "a.zarr", FakeRecipe(), 22, seed=3, split="test")


def test_zarr_reads_what_the_checked_reader_reads(tmp_path):
    make(tmp_path / "a.zarr")
    group, cache = zarr.open_group(tmp_path / "a.zarr", mode="r"), SpeckleCache(tmp_path / "a.zarr")
    for n in range(22):
        sample = cache.numpy(n)
        for key in ("image", "field", "object", "level"):
            np.testing.assert_array_equal(group[key][n], sample[key])
        names = group["parameters"].attrs["names"]
        assert dict(zip(names, group["parameters"][n], strict=True)) == sample["parameters"]
    np.testing.assert_array_equal(group["index"][:], np.arange(22))
    np.testing.assert_array_equal(group["seed"][:], 0)
    assert group["valid"][:].all()


@pytest.mark.filterwarnings("error::UserWarning")
def test_xarray_reads_names_units_and_recipe(tmp_path):
    recipe = FakeRecipe()
    make(tmp_path / "a.zarr", recipe)
    data = xarray.open_zarr(tmp_path / "a.zarr", consolidated=False)
    assert data["image"].dims == ("sample", "y", "x")
    assert data["field"].dims == ("sample", "tilt", "y", "x")
    assert data["image"].attrs["units"] == "counts"
    assert data.attrs["recipe"]["medium"]["thickness"] == recipe.thickness
    np.testing.assert_array_equal(data["image"][7], recipe.sample(0, "train", 7)["image"])


def test_plain_readers_do_not_need_specklegen(tmp_path):
    make(tmp_path / "a.zarr")
    code = (
        "import sys, zarr; group = zarr.open_group(sys.argv[1], mode='r');"
        "print(sorted(dict(group.arrays())), int(group['image'][3].sum()), group.attrs['title']);"
        "assert 'specklegen' not in sys.modules"
    )
    command = [sys.executable, "-W", "error::UserWarning", "-c", code, tmp_path / "a.zarr"]
    out = subprocess.run(command, capture_output=True, text=True, check=True, timeout=TIMEOUT).stdout
    total = int(FakeRecipe().sample(0, "train", 3)["image"].sum())
    names = ["checksum", "field", "image", "index", "level", "object", "parameters", "seal", "seed", "valid"]
    assert out.strip() == f"{names} {total} fake"


class WithoutZeros(BatchedCodecPipeline):
    """A pipeline that writes no chunk of zeros, whatever the array asks for, as that of ``zarrs``."""

    async def write(self, batch_info, value, drop_axes=()):
        batch = [
            (place, replace(chunk, config=replace(chunk.config, write_empty_chunks=False)), *rest)
            for place, chunk, *rest in batch_info
        ]
        await super().write(batch, value, drop_axes)


register_pipeline(WithoutZeros)

SETTINGS = {
    "codec_pipeline.path": "no.such.Pipeline",
    "codec_pipeline.batch_size": 3,
    "array.write_empty_chunks": False,
    "array.read_missing_chunks": False,
    "array.order": "F",
    "array.target_shard_size_bytes": 16,
    "async.concurrency": 1,
    "async.timeout": 1e-9,
    "threading.max_workers": 1,
    "default_zarr_format": 2,
    "json_indent": 7,
    "buffer": "no.such.Buffer",
    "ndbuffer": "no.such.Buffer",
}
"""Each of zarr's settings but its codecs, far from its default."""


def _settings(nested, before=""):
    """Names of all settings of the zarr that is installed."""
    for name, value in nested.items():
        yield from _settings(value, f"{before}{name}.") if isinstance(value, dict) else [before + name]


def test_a_store_is_the_same_under_any_settings_of_zarr(tmp_path):
    names = {*_settings(zarr.config.config)}
    codecs = {name: "no.such.Codec" for name in names if name.startswith("codecs.")}
    assert names <= SETTINGS.keys() | codecs.keys(), "a new setting of zarr: give it a value here"
    make(tmp_path / "plain.zarr", Dark())
    with zarr.config.set(SETTINGS | codecs):
        make(tmp_path / "set.zarr", Dark())
        assert verify(tmp_path / "set.zarr").sound
        assert_holds(tmp_path / "set.zarr", Dark(), 22)
    assert contents(tmp_path / "set.zarr") == contents(tmp_path / "plain.zarr")


ENVIRONMENT = {
    "ZARR_CODEC_PIPELINE__PATH": "zarrs.ZarrsCodecPipeline", "ZARR_ARRAY__ORDER": "F",
    "ZARR_ARRAY__WRITE_EMPTY_CHUNKS": "False", "ZARR_DEFAULT_ZARR_FORMAT": "2",
    # The library that packs whole numbers reads these, where it is called from the main thread.
    "BLOSC_CLEVEL": "0", "BLOSC_SHUFFLE": "NOSHUFFLE", "BLOSC_TYPESIZE": "8", "BLOSC_COMPRESSOR": "lz4",
    "BLOSC_BLOCKSIZE": "32", "BLOSC_NTHREADS": "2", "BLOSC_SPLITMODE": "ALWAYS", "BLOSC_NOLOCK": "1",
}  # fmt: skip


def test_stores_are_written_checked_and_read_without_zarr_under_any_environment(tmp_path):
    """No setting, no variable and no version of it can reach what is never loaded."""
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); sys.modules['zarr'] = None\n"
        "from small_stores import FakeRecipe, assert_holds, make\n"
        "from specklegen.datasets.store.verify import verify\n"
        "make(sys.argv[2]); assert_holds(sys.argv[2], FakeRecipe(), 22); print(verify(sys.argv[2]).sound)"
    )
    command = [sys.executable, "-c", code, ROOT / "tests", tmp_path / "a.zarr"]
    environment = os.environ | ENVIRONMENT
    out = subprocess.run(command, capture_output=True, text=True, check=True, timeout=TIMEOUT, env=environment).stdout
    assert out.strip() == "True"
    make(tmp_path / "b.zarr")
    assert contents(tmp_path / "a.zarr") == contents(tmp_path / "b.zarr")


class Dark(FakeRecipe):
    """A recipe whose samples are zeros, as zarr fills in for a chunk that is not there."""

    def sample(self, seed, split, index):
        sample = super().sample(seed, split, index)
        return sample | {key: np.zeros_like(sample[key]) for key in ("image", "field", "object", "level")}


@pytest.mark.parametrize("pipeline", ["own", "zarrs.ZarrsCodecPipeline"])
def test_samples_of_zeros_are_written_where_zarr_would_leave_them_out(tmp_path, pipeline):
    if pipeline != "own":
        pytest.importorskip("zarrs")
    path = f"{WithoutZeros.__module__}.{WithoutZeros.__qualname__}" if pipeline == "own" else pipeline
    with zarr.config.set({"codec_pipeline.path": path, "array.write_empty_chunks": False}):
        array = zarr.create_array(tmp_path / "other.zarr", shape=(4,), chunks=(2,), dtype="uint16",
                                  config={"write_empty_chunks": True})  # fmt: skip
        array[:2] = 0
        assert not (tmp_path / "other.zarr/c/0").exists(), "such chunks it leaves out"
        make(tmp_path / "a.zarr", Dark())
        assert verify(tmp_path / "a.zarr").sound
    assert_holds(tmp_path / "a.zarr", Dark(), 22)


def test_what_verify_calls_sound_can_be_read(tmp_path, monkeypatch):
    """A store whose checksums are right, and whose samples its reader refuses."""
    make(tmp_path / "a.zarr")
    assert verify(tmp_path / "a.zarr").sound
    whole = encoding.shard_bytes
    monkeypatch.setattr(encoding, "shard_bytes", lambda samples, rows: whole(dict(list(samples.items())[:-1]), rows))
    monkeypatch.setattr(store, "shard_bytes", encoding.shard_bytes)
    make(tmp_path / "b.zarr")
    assert verify(tmp_path / "b.zarr").damaged == (0, 1, 2, 3, 4)


def test_worker_processes_write_the_same_bytes(tmp_path):
    make(tmp_path / "one.zarr")
    make(tmp_path / "two.zarr", processes=2)
    assert contents(tmp_path / "one.zarr") == contents(tmp_path / "two.zarr")


def test_shard_ranges_equal_one_run(tmp_path):
    make(tmp_path / "whole.zarr")
    results = [make(tmp_path / "parts.zarr", shard_range=(part, 3)) for part in (2, 0, 1)]
    assert [(result["done"], result["total"]) for result in results] == [(7, 7), (5, 5), (10, 10)]
    assert contents(tmp_path / "whole.zarr") == contents(tmp_path / "parts.zarr")


def test_rerunning_renders_nothing_and_growing_only_what_is_new(tmp_path):
    log = tmp_path / "log"
    recipe = FakeRecipe(log=str(log))
    make(tmp_path / "a.zarr", recipe, samples=10)
    before = contents(tmp_path / "a.zarr")
    log.unlink()
    make(tmp_path / "a.zarr", recipe, samples=10)
    assert not log.exists()
    assert contents(tmp_path / "a.zarr") == before
    make(tmp_path / "a.zarr", recipe, samples=22)
    assert {int(line.split()[1]) for line in log.read_text().splitlines()} == set(range(10, 22))
    make(tmp_path / "b.zarr", recipe, samples=22)
    assert contents(tmp_path / "a.zarr") == contents(tmp_path / "b.zarr")


def test_growing_from_a_shard_that_was_not_full(tmp_path):
    make(tmp_path / "a.zarr", samples=8)
    cache = SpeckleCache(tmp_path / "a.zarr")
    cache.numpy(7)
    make(tmp_path / "a.zarr", samples=22)
    assert_holds(tmp_path / "a.zarr", FakeRecipe(), 22)
    assert verify(tmp_path / "a.zarr").sound


def test_fewer_samples_than_the_store_holds_are_a_part_of_it(tmp_path):
    make(tmp_path / "a.zarr")
    assert make(tmp_path / "a.zarr", samples=6)["total"] == 22


@pytest.mark.parametrize(
    ("changes", "field"),
    [({"recipe": FakeRecipe(thickness=999.0)}, r"recipe\.medium\.thickness \(1000\.0 there, 999\.0 here\)"),
     ({"seed": 1}, r"seed \(0 there, 1 here\)"), ({"split": "test"}, "split"),
     ({"dtype": "float32"}, "dtype"), ({"recipe": FakeRecipe(data_version=2)}, "data_version")],
)  # fmt: skip
def test_another_data_set_is_refused_by_the_fields_that_differ(tmp_path, changes, field):
    make(tmp_path / "a.zarr")
    before = contents(tmp_path / "a.zarr")
    with pytest.raises(ValueError, match=field):
        make(tmp_path / "a.zarr", **changes)
    assert contents(tmp_path / "a.zarr") == before


def test_a_folder_of_other_things_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(ValueError, match="store.folder must be"):
        make(tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "precious"
    zarr.create_group(tmp_path / "other.zarr", zarr_format=3)
    with pytest.raises(ValueError, match="store.folder must be"):
        make(tmp_path / "other.zarr")


def test_an_unwritable_folder_is_named(tmp_path):
    """A file in the way stands for every reason, since tests may run as root, who may write everywhere."""
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="generate.folder must be a folder in which you can write"):
        make(tmp_path / "file" / "a.zarr")
    with pytest.raises(ValueError, match="store.folder must be"):
        make(tmp_path / "file")


def test_the_fingerprint_changes_with_what_decides_the_bytes_and_nothing_else():
    base = fingerprint(identity(FakeRecipe(), 0, "train"))
    same = [FakeRecipe(name="renamed"), FakeRecipe(samples=7), FakeRecipe(seconds=1.0), FakeRecipe(log="x")]
    assert {fingerprint(identity(recipe, 0, "train")) for recipe in same} == {base}
    others = [
        identity(FakeRecipe(thickness=1000.0000001), 0, "train"),
        identity(FakeRecipe(side=9), 0, "train"),
        identity(FakeRecipe(data_version=2), 0, "train"),
        identity(FakeRecipe(), 1, "train"),
        identity(FakeRecipe(), 0, "test"),
        identity(FakeRecipe(), 0, "train", "float32"),
    ]
    assert len({base, *map(fingerprint, others)}) == 7


def test_the_fingerprint_does_not_depend_on_how_it_is_generated(tmp_path):
    a = make(tmp_path / "a.zarr")
    b = make(tmp_path / "b.zarr", samples=10, shard_samples=3, shard_range=(0, 2))
    assert a["fingerprint"] == b["fingerprint"] == fingerprint(identity(FakeRecipe(), 0, "train"))


def test_differences_name_nested_fields_and_absent_ones():
    there, here = {"a": {"b": [{"g": 0.9}], "c": 1}}, {"a": {"b": [{"g": 0.8}]}, "d": {}}
    assert differences(there, here) == [
        "a.b[0].g (0.9 there, 0.8 here)",
        "a.c (1 there, absent here)",
        "d (absent there, {} here)",
    ]
    assert differences(there, there) == []


def test_progress_and_info(tmp_path):
    calls = []
    make(tmp_path / "a.zarr", shard_range=(0, 2), progress=lambda done, total: calls.append((done, total)))
    assert calls == [(0, 10), (5, 10), (10, 10)]
    told = info(tmp_path / "a.zarr")
    assert (told["done"], told["total"], told["shards_done"], told["shards"]) == (10, 22, 2, 5)
    files = [file for file in (tmp_path / "a.zarr").rglob("*") if file.is_file()]
    assert told["bytes"] == sum(file.stat().st_size for file in files)
    assert told["recipe"] == identity(FakeRecipe(), 0, "train")["recipe"]
    assert told["parameters"] == ["thickness", "level"]


def test_the_card_says_what_is_in_the_store(tmp_path):
    make(tmp_path / "a.zarr", notes="Media are disjoint between splits.")
    text = (tmp_path / "a.card.md").read_text()
    told = info(tmp_path / "a.zarr")
    for words in (
        "22 samples",
        told["fingerprint"],
        "| `image` | uint16 | sample × y 8 × x 8 | counts |",
        "no fsync",
        "Media are disjoint",
        '"thickness": 1000.0',
        "`thickness`, `level`",
    ):
        assert words in text
    make(tmp_path / "a.zarr", samples=30)
    assert "30 samples" in (tmp_path / "a.card.md").read_text()
    assert "Media are disjoint" in (tmp_path / "a.card.md").read_text()


def test_default_shards():
    assert default_shard_samples(256, 128 * 128 * 2) == 16
    assert default_shard_samples(1_000_000, 128 * 128 * 2) == 1024
    assert default_shard_samples(3, 2**40) == 1


class Liar(FakeRecipe):
    """Breaks its promises, one at a time."""

    def sample(self, seed, split, index):
        sample = super().sample(seed, split, index)
        match self.name:
            case "float counts":
                sample["image"] = sample["image"].astype(np.float32)
            case "other names" if index > 6:
                sample["parameters"] = {"thickness": 1.0, "extra": 2.0}
            case "other index":
                sample["index"] = np.int64(index + 1)
        return sample


@pytest.mark.parametrize(
    ("name", "words"),
    [("float counts", r"sample\['image'\] must be uint16"), ("other names", "in every sample"),
     ("other index", "in the order of their indices")],
)  # fmt: skip
def test_a_recipe_that_breaks_its_layout_is_refused(tmp_path, name, words):
    with pytest.raises(GenerationError, match=words):
        make(tmp_path / "a.zarr", Liar(name=name))


class FloatCounts(FakeRecipe):
    """Counts as float32 samples; half a count if asked."""

    def layout(self):
        return dict(super().layout()) | {
            "image": ArraySpec(shape=(8, 8), dtype="float32", dims=("y", "x"), counts=True)
        }

    def sample(self, seed, split, index):
        sample = super().sample(seed, split, index)
        extra = {"half": 0.5, "negative": -1e6, "large": 70000.0}.get(self.name, 0.0)
        return sample | {"image": sample["image"].astype(np.float32) + np.float32(extra)}


@pytest.mark.filterwarnings("ignore:invalid value encountered in cast")
def test_float_counts_are_stored_as_uint16_without_loss_or_refused(tmp_path):
    assert make(tmp_path / "a.zarr", FloatCounts())["arrays"]["image"]["dtype"] == "uint16"
    assert_holds(tmp_path / "a.zarr", FloatCounts(), 22)
    for name in ("half", "negative", "large"):
        with pytest.raises(GenerationError, match="whole counts from 0 to 65535"):
            make(tmp_path / f"{name}.zarr", FloatCounts(name=name))


def test_an_axis_name_with_two_lengths_is_refused():
    class Clash(FakeRecipe):
        def layout(self):
            return dict(super().layout()) | {"object": ArraySpec(shape=(3, 5), dims=("y", "x"))}

    with pytest.raises(ValueError, match="such as 'object_y'"):
        stored_arrays(Clash())
    with pytest.raises(ValueError, match="one distinct name for each axis"):
        ArraySpec(shape=(3, 5), dims=("y",))


def test_memory_stays_flat(tmp_path):
    """A shard is in memory, not the data set: columns of one shard exist at a time."""
    peaks = []
    for samples in (50, 100):
        tracemalloc.start()
        make(tmp_path / f"{samples}.zarr", FakeRecipe(side=64), samples=samples, shard_samples=5)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    added = 50 * 64 * 64 * (2 + 8)  # bytes of images and fields
    assert peaks[1] - peaks[0] < added / 10, peaks
