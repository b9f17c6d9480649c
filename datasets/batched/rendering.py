"""From media made ready to images, for one bucket of equal rank."""

import torch

from specklegen.datasets.batched import optics
from specklegen.datasets.batched.medium import MediumBatch, profile_power
from specklegen.datasets.batched.mixtures import mixture
from specklegen.datasets.batched.plan import Sizes, Tables, beams_of
from specklegen.datasets.recipes.recipe import Recipe


def render(
    recipe: Recipe, sizes: Sizes, tables: Tables, medium: MediumBatch, keys: torch.Tensor, light: torch.Tensor,
    rank: int,
) -> torch.Tensor:  # fmt: skip
    """Images over their expected value, float32[B, T, H, W].

    Parameters
    ----------
    recipe, sizes, tables
        The recipe, and what goes with it.
    medium
        Media of at most ``rank`` modes.
    keys : int64[B, 2]
        Keys of their fields.
    light : float32[B, h, w]
        Objects.
    rank
        Modes to render.
    """
    shape, tilts = beams_of(recipe)
    values = tables.basis @ medium.columns[:, :, :rank]
    values = values / torch.linalg.vector_norm(values, dim=2, keepdim=True)
    modes = values[:, :, :, None] if tilts > 1 else values.mT[:, None]
    drawn = optics.fields(keys, medium.cells[:, 0], medium.cells[:, 1], medium.envelope, rank)
    seen = optics.images(
        optics.spectra(drawn, sizes.lags), modes.to(torch.float32), light, transforms(recipe, sizes, medium, shape)
    )
    return seen / light.sum((1, 2), dtype=torch.float64).to(torch.float32)[:, None, None, None]


def transforms(
    recipe: Recipe, sizes: Sizes, medium: MediumBatch, shape: tuple[int, int]
) -> dict[str, torch.Tensor]:
    """Transforms of object and camera at the lags of each medium; see :func:`optics.images`."""
    device, wavelength = medium.size.device, recipe.wavelength
    rows, columns = sizes.lags
    number_y = torch.arange(rows, dtype=torch.float64, device=device)
    number_y = torch.where(number_y < rows // 2, number_y, number_y - rows)
    number_x = torch.arange(columns // 2 + 1, dtype=torch.float64, device=device)
    lags = [number_y * medium.size[:, 0, None], number_x * medium.size[:, 1, None]]
    gains = [torch.ones_like(number_y), torch.where(number_x == 0, 1.0, 2.0)]
    names = ("rows", "columns")
    found = {}
    for axis, name in enumerate(names):
        lag, gain = lags[axis], gains[axis].expand_as(lags[axis])
        if recipe.exposure is not None:
            gain = gain * torch.sinc((medium.camera_pitch / wavelength)[:, None] * lag)
        if shape != (1, 1):
            sines = -_centred(shape[axis], medium.object_pitch)
            found[f"object_{name}"] = torch.view_as_complex(
                optics.waves(lag, sines / wavelength, torch.ones_like(sines))
            )
        views = _centred(recipe.camera_shape[axis], medium.camera_pitch)
        views = views[:, None] - medium.base[:, :, 1 - axis, None]
        waves = optics.waves(views.flatten(1) / -wavelength, lag, gain).unflatten(1, views.shape[1:])
        found[f"camera_{name}"] = torch.view_as_complex(waves)
    found["camera_columns"] = found["camera_columns"].mT
    return found


def _centred(count: int, pitch: torch.Tensor) -> torch.Tensor:
    """Sines float64[B, count] about 0."""
    number = torch.arange(count, dtype=torch.float64, device=pitch.device) - (count - 1) / 2
    return number * pitch[:, None]


def expected_contrast(
    recipe: Recipe, sizes: Sizes, tables: Tables, medium: MediumBatch, light: torch.Tensor
) -> torch.Tensor:
    """Expected contrast float64[B] of the images of objects float32[B, h, w]: ``ObjectSampler.contrast``."""
    shape, _ = beams_of(recipe)
    shown = []
    for axis in (0, 1):
        power = profile_power(
            recipe, sizes.cells[axis], medium.parameters["width"], medium.cells[:, axis], medium.size[:, axis]
        )
        length = sizes.lags[axis]
        pairs = torch.fft.irfft(torch.fft.rfft(power, length).abs().square(), length)[:, : sizes.cells[axis]]
        lag = torch.arange(sizes.cells[axis], device=power.device) * medium.size[:, axis, None]
        if recipe.exposure is not None:
            pairs = pairs * torch.sinc((medium.camera_pitch / recipe.wavelength)[:, None] * lag).square()
        pairs = torch.cat([pairs[:, :1], 2 * pairs[:, 1:]], 1)
        step = torch.arange(shape[axis], device=power.device) * (
            2 * torch.pi / recipe.wavelength * medium.object_pitch
        )[:, None]
        shown.append((torch.cos(step[:, :, None] * lag[:, None]) @ pairs[:, :, None])[..., 0])
    variance = shown[0][:, :, None] * shown[1][:, None]
    if shape != (1, 1):
        q = (2 * torch.pi / recipe.wavelength * medium.object_pitch)[:, None] * tables.steps
        variance = variance * mixture(q, medium.kernels.radius, medium.kernels.share)[:, tables.which].square()
    rows, columns = shape
    grid = [2 * rows - 1, 2 * columns - 1]
    brightness = light.to(torch.float64)
    pairs = torch.fft.irfft2(torch.fft.rfft2(brightness, grid).abs().square(), grid)
    # Differences of either sign along either axis, of an even variance.
    y, x = (torch.where(torch.arange(n, device=light.device) == 0, 1.0, 2.0) for n in (rows, columns))
    both = torch.cat([pairs[:, :rows, :1], 0.5 * (pairs[:, :rows, 1:columns] + pairs[:, :rows, columns:].flip(2))], 2)
    total = (both * y[:, None] * x * variance).sum((1, 2))
    return torch.sqrt(total.clamp(min=0)) / brightness.sum((1, 2))
