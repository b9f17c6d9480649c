"""The light of a recipe: how many independent speckle patterns add up in one image.

Light of one wavelength and one polarisation makes speckle of contrast 1. A band of wavelengths makes an
incoherent sum over the modes of the light behind that medium (:mod:`specklegen.samplers.stationary.spectrum`);
light that the medium depolarised one over two independent halves, contrast 1/sqrt(2).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.lazy import LazyModule
from specklegen.core.random_streams import Seed
from specklegen.core.values import NonNegative, Positive, Value
from specklegen.datasets.split import Purpose, Split, substream
from specklegen.samplers.screens.objects import ScreenObjects
from specklegen.samplers.stationary.objects import ObjectSampler
from specklegen.samplers.stationary.spectrum import Spectrum

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")


class Light(Value):
    """The light.

    Parameters
    ----------
    bandwidth
        Full width at half maximum of the spectrum in vacuum wavelength, in the recipe's unit of length
        (1 nm is 0.001 where that is the micrometre); 0 is one wavelength.
    spectrum
        "gaussian" or "flat" over the wavenumber.
    polarised
        Whether one polarisation reaches the camera; false adds two independent halves.
    refractive_index
        Of the layer, which turns vacuum wavelengths into wavenumbers inside it.
    """

    bandwidth: NonNegative = 0.0
    spectrum: Spectrum = "gaussian"
    polarised: bool = True
    refractive_index: Positive = 1.0

    @property
    def halves(self) -> int:
        """Independent polarisations."""
        return 1 if self.polarised else 2


MEDIUM_PURPOSES = (Purpose.MEDIUM, Purpose.POLARISATION)
"""Substreams of a medium's fields, one for each polarisation."""


def medium_seeds(light: Light, seed: int, split: Split, medium: int) -> list[Seed]:
    """Seeds of a medium, one for each polarisation."""
    return [substream(seed, split, purpose, medium) for purpose in MEDIUM_PURPOSES[: light.halves]]


def draw_medium(
    light: Light, sampler: ObjectSampler | ScreenObjects, seed: int, split: Split, medium: int
) -> torch.Tensor:
    """One medium for this light, complex[N, R, y, x]; each polarisation has a substream of its own."""
    halves = [sampler.medium(each) for each in medium_seeds(light, seed, split, medium)]
    return _joined(halves)


def draw_frames(
    light: Light, sampler: ObjectSampler | ScreenObjects, seed: int, split: Split, medium: int, count: int,
    correlation: float,
) -> list[torch.Tensor]:
    """A medium that changes from frame to frame, ``count`` times complex[N, R, y, x].

    Each field follows a first-order autoregression, G_f = c G_(f-1) + sqrt(1 - c^2) white: fields f frames
    apart are correlated by c^f, c = ``correlation``, their intensities by c^(2f).
    """
    fresh = float(np.sqrt(1 - correlation**2))
    halves = []
    for number, first in enumerate(medium_seeds(light, seed, split, medium)):
        frames = [sampler.medium(first)]
        for frame in range(1, count):
            seeds = (*substream(seed, split, Purpose.DYNAMICS, medium), number, frame)
            frames.append(correlation * frames[-1] + fresh * sampler.medium(seeds))
        halves.append(frames)
    return [_joined(list(frame)) for frame in zip(*halves, strict=True)]


def _joined(halves: list[torch.Tensor]) -> torch.Tensor:
    return halves[0] if len(halves) == 1 else torch.cat(halves) * len(halves) ** -0.5
