"""Media that are kept: each is prepared once on the host, and lies on the device for all its samples."""

from dataclasses import dataclass

import torch

from specklegen.datasets.batched import optics
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.medium_realization import medium_realization
from specklegen.datasets.split import Split

MOST_BYTES = 2**31
"""Memory that kept media may take on the device."""


@dataclass(frozen=True)
class KeptMedium:
    """One medium on the device.

    Attributes
    ----------
    spectra : complex64[pairs, n, m]
    modes : float32[T, R, h * w]
    transforms : dict
        As :func:`optics.images` wants them, with a leading axis of 1.
    flat, mean : float
        Even brightness, over an object of brightness 1; what the image is divided by.
    variance : float64[2h - 1, 2w - 1]
        Spectrum of what the contrast is made of.
    contrast : float
        What polarisation leaves of it.
    parameters : dict of float
    tilts : float64[T, 2]
    """

    spectra: torch.Tensor
    modes: torch.Tensor
    transforms: dict[str, torch.Tensor]
    flat: float
    mean: float
    variance: torch.Tensor
    contrast: float
    parameters: dict[str, float]
    tilts: torch.Tensor


def keep(recipe: HiddenObject, seed: int, split: Split, medium: int, device: torch.device) -> KeptMedium:
    """Prepare a medium as the CPU does, and bring it to the device."""
    ready = medium_realization(recipe.on("cpu"), seed, split, medium)
    sampler = ready.sampler
    (drawn,) = ready.media
    spectra = drawn if drawn.shape[-2:] != sampler.envelope.shape else sampler.spectra(drawn)
    names = ("object_rows", "object_columns", "camera_rows", "camera_columns")
    return KeptMedium(
        spectra.to(device), sampler.modes.to(device), {name: getattr(sampler, name)[None].to(device) for name in names},
        sampler.flat * sampler.mean, sampler.mean, torch.from_numpy(sampler._variance_spectrum).to(device),
        ready.contrast, dict(ready.parameters), torch.from_numpy(ready.tilts).to(device),
    )  # fmt: skip


def render(medium: KeptMedium, light: torch.Tensor) -> torch.Tensor:
    """Images over their expected value, float32[B, T, H, W], of objects float32[B, h, w] through one medium."""
    count = len(light)
    seen = optics.images(
        medium.spectra.expand(count, -1, -1, -1), medium.modes.expand(count, -1, -1, -1), light, medium.transforms
    )
    total = light.sum((1, 2), dtype=torch.float64)[:, None, None, None]
    return (seen + medium.flat * total.to(seen.dtype)) / (medium.mean * total).to(seen.dtype)


def expected_contrast(medium: KeptMedium, light: torch.Tensor) -> torch.Tensor:
    """Expected contrast float64[B]: ``ObjectSampler.contrast``."""
    brightness = light.to(torch.float64)
    grid = [2 * n - 1 for n in light.shape[1:]]
    power = torch.fft.rfft2(brightness, grid).abs().square() * medium.variance
    twice = torch.where(torch.arange(power.shape[-1], device=power.device) == 0, 1.0, 2.0)  # sides are odd
    total = (power * twice).sum((1, 2)) / (grid[0] * grid[1])
    return medium.contrast * torch.sqrt(total.clamp(min=0)) / brightness.sum((1, 2))
