"""NumPy's SeedSequence and Philox and the engine's Philox in 64-bit integers of torch: the same words to the bit.

A product of two 32-bit numbers wraps in two's complement, whose halves are the right ones after masking. Numbers of
samples are known on the host, so :func:`uniforms` and :func:`stream_keys` run there, for a batch at once, and what they
find is copied. :func:`uniforms` must not be compiled: Inductor (torch 2.13, on the CPU) makes other numbers of it,
while its parts come out right one by one.
Source: O'Neill, *Developing a seed_seq alternative* (2015), as NumPy's SeedSequence has it.
"""

from functools import lru_cache

import torch

_LOW = 0xFFFFFFFF
_INIT_A, _MULT_A, _INIT_B, _MULT_B = 0x43B0D7E5, 0x931E8875, 0x8B51F9DD, 0x58F38DED
_MIX_L, _MIX_R = 0xCA01F9DD, 0x4973F715
_LONG_M = (0xD2E7470EE14C6C93, 0xCA5A826395121157)
_LONG_W = (0x9E3779B97F4A7C15, 0xBB67AE8584CAA73B)


def _signed(value: int) -> int:
    value &= 2**64 - 1
    return value - 2**64 if value >= 2**63 else value


@lru_cache(maxsize=8)
def _constants(start: int, factor: int, count: int) -> list[int]:
    found = [start]
    for _ in range(count):
        found.append(found[-1] * factor & _LOW)
    return found


def _hashed(value: torch.Tensor, constants: list[int], at: int) -> torch.Tensor:
    value = ((value ^ constants[at]) * constants[at + 1]) & _LOW
    return value ^ (value >> 16)


def _mixed(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    value = (x * _MIX_L - y * _MIX_R) & _LOW
    return value ^ (value >> 16)


def seed_state(entropy: torch.Tensor, count: int) -> list[torch.Tensor]:
    """Return what ``SeedSequence(words).generate_state(count)`` does, ``count`` times int64[...].

    Parameters
    ----------
    entropy : int64[..., n]
        Words of 32 bits, at least 4 of them.
    count
        Words wanted, at most 4.
    """
    words = entropy.unbind(-1)
    constants, at = _constants(_INIT_A, _MULT_A, 16 + 4 * len(words)), 0
    pool = []
    for word in words[:4]:
        pool.append(_hashed(word, constants, at))
        at += 1
    for source in range(4):
        for target in range(4):
            if source != target:
                pool[target] = _mixed(pool[target], _hashed(pool[source], constants, at))
                at += 1
    for word in words[4:]:
        for target in range(4):
            pool[target] = _mixed(pool[target], _hashed(word, constants, at))
            at += 1
    out = _constants(_INIT_B, _MULT_B, count)
    return [_hashed(pool[n], out, n) for n in range(count)]


def _joined(low: torch.Tensor, high: torch.Tensor) -> torch.Tensor:
    """64 bits of two words, without a shift past the sign."""
    return low | (torch.where(high >= 2**31, high - 2**32, high) * 2**32)


def _high(a: torch.Tensor, factor: int) -> torch.Tensor:
    """High 64 bits of a product of two unsigned numbers of 64 bits."""
    upper, lower = (a >> 32) & _LOW, a & _LOW
    high, low = factor >> 32, factor & _LOW
    middle = upper * low + (((lower * low) >> 32) & _LOW)
    other = lower * high + (middle & _LOW)
    return upper * high + ((middle >> 32) & _LOW) + ((other >> 32) & _LOW)


def uniforms(entropy: torch.Tensor) -> torch.Tensor:
    """First four of ``Generator(Philox(SeedSequence(words))).random()``, float64[..., 4], from int64[..., n]."""
    a, b, c, d = seed_state(entropy, 4)
    k0, k1 = _joined(a, b), _joined(c, d)
    # The first round by hand, of the counter (1, 0, 0, 0).
    x = [k0, torch.zeros_like(k0), k1, torch.full_like(k0, _signed(_LONG_M[0]))]
    for _ in range(9):
        k0, k1 = k0 + _signed(_LONG_W[0]), k1 + _signed(_LONG_W[1])
        products = [(_high(x[2 * n], _LONG_M[n]), x[2 * n] * _signed(_LONG_M[n])) for n in (0, 1)]
        (high0, low0), (high1, low1) = products
        x = [high1 ^ x[1] ^ k0, low1, high0 ^ x[3] ^ k1, low0]
    return torch.stack([((word >> 11) & (2**53 - 1)).to(torch.float64) * 2.0**-53 for word in x], -1)


def stream_keys(entropy: torch.Tensor) -> torch.Tensor:
    """Key int64[..., 2] of two 32-bit words, as ``specklegen.core.random_streams.stream_key`` makes it."""
    return torch.stack(seed_state(entropy, 2), -1)


def substreams(split: int, purposes: list[int], numbers: torch.Tensor, tail: tuple[int, ...]) -> torch.Tensor:
    """Words int64[B, purposes, n] of ``specklegen.datasets.split.substream``.

    Parameters
    ----------
    split
        Number of the split.
    purposes
        Numbers of the purposes.
    numbers : int64[B]
        Numbers of the samples or media.
    tail
        What follows the number: the seed's parts, counted.
    """
    purpose = torch.arange(len(purposes), device=numbers.device)
    shape = (len(numbers), len(purposes))
    number = numbers[:, None].expand(shape)
    chosen = torch.zeros_like(purpose)
    for place, value in enumerate(purposes):
        chosen = torch.where(purpose == place, value, chosen)
    full = lambda value: torch.full(shape, value, dtype=torch.int64, device=numbers.device)  # noqa: E731
    return torch.stack(
        [full(split), chosen.expand(shape), number & _LOW, (number >> 32) & _LOW, *map(full, tail)], -1
    )


def keyed(stream: int, words: torch.Tensor) -> torch.Tensor:
    """Words int64[..., n + 2] from which :func:`stream_keys` makes a key: stream and length first."""
    head = torch.full_like(words[..., :1], stream)
    return torch.cat([head, torch.full_like(head, words.shape[-1]), words], -1)
