"""SIGTERM, as Slurm sends it to every process of a job: the same command goes on, and loses nothing."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fake_recipe import FakeRecipe
from scenes import ROOT
from small_runs import CHANGES, assert_same_run, checkpoint
from small_stores import contents, make

from specklegen.cli import commands, stores
from specklegen.datasets.store.store import Store
from specklegen.datasets.store.verify import verify

STOPPED = {128 + signal.SIGTERM, -signal.SIGTERM}  # the latter before the command line has begun; a shell shows 143


def begun(words, folder):
    """Start a command in a group of processes of its own."""
    return subprocess.Popen([sys.executable, "-m", "specklegen", *words], cwd=folder, start_new_session=True,
                            env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=subprocess.DEVNULL,
                            stderr=subprocess.PIPE, text=True)  # fmt: skip


def ended(words, folder, moments):
    """Run a command, stop its processes after each of these seconds, go on; return what it said each time."""
    said = []
    for seconds in moments:
        call = begun(words, folder)
        try:
            error = call.communicate(timeout=seconds)[1]
        except subprocess.TimeoutExpired:
            os.killpg(call.pid, signal.SIGTERM)
            error = call.communicate(timeout=300)[1]
            assert call.returncode in STOPPED, (call.returncode, error)
        said.append((call.returncode, error))
        if call.returncode == 0:
            return said
    call = begun(words, folder)
    said.append((0, call.communicate(timeout=300)[1]))
    assert call.returncode == 0, said
    return said


class Preempted(FakeRecipe):
    """Is sent SIGTERM at sample 12, once."""

    def sample(self, seed, split, index):
        if index == 12 and not Path(self.log).exists():
            Path(self.log).touch()
            signal.raise_signal(signal.SIGTERM)
        return FakeRecipe().sample(seed, split, index)


def test_generate_says_that_the_store_goes_on(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(stores, "load", lambda *_: Preempted(log=str(tmp_path / "log")))
    words = ["generate", "fake", "--samples", "22", "--processes", "1", "--out", str(tmp_path / "a.zarr")]
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as stopped:
        commands.main(words)
    assert stopped.value.code == 143
    assert signal.getsignal(signal.SIGTERM) is before
    assert "Run the same command again to resume" in capsys.readouterr().err
    assert not [*tmp_path.rglob("*.partial")]
    with pytest.raises(SystemExit) as done:
        commands.main(words)
    assert done.value.code in (None, 0)
    make(tmp_path / "quiet.zarr", shard_samples=Store(tmp_path / "a.zarr").shard_samples)
    there, quiet = contents(tmp_path / "a.zarr"), contents(tmp_path / "quiet.zarr")
    assert {n: d for n, d in there.items() if "/c/" in n} == {n: d for n, d in quiet.items() if "/c/" in n}


@pytest.mark.slow
@pytest.mark.parametrize("processes", [1, 2])
def test_a_store_that_was_stopped_at_random_has_the_same_bytes(tmp_path, processes):
    words = ["generate", "through-slab", *CHANGES, "--set", "material.kernel_paths=100000", "--samples", "1500",
             "--processes", str(processes), "--out"]  # fmt: skip
    start = time.monotonic()
    assert ended([*words, "quiet.zarr"], tmp_path, [])[0][0] == 0
    whole, draws = time.monotonic() - start, random.Random(processes)
    said = ended([*words, "stopped.zarr"], tmp_path, [draws.uniform(0.1, 0.6) * whole for _ in range(6)])
    assert len(said) > 2
    assert verify(tmp_path / "stopped.zarr").sound
    there = contents(tmp_path / "stopped.zarr")
    assert {name: data for name, data in there.items() if not name.endswith(".partial")} == contents(
        tmp_path / "quiet.zarr"
    )


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, 2])
def test_a_training_that_was_stopped_at_random_has_the_same_bits(tmp_path, workers):
    words = ["train", "through-slab", *CHANGES, "--set", "samples.train=400", "--width", "4", "--epochs", "6",
             "--batch-size", "16", "--validation-samples", "4", "--workers", str(workers), "--out"]  # fmt: skip
    start = time.monotonic()
    assert ended([*words, "quiet"], tmp_path, [])[0][0] == 0
    whole, draws = time.monotonic() - start, random.Random(workers)
    said = ended([*words, "stopped"], tmp_path, [draws.uniform(0.1, 0.5) * whole for _ in range(6)])
    assert len(said) > 2
    assert_same_run(checkpoint(tmp_path / "quiet"), checkpoint(tmp_path / "stopped"))
    assert (tmp_path / "quiet" / "best.pt").read_bytes() == (tmp_path / "stopped" / "best.pt").read_bytes()
