"""The quantiles of :mod:`specklegen.kernels.quantiles` in torch, for any device: the same numbers to rounding.

Both sides of every branch are computed, so this is for devices that do not mind; the CPU has the kernels.
"""


import torch

from specklegen.kernels.quantiles import CENTRE, CONSTANT, HELD, INVERSE, LEAST, MIDDLE, QUADRATIC, SQUARE, SUMMED, TAIL

_STEPS = 100  # P(N > 100) is below 2^-60 for a mean of 32


def units(words: torch.Tensor) -> torch.Tensor:
    """Uniform numbers in ``(0, 1)``, float64[..., 2], from blocks of 32-bit words, int64[..., 4]."""
    high, low = words[..., 0::2], words[..., 1::2]
    return ((high * 2**20 + (low >> 12)).to(torch.float64) + 0.5) * 2.0**-52


def _horner(coefficients: tuple[float, ...], t: torch.Tensor) -> torch.Tensor:
    value = torch.full_like(t, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        value = value * t + coefficient
    return value


def normal_quantile(u: torch.Tensor) -> torch.Tensor:
    """W with Phi(w) = u, float64 of the shape of u, for u in (0, 1)."""
    q = u - 0.5
    ratio = lambda table, r: _horner(table[0], r) / _horner(table[1], r)  # noqa: E731
    r = torch.sqrt(-torch.log(torch.where(q < 0, u, 1 - u)))
    outside = torch.where(r <= 5, ratio(MIDDLE, r - 1.6), ratio(TAIL, r - 5)) * torch.sign(q)
    return torch.where(q.abs() <= 0.425, q * ratio(CENTRE, 0.180625 - q * q), outside)


def poisson_quantile(mean: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
    """Smallest whole k with P(N <= k) >= u, for means of at least 0 and u in ``(0, 1)``, all float64 of one shape."""
    small = mean.clamp(max=SUMMED)
    term = torch.exp(-small)
    total, count = term, torch.zeros_like(mean)
    for k in range(1, _STEPS):
        count = count + ((total < u) & (term > LEAST))
        term = term * (small / k)
        total = total + term
    w = normal_quantile(u)
    large = mean.clamp(min=SUMMED)
    root = torch.sqrt(large)
    t = (w / root).clamp(-HELD, HELD) * (1 / HELD)
    correction = _horner(CONSTANT, t) + (_horner(INVERSE, t) + _horner(SQUARE, t) / large) / large
    quantile = torch.floor(large + root * w + w * w * _horner(QUADRATIC, t) + correction).clamp(min=0)
    return torch.where(mean < SUMMED, count, quantile)
