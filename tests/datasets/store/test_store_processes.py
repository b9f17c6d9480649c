"""Stores filled by several processes, which may die at any moment."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fake_recipe import FakeRecipe, Mortal
from scenes import ROOT
from small_stores import TIMEOUT, Forked, age, assert_holds, claiming, contents, make

from specklegen.datasets.store import metadata
from specklegen.datasets.store.filling import GenerationError, fill_shard
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.info import info
from specklegen.datasets.store.locks import claim
from specklegen.datasets.store.store import Store


def test_a_lost_worker_is_replaced(tmp_path):
    assert make(tmp_path / "a.zarr", Mortal(name=str(tmp_path / "once")), processes=2)["done"] == 22
    assert_holds(tmp_path / "a.zarr", FakeRecipe(), 22)


def test_a_worker_that_always_dies_ends_the_call_with_advice(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(GenerationError, match="use fewer processes.*it resumes"):
        make(tmp_path / "a.zarr", Mortal(name="always"), processes=2)


def test_a_script_without_a_main_guard_is_told_so(tmp_path):
    script = tmp_path / "bare.py"
    script.write_text(SCRIPT.replace('if __name__ == "__main__":', "if True:"))
    here, go = ROOT / "tests", tmp_path / "go"
    go.touch()
    command = [sys.executable, script, here, tmp_path / "a.zarr", tmp_path / "log", "2", go]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=TIMEOUT, check=False)
    assert done.returncode != 0
    assert 'if __name__ == "__main__":' in done.stderr.splitlines()[-1]


def test_a_claim_excludes_other_processes_and_ends_with_them(tmp_path):
    file = tmp_path / "claims"
    file.touch()
    other = claiming(file, 3)
    try:
        with claim(file, 3) as state:
            assert state == "busy"
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
    other, calls = claiming(tmp_path / "a.zarr/valid/locks", 2), []

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
    write = metadata.put
    for deaths in range(12):  # each call dies one file later: the record, nine arrays, the ledger, the record
        left = iter(range(deaths))

        def dying(file, data, left=left):
            next(left)  # StopIteration stands for the kill
            write(file, data)

        monkeypatch.setattr(metadata, "put", dying)
        with pytest.raises(StopIteration):
            make(tmp_path / "a.zarr", samples=22)
        monkeypatch.undo()
        kept = {key: value for key, value in good.items() if key != "rendered"}
        assert info(tmp_path / "a.zarr") == kept | {"bytes": info(tmp_path / "a.zarr")["bytes"]}
        assert_holds(tmp_path / "a.zarr", FakeRecipe(), 8)
        shutil.rmtree(tmp_path / "a.zarr")
        make(tmp_path / "a.zarr", samples=8)
    make(tmp_path / "a.zarr", samples=22)
    assert_holds(tmp_path / "a.zarr", FakeRecipe(), 22)


def test_a_claimed_shard_is_left_alone(tmp_path):
    make(tmp_path / "a.zarr", shard_range=(0, 5))
    store = Store(tmp_path / "a.zarr")
    assert fill_shard(store, FakeRecipe(fails_at=0), 0).state == "present"
    assert fill_shard(store, FakeRecipe(), 1).state == "written"


SCRIPT = """
import sys
import time
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from fake_recipe import FakeRecipe
from specklegen.datasets.store.generate import generate

if __name__ == "__main__":
    Path(sys.argv[3] + ".ready").touch()
    while not Path(sys.argv[5]).exists():
        time.sleep(0.001)
    recipe = FakeRecipe(seconds=0.005, log=sys.argv[3])
    generate(recipe, samples=120, shard_samples=5, folder=sys.argv[2], processes=int(sys.argv[4]))
"""


def fill(folder, log, go):
    """Do what the script does, in one process."""
    log.with_name(log.name + ".ready").touch()
    wait_until(go.exists)
    generate(FakeRecipe(seconds=0.005, log=str(log)), samples=120, shard_samples=5, folder=folder, processes=1)


def start(folder, processes, *logs):
    """Start one call for each log, all at the same moment, on one store; of more processes as a program of its own."""
    script, go = folder.parent / "fill.py", folder.parent / f"go{logs[0].name}"
    script.write_text(SCRIPT)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    if processes == 1:
        calls = [Forked(target=fill, args=(folder, log, go)) for log in logs]
        for call in calls:
            call.start()
    else:
        calls = [
            subprocess.Popen([sys.executable, script, ROOT / "tests", folder, log, str(processes), go], env=environment)
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


@pytest.mark.parametrize("processes", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_kill_9_then_rerun_equals_an_uninterrupted_run(tmp_path, uninterrupted, processes):
    """Two calls fill one store and are killed; a rerun keeps what was finished and sweeps up."""
    folder, logs = tmp_path / "a.zarr", (tmp_path / "one", tmp_path / "two")
    calls = [*start(folder, processes, logs[0]), *start(folder, 1, logs[1])]
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
    (folder / f"image/c/20/0/0.{'feed' * 8}.partial").write_bytes(b"half a shard")
    (folder / f"zarr.{'feed' * 8}.partial").write_bytes(b"half a header")
    age(tmp_path)
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
