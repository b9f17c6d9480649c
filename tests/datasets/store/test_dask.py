"""Filling a store on a Dask cluster: the same bytes as without one, whatever happens to the workers."""

import contextlib
import os
import pickle
import random
import signal
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import torch
from fake_recipe import FakeRecipe, Mortal
from small_stores import contents

pytest.importorskip("distributed", reason="the extra dask is not installed")

import dask
from distributed import Client, LocalCluster

from specklegen.cli import commands, stores
from specklegen.core.errors import DoubtWarning
from specklegen.core.parallel import thread_count
from specklegen.datasets.loading.cache import SpeckleCache
from specklegen.datasets.store.dask import RETRIES, fill
from specklegen.datasets.store.filling import GenerationError
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.info import info
from specklegen.datasets.store.store import Store
from specklegen.datasets.store.verify import verify

SAMPLES, SHARD = 40, 4
TIMEOUT = 300


def within(seconds, function, *arguments, **options):
    """Call a function, but fail instead of hanging."""
    result = []

    def call():
        try:
            result.append((function(*arguments, **options), None))
        except BaseException as error:
            result.append((None, error))

    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(seconds)
    assert result, "waited in vain"
    value, error = result[0]
    if error is not None:
        raise error
    return value


def make(folder, recipe=None, **options):
    settings = {"samples": SAMPLES, "shard_samples": SHARD} | options
    return within(TIMEOUT, generate, recipe or FakeRecipe(), folder=folder, **settings)


def shards_there(folder):
    return {int(file.parts[-1]) for file in folder.glob("valid/c/*")}


@pytest.fixture(scope="module")
def client():
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, memory_limit=0) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        client.wait_for_workers(2, timeout=TIMEOUT)
        yield client


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain") / "a.zarr"
    make(folder, processes=1)
    return contents(folder)


def test_a_cluster_writes_the_same_bytes(tmp_path, client, plain):
    seen = []
    result = make(tmp_path / "a.zarr", cluster=client, progress=lambda done, total: seen.append((done, total)))
    assert (result["done"], result["total"]) == (SAMPLES, SAMPLES)
    assert contents(tmp_path / "a.zarr") == plain
    assert seen == [(n, SAMPLES) for n in range(0, SAMPLES + 1, SHARD)]


@pytest.mark.parametrize("kind", ["address", "cluster"])
def test_an_address_and_a_cluster_will_do(tmp_path, client, plain, kind):
    make(tmp_path / "a.zarr", cluster=client.scheduler.address if kind == "address" else client.cluster)
    assert contents(tmp_path / "a.zarr") == plain
    assert client.status == "running"


def test_a_large_recipe_is_sent(tmp_path, client, plain):
    """As one is that has cached correlations: distributed fails at keywords above 100 kB."""
    make(tmp_path / "a.zarr", FakeRecipe(ballast=bytes(200_000)), cluster=client)
    assert contents(tmp_path / "a.zarr") == plain


def test_outcomes_are_small(tmp_path):
    make(tmp_path / "a.zarr", shard_range=(0, 10), processes=1)
    folder = tmp_path / "a.zarr"
    known, recipe = Store(folder).fingerprint, pickle.dumps(FakeRecipe())
    outcome = fill(5, str(folder), known, recipe, wait=False, caller=os.getpid())
    assert (outcome.shard, outcome.state, len(outcome.checksum)) == (5, "written", 64)
    assert len(pickle.dumps(outcome)) < 400


@pytest.mark.slow
def test_kill_9_of_one_of_two_workers(tmp_path, client, plain):
    """Killed from outside at the first shard; both workers took part before or after."""
    log, killed = tmp_path / "log", []

    def kill(done, total):
        if done and not killed:
            victim = int(log.read_text().splitlines()[-1].split()[0])
            killed.append(victim)
            os.kill(victim, signal.SIGKILL)

    make(tmp_path / "a.zarr", FakeRecipe(seconds=0.02, log=str(log)), cluster=client, progress=kill)
    assert {name: data for name, data in contents(tmp_path / "a.zarr").items() if "partial" not in name} == plain
    workers = {int(line.split()[0]) for line in log.read_text().splitlines()} - {os.getpid()}
    assert set(killed) < workers


def test_a_worker_that_dies_in_the_middle_of_a_shard(tmp_path, client, plain):
    make(tmp_path / "a.zarr", Mortal(name=str(tmp_path / "died")), cluster=client)
    assert (tmp_path / "died").exists()
    assert verify(tmp_path / "a.zarr").sound
    held = contents(tmp_path / "a.zarr")
    assert all(held[key] == plain[key] for key in plain if "/c/" in key)


@pytest.mark.slow
def test_kill_9_of_workers_at_random(tmp_path, plain):
    """Whichever rendered last, every second or so; nannies start others. The bytes are those of a quiet run.

    By default a shard that lost four workers is given up, and so is the nanny of one that was not there when a local
    cluster looked, 15 s after a death.
    """
    log, killed, ended, draws = tmp_path / "log", set(), threading.Event(), random.Random(0)

    def kill():
        while not ended.wait(draws.uniform(0.5, 1.5)) and len(killed) < 6:
            victim = int(log.read_text().splitlines()[-1].split()[0]) if log.exists() else None
            if victim not in (None, os.getpid(), *killed):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGKILL)
                    killed.add(victim)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        recipe = FakeRecipe(seconds=0.2, log=str(log))
        patient = {"distributed.scheduler.allowed-failures": 20, "distributed.deploy.lost-worker-timeout": "1 hour"}
        with (
            dask.config.set(patient),
            LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, memory_limit=0) as cluster,
        ):
            assert make(tmp_path / "a.zarr", recipe, cluster=cluster)["done"] == SAMPLES
    finally:
        ended.set()
        killer.join()
    assert len(killed) >= 3
    assert verify(tmp_path / "a.zarr").sound
    assert {name: data for name, data in contents(tmp_path / "a.zarr").items() if "partial" not in name} == plain


@pytest.mark.parametrize("kind", ["cluster", "address"])
def test_a_cluster_that_has_lost_all_workers_is_told(tmp_path, plain, monkeypatch, kind):
    """A local one has given them up; one of jobs may get others, and is waited for."""
    monkeypatch.setattr("specklegen.datasets.store.dask.PATIENCE", 0.3)
    come = []
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster:

        def lose(done, total):
            if done and not come:
                cluster.scale(0)
                come.append(threading.Timer(2.0, cluster.scale, [1]))
                come[0].start()

        recipe = FakeRecipe(seconds=0.01)
        if kind == "cluster":
            with pytest.raises(GenerationError, match="no worker left.*Start a cluster"):
                make(tmp_path / "a.zarr", recipe, cluster=cluster, progress=lose)
        else:
            with pytest.warns(DoubtWarning, match="generate waits, since"):
                make(tmp_path / "a.zarr", recipe, cluster=cluster.scheduler_address, progress=lose)
            assert contents(tmp_path / "a.zarr") == plain
        come[0].join()


class Deadly(FakeRecipe):
    """Kills every process that renders sample 12."""

    def sample(self, seed, split, index):
        if index == 12:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().sample(seed, split, index)


@pytest.mark.slow
def test_a_shard_that_kills_every_worker_is_named_and_the_others_finish(tmp_path, client):
    with pytest.raises(GenerationError, match="1 of 10 shards failed.*\n.*shard 3: KilledWorker"):
        make(tmp_path / "a.zarr", Deadly(), cluster=client)
    assert shards_there(tmp_path / "a.zarr") == set(range(10)) - {3}


def test_a_deterministic_failure_is_named_and_the_others_finish(tmp_path, client):
    log = tmp_path / "log"
    with pytest.raises(GenerationError, match=r"1 of 10 .*\n.*seed=0, split='train', index=22\) failed: Arithmetic"):
        make(tmp_path / "a.zarr", FakeRecipe(fails_at=22, log=str(log)), cluster=client)
    assert shards_there(tmp_path / "a.zarr") == set(range(10)) - {5}
    rendered = [int(line.split()[1]) for line in log.read_text().splitlines()]
    assert rendered.count(20) == 2, "in the batch and to find the culprit, but not tried again"


def test_a_failure_has_an_exit_code(tmp_path, client, monkeypatch, capsys):
    store = str(tmp_path / "a.zarr")
    words = ["specklegen", "generate", "fake", "--out", store, "--samples", "8", "--cluster", client.scheduler.address]
    monkeypatch.setattr(sys, "argv", words)
    for fails_at, code in ((3, 2), (-1, 0)):
        recipe = FakeRecipe(fails_at=fails_at)
        monkeypatch.setattr(stores, "load", lambda *_, recipe=recipe: recipe)
        with pytest.raises(SystemExit) as stopped:
            commands.main()
        assert (stopped.value.code or 0) == code
    said = capsys.readouterr()
    assert "index=3) failed" in said.err
    assert "8 of 8 samples" in said.out


class Flaky(FakeRecipe):
    """Loses its file system at sample 12, as often as ``name`` says, counted in ``log``."""

    def sample(self, seed, split, index):
        if index == 12:
            with Path(self.log).open("a") as file:
                file.write("tried\n")
            if len(Path(self.log).read_text().splitlines()) <= int(self.name):
                raise OSError("stale file handle")
        return FakeRecipe().sample(seed, split, index)


def test_an_os_error_is_tried_again(tmp_path, client, plain):
    # A batch that fails is followed by its samples one by one: two tries a turn.
    flaky = Flaky(name=str(2 * RETRIES), log=str(tmp_path / "log"))
    assert make(tmp_path / "a.zarr", flaky, cluster=client)["done"] == SAMPLES
    held = contents(tmp_path / "a.zarr")
    assert all(held[key] == plain[key] for key in plain if "/c/" in key)
    assert len((tmp_path / "log").read_text().splitlines()) == 2 * RETRIES + 1


def test_an_os_error_that_stays_is_named(tmp_path, client):
    flaky = Flaky(name="1000", log=str(tmp_path / "log"))
    with pytest.raises(GenerationError, match=r"index=12\) failed: OSError: stale file handle"):
        make(tmp_path / "a.zarr", flaky, cluster=client)
    assert shards_there(tmp_path / "a.zarr") == set(range(10)) - {3}
    assert len((tmp_path / "log").read_text().splitlines()) == 2 * (RETRIES + 1)


def test_runs_resume_and_grow(tmp_path, client, plain):
    log = tmp_path / "log"
    recipe = FakeRecipe(log=str(log))
    make(tmp_path / "a.zarr", recipe, samples=20, cluster=client, shard_range=(0, 2))
    assert shards_there(tmp_path / "a.zarr") == {0, 1}
    log.unlink()
    make(tmp_path / "a.zarr", recipe, cluster=client)
    assert contents(tmp_path / "a.zarr").keys() == plain.keys()
    assert sorted(int(line.split()[1]) for line in log.read_text().splitlines()) == list(range(8, SAMPLES))
    log.unlink()
    assert make(tmp_path / "a.zarr", recipe, cluster=client)["done"] == SAMPLES
    assert not log.exists()


class Threads(FakeRecipe):
    """Reports the threads that it may use: Numba's, torch's and the engine's."""

    def sample(self, seed, split, index):
        import numba

        threads = 100 * numba.config.NUMBA_NUM_THREADS + 10 * torch.get_num_threads() + thread_count()
        return super().sample(seed, split, index) | {"level": np.float64(threads)}


def test_workers_render_on_one_thread(tmp_path, client):
    make(tmp_path / "a.zarr", Threads(), cluster=client)
    cache = SpeckleCache(tmp_path / "a.zarr")
    assert {float(cache.numpy(n)["level"]) for n in range(SAMPLES)} == {111.0}


def test_a_cluster_of_threads_leaves_this_process_alone(tmp_path, plain):
    before = torch.get_num_threads(), thread_count(), os.environ.get("NUMBA_NUM_THREADS")
    with LocalCluster(
        n_workers=1, threads_per_worker=3, processes=False, dashboard_address=":0", memory_limit=0
    ) as cluster:
        make(tmp_path / "a.zarr", cluster=cluster)
    assert contents(tmp_path / "a.zarr") == plain
    assert before == (torch.get_num_threads(), thread_count(), os.environ.get("NUMBA_NUM_THREADS"))


class Newer(FakeRecipe):
    """Is of another version in the workers, as an engine that was updated on one machine only."""

    def canonical_json(self):
        return super().canonical_json().replace("1000", "1000" if os.getpid() == int(self.name) else "1001")


def test_a_worker_that_would_render_something_else_is_refused(tmp_path, client):
    with pytest.raises(GenerationError, match=r"recipe.medium.thickness \(1000.0 there, 1001.0 here\)"):
        make(tmp_path / "a.zarr", Newer(name=str(os.getpid())), cluster=client)
    assert info(tmp_path / "a.zarr")["done"] == 0


def test_what_cannot_be_is_refused(tmp_path, client):
    with pytest.raises(ValueError, match=r"generate.processes must be left out with a cluster.*; got 2"):
        make(tmp_path / "a.zarr", cluster=client, processes=2)
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "200ms"}),
        pytest.raises(ValueError, match=r"generate.cluster must be the address of a Dask scheduler that answers; got"),
    ):
        make(tmp_path / "a.zarr", cluster="tcp://127.0.0.1:9")
