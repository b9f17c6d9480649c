"""Kill -9 at file operations of those who create, fill, grow and repair: the short form of tests/fuzz_stores.py."""

import errno
import os
import random
import threading

import numpy as np
import pytest
from fake_recipe import FakeRecipe
from fuzz_stores import SCENES, Fuzz
from small_stores import age, assert_holds, make

from specklegen.core.errors import RuleError
from specklegen.datasets.loading.cache import SpeckleCache
from specklegen.datasets.store import creation, encoding, metadata, store
from specklegen.datasets.store.filling import GenerationError
from specklegen.datasets.store.info import info
from specklegen.datasets.store.shards import MissingSample
from specklegen.datasets.store.store import Store
from specklegen.datasets.store.verify import verify


@pytest.fixture(scope="module")
def fuzz(tmp_path_factory):
    return Fuzz(tmp_path_factory.mktemp("fuzz"))


@pytest.mark.parametrize("scene", SCENES)
def test_a_kill_at_any_file_operation_loses_nothing(fuzz, scene):
    """Four operations spread over all of them, at places of their own each (the script takes every one).

    A trial asserts what fuzz_stores.py says, and returns the operations of who lived.
    """
    count = fuzz.operations[scene]
    assert count > 50, "the hook sees what is written"
    for kill in np.linspace(1, count, 4).astype(int).tolist():
        assert fuzz.trial(scene, [kill]) < kill, "it was killed there, or had less to do"


def test_kills_among_several_processes_lose_nothing(fuzz):
    draws = random.Random(4)
    for _ in range(5):
        scene, kills = fuzz.several(draws)
        done = fuzz.trial(scene, kills)
        assert done > 0 or 0 not in kills, "who is not killed writes"


@pytest.mark.slow
def test_eight_processes_create_one_store_at_once(fuzz):
    """None fails, and what they make is one store; seen through the moments at which a maker is least protected."""
    for _ in range(4):
        assert fuzz.trial("create", [0] * 8) > 0


def test_the_power_of_the_fuzz(fuzz, monkeypatch):
    """A store whose ledger is written before its samples must be caught."""
    whole = store.Store.write_shard

    def hasty(self, shard, columns):
        listed = np.arange(self.shard_samples) < len(self.span(shard))
        store.put(self._file("valid", shard), encoding.table_bytes(listed), sweeping=False)
        return whole(self, shard, columns)

    monkeypatch.setattr(store.Store, "write_shard", hasty)

    def any_kill():
        for kill in range(fuzz.operations["generate"] // 3, fuzz.operations["generate"]):
            fuzz.trial("generate", [kill])

    with pytest.raises((AssertionError, MissingSample)):
        any_kill()


def test_threads_of_one_process_create_one_store_at_once(tmp_path):
    errors = []

    def work():
        try:
            make(tmp_path / "a.zarr", samples=5)
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(120)
    assert not errors
    assert_holds(tmp_path / "a.zarr", FakeRecipe(), 5)


def test_half_made_stores_are_swept(tmp_path):
    """Their makers died; and what is not a maker's is left alone."""
    (tmp_path / f".a.zarr.{'e' * 32}.creating").mkdir()
    (tmp_path / ".a.zarr.backup.creating").mkdir()
    age(tmp_path)
    make(tmp_path / "a.zarr")
    assert {file.name for file in tmp_path.iterdir()} == {"a.zarr", "a.card.md", ".a.zarr.backup.creating"}


def test_temporary_files_are_swept_exactly(tmp_path):
    """Dead writers' files go, those of living writers and of the user stay."""
    folder = tmp_path / "a.zarr"
    make(folder)
    dead = [folder / f"image/c/1/0/0.{'0' * 32}.partial", folder / f"level/c/2.{'1' * 32}.partial",
            folder / f"image/zarr.{'2' * 32}.partial", folder / f"zarr.json.{'3' * 32}.partial",
            folder / f"valid/record.json.{'4' * 32}.partial", tmp_path / f"a.card.md.{'5' * 32}.partial"]  # fmt: skip
    living = [folder / f"image/c/3/0/0.{'6' * 32}.partial", tmp_path / f".a.zarr.{'8' * 32}.creating"]
    users = [folder / "thesis.partial", folder / "image/thesis.partial", folder / "image/c/1/0/mine.partial",
             folder / f"notes/c/1/0.{'7' * 32}.partial", tmp_path / "a.card.md.old.partial"]  # fmt: skip
    for file in (*dead, *users):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(b"precious")
    age(tmp_path)
    for file in living:
        file.write_bytes(b"half")
    assert verify(folder).orphans == 5, "of the store: the card lies beside it"
    make(folder)
    assert [file for file in dead if file.exists()] == []
    assert all(file.exists() for file in (*living, *users))


@pytest.mark.parametrize("deaths", range(10))
def test_a_growing_store_is_sound_after_a_kill_in_a_rewrite(tmp_path, monkeypatch, deaths):
    """Shard 1 held 3 of its 5 samples; its rewriting dies at its first file, its second, ... the ledger."""
    folder = tmp_path / "a.zarr"
    make(folder, samples=8)
    write, left = store.put, iter(range(deaths))

    def dying(file, data, **options):
        if next(left, None) is None:
            raise KeyboardInterrupt
        write(file, data, **options)

    monkeypatch.setattr(store, "put", dying)
    with pytest.raises(KeyboardInterrupt):
        make(folder)
    monkeypatch.undo()
    found = verify(folder)
    assert (found.damaged, found.unfinished) == ((), (1, 2, 3, 4))
    assert_holds(folder, FakeRecipe(), 8)
    make(folder)
    assert_holds(folder, FakeRecipe(), 22)


def test_damage_in_a_shard_that_is_not_full_is_found_all_the_same(tmp_path):
    folder = tmp_path / "a.zarr"
    make(folder, samples=8)
    creation.grown(Store(folder), 22)
    file = folder / "object/c/1/0/0"
    data = bytearray(file.read_bytes())
    data[0] ^= 1
    file.write_bytes(data)
    assert verify(folder).damaged == (1,)


def test_a_lost_file_names_the_remedy(tmp_path):
    make(tmp_path / "a.zarr")
    (tmp_path / "a.zarr/image/c/1/0/0").unlink()
    with pytest.raises(MissingSample, match="but the ledger lists it. Repair the store with"):
        SpeckleCache(tmp_path / "a.zarr").numpy(7)
    make(tmp_path / "b.zarr", shard_range=(0, 2))
    with pytest.raises(MissingSample, match="has not been generated yet. Run generate again"):
        SpeckleCache(tmp_path / "b.zarr").numpy(21)


def full_after(monkeypatch, writes):
    """Let the disk be full after some columns were written."""
    write, left = store.put, iter(range(writes))

    def filling(file, data, **options):
        if next(left, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(file, data, **options)

    monkeypatch.setattr(store, "put", filling)


def test_a_full_disk_stops_at_once(tmp_path, monkeypatch):
    """In shard 1: shards 2 to 4 are not rendered in vain; with room again the call goes on."""
    log = tmp_path / "log"
    full_after(monkeypatch, 13)
    with pytest.raises(GenerationError, match=r"Writing to .* failed after 5 of 22 .*\n.*No space.*\nFree some space"):
        make(tmp_path / "a.zarr", FakeRecipe(log=str(log)))
    monkeypatch.undo()
    assert max(int(line.split()[1]) for line in log.read_text().splitlines()) == 9
    assert info(tmp_path / "a.zarr")["done"] == 5
    make(tmp_path / "a.zarr")
    assert_holds(tmp_path / "a.zarr", FakeRecipe(), 22)


@pytest.mark.parametrize("step", ["create", "grow"])
def test_a_full_disk_is_named_when_a_store_is_made_or_grown(tmp_path, monkeypatch, step):
    if step == "grow":
        make(tmp_path / "a.zarr", samples=8)

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(metadata, "put", full)
    with pytest.raises(RuleError, match="No space left on device.*Make room, then run the same command again"):
        make(tmp_path / "a.zarr")
    monkeypatch.undo()
    make(tmp_path / "a.zarr")
    assert_holds(tmp_path / "a.zarr", FakeRecipe(), 22)
    assert {file.name for file in tmp_path.iterdir()} == {"a.zarr", "a.card.md"}
