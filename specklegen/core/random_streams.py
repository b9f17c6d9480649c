"""Random streams: which purpose draws from which key.

A key is made from (seed, stream); the kernels address single draws under it by (sample, path,
dimension). Separate purposes use separate streams, so that a new kind of draw never disturbs the others.
"""

from collections.abc import Sequence
from enum import IntEnum
from functools import lru_cache

import numpy as np

from specklegen.core.errors import reject

Seed = int | Sequence[int]
"""A non-negative integer, or a sequence of them such as (seed, split, index)."""


class Stream(IntEnum):
    """Purposes that draw random numbers in the engine; numbers are part of the data version."""

    PATHS = 1
    PHASES = 2
    PILOT = 3
    STATIONARY = 4
    EIGEN = 5
    CAMERA = 6
    TYPES = 7
    MOTION = 8
    DIFFRACTION = 21
    BEAMS = 22
    MATERIALS = 31


def stream_key(seed: Seed, stream: Stream) -> tuple[int, int]:
    """Two 32-bit words that key the draws of one stream of one seed."""
    return _key(int(stream), seed_words(seed))


def seed_words(seed: Seed) -> tuple[int, ...]:
    """Return the whole numbers of a seed, one or several."""
    words = list(seed) if isinstance(seed, Sequence) and not isinstance(seed, str | bytes) else [seed]
    if not words or any(isinstance(w, bool) or not isinstance(w, int | np.integer) or w < 0 for w in words):
        reject("seed", "a whole number of at least 0, or a sequence of them", seed)
    return tuple(map(int, words))


@lru_cache(256)  # stack after stack asks for the same
def _key(stream: int, words: tuple[int, ...]) -> tuple[int, int]:
    # The length enters, because SeedSequence treats (1,) and (1, 0) alike.
    first, second = np.random.SeedSequence([stream, len(words), *words]).generate_state(2)
    return int(first), int(second)


def pilot_seed(fingerprint: str) -> int:
    """Seed of a scene's pilots: a function of its fingerprint, never of the run."""
    return int(fingerprint[:16], 16)
