"""Bessel's J0 in torch, and the memory-effect correlation as the mixture of it that it is."""

import math

import numpy as np
import torch

from specklegen.kernels.bessel import COSINE, NEAR, SINE, SMALL, bessel_mixture
from specklegen.kernels.slab_lookup import fill_half_ranges
from specklegen.memory_effects.correlation import ROOT_NODES, ROOT_STEP, SCAN_STEP
from specklegen.synthesis.fused import fused

_NODES: list[float] = ROOT_NODES.tolist()
SCANNED = 32
"""Steps of the scan for the half range: a factor of 1000 above its least value."""
_SCAN = SCAN_STEP ** np.arange(SCANNED, dtype=np.float64)


def _horner(coefficients: tuple[float, ...], t: torch.Tensor) -> torch.Tensor:
    value = torch.full_like(t, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        value = value * t + coefficient
    return value


def j0(x: torch.Tensor) -> torch.Tensor:
    """J0 for float64 x >= 0, absolute error 2e-15: torch's own is wrong by 4e-7 about x = 5."""
    far = x.clamp(min=NEAR)
    inverse = 1 / far
    t = 2 * (NEAR * inverse).square() - 1
    angle = far - math.pi / 4
    wave = _horner(COSINE, t) * torch.cos(angle) - _horner(SINE, t) * inverse * torch.sin(angle)
    near = x.clamp(max=NEAR)
    return torch.where(x < NEAR, _horner(SMALL, near * near / 32 - 1), torch.sqrt(2 / math.pi * inverse) * wave)


def _on_the_cpu(q: torch.Tensor, radius: torch.Tensor, share: torch.Tensor) -> torch.Tensor:
    correlation = np.empty(tuple(q.shape))
    parts = (part.contiguous().numpy() for part in (q, radius, share))
    for arguments in zip(*parts, correlation, strict=True):
        bessel_mixture(*arguments)
    return torch.from_numpy(correlation)


def plain_mixture(q: torch.Tensor, radius: torch.Tensor, share: torch.Tensor) -> torch.Tensor:
    """K float64[B, M] at q float64[B, M], from radii and shares float64[B, n]."""
    return (j0(q[:, :, None] * radius[:, None, :]) * share[:, None, :]).sum(-1)


mixture = fused(
    "mixture(Tensor q, Tensor radius, Tensor share) -> Tensor", lambda q, r, s: torch.empty_like(q), _on_the_cpu
)(plain_mixture)


def _half_ranges_on_the_cpu(
    radius: torch.Tensor, share: torch.Tensor, single: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    half, found = np.empty(len(single)), np.empty(len(single), np.bool_)
    mixtures = (part.contiguous().numpy() for part in (radius, share, single))
    fill_half_ranges(*mixtures, ROOT_NODES, _SCAN, ROOT_STEP, half, found)
    return torch.from_numpy(half), torch.from_numpy(found)


@fused(
    "half_range(Tensor radius, Tensor share, Tensor single) -> (Tensor, Tensor)",
    lambda radius, share, single: (torch.empty_like(single), torch.empty_like(single, dtype=torch.bool)),
    _half_ranges_on_the_cpu,
    kernels=8,
)
def half_range(radius: torch.Tensor, share: torch.Tensor, single: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Half ranges float64[B] of mixtures, as ``MemoryEffectCorrelation.half_range`` finds them; and whether found.

    Not found are those of singly scattered light and those a factor of 1000 above the bound from <r^2>.
    """
    floor = single.square()
    level = torch.sqrt(floor + 0.5 * (1 - floor))
    start = 1.999 * torch.sqrt((1 - level) / (share * radius.square()).sum(-1))
    steps = SCAN_STEP ** torch.arange(SCANNED, dtype=torch.float64, device=radius.device)
    scan = start[:, None] * steps
    below = plain_mixture(scan, radius, share) < level[:, None]
    first = below.to(torch.int8).argmax(-1, keepdim=True)
    high = scan.gather(-1, first)
    nodes = high * _row(_NODES, radius.device)
    half = _inverse(nodes, plain_mixture(nodes, radius, share), level)
    beside = half[:, None] * _row([1 - ROOT_STEP, 1.0, 1 + ROOT_STEP], radius.device)
    lower, at, upper = plain_mixture(beside, radius, share).unbind(-1)
    half = half * (1 + 2 * ROOT_STEP * (at - level) / (lower - upper))
    return half, below.any(-1) & (floor <= 1 - 1e-9)


def _row(values: list[float], device: torch.device) -> torch.Tensor:
    """Return a few numbers as a tensor, without a copy from the host."""
    place = torch.arange(len(values), device=device)
    row = torch.zeros(len(values), dtype=torch.float64, device=device)
    for n, value in enumerate(values):
        row = torch.where(place == n, value, row)
    return row


def _inverse(x: torch.Tensor, y: torch.Tensor, level: torch.Tensor) -> torch.Tensor:
    """Lagrange's polynomial of x float64[B, n] in y float64[B, n] at levels float64[B]."""
    same = torch.eye(y.shape[-1], dtype=torch.bool, device=y.device)
    ratio = (level[:, None, None] - y[:, None, :]) / (y[:, :, None] - y[:, None, :]).masked_fill(same, 1.0)
    return (x * ratio.masked_fill(same, 1.0).prod(-1)).sum(-1)
