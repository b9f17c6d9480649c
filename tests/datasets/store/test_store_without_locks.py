"""Stores in folders whose locks exclude nobody (Lustre with ``localflock``, some NFS), and whose files come and go."""

import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from fake_recipe import FakeRecipe
from fuzz_stores import RECIPE, SHARD, child, repair
from small_stores import age, assert_holds, contents, make

from specklegen.core import whole_files
from specklegen.datasets.loading.cache import SpeckleCache
from specklegen.datasets.store import generate as generate_module
from specklegen.datasets.store import locks
from specklegen.datasets.store.creation import grown, open_for
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.shards import MissingSample
from specklegen.datasets.store.store import Store
from specklegen.datasets.store.verify import verify

WRITERS, SAMPLES = 3, 40  # full shards: the last one of others is away for a moment when it is written anew


@pytest.fixture
def no_locks(monkeypatch):
    """Every lock is given to everybody, in this process and in those that it forks; what is 2 s old is dead."""
    monkeypatch.setattr(locks, "_lock", lambda descriptor, number, wait: "held")
    monkeypatch.setattr(whole_files, "AGE", 2.0)


def together(folder, *works):
    """Run works at once, each in a process of its own; return what those that failed say."""
    logs = [folder.with_name(f"{place}.log") for place in range(len(works))]
    numbers = [child(work, folder, 0, log) for work, log in zip(works, logs, strict=True)]
    codes = [os.waitpid(number, 0)[1] for number in numbers]
    return [log.read_text() for log, code in zip(logs, codes, strict=True) if code]


def done(folder):
    return len(list(folder.parent.glob("*.done"))) == WRITERS


def write(folder):
    """Fill a store, twice: in between everything is taken off the ledger, as a repair does."""
    try:
        generate(RECIPE, samples=SAMPLES, shard_samples=SHARD, folder=folder, processes=1)
        store = Store(folder)
        for shard in range(store.shard_count):
            store.forget_shard(shard)
        generate(RECIPE, samples=SAMPLES, shard_samples=SHARD, folder=folder, processes=1)
    finally:  # sweepers and readers wait for it, whatever happens
        folder.with_name(f"{os.getpid()}.done").touch()


def sweep(folder):
    while not done(folder):
        whole_files.sweep(open_for(RECIPE, 0, "train", "uint16", folder, SAMPLES, SHARD).store.temporaries())


def read(folder):
    while not (folder / "valid" / "record.json").exists() and not done(folder):
        time.sleep(0.001)
    while not done(folder):
        cache = SpeckleCache(folder)
        for n in range(len(cache)):
            try:
                assert cache.numpy(n)["index"] == n
            except MissingSample as error:
                if "has not been generated yet" not in str(error):  # what is off the ledger is all that is missed
                    raise


@pytest.mark.parametrize("trial", range(3))
def test_writers_sweepers_and_readers_at_once(tmp_path, no_locks, trial):
    """No raw error, nothing lost: a store as one process alone would have made it; what the dead left is gone."""
    alone, folder = tmp_path / "alone" / "a.zarr", tmp_path / "a.zarr"
    generate(RECIPE, samples=SAMPLES, shard_samples=SHARD, folder=alone, processes=1)
    left = tmp_path / f".a.zarr.{'d' * 32}.creating"
    left.mkdir()
    age(tmp_path)
    assert together(folder, *[write] * WRITERS, sweep, sweep, read, read) == []
    repair(folder)  # of two that wrote one shard, the later one may have been taking it off the ledger
    assert verify(folder).sound
    assert contents(folder) == contents(alone)
    assert not left.exists()


def test_a_writer_that_fails_ends_those_who_wait_for_it(tmp_path, no_locks, monkeypatch):
    monkeypatch.setattr(Store, "write_shard", lambda *_: 1 / 0)
    assert len(together(tmp_path / "a.zarr", *[write] * WRITERS, sweep, read)) >= WRITERS


def test_a_shard_that_another_process_takes_off_the_ledger_is_rendered(tmp_path, monkeypatch):
    """Between a call's look at the ledger and its look at the samples: no foreign shard, but one to do."""
    folder = tmp_path / "a.zarr"
    good = make(folder, RECIPE)
    before = contents(folder)

    def opened(*arguments):
        share = open_for(*arguments)
        share.store.forget_shard(1)
        return share

    monkeypatch.setattr(generate_module, "open_for", opened)
    assert make(folder, RECIPE) == good | {"rendered": 5}
    assert contents(folder) == before
    (folder / "object/c/2/0/0").unlink()  # listed, and lost: this is told as ever
    with pytest.raises(generate_module.GenerationError, match="1 shard of .* differ"):
        make(folder, RECIPE)


def test_several_grow_one_store_to_other_lengths(tmp_path, no_locks):
    """The longest is agreed on, whoever comes last, and the metadata are those of this length."""
    folder = tmp_path / "a.zarr"
    make(folder, RECIPE, samples=5)
    lengths = [8, 16, 24]

    def grow(samples):
        return lambda folder: [grown(Store(folder), samples + step) for step in range(2)]

    assert together(folder, *map(grow, lengths)) == []
    assert Store(folder).samples >= 25
    assert grown(Store(folder), 40).samples == 40
    assert verify(folder).sound


def test_several_repair_one_store(tmp_path, no_locks):
    """None deletes what another has just written."""
    folder, whole = tmp_path / "a.zarr", tmp_path / "whole" / "a.zarr"
    for place in (folder, whole):
        make(place, RECIPE)
    for shard in (1, 2, 4):  # 4 is not full
        file = folder / f"image/c/{shard}/0/0"
        file.write_bytes(bytes([file.read_bytes()[0] ^ 1]) + file.read_bytes()[1:])
    assert verify(folder).damaged == (1, 2, 4)
    assert together(folder, *[repair] * 4) == []
    assert verify(folder).sound
    assert contents(folder) == contents(whole)


@pytest.mark.parametrize("name", ["zarr.json", "image/zarr.json", "valid/record.json", "valid/zarr.json",
                                  "image/c/1/0/0", "parameters/c/1/0", "checksum/c/1/0"])  # fmt: skip
def test_a_file_that_is_away_for_two_milliseconds(tmp_path, name):
    """As while it is replaced in a network folder: opening, reading and verifying wait for it."""
    folder = tmp_path / "a.zarr"
    make(folder)
    file, away, ended = folder / name, tmp_path / "away", threading.Event()

    def move():
        while not ended.is_set():
            file.rename(away)
            time.sleep(0.002)
            away.rename(file)
            time.sleep(0.01)

    mover = threading.Thread(target=move)
    mover.start()
    try:
        for _ in range(40):  # the file is away for a sixth of the time: all miss it once in 1500 runs
            assert_holds(folder, FakeRecipe(), 8)
        assert verify(folder).sound
    finally:
        ended.set()
        mover.join()


def test_a_file_that_stays_away_is_named(tmp_path):
    make(tmp_path / "a.zarr")
    (tmp_path / "a.zarr/image/zarr.json").unlink()
    with pytest.raises(ValueError, match=r"image/zarr.json \(missing\).*verify --repair"):
        SpeckleCache(tmp_path / "a.zarr")


def swept_once(monkeypatch):
    """Let the first temporary file be swept before it is renamed, as if its writer had slept for long."""
    replace, swept = Path.replace, []

    def late(self, target):
        if not swept and whole_files.is_temporary(self):
            swept.append(self)
            self.unlink()
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", late)
    return swept


def test_who_slept_too_long_writes_again(tmp_path, monkeypatch):
    swept = swept_once(monkeypatch)
    whole_files.write_whole(tmp_path / "a", b"content")
    assert len(swept) == 1
    assert (tmp_path / "a").read_bytes() == b"content"


def test_a_shard_whose_file_was_swept_is_written_again(tmp_path, monkeypatch):
    folder = tmp_path / "a.zarr"
    make(folder, samples=8)
    swept = swept_once(monkeypatch)
    store = grown(Store(folder), 8)
    store.forget_shard(0)
    make(folder, samples=8)
    assert len(swept) == 1
    assert_holds(folder, FakeRecipe(), 8)
    assert verify(folder).sound


def test_a_heart_keeps_a_folder_alive_and_a_file_lives_for_its_age(tmp_path, monkeypatch):
    """A folder that is filled for four times the age is not swept; one whose heart does not beat is, and is told so."""
    monkeypatch.setattr(whole_files, "AGE", 0.5)
    monkeypatch.setattr(whole_files, "BEAT", 0.02)

    def fill(name):
        with whole_files.making(tmp_path / name) as temporary:
            for _ in range(20):
                time.sleep(0.1)
                assert whole_files.sweep(tmp_path.iterdir()) in ([], [temporary])
            (temporary / "content").touch() if temporary.exists() else temporary.mkdir()

    fill("living")
    assert (tmp_path / "living" / "content").exists()
    monkeypatch.setattr(whole_files, "BEAT", 600.0)
    with pytest.raises(FileNotFoundError, match="swept while this process slept"):
        fill("asleep")
    assert [path.name for path in tmp_path.iterdir()] == ["living"]


@pytest.mark.parametrize("ahead", [-7200.0, 7200.0])
def test_the_clock_is_the_server_s(tmp_path, monkeypatch, ahead):
    """Where ours is two hours before or behind it, a young file is young and an old one old."""
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + ahead)
    young, old = (tmp_path / f"a.{letter * 32}.partial" for letter in "ab")
    young.touch()
    old.touch()
    os.utime(old, (now - 2 * whole_files.AGE,) * 2)
    assert whole_files.sweep(tmp_path.iterdir()) == [old]
    assert young.exists()


def test_the_first_of_two_that_make_a_folder_wins(tmp_path):
    def make_late():
        with whole_files.making(tmp_path / "a") as late:
            with whole_files.making(tmp_path / "a") as early:
                (early / "first").touch()
            (late / "second").touch()

    with pytest.raises(FileExistsError, match="File exists"):
        make_late()
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["first"]
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_other_errors_are_not_waited_for(tmp_path):
    """A folder in the place of a file is no file that is away."""
    calls = []

    def read_folder():
        calls.append(1)
        return tmp_path.read_bytes()

    with pytest.raises(IsADirectoryError):
        whole_files.patiently(read_folder)
    assert len(calls) == 1
    assert np.isclose(sum(whole_files.WAITS), 0.254)
