"""Some interleavings of tests/model_check.py at an object store and in a folder; deliberate faults are found."""

import contextlib

import model_check
import numpy as np
import pytest

from specklegen.datasets.store import creation, metadata, places, store
from specklegen.datasets.store.encoding import table_bytes


def test_no_order_of_writers_deaths_and_readers_breaks_a_law():
    assert model_check.run(25, seed=1_000_000) == {}


def test_writers_that_are_stopped_for_longer_than_their_claims_last_break_no_law():
    assert model_check.run(20, seed=1_000_000, stopped=True) == {}
    for late in (311, 622, 1160):  # a length that came late; a record that came late; a shard replaced while it is read
        assert model_check.run(1, seed=late, stopped=True) == {}


def test_claims_exclude_nobody_and_no_law_is_broken(monkeypatch):
    """They save double work alone; but the lengths that come late must be known for what they are."""
    monkeypatch.setattr(store, "claim_object", lambda file, wait=False: contextlib.nullcontext("held"))
    assert model_check.run(9) == {}
    monkeypatch.setattr(metadata, "is_remote", lambda folder: False)
    assert model_check.run(9) != {}


def test_a_folder_that_is_looked_through_after_its_group_is_looked_for_is_found(monkeypatch):
    """The group and more of another task may appear in between: two tasks began a store, and one failed."""
    begin = creation._begin

    def hasty(recipe, wanted, folder, *rest):
        if metadata.is_store(folder) or not creation.listed(folder, maxdepth=2):
            begin(recipe, wanted, folder, *rest)

    monkeypatch.setattr(creation, "_begin", hasty)
    words = " ".join(model_check.run(12, ahead=False).values())
    assert "must be a store whose creation has ended" in words


def test_a_claim_that_is_old_by_its_own_date_alone_is_found(monkeypatch):
    """The clock of the machine that died was ahead: others waited for that long."""
    made = model_check.Schedule.__init__

    def unwatched(self, *arguments):
        made(self, *arguments)
        self.time.monotonic = lambda: 0.0

    monkeypatch.setattr(model_check.Schedule, "__init__", unwatched)
    assert "waits for a dead claim for hours" in " ".join(model_check.run(8).values())


@pytest.mark.parametrize("unlockable", [False, True])
def test_no_order_breaks_a_law_in_a_folder(unlockable, tmp_path):
    assert model_check.run(6, seed=1_000_000, folder=tmp_path, unlockable=unlockable) == {}


@pytest.mark.parametrize("seed", [41181, 41214])
def test_a_shard_of_two_lengths_is_made_whole_where_locks_exclude_nobody(seed, tmp_path):
    """A call of fewer samples wrote some files of a shard after one of more, whose ledger came last."""
    assert model_check.run(1, seed=seed, folder=tmp_path, unlockable=True) == {}


@pytest.mark.parametrize("local", [False, True])
def test_a_ledger_that_is_written_first_is_found(local, tmp_path, monkeypatch):
    write = store.Store.write_shard

    def ledger_first(self, shard, columns):
        places.put(self._file("valid", shard), table_bytes(np.ones(self.shard_samples, bool)))
        return write(self, shard, columns)

    monkeypatch.setattr(store.Store, "write_shard", ledger_first)
    assert model_check.run(8, folder=tmp_path if local else None) != {}
