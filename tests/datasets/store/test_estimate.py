"""Costs stated before a run are within a factor of two of what happens (data_pipeline.md 5, point 12)."""

import shutil
import tracemalloc
from types import SimpleNamespace

import pytest
from fake_recipe import FakeRecipe

from specklegen.core.errors import RuleError
from specklegen.datasets.store import estimate as estimating
from specklegen.datasets.store.estimate import estimate, foreseen
from specklegen.datasets.store.filling import GenerationError
from specklegen.datasets.store.generate import generate


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
@pytest.mark.parametrize("side", [32, 128])
def test_bytes_and_memory(tmp_path, dtype, side):
    recipe = FakeRecipe(side=side)
    told = estimate(recipe, 60, dtype=dtype, shard_samples=20)
    generate(recipe, samples=1, folder=tmp_path / "first.zarr", processes=1)  # imports and caches
    tracemalloc.start()
    result = generate(recipe, samples=60, folder=tmp_path / "a.zarr", dtype=dtype, shard_samples=20, processes=1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.5 < result["bytes"] / told["bytes"] < 2
    assert 0.5 < peak / told["memory"] < 2
    assert (told["shards"], told["shard_samples"]) == (3, 20)


def test_seconds_count_every_sample():
    """Samples that sleep 5 ms: no estimate of 400 of them on two processes may be below a second."""
    told = estimate(FakeRecipe(seconds=0.005), 400, processes=2)
    assert told["seconds"] >= 400 * 0.005 / 2
    assert told["processes"] == 2


def test_a_recipe_that_fails_is_told_before_the_run():
    with pytest.raises(GenerationError, match="index=7"):
        estimate(FakeRecipe(fails_at=7), 1000)


def test_little_is_not_spoken_of(tmp_path):
    assert foreseen(FakeRecipe(), 100, tmp_path / "a.zarr") == ""


def test_what_takes_long_is_told_in_minutes_and_bytes(tmp_path):
    """A hundred thousand samples that sleep 2 ms: at least 200 s."""
    told = foreseen(FakeRecipe(seconds=0.002), 100_000, tmp_path / "no" / "a.zarr", processes=1)
    assert told.startswith("100000 samples to render: about ")
    assert "minutes on 1 core, " in told
    assert told.endswith(" GiB")


def test_what_a_disk_has_no_room_for_is_refused(tmp_path, monkeypatch):
    """Ten kilobytes are free; who insists goes on."""
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=10_000))
    with pytest.raises(RuleError, match=r"generate.samples must be small enough for the .* GiB free.*--anyway"):
        foreseen(FakeRecipe(), 1000, tmp_path / "a.zarr")
    assert "GiB" in foreseen(FakeRecipe(), 1000, tmp_path / "a.zarr", anyway=True)
    assert foreseen(FakeRecipe(side=2), 5, tmp_path / "a.zarr") == ""


def test_months_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(estimating, "TOLD_SECONDS", 0.01)
    monkeypatch.setattr(estimating, "MOST_SECONDS", 0.02)
    monkeypatch.setattr("specklegen.core.budgets.MOST_SECONDS", 0.02)
    with pytest.raises(RuleError, match=r"generate.samples must be done within .* days.*--anyway"):
        foreseen(FakeRecipe(seconds=0.01), 100, tmp_path / "a.zarr", processes=1)
