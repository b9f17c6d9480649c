"""Costs stated before a run are within a factor of two of what happens (data_pipeline.md 5, point 12)."""

import tracemalloc

import pytest
from fake_recipe import FakeRecipe

from specklegen.datasets.store.estimate import estimate  # noqa: E402
from specklegen.datasets.store.generate import GenerationError, generate  # noqa: E402


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
@pytest.mark.parametrize("side", [32, 128])
def test_bytes_and_memory(tmp_path, dtype, side):
    recipe = FakeRecipe(side=side)
    told = estimate(recipe, 60, dtype=dtype, shard_samples=20)
    generate(recipe, samples=1, folder=tmp_path / "first.zarr", processes=1)  # imports and caches
    tracemalloc.start()
    result = generate(
        recipe, samples=60, folder=tmp_path / "a.zarr", dtype=dtype, shard_samples=20, processes=1
    )
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
