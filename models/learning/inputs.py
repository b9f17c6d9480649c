"""Inputs of networks: the camera image, or the autocorrelation of its speckle around zero lag.

The autocorrelation is that of the object times the material's memory effect, plus a speckle grain at zero lag (Freund
1990; Katz et al. 2014), and all of it lies within one object's side of zero lag. So only those lags are handed over, on
the pitch at which the object is to be reconstructed (``object_pitch``, chosen by the caller; a material
does not tell it). That takes scale out of the problem, and averages over pixels where they are finer than that pitch.
"""

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import torch
from scipy.fft import next_fast_len
from torch import Tensor

from specklegen.core.errors import reject
from specklegen.core.shielded import shielded
from specklegen.models.learning.exposures import exposures_input
from specklegen.models.learning.local_contrast import local_contrast_input
from specklegen.models.likelihood.likelihood import BAND, lag_transforms
from specklegen.models.likelihood.spectrum import Transforms
from specklegen.models.retrieval.autocorrelation import lag_means
from specklegen.models.retrieval.camera_noise import READABLE, camera_noise
from specklegen.models.retrieval.edges import lowest_frequency, pair_counts, taper_of, tapered

LAGS = 64
"""Side of the window of lags: up to 32 object pixels either way, for objects of at most 32 pixels."""


def speckle_autocorrelation(images: Tensor, noise: Tensor | None = None) -> Tensor:
    """Autocorrelation of fluctuations, float[..., 2H - 1, 2W - 1], zero lag in the middle and equal to 1.

    Every lag is divided by the number of pixel pairs that it has, under the taper that an image's light asks for
    (:func:`~specklegen.models.retrieval.edges.taper_of`); ``noise``, the variance that a camera adds to a pixel,
    float[...], is taken off the zero lag.
    """
    rows, columns = images.shape[-2:]
    fluctuation = images - images.mean((-2, -1), keepdim=True)
    lags = lag_means(fluctuation, (rows - 1, columns - 1), taper_of(images))
    if noise is not None:
        lags[..., 0, 0] -= noise.to(lags)
    peak = lags[..., :1, :1].clamp_min(torch.finfo(lags.dtype).tiny)
    return torch.fft.fftshift(lags / peak, dim=(-2, -1))


def resampled_lags(lags: Tensor, step: Tensor, size: int) -> Tensor:
    """Lags float[B, M, N] on another pitch, float[B, size, size]; zero lag at [size // 2, size // 2].

    Each new lag is a weighted mean under a triangle as wide as the coarser of the two pitches, so that nothing is
    aliased and noise is averaged. Where the input has no lag the output is 0.

    Parameters
    ----------
    lags
        Zero lag in the middle; M and N are odd.
    step
        Old pitches in a new one, float[B].
    size
        Side of the result.
    """
    rows, columns = (_triangles(n, step, size) for n in lags.shape[-2:])
    return rows @ lags @ columns.transpose(-2, -1)


def object_lags(images: Tensor, step: Tensor, size: int, noise: Tensor | None = None) -> Tensor:
    """Autocorrelations of fluctuations on the object's pitch, float[B, size, size]; zero lag at [size // 2, size // 2].

    ``resampled_lags(speckle_autocorrelation(images), step, size)``, but of the lags that are kept alone: the transform
    is as long as they need, and of two opposite lags one is made. On the CPU image by image, so that companions do not
    change an image's last bits.

    Parameters
    ----------
    images
        float[B, H, W].
    step
        Camera pixels in an object pixel, float[B].
    size
        Side of the result, even.
    noise
        Variance that a camera adds to a pixel, float[B], taken off the zero lag; by default none.
    """
    if images.device.type != "cpu":
        return resampled_lags(speckle_autocorrelation(images, noise), step, size)
    levels = torch.zeros_like(step) if noise is None else noise.to(step)
    return torch.stack([
        _half_by_half(image, each, size, level) for image, each, level in zip(images, step, levels, strict=True)
    ])


def _half_by_half(image: Tensor, step: Tensor, size: int, noise: Tensor) -> Tensor:
    """One image float[H, W]; only lags with a row of at least 0 are summed, the others are these turned about."""
    shape, half, taper = image.shape, size // 2, float(taper_of(image[None]))
    reach = [min(n - 1, math.ceil(half * float(step) + max(float(step), 1.0))) for n in shape]
    padded = [int(next_fast_len(n + far, real=True) or 0) for n, far in zip(shape, reach, strict=True)]
    light = tapered((image - image.mean())[None], taper)[0]
    spectrum = torch.view_as_real(torch.fft.rfft2(light, s=padded)).square_()
    sums = torch.fft.irfft2((spectrum[..., 0] + spectrum[..., 1]).to(image.dtype.to_complex()), s=padded)
    pairs = [
        pair_counts(torch.arange(-far, far + 1, dtype=image.dtype), n, taper).to(image)
        for n, far in zip(shape, reach, strict=True)
    ]
    kept = torch.cat([sums[: reach[0] + 1, -reach[1] :], sums[: reach[0] + 1, : reach[1] + 1]], dim=1)
    kept = kept / (pairs[0][reach[0] :, None] * pairs[1])
    if noise:
        kept[0, reach[1]] -= noise
    kept = kept / kept[0, reach[1]].clamp_min(torch.finfo(kept.dtype).tiny)
    # Triangles about rows near 0 reach over to rows below, which are those above turned about.
    weights = {far: _triangles(2 * far + 1, step[None].to(image), size + 2)[0, 1:] for far in {*reach}}
    rows, columns = (weights[far] for far in reach)
    down, up = rows[half:, reach[0] :], rows[half:, : reach[0]].flip(1)
    correlation = down @ kept @ columns.T
    correlation += (up @ kept[1:].flip(1)) @ columns.T
    upper = correlation[1 : half + 1].flip((0, 1))
    return torch.cat([upper[:, :size], correlation[:half, :size]])


def _triangles(count: int, step: Tensor, size: int) -> Tensor:
    """Weights float[B, size, count] of one axis."""
    old = torch.arange(count, device=step.device, dtype=step.dtype) - count // 2
    new = (torch.arange(size, device=step.device, dtype=step.dtype) - size // 2) * step[:, None]
    distance = (new[..., None] - old).abs() / step.clamp_min(1)[:, None, None]
    weights = (1 - distance).clamp_min(0)
    return weights / weights.sum(-1, keepdim=True).clamp_min(1e-6)


def without_background(lags: Tensor) -> Tensor:
    """Lags float[B, n, n] less the mean of the longest, three rows of them, which no object has."""
    return lags - torch.cat([lags[:, :2], lags[:, -1:]], dim=1).mean((1, 2), keepdim=True)


def zero_phase(lags: Tensor) -> Tensor:
    """Image with the modulus that autocorrelations float[B, n, n] stand for and no phases, its middle equal to 1.

    Power below 0 is noise.
    """
    power = torch.fft.rfft2(torch.fft.ifftshift(without_background(lags), dim=(-2, -1))).real
    image = torch.fft.irfft2(power.clamp_min(0).sqrt(), s=lags.shape[-2:])
    peak = image[:, :1, :1].clamp_min(torch.finfo(image.dtype).tiny)
    return torch.fft.fftshift(image / peak, dim=(-2, -1))


def camera_input(images: Tensor, step: Tensor, noise: Tensor | None = None) -> Tensor:  # noqa: ARG001
    """Channels float[B, 2, H, W]: the image over its mean less 1, and the scale (the same in every pixel)."""
    mean = images.mean((-2, -1), keepdim=True).clamp_min(torch.finfo(images.dtype).tiny)
    return _with_scale(images / mean - 1, step)


def autocorrelation_input(images: Tensor, step: Tensor, noise: Tensor | None = None) -> Tensor:
    """Channels float[B, 2, LAGS, LAGS]: the autocorrelation on the object's pitch, and the scale.

    ``noise``, the variance that a camera adds to a pixel, float[B], is taken off the zero lag.
    """
    return _with_scale(object_lags(images, step, LAGS, noise), step)


def _with_scale(picture: Tensor, step: Tensor) -> Tensor:
    scale = torch.log2(step)[:, None, None].expand_as(picture)
    return torch.stack([picture, scale], dim=1)


INPUTS: dict[str, Callable[[Tensor, Tensor, Tensor | None], Tensor]] = {
    "camera": camera_input,
    "autocorrelation": autocorrelation_input,
}
"""Name to function of (images float[B, H, W], camera pixels in an object pixel float[B], camera noise or None)."""

_OPTICS = ("wavelength", "width", "camera_pitch")
_SILENT = 1e-3
"""Share of an image's variance below which what is read off as noise is light that leaks, and is left alone."""


def noise_of(images: Tensor, parameters: Mapping[str, Tensor]) -> Tensor | None:
    """Variance that camera noise adds to a pixel of images real[B, H, W], float[B]; None where it cannot be read off.

    It can where grains are wide enough to leave frequencies to noise alone (:mod:`camera_noise`).
    """
    if not set(_OPTICS) <= parameters.keys():
        return None
    grain = parameters["wavelength"] / parameters["width"] / parameters["camera_pitch"]
    if not (grain > READABLE).all():
        return None
    images = images.double()
    mean = images.mean((-2, -1), keepdim=True)
    level = camera_noise(images, grain.to(images.device)) * mean[..., 0, 0].square()
    variance = (images - mean).square().sum((-2, -1)) / max(images[0].numel() - 1, 1)  # faster than `var`
    return torch.where(level > _SILENT * variance, level, 0.0)


def registered_input(batch: Mapping[str, Any]) -> Tensor:
    """Features float[B, 2 (T - 1)] of stacks under T equally spaced tilts: how the speckle decorrelates.

    The pattern follows the tilt, so each image is moved back by the tilts' difference, to the nearest pixel, before two
    are correlated where both see it. The mean over all pairs n tilts apart is C_I there: C and ``log10(1 - C)`` for n =
    1 to ``T - 1``. Images that no longer overlap count as uncorrelated.
    """
    for name in ("stack", "tilts"):
        if name not in batch:
            reject("batch", 'a batch with "stack" and "tilts"', sorted(batch), "Use a recipe such as registered-tilts.")
    stack, sines = batch["stack"].float(), torch.sin(batch["tilts"])
    moved = ((sines - sines[:, :1]) / batch["parameters"]["camera_pitch"][:, None, None]).round().long()
    count = stack.shape[1]
    correlations = []
    for images, places in zip(stack, moved.tolist(), strict=True):
        means = []
        for apart in range(1, count):
            pairs = [_registered(images[n], images[n + apart], places[n], places[n + apart])
                     for n in range(count - apart)]  # fmt: skip
            means.append(torch.stack(pairs).mean())
        correlations.append(torch.stack(means))
    correlation = torch.stack(correlations)
    return torch.cat([correlation, (1 - correlation).clamp(1e-5, 2).log10()], dim=1)


def _registered(one: Tensor, other: Tensor, here: list[int], there: list[int]) -> Tensor:
    """Pearson correlation of two images [H, W] whose patterns were moved by (x, y) pixels, where they overlap."""
    for axis, shift in ((1, there[0] - here[0]), (0, there[1] - here[1])):
        length = one.shape[axis] - abs(shift)
        if length < 2:
            return one.new_zeros(())
        one, other = one.narrow(axis, max(-shift, 0), length), other.narrow(axis, max(shift, 0), length)
    return torch.corrcoef(torch.stack([one.flatten(), other.flatten()]))[0, 1]


def registered_and_power_input(batch: Mapping[str, Any]) -> Tensor:
    """Features of :func:`registered_input`, and log10 of the radiance straight ahead over the irradiance."""
    power = batch["parameters"]["forward_radiance"] * batch["stack"].double().mean((1, 2, 3))
    return torch.cat([registered_input(batch), power.log10()[:, None].float()], dim=1)


def band(shape: tuple[int, int], grain: float) -> tuple[Tensor, Tensor]:
    """Frequencies of a camera that a grain of so many pixels leaves, as whole numbers int64[F] and int64[G].

    Of the columns those from 0 on, of both axes those up to :data:`BAND` cycles a grain and below Nyquist's.
    """
    rows, columns = (min(int(BAND / grain * n), (n - 1) // 2) for n in shape)
    return torch.arange(-rows, rows + 1), torch.arange(columns + 1)


def banded_lags(power: Tensor, shape: tuple[int, int], grain: float, step: float, taper: float = 0.0) -> Tensor:
    """Lags float32[LAGS, LAGS], the zero lag in the middle and 1, of one periodogram float[F, G], its noise taken off.

    Parameters
    ----------
    power
        At the frequencies of :func:`band`; f = 0, which an image's mean takes, is left out.
    shape
        Of the camera.
    grain, step
        Camera pixels in a grain, and in an object pixel.
    taper
        That the power was seen under (:mod:`~specklegen.models.retrieval.edges`).
    """
    counted, turns = _banded(shape, grain, step, power.device, taper)
    lags = turns.back((power * counted)[None])[0]
    return torch.fft.fftshift(lags / lags[0, 0].clamp_min(torch.finfo(lags.dtype).tiny))


@lru_cache(maxsize=64)
def _banded(
    shape: tuple[int, int], grain: float, step: float, device: torch.device, taper: float
) -> tuple[Tensor, Transforms]:
    """Frequencies that count, of two opposite ones one, float32[F, G], and transforms to lags."""
    rows, columns = band(shape, grain)
    counted = (columns > 0) | (rows > 0)[:, None]
    cycles = rows.double() / shape[0], columns.double() / shape[1]
    if taper:
        counted &= torch.hypot(cycles[0][:, None], cycles[1]) >= lowest_frequency(taper, shape)
    turns = lag_transforms(cycles, shape, torch.tensor([step], dtype=torch.float32), LAGS, taper)
    return counted.float().to(device), Transforms(*(each.to(device) for each in turns))


def periodogram_input(batch: Mapping[str, Any]) -> Tensor:
    """Channels float[B, 2, LAGS, LAGS]: lags of the periodogram within the window's band, and the scale.

    They are those of one image a sample, its noise taken off, or "lags" that a law has drawn (:mod:`law`). Sample by
    sample, so that companions do not change the last bits.
    """
    drawn = batch["parameters"]
    if "lags" not in batch and ("image" not in batch or not {*_OPTICS, "object_pitch"} <= drawn.keys()):
        reject("batch", 'a batch with "image" of a hidden object, or "lags"', sorted(batch),
               "Use a recipe such as unknown-slab.")  # fmt: skip
    step = steps_of(batch)
    if "lags" in batch:
        return _with_scale(batch["lags"], step.float())
    images = batch["image"].float()
    shape, noise = (images.shape[1], images.shape[2]), noise_of(images, drawn)
    grains = (drawn["wavelength"] / drawn["width"] / drawn["camera_pitch"]).tolist()
    lags = []
    for n, grain in enumerate(grains):
        rows, columns = band(shape, grain)
        taper = float(taper_of(images[n : n + 1]))
        light = tapered(images[n : n + 1], taper)[0]
        power = torch.fft.rfft2(light)[rows % shape[0]][:, columns].abs().square() / (shape[0] * shape[1])
        level = 0.0 if noise is None else noise[n].to(power)
        lags.append(banded_lags(power - level, shape, grain, float(step[n]), taper))
    return _with_scale(torch.stack(lags), step.float())


FEATURES: dict[str, Callable[[Mapping[str, Any]], Tensor]] = {
    "periodogram": periodogram_input, "registered": registered_input, "registered+power": registered_and_power_input,
    "exposures": exposures_input, "local-contrast": local_contrast_input,
}  # fmt: skip
"""Name to function of a batch: of stacks, float[B, F], or pictures or maps float[B, C, H, W]."""


def steps_of(batch: Mapping[str, Any]) -> Tensor:
    """Camera pixels in an object pixel, float64[B]; of coherent objects, which have no image, the camera's share."""
    if "object_pitch" not in batch["parameters"]:
        share = max(batch["image"].shape[-2:]) / max(batch["object"].shape[-2:])
        return torch.full_like(batch["parameters"]["camera_pitch"], share)
    return batch["parameters"]["object_pitch"] / batch["parameters"]["camera_pitch"]


@shielded()
def network_input(batch: Mapping[str, Any], kind: str) -> Tensor:
    """Turn a batch into a network's input.

    Raise a `RuleError` if there is no such input, or the batch has no images of a hidden object.

    Returns
    -------
    float[B, 2, H, W], or float[B, T, 2, H, W] for recipes with "stack" or "frames"; of :data:`FEATURES` as they say.
    """
    if kind in FEATURES:
        return FEATURES[kind](batch)
    if kind not in INPUTS:
        reject("input", f"one of {', '.join([*INPUTS, *FEATURES])}", kind)
    name = next((name for name in ("image", "stack", "frames") if name in batch), None)
    if name is None or "object" not in batch:
        reject("batch", 'a batch with "object", and "image", "stack" or "frames"', sorted(batch))
    images = batch[name].float()
    step = steps_of(batch).to(images)
    frames = 1 if images.ndim == 3 else images.shape[1]
    drawn = {key: batch["parameters"][key].repeat_interleave(frames) for key in _OPTICS if key in batch["parameters"]}
    each = images if images.ndim == 3 else images.flatten(0, 1)
    prepared = INPUTS[kind](each, step.repeat_interleave(frames), noise_of(each, drawn))
    if images.ndim == 3:
        return prepared
    return prepared.unflatten(0, (-1, frames))
