"""The camera for batches: :func:`specklegen.instrument.camera.expose`, every noise from addressed uniform numbers."""

import numpy as np
import torch

from specklegen.core.content import is_own
from specklegen.core.errors import reject
from specklegen.core.values import equals_default
from specklegen.datasets.split import Purpose
from specklegen.instrument.camera import Camera, counted
from specklegen.instrument.camera import exposed as own_counts
from specklegen.instrument.torch_quantiles import normal_quantile, poisson_quantile, units
from specklegen.synthesis.fused import fused
from specklegen.synthesis.gaussian_noise import philox

NOISES = (Purpose.SHOT_NOISE, Purpose.BACKGROUND, Purpose.DARK_CURRENT, Purpose.READ_NOISE)
"""Substreams of its noises."""
FIELDS = ("background", "dark_current", "exposure", "read_noise", "gain", "full_well", "bit_depth", "offset")
"""Fields of a camera that :func:`exposed` obeys, in the order of its numbers, ..."""
_NONE = {"full_well": float("inf"), "bit_depth": 0.0}  # ... None among them, ...
_BEFORE = ("photons", "oversampling")  # ... and those that are obeyed before it


def _shape(light: torch.Tensor, *_: object) -> torch.Tensor:
    return light.new_empty(light.shape, dtype=torch.float32)


def _on_the_cpu(light: torch.Tensor, keys: torch.Tensor, numbers: list[float]) -> torch.Tensor:
    camera = _camera(numbers)
    counts = [
        counted(camera, image, [(k0, k1) for k0, k1 in four])
        for image, four in zip(light.contiguous().numpy(), keys.tolist(), strict=True)
    ]
    return torch.from_numpy(np.stack(counts).astype(np.float32))


def _camera(numbers: list[float]) -> Camera:
    fields = dict(zip(FIELDS, numbers, strict=True))
    return Camera(photons=1.0, **{name: None if value == _NONE.get(name) else value for name, value in fields.items()})


@fused(
    "exposed(Tensor light, Tensor keys, float[] numbers) -> Tensor", _shape, _on_the_cpu,
    stepwise="the mean of the counts, (light + background + dark charge) / gain + offset",
)  # fmt: skip
def exposed(light: torch.Tensor, keys: torch.Tensor, numbers: list[float]) -> torch.Tensor:
    """Counts float32[B, ...] of mean detected photons float64[B, ...].

    Parameters
    ----------
    light
        At least 0.
    keys : int64[B, 4, 2]
        Keys of shot noise, background, dark current and readout.
    numbers
        From :func:`numbers_of`.
    """
    background, current, time, read, gain, well, bits, offset = numbers
    mean = light.flatten(1)
    pixel = torch.arange(mean.shape[1], device=mean.device)

    def uniform(noise: int) -> torch.Tensor:
        words = torch.stack(philox(keys[:, noise, None], (pixel >> 1).expand(mean.shape)), -1)
        both = units(words)
        return torch.where((pixel & 1) == 1, both[..., 1], both[..., 0])

    charge = poisson_quantile(mean, uniform(0))
    for noise, constant in ((1, background), (2, current * time)):
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
    """What :func:`exposed` wants to know of a camera: its :data:`FIELDS`.

    Raises
    ------
    RuleError
        If the camera has fields that batches do not know: their effect would be left out.
    """
    fields = type(camera).model_fields
    new = fields.keys() - {*FIELDS, *_BEFORE}
    unknown = sorted(name for name in new if not equals_default(getattr(camera, name), fields[name]))
    if unknown:
        reject("Recipe.exposure", "a camera of fields that batches know", unknown,
               "Add their effect to specklegen.datasets.recipes.parts.exposure.")  # fmt: skip
    return [float(_NONE[name] if value is None else value)
            for name, value in ((name, getattr(camera, name)) for name in FIELDS)]  # fmt: skip


def expose(camera: Camera, images: torch.Tensor, keys: torch.Tensor) -> torch.Tensor:
    """Counts of images float32[B, ...], 1 standing for ``camera.photons``: uint16, or float32 without bits.

    A camera of a user's own class is asked itself, image by image on the host.
    """
    if is_own(type(camera)):
        intensity = images.clamp(min=0).to(torch.float64).cpu().numpy()
        frames = [
            own_counts(camera, image, [(k0, k1) for k0, k1 in four])
            for image, four in zip(intensity, keys.tolist(), strict=True)
        ]
        return torch.from_numpy(np.stack(frames)).to(images.device)
    # Rounding may leave a dark pixel a little below 0.
    light = camera.photons * images.clamp(min=0).to(torch.float64)
    counts = exposed(light, keys, numbers_of(camera))
    return counts if camera.bit_depth is None else counts.to(torch.uint16)
