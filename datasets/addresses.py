"""Source of the random numbers of a data set: every draw has an address, and a batch of them is drawn at once.

A number is a pure function of (seed, split, purpose, number of the sample or medium). What is found for a batch is, to
the bit, what NumPy's generators find one by one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from specklegen.core.random_streams import Seed, Stream
from specklegen.datasets import random_words
from specklegen.datasets.distributions import Choice, Draw, drawn, drawn_from
from specklegen.datasets.split import Purpose, Split, generator, split_number, substream


@dataclass(frozen=True)
class Addresses:
    """The draws of one split of a data set.

    Attributes
    ----------
    seed, split
        Of the data set.
    device
        Where what is drawn is wanted.
    """

    seed: Seed
    split: Split
    device: torch.device

    @cached_property
    def _tail(self) -> tuple[int, ...]:
        return substream(self.seed, self.split, Purpose.MATERIAL, 0)[4:]

    def words(self, numbers: Sequence[int], purposes: Sequence[Purpose]) -> torch.Tensor:
        """Words int64[B, purposes, n] of :func:`specklegen.datasets.split.substream`, on the host."""
        chosen = [int(p) for p in purposes]
        return random_words.substreams(split_number(self.split), chosen, numbers, self._tail)

    def numbers(self, purpose: Purpose, sources: Sequence[Draw], numbers: Sequence[int]) -> list[torch.Tensor]:
        """One number float64[B] of each source, as :func:`drawn` draws one after the other; at most four at once."""
        if len(sources) > 4 or any(isinstance(source, Choice) for source in sources):
            rows = []
            for number in numbers:
                rng = generator(substream(self.seed, self.split, purpose, number))
                rows.append([drawn(source, rng) for source in sources])
            return [*torch.tensor(rows, dtype=torch.float64).to(self.device, non_blocking=True).unbind(1)]
        uniform = self.uniforms(purpose, numbers)
        return [drawn_from(source, uniform[:, place]) for place, source in enumerate(sources)]

    def uniforms(self, purpose: Purpose, numbers: Sequence[int]) -> torch.Tensor:
        """The first four uniform numbers float64[B, 4] of each generator."""
        return random_words.uniforms(self.words(numbers, [purpose]))[:, 0].to(self.device, non_blocking=True)

    def keys(self, stream: Stream, words: torch.Tensor) -> torch.Tensor:
        """Keys int64[..., 2] of the engine's generator, of words int64[..., n]."""
        return random_words.stream_keys(random_words.keyed(stream, words)).to(self.device, non_blocking=True)

    def put(self, numbers: Sequence[int] | np.ndarray) -> torch.Tensor:
        """Whole numbers on the device, int64[...]."""
        return torch.from_numpy(np.array(numbers, np.int64)).to(self.device, non_blocking=True)
