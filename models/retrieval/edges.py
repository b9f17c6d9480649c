"""Taper of a camera's edges: it keeps light that is not even out of periodograms and autocorrelations.

A camera cuts off what it sees. Light that falls off ends there in a jump, whose transform falls off as 1 / f along both
axes and exceeds speckle at all frequencies. Under a taper h it ends at 0. h rises along a cosine from either edge
(Tukey; Harris, *Proc. IEEE* 66, 51 (1978)), over a share a of the side in all, and has the mean square 1:

    I(f) = |sum_l h(l) x(l) e^(-2 pi i f l)|^2 / M,   <I(f)> = sum_l w(l) K(l) e^(-2 pi i f l),   w = h (*) h / M

This is the law of :mod:`~specklegen.models.likelihood.spectrum` with w for a triangle and |H|^2 / M for Fejer's kernel.
Neighbouring frequencies are correlated by r, the transform of h^2 over M, so that one counts as ``1 / <h^4>``. Half a
side costs 45 % of them; so even light has none (:func:`taper_of`).
"""

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

WIDTHS = (0.0, 0.25, 0.5)
"""Shares of a side that a taper's ramps may take."""
LEAKS = 3.0
"""Power on the axes over that under the widest taper, above which a wider one is taken."""
SLOW = 0.65
"""Share of an image's variance below 1.6 / side, above which the widest is taken: 0.02 to 0.3 of even light."""
FALLING = (0.4, 7.0)
"""Share below 1.6 / side, and power there over that up to 2.8 / side, above which light falls off to dark edges.

Such light has no jump on the axes. Of 448 images under even light none has both; of 112 in natural light all have."""
_FIRST, _LINES = 3, 4  # frequencies on the axes, over 1 / side: the first, and the farthest line beside them
_LEAST = 16  # pixels a side, below which there is no room for a taper
_FAINT = 1e-3  # of the largest power beside the axes, below which frequencies do not count


def lowest_frequency(share: float, shape: tuple[int, int]) -> float:
    """Frequency, in cycles a pixel of a tile (M, N), below which a taper leaves light that is not even; 0 without."""
    return (0.6 + 4 * share) / min(shape) if share else 0.0


def _ramp(pixels: int, share: float) -> int:
    return int(share * pixels / 2)


@lru_cache(maxsize=64)
def edge_taper(pixels: int, share: float) -> np.ndarray:
    """Taper h of one axis, float64[pixels], its mean square 1; ``share`` of the side lies on its two ramps."""
    ramp = _ramp(pixels, share)
    rising = 0.5 - 0.5 * np.cos(np.pi * (np.arange(ramp) + 0.5) / max(ramp, 1))
    taper = np.concatenate([rising, np.ones(pixels - 2 * ramp), rising[::-1]])
    taper = taper / np.sqrt(np.square(taper).mean())
    taper.setflags(write=False)
    return taper


def taper_kernel(frequency: np.ndarray, pixels: int, share: float = 0.0) -> np.ndarray:
    """|H|^2 / M at frequencies in cycles a pixel: Fejer's kernel without a taper, its integral over a period 1."""
    ramp = _ramp(pixels, share)
    flat, whole = pixels - 2 * ramp, np.sin(np.pi * frequency)
    near = np.abs(whole) < 1e-9
    if not ramp:
        return np.where(near, pixels, np.square(np.sin(np.pi * pixels * frequency) / np.where(near, 1, whole)) / pixels)
    taper = edge_taper(pixels, share)
    middle = np.sin(np.pi * flat * frequency) / np.where(near, 1, whole)
    total = taper[ramp] * np.where(near, flat * np.cos(np.pi * (flat - 1) * frequency), middle)
    for place in range(ramp):  # pixels that lie opposite about the middle
        total += 2 * taper[place] * np.cos(np.pi * (pixels - 1 - 2 * place) * frequency)
    return np.square(total) / pixels


def lag_weights(distance: Tensor, pixels: int, share: float = 0.0) -> Tensor:
    """Weight w at distances in pixels: 1 at 0, the share of pairs that a lag has; between pixels on a straight line."""
    if not _ramp(pixels, share):
        return 1 - distance.abs() / pixels
    taper = edge_taper(pixels, share)
    values = np.correlate(taper, taper, "full")[pixels - 1 :] / pixels
    at = np.interp(distance.detach().abs().cpu().numpy(), np.arange(pixels + 1), np.append(values, 0.0))
    return torch.from_numpy(np.asarray(at)).to(distance)


@lru_cache(maxsize=64)
def independent(shape: tuple[int, int], share: float) -> tuple[float, float]:
    """Independent frequencies for one of a tile (M, N), and what the variance of the true object's deviance grows by.

    I(f) and I(f') are exponential numbers, correlated by r^2. Of their sum the variance grows by sum r^2 = <h^4>. The
    deviance I / S - log(I / S) is a sum of Laguerre's polynomials L_k / k from k = 2 on, whose correlation is r^2k.
    """
    if not any(_ramp(n, share) for n in shape):
        return 1.0, 1.0
    alike = [np.square(np.abs(np.fft.fft(np.square(edge_taper(n, share))) / n)) for n in shape]
    order = np.arange(2, 60)
    sums = [(each[:, None] ** order).sum(0) for each in alike]
    growth = 1 + float(((sums[0] * sums[1] - 1) / order**2).sum()) / (np.pi**2 / 6 - 1)
    return float(1 / (alike[0].sum() * alike[1].sum())), growth


def shares_of(share: Tensor | float, count: int) -> list[float]:
    """Shares as numbers, one for each of so many images."""
    return torch.as_tensor(share, dtype=torch.float64).expand(count).tolist()


def pair_counts(lags: Tensor, pixels: int, share: float = 0.0) -> Tensor:
    """Pairs of pixels that lags have along one axis, as many as the taper leaves: a tenth of the side at least."""
    if not _ramp(pixels, share):
        return pixels - lags.abs()
    return pixels * lag_weights(lags.double(), pixels, share).clamp_min(0.1)


def tapered(flat: Tensor, share: Tensor | float) -> Tensor:
    """Images real[B, ..., H, W] about 0 under the taper of each, without their frequencies below the lowest one.

    Those of the share 0 stay as they are.
    """
    shares = shares_of(share, len(flat))
    if not any(shares):
        return flat
    return torch.stack([_under(image, each) if each else image for image, each in zip(flat, shares, strict=True)])


def _under(image: Tensor, share: float) -> Tensor:
    """Images real[..., H, W] under one taper."""
    shape = (image.shape[-2], image.shape[-1])
    down, across = (torch.from_numpy(edge_taper(n, share).copy()).to(image) for n in shape)
    taper = down[:, None] * across
    spectrum = torch.fft.rfft2((image - (image * taper).mean((-2, -1), keepdim=True) / taper.mean()) * taper)
    f, g = torch.fft.fftfreq(shape[0], dtype=torch.float64), torch.fft.rfftfreq(shape[1], dtype=torch.float64)
    left = torch.hypot(f[:, None], g) >= lowest_frequency(share, shape)
    return torch.fft.irfft2(spectrum * left.to(image), s=shape)


def taper_of(images: Tensor) -> Tensor:
    """Share of the sides that the ramps of images real[B, ..., H, W] should take, float64[B]: 0 of even light.

    Power on the axes of frequencies is compared with what it is under the widest taper, each over the power beside the
    axes there: light that falls off leaks along the axes alone. The narrowest taper is taken under which it is not more
    than :data:`LEAKS` times as much. Light that falls off to dark edges (:data:`FALLING`) gets one in any case. The
    widest is taken where speckle is the smaller part of the variance (:data:`SLOW`). Frames of one object are judged
    together.
    """
    light = images.reshape(len(images), -1, *images.shape[-2:])
    light = light if light.dtype == torch.float64 else light.float()
    light = light / light.mean((-2, -1), keepdim=True).clamp_min(torch.finfo(light.dtype).tiny) - 1
    if min(light.shape[-2:]) < _LEAST:
        return torch.zeros(len(images), dtype=torch.float64)
    along, beside = _on_axes(light)
    counted = (beside > _FAINT * beside.amax(1, keepdim=True)).double()
    leaked = (along * (counted / beside.clamp_min(torch.finfo(torch.float64).tiny))[:, None]).sum(-1)
    too_narrow = leaked > LEAKS * leaked[:, -1:].clamp_min(torch.finfo(torch.float64).tiny)
    number = too_narrow.long().cumprod(1).sum(1)
    share, over = _slow_share(light)
    number = torch.where((share > FALLING[0]) & (over > FALLING[1]), number.clamp_min(1), number)
    number[share > SLOW] = len(WIDTHS) - 1
    return torch.tensor(WIDTHS, dtype=torch.float64)[number.cpu()]


@lru_cache(maxsize=64)
def _slow_waves(pixels: int, dtype: torch.dtype) -> Tensor:
    """The five slowest waves of one axis, each of the mean square 1, real[5, pixels]."""
    turns = 2 * torch.pi * torch.arange(pixels, dtype=torch.float64) / pixels
    waves = [2**0.5 * wave for n in (1, 2) for wave in ((n * turns).cos(), (n * turns).sin())]
    return torch.stack([torch.ones_like(turns), *waves]).to(dtype)


def _slow_share(light: Tensor) -> tuple[Tensor, Tensor]:
    """Share of the variance of images real[B, F, H, W] in the lowest eight frequencies; its power over the next 16."""
    down, across = (_slow_waves(n, light.dtype).to(light.device) for n in light.shape[-2:])
    power = (down @ light @ across.T).square().double()
    slow, both = power[..., :3, :3].sum((-2, -1)), power.sum((-2, -1))
    pixels, tiny = light.shape[-2] * light.shape[-1], torch.finfo(torch.float64).tiny
    whole = light.square().sum((-2, -1)).double().clamp_min(tiny)
    over = 2 * slow.mean(1) / (both - slow).mean(1).clamp_min(tiny)
    return (slow / pixels / whole).mean(1), over


@lru_cache(maxsize=64)
def _lines(pixels: int, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Cosines and minus sines of slow waves under all tapers, real[W * 2 * L, pixels]; tapers real[W, 1, 1, pixels]."""
    tapers = torch.from_numpy(np.stack([edge_taper(pixels, share) for share in WIDTHS]))[:, None, None]
    numbers, places = (torch.arange(n, dtype=torch.float64) for n in (_LINES + 1, pixels))
    turns = 2 * torch.pi * torch.outer(numbers, places) / pixels
    waves = torch.stack([turns.cos(), -turns.sin()]) * tapers
    return waves.flatten(0, 2).to(dtype), tapers.to(dtype)


def _on_axes(light: Tensor) -> tuple[Tensor, Tensor]:
    """Power on both axes of frequencies under every taper, float64[B, W, F]; its mean beside them under the widest."""
    along, beside = [], []
    for image in (light, light.mT):
        rows, columns = image.shape[-2:]
        waves, tapers = _lines(rows, image.dtype)[0].to(image.device), _lines(columns, image.dtype)[1].to(image.device)
        parts = (waves @ image).unflatten(-2, (len(WIDTHS), 2, _LINES + 1)) * tapers
        power = torch.fft.fft(torch.complex(*parts.unbind(-3))).abs().square().mean(1).double()
        places = torch.arange(_FIRST, columns // 2)
        along.append(power[:, :, 0, places])
        beside.append((power[:, -1, 2:, places] + power[:, -1, 2:, -places]).mean(1) / 2)
    return torch.cat(along, -1), torch.cat(beside, -1)
