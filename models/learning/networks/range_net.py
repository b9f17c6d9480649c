"""Width of an object in memory-effect ranges of an unknown slab, by a dense net from the lags.

It answers with probabilities of the extent, in steps of equal ratio. Trained where all of them are equally likely, its
probabilities are likelihoods with the object integrated out, over what objects look like (Cranmer, Brehmer and Louppe,
PNAS 117, 30055 (2020)). A most probable object for each range will not do: one range longer and an object smaller
explain an image nearly as well, and what freedom an object has favours long ranges.
"""

import numpy as np
import torch
from torch import Tensor, nn

EXTENTS = (0.1, 6.0)
"""Extents that are told apart, object frames over the range."""
BINS = 25
NUMBERS = 3
"""Numbers that describe a measurement without the slab."""


def extents() -> np.ndarray:
    """Extents whose probabilities are predicted, float64[BINS]."""
    return np.geomspace(*EXTENTS, BINS)


def shares(extent: Tensor) -> Tensor:
    """Extents float[B] shared out over the two nearest ones, float[B, BINS]."""
    place = (extent.log() - float(np.log(EXTENTS[0]))) / float(np.log(EXTENTS[1] / EXTENTS[0])) * (BINS - 1)
    steps = torch.arange(BINS, device=extent.device)
    return (1 - (place[:, None] - steps).abs()).clamp_min(0)


def likelihoods(told: Tensor) -> Tensor:
    """Log-likelihoods float[..., BINS] of the extents from logarithms of their probabilities, of the same shape.

    Extents were equally likely in their logarithm, so that :func:`shares` gave the first and the last, which have one
    neighbour each, half of what it gave the others.
    """
    equal = torch.zeros(BINS, dtype=told.dtype, device=told.device)
    equal[[0, -1]] = float(np.log(2))
    return told + equal


class RangeNet(nn.Module):
    """Lags of an object frame either way to logarithms of probabilities.

    Parameters
    ----------
    side
        Lags either way.
    units, blocks
        Of the dense net.
    """

    def __init__(self, side: int = 28, units: int = 256, blocks: int = 2) -> None:
        super().__init__()
        self.side, self.units, self.count = side, units, blocks
        self.first = nn.Linear(side * (2 * side - 1) + NUMBERS, units)
        self.blocks = nn.ModuleList(
            nn.Sequential(nn.LayerNorm(units), nn.Linear(units, 2 * units), nn.GELU(), nn.Linear(2 * units, units))
            for _ in range(blocks)
        )
        self.last = nn.Sequential(nn.LayerNorm(units), nn.Linear(units, BINS))

    def forward(self, lags: Tensor, numbers: Tensor) -> Tensor:
        """Logarithms float[B, BINS] from lags float[B, n, n], the zero lag in the middle, and float[B, NUMBERS]."""
        middle = lags.shape[-1] // 2
        half = lags[:, middle + 1 - self.side : middle + 1, middle + 1 - self.side : middle + self.side]
        x = self.first(torch.cat([half.flatten(1), numbers], dim=1))
        for block in self.blocks:
            x = x + block(x)
        return self.last(x).log_softmax(1)
