"""Some interleavings of tests/model_check.py, and that it finds writers who exclude nobody."""

import contextlib

import model_check
import pytest

from specklegen.datasets.store import store


@pytest.fixture(autouse=True)
def _empty():
    yield
    system = model_check.fsspec.filesystem("memory")
    if system.exists("/model"):
        system.rm("/model", recursive=True)


def test_no_order_of_writers_deaths_and_readers_breaks_a_law():
    assert model_check.run(60, seed=1_000_000) == {}


def test_claims_that_exclude_nobody_are_found(monkeypatch):
    monkeypatch.setattr(store, "claim_object", lambda file, wait=False: contextlib.nullcontext("held"))
    assert model_check.run(40) != {}
