"""The camera for batches: :func:`specklegen.instrument.camera.expose`, every noise from addressed uniform numbers."""

import numpy as np
import torch

from specklegen.datasets.batched.fused import fused
from specklegen.datasets.batched.words import philox
from specklegen.instrument.camera import Camera, counted
from specklegen.instrument.torch_quantiles import normal_quantile, poisson_quantile, units


def _shape(light: torch.Tensor, *_: object) -> torch.Tensor:
    return light.new_empty(light.shape, dtype=torch.float32)


def _on_the_cpu(light: torch.Tensor, keys: torch.Tensor, numbers: list[float]) -> torch.Tensor:
    camera = _camera(numbers)
    found = [
        counted(camera, image, [(k0, k1) for k0, k1 in four])
        for image, four in zip(light.contiguous().numpy(), keys.tolist(), strict=True)
    ]
    return torch.from_numpy(np.stack(found).astype(np.float32))


def _camera(numbers: list[float]) -> Camera:
    background, dark, well, read, gain, offset, bits = numbers
    return Camera(
        photons=1.0, background=background, dark_current=dark, exposure=1.0, read_noise=read, gain=gain, offset=offset,
        full_well=well if np.isfinite(well) else None, bit_depth=int(bits) if bits else None,
    )  # fmt: skip


@fused("exposed(Tensor light, Tensor keys, float[] numbers) -> Tensor", _shape, _on_the_cpu)
def exposed(light: torch.Tensor, keys: torch.Tensor, numbers: list[float]) -> torch.Tensor:
    """Counts float32[B, ...] of mean detected photons float64[B, ...].

    Parameters
    ----------
    light
        At least 0.
    keys : int64[B, 4, 2]
        Keys of shot noise, background, dark current and readout.
    numbers
        Background, dark charge, full well, read noise, gain, offset, bits (0 for no rounding).
    """
    background, dark, well, read, gain, offset, bits = numbers
    mean = light.flatten(1)
    pixel = torch.arange(mean.shape[1], device=mean.device)

    def uniform(noise: int) -> torch.Tensor:
        words = torch.stack(philox(keys[:, noise, None], (pixel >> 1).expand(mean.shape)), -1)
        both = units(words)
        return torch.where((pixel & 1) == 1, both[..., 1], both[..., 0])

    charge = poisson_quantile(mean, uniform(0))
    for noise, constant in ((1, background), (2, dark)):
        if constant > 0:
            charge = charge + poisson_quantile(torch.full_like(mean, constant), uniform(noise))
    charge = charge.clamp(max=well)
    if read > 0:
        charge = charge + read * normal_quantile(uniform(3))
    counts = charge / gain + offset
    if bits:
        counts = torch.round(counts).clamp(0, 2.0**bits - 1)
    return counts.reshape(light.shape).to(torch.float32)


def numbers_of(camera: Camera) -> list[float]:
    """What :func:`exposed` wants to know of a camera."""
    well = float("inf") if camera.full_well is None else camera.full_well
    dark = camera.dark_current * camera.exposure
    return [camera.background, dark, well, camera.read_noise, camera.gain, camera.offset, float(camera.bit_depth or 0)]


def expose(camera: Camera, images: torch.Tensor, keys: torch.Tensor) -> torch.Tensor:
    """Counts of images float32[B, ...], 1 standing for ``camera.photons``: uint16, or float32 without bits."""
    # Rounding may leave a dark pixel a little below 0.
    light = camera.photons * images.clamp(min=0).to(torch.float64)
    counts = exposed(light, keys, numbers_of(camera))
    return counts if camera.bit_depth is None else counts.to(torch.uint16)
