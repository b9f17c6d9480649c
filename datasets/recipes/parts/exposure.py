"""The camera for batches: :func:`specklegen.instrument.camera.expose`, every noise from addressed uniform numbers."""

import numpy as np
import torch

from specklegen.core.content import is_own
from specklegen.core.errors import reject
from specklegen.core.values import equals_default
from specklegen.datasets.split import Purpose
from specklegen.instrument import camera as cameras
from specklegen.instrument.camera import Camera, counted, kernel_draws
from specklegen.instrument.torch_quantiles import normal_quantile, poisson_quantile, units
from specklegen.synthesis.fused import fused
from specklegen.synthesis.gaussian_noise import philox

NOISES = (Purpose.SHOT_NOISE, Purpose.BACKGROUND, Purpose.DARK_CURRENT, Purpose.READ_NOISE)
"""Substreams of its noises."""
FIELDS = (
    "photons", "oversampling", "background", "dark_current", "exposure", "read_noise", "gain", "full_well", "bit_depth",
    "offset",
)  # fmt: skip
"""Fields of a camera that batches obey: the first two before :func:`exposed`, the others in it."""


def _shape(light: torch.Tensor, *_: object) -> torch.Tensor:
    return light.new_empty(light.shape, dtype=torch.float32)


def _on_the_cpu(
    light: torch.Tensor, keys: torch.Tensor, electronics: list[float], noise_map: torch.Tensor | None = None
) -> torch.Tensor:
    counts = [
        counted(electronics, image, kernel_draws(four, image.shape), None if noise_map is None else noise_map.numpy())
        for image, four in zip(light.numpy(), keys.tolist(), strict=True)
    ]
    return torch.from_numpy(np.stack(counts).astype(np.float32))


@fused(
    "exposed(Tensor light, Tensor keys, float[] electronics, Tensor? noise_map=None) -> Tensor", _shape, _on_the_cpu,
    stepwise="the mean of the counts, (light + background + dark charge) / gain + offset",
)  # fmt: skip
def exposed(
    light: torch.Tensor, keys: torch.Tensor, electronics: list[float], noise_map: torch.Tensor | None = None
) -> torch.Tensor:
    """Counts float32[B, ...] of mean detected photons float64[B, ...].

    Parameters
    ----------
    light
        At least 0.
    keys : int64[B, 4, 2]
        Keys of shot noise, background, dark current and readout.
    electronics
        From :attr:`Camera.electronics`.
    noise_map : float64[H, W], optional
        The read noise of each pixel.
    """
    pixel = torch.arange(light[0].numel(), device=light.device)
    blocks = (pixel >> 1).expand(len(light), -1)

    def drawn(noise: int, mean: float | torch.Tensor | None = None) -> torch.Tensor:
        both = units(torch.stack(philox(keys[:, noise, None], blocks), -1))
        uniform = torch.where((pixel & 1) == 1, both[..., 1], both[..., 0]).reshape(light.shape)
        if mean is None:
            return normal_quantile(uniform)
        return poisson_quantile(mean if isinstance(mean, torch.Tensor) else torch.full_like(light, mean), uniform)

    return counted(electronics, light, drawn, noise_map).to(torch.float32)


def expose(camera: Camera, images: torch.Tensor, keys: torch.Tensor) -> torch.Tensor:
    """Counts of images float32[B, ...], 1 standing for ``camera.photons``: uint16, or float32 without bits.

    A camera of a user's own class is asked itself, image by image on the host.

    Raises
    ------
    RuleError
        If the camera has fields that batches do not know: their effect would be left out.
    """
    if is_own(type(camera)):
        intensity = images.clamp(min=0).to(torch.float64).cpu().numpy()
        frames = [cameras.exposed(camera, image, four) for image, four in zip(intensity, keys.tolist(), strict=True)]
        return torch.from_numpy(np.stack(frames)).to(images.device)
    fields = type(camera).model_fields
    new = fields.keys() - {*FIELDS}
    unknown = sorted(name for name in new if not equals_default(getattr(camera, name), fields[name]))
    if unknown:
        reject("Recipe.exposure", "a camera whose fields all have an effect in batches", unknown,
               "Add their effect to specklegen.datasets.recipes.parts.exposure.")  # fmt: skip
    # Rounding may leave a dark pixel a little below 0.
    light = camera.photons * images.clamp(min=0).to(torch.float64)
    noise_map = camera.noise_map(images.shape[-2:])
    counts = exposed(light, keys, camera.electronics,
                     None if noise_map is None else torch.tensor(noise_map, device=images.device))  # fmt: skip
    return counts if camera.bit_depth is None else counts.to(torch.uint16)
