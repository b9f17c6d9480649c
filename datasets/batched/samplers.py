"""Object samplers of the CPU brought to a device, and what they make of spectra there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from specklegen.datasets.batched import optics
from specklegen.datasets.recipes.medium_realization import MediumRealization
from specklegen.samplers.stationary.objects import ObjectSampler


@dataclass(frozen=True)
class Samplers:
    """Samplers of M media, of one rank and one grid of lags; what all of them share has a leading axis of 1.

    Attributes
    ----------
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

    modes: torch.Tensor
    transforms: dict[str, torch.Tensor]
    flat: torch.Tensor
    mean: torch.Tensor
    contrast: torch.Tensor
    variance: torch.Tensor
    parameters: torch.Tensor
    tilts: torch.Tensor


_TRANSFORMS: dict[str, Callable[[ObjectSampler], torch.Tensor]] = {
    "object_rows": lambda sampler: sampler.object_rows,
    "object_columns": lambda sampler: sampler.object_columns.mT.contiguous(),
    "camera_rows": lambda sampler: sampler.camera_rows,
    "camera_columns": lambda sampler: torch.view_as_real(sampler.camera_columns.mH.resolve_conj()).flatten(2),
}


def together(media: Sequence[MediumRealization], device: torch.device) -> Samplers:
    """Bring the samplers of media to a device; the camera's transform is copied once if all share one sampler."""
    samplers = [sampler_of(ready) for ready in media]
    different = samplers[:1] if all(sampler is samplers[0] for sampler in samplers) else samplers
    numbers = lambda values: torch.tensor(np.array(values), dtype=torch.float64).to(device)  # noqa: E731
    return Samplers(
        torch.stack([sampler.modes for sampler in different]).to(device),
        {name: torch.stack([of(each) for each in different]).to(device) for name, of in _TRANSFORMS.items()},
        numbers([sampler.flat * sampler.mean for sampler in samplers]),
        numbers([sampler.mean for sampler in samplers]),
        numbers([ready.contrast for ready in media]),
        numbers([sampler._variance_spectrum for sampler in samplers]),
        numbers([list(ready.parameters.values()) for ready in media]),
        numbers([ready.tilts for ready in media]),
    )


def sampler_of(medium: MediumRealization) -> ObjectSampler:
    """What images objects through a medium."""
    assert isinstance(medium.sampler, ObjectSampler)
    return medium.sampler


def render(samplers: Samplers, which: torch.Tensor, spectra: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    """Images over their expected value, float32[B, T or F, H, W].

    Parameters
    ----------
    samplers, which : Samplers, int64[B]
        Sampler of each image.
    spectra : complex64[B, F, pairs, n, m]
        Of the medium in each frame.
    light : float32[B, h, w]
        Objects.
    """
    pick = lambda value: value if len(value) == 1 else value[which]  # noqa: E731
    modes = pick(samplers.modes)
    transforms = {name: pick(value) for name, value in samplers.transforms.items()}
    seen = optics.images(spectra, modes.expand(len(light), -1, -1, -1), light, transforms)
    total = light.sum((1, 2), dtype=torch.float64)
    flat, mean = (value[which] * total for value in (samplers.flat, samplers.mean))
    return (seen + flat.to(seen.dtype)[:, None, None, None]) / mean.to(seen.dtype)[:, None, None, None]


def expected_contrast(samplers: Samplers, which: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    """Expected contrast float64[B]: ``ObjectSampler.contrast``."""
    brightness = light.to(torch.float64)
    grid = [2 * n - 1 for n in light.shape[1:]]
    power = torch.fft.rfft2(brightness, grid).abs().square() * samplers.variance[which]
    twice = torch.where(torch.arange(power.shape[-1], device=power.device) == 0, 1.0, 2.0)  # sides are odd
    total = (power * twice).sum((1, 2)) / (grid[0] * grid[1])
    return samplers.contrast[which] * torch.sqrt(total.clamp(min=0)) / brightness.sum((1, 2))
