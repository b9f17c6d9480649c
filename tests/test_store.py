"""The store: what is written is read, by plain readers too; filling, resuming, refusing, mending."""

import os
import shutil
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import xarray
import zarr
from fake_recipe import FakeRecipe, Mortal, assert_same

from specklegen.datasets.cache import SpeckleCache  # noqa: E402
from specklegen.datasets.claims import claim  # noqa: E402
from specklegen.datasets.creation import default_shard_samples, sweep_creations  # noqa: E402
from specklegen.datasets.generate import GenerationError, fill_shard, generate  # noqa: E402
from specklegen.datasets.identity import differences, fingerprint, identity  # noqa: E402
from specklegen.datasets.info import info  # noqa: E402
from specklegen.datasets.protocol import ArraySpec, stored_arrays  # noqa: E402
from specklegen.datasets.store import Store  # noqa: E402
from specklegen.datasets.verify import verify  # noqa: E402

TIMEOUT = 120


def make(folder, recipe=None, **options):
    settings = {"samples": 22, "shard_samples": 5, "processes": 1} | options
    return generate(recipe or FakeRecipe(), folder=folder, **settings)


def assert_holds(folder, recipe, samples, seed=0, split="train"):
    """Require samples 0 to ``samples`` - 1 to be in the store, to the bit."""
    cache = SpeckleCache(folder)
    for n in range(samples):
        assert_same(cache.numpy(n) | {"index": np.int64(n)}, recipe.sample(seed, split, n))


def contents(folder):
    """Return every file of a store but the claims, by its path."""
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file.name != "claims"]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


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
    names = ["checksum", "field", "image", "index", "level", "object", "parameters", "seed", "valid"]
    assert out.strip() == f"{names} {total} fake"


def test_worker_processes_write_the_same_bytes(tmp_path):
    make(tmp_path / "one.zarr")
    make(tmp_path / "two.zarr", processes=2)
    assert contents(tmp_path / "one.zarr") == contents(tmp_path / "two.zarr")


def test_shard_ranges_equal_one_run(tmp_path):
    make(tmp_path / "whole.zarr")
    for part in (2, 0, 1):
        result = make(tmp_path / "parts.zarr", shard_range=(part, 3))
    assert result["done"] == 22
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
    with pytest.raises(ValueError, match="generate.folder must be in a place where you can write"):
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


@pytest.mark.parametrize("processes", [1, 2])
def test_a_failing_sample_is_named_and_the_others_are_stored(tmp_path, processes):
    with pytest.raises(GenerationError, match=r"\(seed=0, split='train', index=7\) failed: ArithmeticError"):
        make(tmp_path / "a.zarr", FakeRecipe(fails_at=7), processes=processes)
    assert info(tmp_path / "a.zarr")["done"] == 17
    assert make(tmp_path / "a.zarr")["done"] == 22


def test_verify_finds_a_flipped_byte_in_any_file_and_a_missing_shard(tmp_path):
    folder = tmp_path / "a.zarr"
    make(folder)
    good = contents(folder)
    assert verify(folder).damaged == ()
    random = np.random.default_rng(0)
    victims = [name for name in good if name.split("/")[1:2] == ["c"]]
    assert len(victims) == 5 * 9
    for name in victims:
        shard = int(name.split("/")[2])
        data = bytearray(good[name])
        data[random.integers(len(data))] ^= 1 << int(random.integers(8))
        (folder / name).write_bytes(data)
        assert verify(folder).damaged == (shard,), name
        assert verify(folder, repair=FakeRecipe()).damaged == (shard,)
        assert contents(folder) == good
    (folder / "image/c/3/0/0").unlink()
    shutil.rmtree(folder / "valid/c")
    (folder / "image/c/1/0/0").unlink()
    found = verify(folder)
    assert (found.damaged, found.unfinished) == ((), (0, 1, 2, 3, 4))
    verify(folder, repair=FakeRecipe())
    assert contents(folder) == good
    (folder / "image/c/3/0/0").unlink()
    assert verify(folder).damaged == (3,)
    verify(folder, repair=FakeRecipe())
    assert contents(folder) == good


def test_repair_with_another_recipe_is_refused(tmp_path):
    make(tmp_path / "a.zarr")
    with pytest.raises(ValueError, match="thickness"):
        verify(tmp_path / "a.zarr", repair=FakeRecipe(thickness=1.0))


def test_generate_on_a_damaged_ledger_points_to_verify(tmp_path):
    make(tmp_path / "a.zarr")
    (tmp_path / "a.zarr/valid/c/1").write_bytes(b"torn")
    with pytest.raises(OSError, match="verify --repair"):
        make(tmp_path / "a.zarr")


def test_a_lost_worker_is_replaced(tmp_path):
    assert make(tmp_path / "a.zarr", Mortal(name=str(tmp_path / "once")), processes=2)["done"] == 22
    assert_holds(tmp_path / "a.zarr", FakeRecipe(), 22)


def test_a_worker_that_always_dies_ends_the_call_with_advice(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(GenerationError, match="with fewer processes: it resumes"):
        make(tmp_path / "a.zarr", Mortal(name="always"), processes=2)


def test_a_script_without_a_main_guard_is_told_so(tmp_path):
    script = tmp_path / "bare.py"
    script.write_text(SCRIPT.replace('if __name__ == "__main__":', "if True:"))
    here, go = Path(__file__).parent, tmp_path / "go"
    go.touch()
    command = [sys.executable, script, here, tmp_path / "a.zarr", tmp_path / "log", "2", go]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=TIMEOUT, check=False
    )
    assert done.returncode != 0
    assert 'if __name__ == "__main__":' in done.stderr.splitlines()[-1]


def claiming(file, number):
    """Start a process that claims a piece and keeps it until it is killed."""
    code = (
        "import sys, time; from pathlib import Path; from specklegen.datasets.claims import claim\n"
        "with claim(Path(sys.argv[1]), int(sys.argv[2])) as state: print(state, flush=True); time.sleep(600)"
    )
    command = [sys.executable, "-c", code, file, str(number)]
    other = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None
    assert other.stdout.readline().strip() == "held"
    return other


def test_a_claim_excludes_other_processes_and_ends_with_them(tmp_path):
    file = tmp_path / "claims"
    file.touch()
    other = claiming(file, 3)
    try:
        with claim(file, 3) as state:
            assert state == "taken"
        with claim(file, 4) as state:
            assert state == "held"
    finally:
        other.kill()
        other.wait(TIMEOUT)
    with claim(file, 3) as state:
        assert state == "held"


def test_a_call_returns_when_shards_that_others_had_claimed_are_there_too(tmp_path):
    """Another process claims shard 1 and dies without having rendered it: this call waits, and takes over."""
    make(tmp_path / "a.zarr", shard_range=(0, 5))
    other, calls = claiming(tmp_path / "a.zarr/valid/claims", 2), []

    def progress(done, total):
        calls.append(done)
        if done == 17:  # all but the claimed shard
            other.kill()

    try:
        assert make(tmp_path / "a.zarr", progress=progress)["done"] == 22
    finally:
        other.kill()
        other.wait(TIMEOUT)
    assert calls == [5, 10, 15, 17, 22]


def test_a_call_that_dies_while_growing_leaves_a_sound_store(tmp_path, monkeypatch):
    good = make(tmp_path / "a.zarr", samples=8)
    resize = zarr.Array.resize
    for _ in range(8):  # each call grows one more array, and dies at the next; the ledger is the ninth
        left = iter([None])

        def dying(array, shape, left=left):
            next(left)  # StopIteration stands for the kill
            resize(array, shape)

        monkeypatch.setattr(zarr.Array, "resize", dying)
        with pytest.raises(StopIteration):
            make(tmp_path / "a.zarr", samples=22)
        monkeypatch.undo()
        assert info(tmp_path / "a.zarr") == good | {"bytes": info(tmp_path / "a.zarr")["bytes"]}
        assert_holds(tmp_path / "a.zarr", FakeRecipe(), 8)
    make(tmp_path / "a.zarr", samples=22)
    assert_holds(tmp_path / "a.zarr", FakeRecipe(), 22)


def test_a_claimed_shard_is_left_alone(tmp_path):
    make(tmp_path / "a.zarr", shard_range=(0, 5))
    store = Store(tmp_path / "a.zarr", writable=True)
    assert fill_shard(store, FakeRecipe(fails_at=0), 0).state == "present"
    assert fill_shard(store, FakeRecipe(), 1).state == "written"


SCRIPT = """
import sys
import time
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from fake_recipe import FakeRecipe
from specklegen.datasets.generate import generate

if __name__ == "__main__":
    Path(sys.argv[3] + ".ready").touch()
    while not Path(sys.argv[5]).exists():
        time.sleep(0.001)
    recipe = FakeRecipe(seconds=0.005, log=sys.argv[3])
    generate(recipe, samples=120, shard_samples=5, folder=sys.argv[2], processes=int(sys.argv[4]))
"""


def start(folder, processes, *logs):
    """Start one call for each log, all at the same moment, on one store."""
    script, go = folder.parent / "fill.py", folder.parent / f"go{logs[0].name}"
    script.write_text(SCRIPT)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    here = Path(__file__).parent
    calls = [
        subprocess.Popen([sys.executable, script, here, folder, log, str(processes), go], env=environment)
        for log in logs
    ]
    wait_until(lambda: all(log.with_name(log.name + ".ready").exists() for log in logs))
    go.touch()
    return calls


def wait_until(condition, seconds=TIMEOUT):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def rendered(log):
    return [int(line.split()[1]) for line in log.read_text().splitlines()] if log.exists() else []


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "a.zarr"
    make(folder, samples=120)
    return contents(folder)


def wait_for_shards(folder, count):
    wait_until(lambda: len(list(folder.glob("valid/c/*"))) >= count)


def test_two_processes_on_one_store_lose_nothing(tmp_path, uninterrupted):
    """Both start with no folder; each sample is rendered once, but for sample 0, which creation tries out."""
    folder, logs = tmp_path / "a.zarr", (tmp_path / "one", tmp_path / "two")
    assert [process.wait(TIMEOUT) for process in start(folder, 1, *logs)] == [0, 0]
    assert contents(folder) == uninterrupted
    shares = [[n for n in rendered(log) if n] for log in logs]
    assert all(shares), "both took part"
    assert sorted(shares[0] + shares[1]) == list(range(1, 120))
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("processes", [1, 2])
def test_kill_9_then_rerun_equals_an_uninterrupted_run(tmp_path, uninterrupted, processes):
    """Two calls fill one store and are killed; a rerun keeps what was finished and sweeps up."""
    folder, logs = tmp_path / "a.zarr", (tmp_path / "one", tmp_path / "two")
    calls = start(folder, processes, *logs)
    wait_for_shards(folder, 4)
    for call in calls:
        call.kill()
        call.wait(TIMEOUT)
    writers = {line.split()[0] for log in logs if log.exists() for line in log.read_text().splitlines()}
    wait_until(lambda: not any(Path(f"/proc/{number}").exists() for number in writers))  # no orphans
    after_kill = contents(folder)
    listed = [name for name in after_kill if name.startswith("valid/c/") and "partial" not in name]
    finished = {int(name.split("/")[2]) for name in listed}
    assert 4 <= len(finished) < 24
    (folder / "image/c/20/0").mkdir(parents=True, exist_ok=True)
    (folder / "image/c/20/0/0.feed.partial").write_bytes(b"half a shard")
    (folder / "zarr.feed.partial").write_bytes(b"half a header")
    again = tmp_path / "again"
    assert start(folder, 1, again)[0].wait(TIMEOUT) == 0
    assert contents(folder) == uninterrupted
    kept = {n for shard in finished for n in range(5 * shard, 5 * shard + 5)}
    assert kept.isdisjoint(rendered(again))
    assert set(rendered(again)) | kept == set(range(120))


def test_a_killed_call_does_not_stop_the_other(tmp_path, uninterrupted):
    folder = tmp_path / "a.zarr"
    first, second = start(folder, 1, tmp_path / "one", tmp_path / "two")
    wait_for_shards(folder, 3)
    first.kill()
    first.wait(TIMEOUT)
    assert second.wait(TIMEOUT) == 0
    assert {name: data for name, data in contents(folder).items() if "partial" not in name} == uninterrupted


def test_half_made_stores_are_swept_and_living_ones_are_not(tmp_path):
    living, dead = tmp_path / ".a.zarr.living.creating", tmp_path / ".a.zarr.dead.creating"
    for temporary in (living, dead):
        (temporary / "valid").mkdir(parents=True)
        (temporary / "valid" / "claims").touch()
    other = claiming(living / "valid" / "claims", 0)
    try:
        assert sweep_creations(tmp_path / "a.zarr") == [dead]
        assert living.exists()
        assert not dead.exists()
    finally:
        other.kill()
        other.wait(TIMEOUT)


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
