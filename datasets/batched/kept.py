"""Media that are kept: all are prepared once on the host, and lie on the device for all samples."""

from dataclasses import dataclass

import numpy as np
import torch

from specklegen.datasets.batched import optics
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.medium_realization import MediumRealization
from specklegen.datasets.split import Split

MOST_BYTES = 2**31
"""Memory that kept media may take on the device."""
_TRANSFORMS = ("object_rows", "object_columns", "camera_rows", "camera_columns")


@dataclass(frozen=True)
class KeptMedia:
    """Media of one rank and one grid of lags; what all of them share has a leading axis of 1.

    Attributes
    ----------
    spectra : complex64[M, pairs, n, m]
    modes : float32[M or 1, T, R, h * w]
    transforms : dict
        As :func:`optics.images` wants them.
    flat, mean, contrast : float64[M]
        Even brightness over an object of brightness 1; what an image is divided by; what polarisation leaves of the
        contrast.
    variance : float64[M, 2h - 1, w]
        Spectrum of what the contrast is made of.
    parameters : float64[M, names]
    tilts : float64[M, T, 2]
    """

    spectra: torch.Tensor
    modes: torch.Tensor
    transforms: dict[str, torch.Tensor]
    flat: torch.Tensor
    mean: torch.Tensor
    contrast: torch.Tensor
    variance: torch.Tensor
    parameters: torch.Tensor
    tilts: torch.Tensor


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
        sampler = ready.sampler
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
    samplers = [ready.sampler for ready in media]
    different = samplers[:1] if all(sampler is samplers[0] for sampler in samplers) else samplers
    numbers = lambda values: torch.tensor(np.array(values), dtype=torch.float64).to(device)  # noqa: E731
    return KeptMedia(
        torch.stack(spectra).to(device),
        torch.stack([sampler.modes for sampler in different]).to(device),
        {name: torch.stack([getattr(sampler, name) for sampler in different]).to(device) for name in _TRANSFORMS},
        numbers([sampler.flat * sampler.mean for sampler in samplers]),
        numbers([sampler.mean for sampler in samplers]),
        numbers([ready.contrast for ready in media]),
        numbers([sampler._variance_spectrum for sampler in samplers]),
        numbers([list(ready.parameters.values()) for ready in media]),
        numbers([ready.tilts for ready in media]),
    )


def render(media: KeptMedia, which: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    """Images over their expected value, float32[B, T, H, W], of objects float32[B, h, w] through media int64[B]."""
    pick = lambda value: value if len(value) == 1 else value[which]  # noqa: E731
    modes = pick(media.modes)
    seen = optics.images(
        media.spectra[which], modes.expand(len(light), -1, -1, -1), light,
        {name: pick(value) for name, value in media.transforms.items()},
    )  # fmt: skip
    total = light.sum((1, 2), dtype=torch.float64)
    flat, mean = (value[which] * total for value in (media.flat, media.mean))
    return (seen + flat.to(seen.dtype)[:, None, None, None]) / mean.to(seen.dtype)[:, None, None, None]


def expected_contrast(media: KeptMedia, which: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    """Expected contrast float64[B]: ``ObjectSampler.contrast``."""
    brightness = light.to(torch.float64)
    grid = [2 * n - 1 for n in light.shape[1:]]
    power = torch.fft.rfft2(brightness, grid).abs().square() * media.variance[which]
    twice = torch.where(torch.arange(power.shape[-1], device=power.device) == 0, 1.0, 2.0)  # sides are odd
    total = (power * twice).sum((1, 2)) / (grid[0] * grid[1])
    return media.contrast[which] * torch.sqrt(total.clamp(min=0)) / brightness.sum((1, 2))
