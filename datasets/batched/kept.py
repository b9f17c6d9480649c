"""Media that are kept: all are prepared once on the host, and lie on the device for all samples."""

from dataclasses import dataclass

import torch

from specklegen.datasets.batched.samplers import Samplers, render, sampler_of, together
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.medium_realization import MediumRealization
from specklegen.datasets.split import Split

MOST_BYTES = 2**31
"""Memory that kept media may take on the device."""


@dataclass(frozen=True)
class KeptMedia:
    """Media of one rank and one grid of lags.

    Attributes
    ----------
    samplers : Samplers
    spectra : complex64[M, pairs, n, m]
    """

    samplers: Samplers
    spectra: torch.Tensor

    def images(self, which: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        """Images float32[B, T, H, W] of objects float32[B, h, w] through media int64[B], over their expected value."""
        return render(self.samplers, which, self.spectra[which][:, None], light)


@dataclass(frozen=True)
class Library:
    """All media of a split.

    Attributes
    ----------
    groups : tuple of KeptMedia
    places : list of (int, int)
        Group of each medium, and its place there.
    names : tuple of str
        Names of the parameters.
    """

    groups: tuple[KeptMedia, ...]
    places: list[tuple[int, int]]
    names: tuple[str, ...]


def library(recipe: HiddenObject, seed: int, split: Split, device: torch.device) -> Library | None:
    """Prepare all media of a split as the CPU does, and bring them to the device; None if they are too many."""
    assert recipe.media is not None
    by_kind: dict[tuple[int, ...], list[tuple[MediumRealization, torch.Tensor]]] = {}
    places, names, left = [], (), MOST_BYTES
    for number in range(recipe.media):
        ready = recipe.prepare(seed, split, number)
        sampler = sampler_of(ready)
        left -= sampler.spectra_bytes
        if left < 0 or sampler.spectra_bytes > MOST_BYTES // recipe.media:
            return None
        (drawn,) = ready.media
        spectra = drawn if drawn.shape[-2:] != sampler.envelope.shape else sampler.spectra(drawn)
        kind = by_kind.setdefault((sampler.rank, *sampler.lags), [])
        places.append((list(by_kind).index((sampler.rank, *sampler.lags)), len(kind)))
        kind.append((ready, spectra))
        names = tuple(ready.parameters)
    return Library(tuple(_together(kind, device) for kind in by_kind.values()), places, names)


def _together(kind: list[tuple[MediumRealization, torch.Tensor]], device: torch.device) -> KeptMedia:
    media, spectra = zip(*kind, strict=True)
    return KeptMedia(together(media, device), torch.stack(spectra).to(device))
