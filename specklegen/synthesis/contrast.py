"""The contrast that speckle is expected to have at one camera pixel, of a batch of media.

Two object pixels a lateral wavevector kappa apart give, at one camera pixel, images whose covariance over
the product of their means is

    V(kappa) = sum_n mu_n^2 |K_n(kappa)|^2  sum_s A(s) a(s)^2 e^(i kappa . s)

A(s) the autocorrelation of the window's intensity b^2, a(s) the transform of the pixel's area, n the modes
of the light. A finite window makes different beams independent from one speckle grain on, whatever the
memory effect says. This is the law of a window behind the medium, as the stationary sampler has it.

Path sums have the window where it is, before the medium: beam i at view v adds up to b(x) e^(ik i . x) over entrances x
and e^(-ik v . (x + r)) over the ways r to the exit. So two beams have B(v - v' - i + i') K(v - v') in common, B the
transform of b^2, and at one view the memory effect does not enter: V without K. Over a pixel's area it does, as the
mean of |K|^2 over pairs of its points. The two agree where K falls little over a grain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import torch

from specklegen.kernels.bright_pairs import fill_extent, fill_pairs
from specklegen.kernels.windows import fill_lag_transforms, fill_window_powers
from specklegen.synthesis.correlations import Correlations, LightBatch
from specklegen.synthesis.exit_grid import disc_power
from specklegen.synthesis.fused import fused
from specklegen.synthesis.modes import on_differences, on_signed_differences, one_by_one
from specklegen.synthesis.sight import Sight

_WITHIN = 8  # steps across a pixel
_MOST_PRODUCTS = 2**19  # of pixels, beyond which transforms are faster


def _power_on_the_cpu(
    width: torch.Tensor, count: torch.Tensor, size: torch.Tensor, most: int, gaussian: bool
) -> torch.Tensor:
    out = np.empty((len(width), most))
    fill_window_powers(*(part.contiguous().numpy() for part in (width, count, size)), gaussian, out)
    return torch.from_numpy(out)


@fused(
    "window_power(Tensor width, Tensor count, Tensor size, int most, bool gaussian) -> Tensor",
    lambda width, count, size, most, gaussian: width.new_empty((len(width), most)),
    _power_on_the_cpu,
)
def window_power(
    width: torch.Tensor, count: torch.Tensor, size: torch.Tensor, most: int, gaussian: bool
) -> torch.Tensor:
    """b^2 along one axis over ``count`` cells, float64[M, most] with sum 1, of square or Gaussian windows.

    Of width, size (distance of cells) float64[M] and count int64[M].
    """
    cell = torch.arange(most, dtype=torch.float64, device=width.device)
    position = (cell - (count[:, None] - 1) / 2) * size[:, None]
    if gaussian:
        power = torch.exp(-8 * (position / width[:, None]).square())
    else:
        half, side = 0.5 * size[:, None], 0.5 * width[:, None]
        power = (torch.minimum(position + half, side) - torch.maximum(position - half, -side)).clamp(min=0)
    power = power * (cell < count[:, None])
    return power / power.sum(1, keepdim=True)


def window_powers(sight: Sight) -> list[torch.Tensor]:
    """b^2 of a separable window along y and x, float64[M, n] each."""
    cells = sight.cells
    return [
        window_power(sight.width, cells.number[:, axis], cells.size[:, axis], most, sight.profile == "gaussian")
        for axis, most in enumerate(sight.most_cells)
    ]


def speckle_variance(
    sight: Sight, correlations: Correlations, light: LightBatch | None = None, *, known: torch.Tensor | None = None,
    one: Sight | None = None,
) -> torch.Tensor:  # fmt: skip
    """V by the differences (row, column) of two object pixels, neither below 0: float64[M, h, w].

    Of K that is not the same in all directions at differences ``0, 1, ..., -2, -1``: float64[M, 2h - 1, 2w - 1].

    Parameters
    ----------
    sight
        Windows, objects and cameras.
    correlations
        Memory effect of the media.
    light
        Modes of the light; by default one.
    known : float64[M, h, w] or None
        K at those differences, of light of one mode, where it is known.
    one
        Sight of one medium, where it is that of all.
    """
    shown = window_variance(sight if one is None else one)
    if known is not None:
        return shown * known.square()
    ones = torch.ones(len(sight), dtype=torch.float64, device=sight.device)
    modes = [(ones, correlations)] if light is None else [*zip(light.shares.unbind(1), light.modes, strict=True)]
    shape, wavevector = sight.shape, sight.wavenumber * sight.object_pitch
    if not all(k.isotropic for _, k in modes):
        signed = [share.square()[:, None, None] * on_signed_differences(k, shape, wavevector).square()
                  for share, k in modes]  # fmt: skip
        y, x = (_wrapped(2 * count - 1, sight.device) for count in shape)
        return shown[:, y[:, None], x] * sum(signed[1:], signed[0])
    seen = [share.square()[:, None, None] * on_differences(k, shape, wavevector).square() for share, k in modes]
    return shown * sum(seen[1:], seen[0])


def window_variance(sight: Sight) -> torch.Tensor:
    """V of beams that have all but the window in common, by the differences of object pixels: float64[M, h, w]."""
    shape, wavevector = sight.shape, sight.wavenumber * sight.object_pitch
    if sight.profile == "disc":
        # On the CPU each alone: cells of companions would have it transformed on another grid, to other last bits.
        each = [slice(n, n + 1) for n in range(len(sight))] if one_by_one(sight.device) else [slice(None)]
        return torch.cat([_disc_lags(sight.at(own), wavevector[own]) for own in each])
    along = [
        lag_transform(power, sight.cells.size[:, axis], wavevector, sight.pixel, shape[axis])
        for axis, power in enumerate(window_powers(sight))
    ]
    return along[0][:, :, None] * along[1][:, None]


def kept_by_pixels(sight: Sight, correlations: Correlations) -> torch.Tensor:
    """Mean of |K|^2 over pairs of points of a camera pixel, float64[M]; 1 of pixels that are points.

    B is taken to change little over a pixel.
    """
    shape, step = (_WITHIN + 1, _WITHIN + 1), 2 * torch.pi * sight.pixel / _WITHIN
    number = torch.arange(_WITHIN + 1, dtype=torch.float64, device=sight.device)
    pairs = 1 - number / _WITHIN  # of points so many steps apart
    if correlations.isotropic:
        seen, pairs = on_differences(correlations, shape, step), pairs * torch.where(number == 0, 1.0, 2.0)
    else:
        seen, pairs = on_signed_differences(correlations, shape, step), torch.cat([pairs, pairs[1:].flip(0)])
    pairs = pairs / pairs.sum()
    return (seen.square() @ pairs) @ pairs


def _wrapped(period: int, device: torch.device) -> torch.Tensor:
    """Lengths of differences ``0, 1, ..., -2, -1``, int64[period]."""
    number = torch.arange(period, device=device)
    return torch.minimum(number, period - number)


def _lags_on_the_cpu(
    power: torch.Tensor, size: torch.Tensor, wavevector: torch.Tensor, pixel: torch.Tensor, count: int
) -> torch.Tensor:
    out = np.empty((len(power), count))
    fill_lag_transforms(*(part.contiguous().numpy() for part in (power, size, wavevector, pixel)), out)
    return torch.from_numpy(out)


@fused(
    "lag_transform(Tensor power, Tensor size, Tensor wavevector, Tensor pixel, int count) -> Tensor",
    lambda power, size, wavevector, pixel, count: power.new_empty((len(power), count)),
    _lags_on_the_cpu,
    kernels=2,
)
def lag_transform(
    power: torch.Tensor, size: torch.Tensor, wavevector: torch.Tensor, pixel: torch.Tensor, count: int
) -> torch.Tensor:
    """Sum over lags s along an axis of ``A(s) a(s)^2 cos(kappa s)``, for differences 0, 1, ... of two object pixels.

    Parameters
    ----------
    power : float64[M, n]
        b^2 over the cells.
    size, wavevector, pixel : float64[M]
        Distance of cells; lateral wavevector of the object's pitch; side of a camera pixel over the wavelength.
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


def _disc_lags(sight: Sight, wavevector: torch.Tensor) -> torch.Tensor:
    """Sums over the lags of both axes, float64[M, h, w], for a window that is no product of a row and a column."""
    cells, (ny, nx) = sight.cells, sight.most_cells
    lags = [2 * ny, 2 * nx]
    power = torch.fft.rfft2(disc_power(sight.width, *cells, ny, nx), lags).abs().square()
    # irfft2 gives the autocorrelation over lags of both signs; half of the columns say it all.
    pairs = torch.fft.irfft2(power, lags)[:, :, : nx + 1]
    device = sight.device
    number_y = torch.arange(2 * ny, dtype=torch.float64, device=device)
    lag_y = torch.where(number_y < ny, number_y, number_y - 2 * ny) * cells.size[:, 0, None]
    number_x = torch.arange(nx + 1, dtype=torch.float64, device=device)
    lag_x = number_x * cells.size[:, 1, None]
    across = torch.where(number_x == 0, 1.0, 2.0) * torch.sinc(sight.pixel[:, None] * lag_x).square()
    down = torch.sinc(sight.pixel[:, None] * lag_y).square()
    pairs = pairs * down[:, :, None] * across[:, None]
    h, w = sight.shape
    step_y, step_x = (torch.arange(n, device=device) * wavevector[:, None] for n in (h, w))
    waves_y = torch.cos(step_y[:, :, None] * lag_y[:, None])
    waves_x = torch.cos(lag_x[:, :, None] * step_x[:, None])
    return waves_y @ pairs @ waves_x


def _contrast_on_the_cpu(light: torch.Tensor, variance: torch.Tensor) -> torch.Tensor:
    if light.shape[1:] == (1, 1):  # of one point, the beam of a stack: there is nothing to transform
        brightness, own = light[:, 0, 0].double().numpy(), variance[:, 0, 0].numpy()
        return torch.from_numpy(np.sqrt(np.maximum(np.square(brightness) * own, 0.0)) / brightness)
    contrasts = []
    for bright, own in zip(light.numpy(), variance.numpy(), strict=True):
        fill_extent(bright, extent := np.empty(5, np.int64))
        top, left, bottom, right, lit = extent.tolist()
        brightness = bright[top:bottom, left:right].astype(np.float64)
        rows, columns = brightness.shape
        pairs = np.empty((rows, 2 * columns - 1))
        if lit * rows * columns <= _MOST_PRODUCTS:
            fill_pairs(brightness, pairs)
        else:
            grid = 2 * rows - 1, 2 * columns - 1
            products = np.fft.irfft2(np.square(np.abs(np.fft.rfft2(brightness, grid))), grid)
            pairs[:] = np.roll(products, columns - 1, 1)[:rows]
        pairs[1:] *= 2  # of either sign
        apart = np.arange(1 - columns, columns)
        own = own[:rows, np.abs(apart) if own.shape == bright.shape else apart]
        contrasts.append(np.sqrt(max((pairs * own).sum(), 0.0)) / brightness.sum())
    return torch.tensor(contrasts, dtype=torch.float64)


@fused(
    "speckle_contrast(Tensor light, Tensor variance) -> Tensor",
    lambda light, variance: light.new_empty(len(light), dtype=torch.float64),
    _contrast_on_the_cpu,
    kernels=4,
)
def speckle_contrast(light: torch.Tensor, variance: torch.Tensor) -> torch.Tensor:
    """Expected contrast float64[B] of images of objects real[B, h, w], over media, of what one camera pixel sees.

    Its square is ``sum_jl O_j O_l V(j - l) / (sum O)^2``, V float64[B, h, w] or ``[B, 2h - 1, 2w - 1]`` from
    :func:`speckle_variance`.
    """
    rows, columns = light.shape[1:]
    grid = [2 * rows - 1, 2 * columns - 1]
    brightness = light.to(torch.float64)
    pairs = torch.fft.irfft2(torch.fft.rfft2(brightness, grid).abs().square(), grid)
    if [*variance.shape[1:]] != grid:
        y, x = (_wrapped(n, light.device) for n in grid)
        variance = variance[:, y[:, None], x]
    total = (pairs * variance).sum((1, 2))
    return torch.sqrt(total.clamp(min=0)) / brightness.sum((1, 2))


@dataclass(frozen=True)
class ExpectedContrast:
    """Contrast of images by path sums, which the window tells, and the memory effect over a pixel.

    Attributes
    ----------
    variance : float64[1, h, w]
        :func:`window_variance` times :func:`kept_by_pixels`.
    """

    variance: torch.Tensor

    @classmethod
    def of(cls, sight: Sight, correlations: Correlations) -> Self:
        """Return the variance of objects that are seen so."""
        return cls(window_variance(sight) * kept_by_pixels(sight, correlations)[:, None, None])

    def contrast(self, light: torch.Tensor) -> torch.Tensor:
        """Expected contrast float64[B] of images of objects real[B, h, w] under polarised light."""
        return speckle_contrast(light, self.variance.expand(len(light), -1, -1))
