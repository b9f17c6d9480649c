"""Standard complex normals from the counter-based generator: the same numbers on any device.

On the CPU the Numba kernel draws them; elsewhere the same Philox rounds run as torch integer arithmetic.
"""

from __future__ import annotations

import math

import numpy as np

from specklegen.core.lazy import torch
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.kernels import rng

_M0, _M1, _W0, _W1 = 0xD2511F53, 0xCD9E8D57, 0x9E3779B9, 0xBB67AE85
_LOW = 0xFFFFFFFF


def complex_normals(
    seed: Seed, sample: int, shape: tuple[int, ...], dtype: torch.dtype, device: torch.device | str = "cpu"
) -> torch.Tensor:
    """Independent z with E|z|^2 = 1, complex[shape], keyed by (seed, sample)."""
    key = stream_key(seed, Stream.STATIONARY)
    count = math.prod(shape)
    real = torch.float32 if dtype == torch.complex64 else torch.float64
    if count == 0:
        return torch.empty(shape, dtype=dtype, device=device)
    if torch.device(device).type == "cpu":
        pairs = np.empty((count, 2), np.float32 if real == torch.float32 else np.float64)
        rng.fill_normals(*key, sample, pairs)
        drawn = torch.from_numpy(pairs)
    else:
        drawn = torch_normals(key, sample, count, device).to(real)
    drawn *= 0.5**0.5
    return torch.view_as_complex(drawn).reshape(shape)


def philox(key: torch.Tensor, block: torch.Tensor, sample: int = 0) -> list[torch.Tensor]:
    """Four words int64[...] of the engine's generator, of blocks int64[...] under keys int64[..., 2].

    A product of two 32-bit numbers wraps in two's complement, whose halves are the right ones after masking. Source:
    Salmon et al., *Parallel random numbers: as easy as 1, 2, 3* (SC11).
    """
    import torch  # by name: the compiler does not look through what stands for it above

    k0, k1 = key[..., 0], key[..., 1]
    words = [torch.zeros_like(block), block & _LOW, block >> 32, torch.full_like(block, sample)]
    for _ in range(10):
        p0, p1 = words[0] * _M0, words[2] * _M1
        words = [((p1 >> 32) & _LOW) ^ words[1] ^ k0, p1 & _LOW, ((p0 >> 32) & _LOW) ^ words[3] ^ k1, p0 & _LOW]
        k0, k1 = (k0 + _W0) & _LOW, (k1 + _W1) & _LOW
    return words


def torch_normals(key: tuple[int, int], sample: int, count: int, device: torch.device | str) -> torch.Tensor:
    """Draw the numbers of :func:`specklegen.kernels.rng.fill_normals`, as float64[count, 2] on any device."""
    block = torch.arange((count + 1) // 2, dtype=torch.int64, device=device)
    u = [word.to(torch.float64) * 2.0**-32 + 2.0**-33
         for word in philox(torch.tensor(key, device=device), block, sample)]  # fmt: skip
    pairs = []
    for a, b in ((u[0], u[1]), (u[2], u[3])):
        radius = torch.sqrt(-2 * torch.log(a))
        pairs.append(torch.stack([radius * torch.cos(2 * torch.pi * b), radius * torch.sin(2 * torch.pi * b)], -1))
    return torch.stack(pairs, 1).reshape(-1, 2)[:count]
