"""Wiener's division of an autocorrelation by the memory effect: as much of it as noise allows.

Behind a slab the lag l of an image has the value P(l) = C(l) R(l) + n(l), with R that of the object, C the memory
effect, and noise n of the variance s^2 = sum_l P^2 / pixels (Bartlett, J. Royal Stat. Soc. Suppl. 8, 27, 1946). The
estimate of R with the least mean square error is (Wiener 1949)

    R'(l) = w(l) P(l),      w = C R^2 / (C^2 R^2 + s^2)

where R^2 has to be known beforehand. Two guesses serve: *dense*, R falls from its level beside the grain's peak to 0 at
1.25 sides of the object; *empirical*, what the lags themselves show above noise, which suits few bright points. A plain
division by C, cut off below a floor, multiplies the longest lags, which hold noise only, by up to ten.

The same formula tells what to expect of any weights, sum_l (w C - 1)^2 R^2 + w^2 s^2, and so whether to divide at all.
"""

from typing import Literal, get_args

import torch
from torch import Tensor

from specklegen.core.errors import reject
from specklegen.models.retrieval.autocorrelation import FLOOR, distances

Division = Literal["none", "dense", "empirical"]
DIVISIONS: tuple[Division, ...] = get_args(Division)

_REACH = 1.25
"""Where the dense guess ends, in sides of the object."""
_BESIDE = (1.0, 2.5)
"""Lags just beside the grain's peak, in grains."""
_SMOOTH = 1.5
"""Lags that the empirical guess is smoothed over."""


def lag_variance(images: Tensor) -> Tensor:
    """Variance of the autocorrelation of images real[..., H, W] over their squared mean, at every lag; float[...].

    Bartlett's sum of squared lags is the mean square of the spectrum, which is half of that of the periodogram.
    """
    flat = images / images.mean((-2, -1), keepdim=True) - 1
    pixels = flat.shape[-2] * flat.shape[-1]
    power = torch.fft.fft2(flat).abs().square() / pixels
    return power.square().mean((-2, -1)) / 2 / pixels


def weights(
    lags: Tensor, memory_effect: Tensor, variance: Tensor, *, side: float, grain: Tensor, guess: Division = "dense"
) -> Tensor:
    """What to multiply lags with, real[B, n, n], 1 at the zero lag.

    Parameters
    ----------
    lags
        Autocorrelations real[B, n, n], the zero lag first, without background and camera noise.
    memory_effect
        C_I at every lag, real[n, n] or real[B, n, n].
    variance
        Of a lag, real[B]; of :func:`lag_variance`, over the square of what the lags were divided by.
    side
        Longest side of the object, in lags.
    grain
        Lags in a grain, real[B].
    guess
        What is taken for R^2, or "none" for weights of 1.

    Raises
    ------
    RuleError
        If there is no such guess.
    """
    if guess not in DIVISIONS:
        reject("wiener guess", f"one of {', '.join(DIVISIONS)}", guess)
    c = memory_effect.to(lags).expand_as(lags)
    noise = variance.to(lags)[:, None, None]
    if guess == "none":
        return torch.ones_like(lags)
    if guess == "dense":
        power = dense_power(lags, side, grain)
        found = c * power / (c.square() * power + noise)
    else:
        found = _kept(lags, noise) / c.clamp_min(FLOOR)
    return found / found[:, :1, :1].clamp_min(torch.finfo(lags.dtype).tiny)


def dense_power(lags: Tensor, side: float, grain: Tensor) -> Tensor:
    """R^2 of a dense object: from its level beside the grain's peak down to 0, real[B, n, n]."""
    length = torch.from_numpy(distances(lags.shape[-1])).to(lags)
    near, far = (bound * grain.to(lags)[:, None, None] for bound in _BESIDE)
    beside = ((length >= near) & (length <= far.clamp_min(near + 1.5))).to(lags)
    level = (lags * beside).sum((1, 2)) / beside.sum((1, 2)).clamp_min(1)
    return (level[:, None, None] * (1 - length / (_REACH * side)).clamp_min(0).square()).square()


def _kept(lags: Tensor, noise: Tensor) -> Tensor:
    """Share of the power of every lag that is not noise."""
    power = _smoothed(lags).square()
    return (power - noise).clamp_min(0) / power.clamp_min(torch.finfo(lags.dtype).tiny)


def _smoothed(lags: Tensor) -> Tensor:
    """Gaussian mean over neighbouring lags, which wrap."""
    steps = torch.fft.fftfreq(lags.shape[-1], device=lags.device).to(lags)
    one = torch.exp(-2 * (torch.pi * _SMOOTH * steps).square())
    return torch.fft.ifft2(torch.fft.fft2(lags) * one[:, None] * one).real
