"""Splits and substreams: which draws and which sources belong to train, validation and test.

Sample n of a split is a pure function of (seed, split, n). Every purpose that draws random numbers has
a substream of its own, so that switching one noise on leaves all the other draws as they were; and the
split is part of every substream, so that the media of two splits never coincide.

Sources that can be listed (characters, pictures, files) are dealt to the splits by the order of
their hashes; sources that cannot (random patterns) are assigned one by one from their hash. Either
way a source belongs to exactly one split, before any sample is drawn.
"""

import hashlib
from collections.abc import Iterable, Sequence
from enum import IntEnum
from functools import lru_cache
from typing import Literal, get_args

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed, seed_words

Split = Literal["train", "validation", "test"]

SPLITS: tuple[Split, ...] = get_args(Split)
SHARES: dict[Split, float] = {"train": 0.8, "validation": 0.1, "test": 0.1}


class Purpose(IntEnum):
    """Purposes of substreams. The numbers are part of the data version: add, never renumber."""

    MATERIAL = 1
    MEDIUM = 2
    OBJECT = 3
    OBJECT_ORDER = 4
    PHASES = 5
    TILTS = 6
    POLARISATION = 7
    SPECTRUM = 8
    DYNAMICS = 9
    SHOT_NOISE = 10
    BACKGROUND = 11
    DARK_CURRENT = 12
    READ_NOISE = 13
    SAMPLE_ORDER = 14
    FIELD = 15
    FAMILY = 16
    OUTLINE = 17
    FOCUS = 18
    BENCH = 19
    BENCH_OF_MEDIUM = 20
    UNEVENNESS = 21
    PERIODOGRAM = 22


def split_number(split: str) -> int:
    """Number of a split: ``0`` for train, ``1`` for validation, ``2`` for test."""
    if not isinstance(split, str) or split not in SPLITS:
        reject("split", f"one of {', '.join(map(repr, SPLITS))}", split)
    return SPLITS.index(split)


def substream(seed: Seed, split: Split, purpose: Purpose, number: int) -> tuple[int, ...]:
    """Words uint32 that address one substream; different arguments give different, unrelated draws.

    The words are entropy for :class:`numpy.random.SeedSequence`, and a seed for `specklegen.render`.

    Parameters
    ----------
    seed
        A whole number of at least 0, or a sequence of them.
    split, purpose
        What the draws are for.
    number
        Index of the sample, or of the medium, from 0 to 2**64 - 1.
    """
    parts = seed_words(seed)
    if not _is_natural(number) or number >= 2**64:
        reject("number", "a whole number from 0 to 2**64 - 1", number)
    head = (split_number(split), int(Purpose(purpose)), int(number) % 2**32, int(number) >> 32, len(parts))
    # Lengths go first: SeedSequence pads with zeros, so that (1,) and (1, 0) would be one seed.
    return head + tuple(word for part in parts for word in _counted_words(part))


def generator(words: Sequence[int]) -> np.random.Generator:
    """Counter-based generator (Philox) of one substream."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(words)))


def medium_of(index: int, media: int) -> int:
    """Number of the medium that sample ``index`` is seen through, when a split has ``media`` of them."""
    if not _is_natural(media) or media < 1:
        reject("media", "a whole number of at least 1", media)
    if not _is_natural(index):
        reject("index", "a whole number of at least 0", index)
    return int(index) % int(media)


def stable_hash(key: str) -> int:
    """64 bits of the SHA-256 of a text: the same on every machine, in every process."""
    return int.from_bytes(hashlib.sha256(key.encode()).digest()[:8], "big")


def split_of(key: str) -> Split:
    """Split that a source belongs to when sources cannot be listed: its hash against `SHARES`."""
    fraction = stable_hash(key) / 2**64
    for split in SPLITS[:-1]:
        fraction -= SHARES[split]
        if fraction < 0:
            return split
    return SPLITS[-1]


def keys_of_split(keys: Iterable[str], split: Split) -> tuple[str, ...]:
    """Keys of a listed set that belong to one split, in the order of their hashes.

    The set, without repetitions, is sorted by hash and cut at `SHARES`: at least one key each for
    validation and test where there are three or more, all of them for train where there are fewer.
    The order of the list and the names of its owners do not matter; adding a key moves only keys
    beside the two cuts.
    """
    ordered = sorted(set(keys), key=lambda key: (stable_hash(key), key))
    held_out = [max(1, round(SHARES[name] * len(ordered))) if len(ordered) > 2 else 0 for name in SPLITS[1:]]
    first, second = len(ordered) - sum(held_out), len(ordered) - held_out[-1]
    start, stop = ((0, first), (first, second), (second, len(ordered)))[split_number(split)]
    return tuple(ordered[start:stop])


def position_in_pass(seed: Seed, split: Split, index: int, count: int) -> int:
    """Which of ``count`` sources sample ``index`` uses: every source once a pass, shuffled anew each pass."""
    return int(_pass_order(seed_words(seed), split, index // count, count)[index % count])


def positions_in_passes(seed: Seed, split: Split, indices: Sequence[int], count: int) -> np.ndarray:
    """Return :func:`position_in_pass` of many samples, int64[B]."""
    words, (number, place) = seed_words(seed), np.divmod(np.asarray(indices, np.int64), count)
    positions = np.empty_like(place)
    for one in np.unique(number):
        own = number == one
        positions[own] = _pass_order(words, split, int(one), count)[place[own]]
    return positions


@lru_cache(maxsize=32)
def _pass_order(seed: Seed, split: Split, number: int, count: int) -> np.ndarray:
    return generator(substream(seed, split, Purpose.OBJECT_ORDER, number)).permutation(count)


def _is_natural(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and int(value) >= 0


def _counted_words(value: int) -> tuple[int, ...]:
    words = [value % 2**32]
    while value := value >> 32:
        words.append(value % 2**32)
    return len(words), *words
