"""The stream: order, ranks, workers, epochs and resume (data_pipeline.md 5, points 1 to 5)."""

import itertools
import pickle
import threading

import numpy as np
import pytest
import torch
from fake_recipe import FakeRecipe, assert_same, stack
from torch.utils.data import DataLoader

from specklegen.datasets import SpeckleStream  # noqa: E402
from specklegen.datasets.loading.partition import batch_count, batch_range  # noqa: E402
from specklegen.datasets.sample_schema import Renderable  # noqa: E402

TIMEOUT = 120


def indices(batches):
    return [batch["index"].tolist() for batch in batches]


def flat(batches):
    return list(itertools.chain.from_iterable(indices(batches)))


def test_the_fake_recipe_keeps_the_protocol():
    recipe: Renderable = FakeRecipe()
    assert isinstance(recipe, Renderable)


def test_a_batch_equals_its_samples_to_the_bit():
    recipe = FakeRecipe()
    batch = next(iter(SpeckleStream(recipe, seed=3, batch_size=4)))
    assert all(isinstance(value, torch.Tensor) for key, value in batch.items() if key != "parameters")
    assert_same(batch, stack([recipe.sample(3, "train", n) for n in range(4)]))


def test_a_stream_survives_pickling():
    stream = SpeckleStream(FakeRecipe(), batch_size=7)
    stream.set_epoch(2)
    for a, b in zip(stream, pickle.loads(pickle.dumps(stream)), strict=True):
        assert_same(a, b)


@pytest.mark.parametrize("length", [1, 5, 96, 97, 100, 1000])
@pytest.mark.parametrize("batch_size", [1, 3, 32])
@pytest.mark.parametrize("world", [1, 2, 4, 7])
def test_ranks_share_an_epoch_without_gap_or_overlap(length, batch_size, world):
    rest = length % (batch_size * world)
    if rest and rest < world:
        with pytest.raises(ValueError, match="has a sample in the last round"):
            batch_count(length, batch_size, world)
        return
    count = batch_count(length, batch_size, world)
    batches = [
        [batch_range(length, batch_size, world, rank, number) for number in range(count)] for rank in range(world)
    ]
    assert all(0 < len(batch) <= batch_size for rank in batches for batch in rank)
    in_order = [n for b in range(count) for rank in range(world) for n in batches[rank][b]]
    assert in_order == list(range(length))


def test_drop_last_gives_full_batches_only():
    batches = indices(SpeckleStream(FakeRecipe(samples=70), batch_size=16, rank=1, world=2, drop_last=True))
    assert batches == [list(range(16, 32)), list(range(48, 64))]
    with pytest.raises(ValueError, match="drop_last"):
        SpeckleStream(FakeRecipe(samples=7), batch_size=16, drop_last=True)


@pytest.mark.filterwarnings("ignore:This DataLoader will create 3 worker processes")
@pytest.mark.parametrize("world", [1, 2, 4])
def test_ranks_times_workers(world):
    """Ranks are disjoint, make up the epoch and count alike; the bits do not depend on the workers."""
    recipe = FakeRecipe(samples=52)
    streams = [SpeckleStream(recipe, batch_size=4, rank=rank, world=world) for rank in range(world)]
    alone = [list(stream) for stream in streams]
    assert len({len(batches) for batches in alone}) == 1
    assert sorted(itertools.chain.from_iterable(map(flat, alone))) == list(range(52))
    for workers in (1, 3):
        rank = workers % world  # one rank for each number of workers keeps the test short
        seen = list(streams[rank].loader(num_workers=workers, timeout=TIMEOUT))
        for a, b in zip(seen, alone[rank], strict=True):
            assert_same(a, b)


@pytest.mark.parametrize("workers", [0, 2])
def test_plain_dataloader(workers):
    """Fork after torch threads ran in the parent: completes, same bits."""
    torch.ones(512, 512) @ torch.ones(512, 512)
    stream = SpeckleStream(FakeRecipe(), batch_size=16)
    plain = DataLoader(stream, batch_size=None, num_workers=workers, timeout=TIMEOUT if workers else 0)
    for a, b in zip(plain, stream, strict=True):
        assert_same(a, b)


@pytest.mark.parametrize("workers", [0, 2])
def test_set_epoch_reaches_persistent_workers(workers):
    stream = SpeckleStream(FakeRecipe(samples=12), batch_size=4)
    loader = stream.loader(num_workers=workers, timeout=TIMEOUT)
    assert flat(loader) == list(range(12))
    loader.set_epoch(5)
    assert flat(loader) == list(range(60, 72))
    stream.set_epoch(1)
    assert flat(loader) == list(range(12, 24))
    next(iter(loader))  # abandoned in the middle
    loader.set_epoch(2)
    assert flat(loader) == list(range(24, 36))
    assert flat(loader) == list(range(24, 36))


def test_set_epoch_reaches_persistent_workers_of_a_plain_dataloader():
    stream = SpeckleStream(FakeRecipe(samples=12), batch_size=4)
    plain = DataLoader(stream, batch_size=None, num_workers=2, persistent_workers=True, timeout=TIMEOUT)
    assert flat(plain) == list(range(12))
    stream.set_epoch(1)
    assert flat(plain) == list(range(12, 24))


def epochs(loader, first, last):
    for epoch in range(first, last):
        loader.set_epoch(epoch)
        yield from loader


@pytest.mark.parametrize("stop", [0, 1, 6, 7, 8, 13])
def test_resume_equals_an_uninterrupted_run(stop):
    def fresh():
        return SpeckleStream(FakeRecipe(samples=50), seed=1, batch_size=8).loader()

    whole = list(epochs(fresh(), 0, 2))
    first = fresh()
    head = list(itertools.islice(epochs(first, 0, 2), stop))
    state = pickle.loads(pickle.dumps(first.state_dict()))
    second = fresh()
    second.load_state_dict(state)
    assert second.state_dict() == state
    tail = list(epochs(second, state["epoch"], 2))
    assert len(head) == stop
    for a, b in zip(head + tail, whole, strict=True):
        assert_same(a, b)


@pytest.mark.parametrize(("before", "after"), [(2, 1), (0, 2)])
def test_resume_with_another_number_of_workers(before, after):
    """Workers had made batches in advance: the position counts only what was handed out."""
    stream = SpeckleStream(FakeRecipe(samples=50), batch_size=4)
    first = stream.loader(num_workers=before, timeout=TIMEOUT)
    head = list(itertools.islice(first, 3))
    second = SpeckleStream(FakeRecipe(samples=50), batch_size=4).loader(num_workers=after, timeout=TIMEOUT)
    second.load_state_dict(first.state_dict())
    assert flat(head) + flat(second) == list(range(50))
    assert flat(second) == list(range(50, 100)), "a resumed position holds for one iteration only"


def test_resume_with_another_world_is_exact_or_refused():
    recipe = FakeRecipe(samples=64)
    one = SpeckleStream(recipe, batch_size=8, rank=0, world=1).loader()
    next(iter(one))
    halves = [SpeckleStream(recipe, batch_size=8, rank=rank, world=2).loader() for rank in (0, 1)]
    with pytest.raises(ValueError, match="Resume with 1 ranks and batches of 8"):
        halves[0].load_state_dict(one.state_dict())
    one = SpeckleStream(recipe, batch_size=8, rank=0, world=1).loader()
    list(itertools.islice(one, 2))
    for half in halves:
        half.load_state_dict(one.state_dict())
    assert sorted(flat(halves[0]) + flat(halves[1])) == list(range(16, 64))
    list(one)
    halves[0].load_state_dict(one.state_dict())
    assert flat(halves[0]) == []
    assert flat(halves[0]) == [n for n in range(128, 192) if n % 16 < 8], "the epoch after the one that was over"


@pytest.mark.parametrize(
    ("change", "field"),
    [({"seed": 1}, "seed"), ({"split": "test"}, "split"),
     ({"recipe": FakeRecipe(thickness=2.0)}, "fingerprint"),
     ({"recipe": FakeRecipe(data_version=2)}, "data_version"),
     ({"recipe": FakeRecipe(samples=9)}, "length")],
)  # fmt: skip
def test_a_state_of_other_samples_is_refused(change, field):
    state = SpeckleStream(FakeRecipe()).loader().state_dict()
    settings = {"recipe": FakeRecipe(), "batch_size": 4} | change
    with pytest.raises(ValueError, match=field):
        SpeckleStream(**settings).loader().load_state_dict(state)


def test_splits_and_seeds_differ():
    images = {
        (seed, split): next(iter(SpeckleStream(FakeRecipe(), seed, split)))["image"].numpy().tobytes()
        for seed in (0, 1)
        for split in ("train", "validation", "test")
    }
    assert len(set(images.values())) == 6


def test_two_threads_at_once():
    stream, seen = SpeckleStream(FakeRecipe(), batch_size=10), [[], []]
    threads = [threading.Thread(target=lambda out=out: out.extend(stream)) for out in seen]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(TIMEOUT)
    for a, b, c in zip(*seen, stream, strict=True):
        assert_same(a, c)
        assert_same(b, c)


class TorchThreads(FakeRecipe):
    """Reports the torch threads that it renders with."""

    def sample(self, seed, split, index):
        return super().sample(seed, split, index) | {"level": np.float64(torch.get_num_threads())}


def test_rendering_uses_one_torch_thread_and_restores_the_rest():
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        assert {float(batch["level"].max()) for batch in SpeckleStream(TorchThreads())} == {1.0}
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


@pytest.mark.parametrize(
    ("settings", "words"),
    [({"batch_size": 0}, "batch_size must be at least 1; got 0"), ({"rank": 2, "world": 2}, "rank must be"),
     ({"rank": -1, "world": 2}, "rank must be")],
)  # fmt: skip
def test_bad_settings_are_named(settings, words):
    with pytest.raises(ValueError, match=words):
        SpeckleStream(FakeRecipe(), **settings)
