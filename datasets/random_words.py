"""Random numbers of a batch of addresses: to the bit what NumPy's generators and the engine's keys find one by one.

Numbers of samples are known on the host: what is drawn of them is drawn there, for a batch at once, and copied.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch

from specklegen.kernels.seeds import fill_first_uniforms, fill_seed_states

_LOW = 0xFFFFFFFF


def _filled(fill: Callable[..., None], rows: torch.Tensor, out: np.ndarray) -> torch.Tensor:
    fill(rows.reshape(-1, rows.shape[-1]).contiguous().numpy(), out)
    return torch.from_numpy(out).reshape(*rows.shape[:-1], out.shape[-1])


def seed_state(entropy: torch.Tensor, count: int) -> torch.Tensor:
    """Return what ``SeedSequence(words).generate_state(count)`` does, int64[..., count].

    Parameters
    ----------
    entropy : int64[..., n]
        Words of 32 bits, at least 4 of them.
    count
        Words wanted, at most 4.
    """
    return _filled(fill_seed_states, entropy, np.empty((entropy.shape[:-1].numel(), count), np.int64))


def uniforms(entropy: torch.Tensor) -> torch.Tensor:
    """First four of ``Generator(Philox(SeedSequence(words))).random()``, float64[..., 4], from int64[..., n]."""
    states = seed_state(entropy, 4)
    return _filled(fill_first_uniforms, states, np.empty((states.shape[:-1].numel(), 4)))


def stream_keys(entropy: torch.Tensor) -> torch.Tensor:
    """Key int64[..., 2] of two 32-bit words, as ``specklegen.core.random_streams.stream_key`` makes it."""
    return seed_state(entropy, 2)


def substreams(split: int, purposes: Sequence[int], numbers: Sequence[int], tail: tuple[int, ...]) -> torch.Tensor:
    """Words int64[B, purposes, n] of ``specklegen.datasets.split.substream``.

    Parameters
    ----------
    split
        Number of the split.
    purposes
        Numbers of the purposes.
    numbers
        B numbers of samples or media.
    tail
        What follows the number: the seed's parts, counted.
    """
    number = np.asarray(numbers, np.int64)[:, None]
    words = np.empty((len(number), len(purposes), 4 + len(tail)), np.int64)
    words[..., 0], words[..., 1] = split, purposes
    words[..., 2], words[..., 3] = number & _LOW, number >> 32
    words[..., 4:] = tail
    return torch.from_numpy(words)


def keyed(stream: int, words: torch.Tensor) -> torch.Tensor:
    """Words int64[..., n + 2] from which :func:`stream_keys` makes a key: stream and length first."""
    head = torch.full_like(words[..., :1], stream)
    return torch.cat([head, torch.full_like(head, words.shape[-1]), words], -1)
