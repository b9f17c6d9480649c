"""From media made ready to images, for one bucket of equal rank."""

import torch

from specklegen.datasets.batched import optics
from specklegen.datasets.batched.fused import fused
from specklegen.datasets.batched.medium import MediumBatch, profile_power
from specklegen.datasets.batched.mixtures import mixture
from specklegen.datasets.batched.plan import Sizes, Tables, beams_of
from specklegen.datasets.recipes.recipe import Recipe


def inputs(
    recipe: Recipe, sizes: Sizes, medium: MediumBatch, keys: torch.Tensor, light: torch.Tensor
) -> dict[str, torch.Tensor]:
    """All that :func:`render` asks of samples, each with a leading axis of samples.

    Parameters
    ----------
    recipe, sizes
        Whose.
    medium
        Media made ready.
    keys : int64[B, 2]
        Keys of their fields.
    light : float32[B, h, w]
        Objects.
    """
    found = {"columns": medium.columns, "cells": medium.cells, "envelope": medium.envelope, "keys": keys}
    return found | {"light": light} | transforms(recipe, sizes, medium)


def render(
    sizes: Sizes, tables: Tables, rank: int, columns: torch.Tensor, cells: torch.Tensor, envelope: torch.Tensor,
    keys: torch.Tensor, light: torch.Tensor, **transforms: torch.Tensor,
) -> torch.Tensor:  # fmt: skip
    """Images over their expected value, float32[B, T, H, W], of samples of at most ``rank`` modes.

    Parameters
    ----------
    sizes, tables
        Of the recipe.
    rank
        Modes to render.
    columns, cells, envelope
        Of the media; see :class:`MediumBatch`.
    keys, light, transforms
        As :func:`inputs` gives them.
    """
    values = tables.basis @ columns[:, :, :rank]
    values = (values / torch.linalg.vector_norm(values, dim=2, keepdim=True)).to(torch.float32)
    modes = values[:, :, :, None] if transforms["camera_rows"].shape[1] > 1 else values.mT[:, None]
    still = torch.ones_like(columns[:, 0, 0])
    drawn = optics.fields(keys[:, None], still, *cells.unbind(1), envelope, rank, [*sizes.lags])
    spectra = optics.spectra(torch.view_as_complex(drawn))
    seen = optics.images(spectra[:, None], modes, light, transforms)
    return seen / light.sum((1, 2), dtype=torch.float64).to(torch.float32)[:, None, None, None]


def transforms(recipe: Recipe, sizes: Sizes, medium: MediumBatch) -> dict[str, torch.Tensor]:
    """Transforms of object and camera at the lags of each medium; see :func:`optics.images`."""
    device, wavelength, (shape, _) = medium.size.device, recipe.wavelength, beams_of(recipe)
    rows, columns = sizes.lags
    number_y = torch.arange(rows, dtype=torch.float64, device=device)
    number_y = torch.where(number_y < rows // 2, number_y, number_y - rows)
    number_x = torch.arange(columns // 2 + 1, dtype=torch.float64, device=device)
    lags = [number_y * medium.size[:, 0, None], number_x * medium.size[:, 1, None]]
    gains = [torch.ones_like(number_y), torch.where(number_x == 0, 1.0, 2.0)]
    found = {}
    for axis, name in enumerate(("rows", "columns")):
        lag, gain = lags[axis], gains[axis].expand_as(lags[axis])
        if recipe.exposure is not None:
            gain = gain * torch.sinc((medium.camera_pitch / wavelength)[:, None] * lag)
        if shape != (1, 1):
            sines = -_centred(shape[axis], medium.object_pitch)
            ends = (lag, sines / wavelength) if axis == 0 else (sines / wavelength, lag)
            waves = optics.waves(*ends, torch.ones_like(ends[1]))
            found[f"object_{name}"] = torch.view_as_complex(waves)
        views = _centred(recipe.camera_shape[axis], medium.camera_pitch)
        views = views[:, None] - medium.base[:, :, 1 - axis, None]
        conjugate = -1 if axis else 1
        waves = optics.waves(views.flatten(1) / -(conjugate * wavelength), lag, gain).unflatten(1, views.shape[1:])
        found[f"camera_{name}"] = waves.flatten(3) if axis else torch.view_as_complex(waves)
    return found


def _centred(count: int, pitch: torch.Tensor) -> torch.Tensor:
    """Sines float64[B, count] about 0."""
    number = torch.arange(count, dtype=torch.float64, device=pitch.device) - (count - 1) / 2
    return number * pitch[:, None]


@fused(
    "lag_transform(Tensor power, Tensor size, Tensor wavevector, Tensor pixel, int count) -> Tensor",
    lambda power, size, wavevector, pixel, count: power.new_empty((len(power), count)),
    kernels=2,
)
def lag_transform(
    power: torch.Tensor, size: torch.Tensor, wavevector: torch.Tensor, pixel: torch.Tensor, count: int
) -> torch.Tensor:
    """What a window along one axis makes of differences 0, 1, ... of two object pixels: ``contrast.lag_transform``.

    Parameters
    ----------
    power : float64[B, n]
        b^2 over the cells.
    size, wavevector, pixel : float64[B]
        Distance of cells; lateral wavevector of the pitch; side of a camera pixel over the wavelength.
    count
        Differences wanted.
    """
    cells = power.shape[1]
    number = torch.arange(cells, device=power.device)
    other = number[:, None] + number  # [cell, lag]
    shifted = power[:, other.clamp(max=cells - 1)] * (other < cells)
    lag = number * size[:, None]
    pairs = (power[:, :, None] * shifted).sum(1) * torch.sinc(pixel[:, None] * lag).square()
    pairs = pairs * torch.where(number == 0, 1.0, 2.0)  # lags of either sign
    step = torch.arange(count, device=power.device) * wavevector[:, None]
    return (torch.cos(step[:, :, None] * lag[:, None]) * pairs[:, None]).sum(-1)


def expected_contrast(
    recipe: Recipe, sizes: Sizes, tables: Tables, medium: MediumBatch, light: torch.Tensor
) -> torch.Tensor:
    """Expected contrast float64[B] of the images of objects float32[B, h, w]: ``ObjectSampler.contrast``."""
    shape, _ = beams_of(recipe)
    shown = []
    pixel = medium.camera_pitch / recipe.wavelength if recipe.exposure is not None else 0 * medium.camera_pitch
    wavevector = 2 * torch.pi / recipe.wavelength * medium.object_pitch
    for axis in (0, 1):
        cells, size = medium.cells[:, axis], medium.size[:, axis]
        power = profile_power(
            medium.parameters["width"], cells, size, sizes.cells[axis], recipe.profile == "gaussian"
        )
        shown.append(lag_transform(power, size, wavevector, pixel, shape[axis]))
    variance = shown[0][:, :, None] * shown[1][:, None]
    if shape != (1, 1):
        q = wavevector[:, None] * tables.steps
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
