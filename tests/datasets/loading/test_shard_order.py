"""The order of shuffled epochs: every sample once, by groups of shards, at any place without those before it."""

import tracemalloc

import numpy as np
import pytest

from specklegen.datasets.loading.shard_order import ShardOrder


@pytest.mark.parametrize(("length", "size", "buffer"), [(1, 4, 2), (22, 5, 2), (100, 10, 4), (97, 7, 3), (40, 5, 100)])
def test_it_holds_each_sample_once_and_is_the_same_from_anywhere(length, size, buffer):
    for seed in range(20):  # the short last shard comes first, in the middle, last
        order = ShardOrder(length, size, buffer, seed, epoch=3)
        whole = order[0:length]
        assert sorted(whole.tolist()) == [*range(length)]
        random = np.random.default_rng(seed)
        for _ in range(30):
            start, stop = sorted(random.integers(0, length + 1, 2))
            again = ShardOrder(length, size, buffer, seed, epoch=3) if start % 2 else order
            assert again[start:stop].tolist() == whole[start:stop].tolist()
        shards, first = whole // size, 0
        while first < length:
            group = {*shards[first : first + 1]}
            while first < length and len(group | {shards[first]}) <= buffer:
                group.add(shards[first])
                first += 1
            assert not group & {*shards[first:].tolist()}, "a shard in two groups"


def test_epochs_seeds_and_groups_have_orders_of_their_own():
    orders = [ShardOrder(4000, 1000, 1, seed, epoch) for seed, epoch in ((0, 0), (0, 1), (1, 0), (0, 2**40))]
    within = {tuple((order[n * 1000 : (n + 1) * 1000] % 1000).tolist()) for order in orders for n in range(4)}
    assert len(within) == 16


def test_every_place_is_as_likely_for_every_sample():
    """Shards of one sample, so that orders are permutations: 11/12 of the sum is a chi-square, of 121 degrees.

    False-alarm rate 1e-6; where groups were left where they are it would be thousands.
    """
    counts = np.zeros((12, 12))
    for seed in range(3000):
        counts[np.arange(12), ShardOrder(12, 1, 3, seed, 0)[0:12]] += 1
    assert 11 / 12 * float((np.square(counts - 250) / 250).sum()) < 209.8


def test_a_hundred_million_samples_take_no_index():
    tracemalloc.start()
    order = ShardOrder(10**8, 1000, 4, 0, 0)
    assert len(np.unique(order[51_234_567:51_234_599])) == 32
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10 * 2**20, "their numbers alone are 800 MB"
