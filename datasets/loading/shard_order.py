"""The order of an epoch of a shuffled store: shards in any order, then the samples of every few of them.

Nothing is held of it but the order of the shards, eight bytes each, and the samples of one group of shards: who
shuffles 1e8 samples by their numbers holds a gigabyte and a half in every worker.
"""

import numpy as np

ORDER = "by group"
"""How it is drawn; whoever goes on in an epoch must draw it in the same way."""


class ShardOrder:
    """Samples of an epoch by their places in it: a pure function of all arguments.

    Parameters
    ----------
    length
        Samples.
    shard_samples
        Samples in a shard; the last one may hold fewer.
    buffer_shards
        Shards in a group, whose samples are shuffled among themselves.
    seed, epoch
        Of the order.
    """

    def __init__(self, length: int, shard_samples: int, buffer_shards: int, seed: int, epoch: int) -> None:
        self._length, self._size, self._buffer, self._key = length, shard_samples, buffer_shards, (seed, epoch)
        self._shards = self._random(0).permutation(-(-length // shard_samples))
        groups = -(-len(self._shards) // buffer_shards)
        ends = np.minimum(np.arange(1, groups + 1) * buffer_shards, len(self._shards)) * shard_samples
        short = len(self._shards) * shard_samples - length  # what the last shard lacks, wherever in the order it comes
        last = int(np.flatnonzero(self._shards == len(self._shards) - 1)[0]) // buffer_shards
        ends[last:] -= short
        self._ends, self._known = ends, (-1, np.empty(0, np.int64))

    def __getitem__(self, places: slice) -> np.ndarray:
        """Samples at places from ``start`` to ``stop``, int64[stop - start]."""
        first, last = np.searchsorted(self._ends, [places.start, max(places.start, places.stop - 1)], side="right")
        start = int(self._ends[first - 1]) if first else 0
        groups = [self._group(number) for number in range(first, last + 1)]
        return np.concatenate(groups)[places.start - start : places.stop - start]

    def _group(self, number: int) -> np.ndarray:
        """Samples of a group in their order; the last one that was asked for is kept."""
        if self._known[0] != number:
            shards = self._shards[number * self._buffer : (number + 1) * self._buffer]
            samples = (shards[:, None] * self._size + np.arange(self._size)).ravel()
            self._known = number, self._random(1 + number).permutation(samples[samples < self._length])
        return self._known[1]

    def _random(self, number: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self._key, spawn_key=(number,)))
