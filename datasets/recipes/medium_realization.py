"""One medium made ready: its material, a sampler, and its fields in the form that its samples share.

Samples of one medium share all of this; a few media are kept in each process.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.lazy import LazyModule
from specklegen.datasets.split import Split
from specklegen.samplers.stationary.objects import ObjectSampler

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")

if TYPE_CHECKING:
    from specklegen.datasets.recipes.recipe import Recipe

KEPT = 64
"""Media kept in a process."""
_SPECTRA_BYTES = 4 * 2**20  # above this a medium's spectra would fill the memory with few media


@dataclass(frozen=True)
class MediumRealization:
    """A medium, ready to be looked through.

    Attributes
    ----------
    sampler : ObjectSampler
    media : tuple of Tensor
        Fields or spectra, one a frame.
    parameters : dict
        What was drawn for the medium, and what follows from it.
    tilts : float64[T, 2]
        Tilts of the illumination, radians.
    contrast : float
        What polarisation leaves of the contrast.
    """

    sampler: ObjectSampler
    media: tuple[torch.Tensor, ...]
    parameters: Mapping[str, float]
    tilts: np.ndarray
    contrast: float

    def images(self, brightness: np.ndarray) -> np.ndarray:
        """Expected intensity over its mean, float32[frames * tilts, H, W]."""
        images = [self.sampler.images(medium, brightness).cpu().numpy() for medium in self.media]
        scale = np.float32(1 / (self.sampler.mean * brightness.sum(dtype=np.float64)))
        return (images[0] if len(images) == 1 else np.concatenate(images)) * scale

    def expected_contrast(self, brightness: np.ndarray) -> float:
        """Expected contrast of the images, noise aside."""
        return self.contrast * self.sampler.contrast(brightness)


def prepared(
    sampler: ObjectSampler,
    media: list[torch.Tensor],
    parameters: Mapping[str, float],
    *,
    halves: int,
    share: bool,
    tilts: np.ndarray,
) -> MediumRealization:
    """Bring a medium into the form that its samples share: spectra where many objects look through it."""
    if share and sampler.spectra_bytes * len(media) <= _SPECTRA_BYTES:
        media = [sampler.spectra(medium) for medium in media]
    return MediumRealization(sampler, tuple(media), parameters, tilts, halves**-0.5)


@lru_cache(maxsize=KEPT)
def medium_realization(recipe: Recipe, seed: int, split: Split, medium: int) -> MediumRealization:
    """Prepare a medium of a recipe, or take the one that is there."""
    return recipe.prepare(seed, split, medium)
