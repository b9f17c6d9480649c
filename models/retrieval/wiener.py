"""Wiener's division of an autocorrelation by the memory effect: as much of it as noise allows.

Behind a slab the lag l of an image has the value ``P(l) = C(l) R(l) + n(l)``; R is that of the object, C the memory
effect, and noise n of the variance ``s^2 = sum_l P^2 / pixels`` (Bartlett, J. Royal Stat. Soc. Suppl. 8, 27 (1946)).
The estimate of R with the least mean square error is (Wiener 1949)

    R'(l) = w(l) P(l),      w = C R^2 / (C^2 R^2 + s^2)

where R^2 has to be known beforehand. Two guesses serve: *dense*, R falls from its level beside the grain's peak to 0 at
1.25 sides of the object; *empirical*, what the lags themselves show above noise, which suits few bright points. A plain
division by C, cut off below a floor, multiplies the longest lags, which hold noise only, by up to ten.

The same formula tells what to expect of any weights, ``sum_l (w C - 1)^2 R^2 + w^2 s^2``, and so whether to divide at
all (:func:`expected_residual`).
"""

from typing import Literal, get_args

import torch
from torch import Tensor

from specklegen.core.errors import reject
from specklegen.models.retrieval.autocorrelation import FLOOR, distances
from specklegen.models.retrieval.edges import independent, shares_of, tapered

Division = Literal["none", "floor", "dense", "empirical"]
DIVISIONS: tuple[Division, ...] = get_args(Division)

_REACH = 1.25
"""Where the dense guess ends, in sides of the object."""
_BESIDE = (1.0, 2.5)
"""Lags just beside the grain's peak, in grains."""
_SMOOTH = 0.5
"""Grains that the empirical guess is smoothed over: a point's peak is as wide as a grain."""


def lag_variance(images: Tensor, taper: Tensor | float = 0.0) -> Tensor:
    """Variance of the autocorrelation of images real[B, ..., H, W] over their squared mean, at every lag; float[...].

    Bartlett's sum of squared lags is the mean square of the spectrum, which is half of that of the periodogram. Under a
    taper, of one share or one for each of B, it is of fewer independent frequencies.
    """
    flat = images / images.mean((-2, -1), keepdim=True) - 1
    shape = (flat.shape[-2], flat.shape[-1])
    power = torch.fft.fft2(tapered(flat, taper)).abs().square() / (shape[0] * shape[1])
    counted = torch.tensor([independent(shape, share)[0] for share in shares_of(taper, len(flat))]).to(power)
    variance = power.square().mean((-2, -1)) / 2 / (shape[0] * shape[1])
    return variance / counted.reshape(-1, *[1] * (variance.ndim - 1))


def weights(
    lags: Tensor, memory_effect: Tensor, variance: Tensor, *, side: float, grain: Tensor, guess: Division = "dense"
) -> Tensor:
    """Return the factor of lags, real[B, n, n], 1 at the zero lag.

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
        What is taken for R^2; "none" for weights of 1, "floor" for 1 / C down to C = 0.1.
    """
    if guess not in DIVISIONS:
        reject("wiener guess", f"one of {', '.join(DIVISIONS)}", guess)
    c = memory_effect.to(lags).expand_as(lags)
    noise = variance.to(lags)[:, None, None]
    if guess == "none":
        return torch.ones_like(lags)
    if guess == "floor":
        return 1 / c.clamp_min(FLOOR)
    if guess == "dense":
        power = dense_power(lags, c, side, grain)
        factors = c * power / (c.square() * power + noise)
    else:
        factors = _kept(lags, noise, grain) / c.clamp_min(FLOOR)
    return factors / factors[:, :1, :1].clamp_min(torch.finfo(lags.dtype).tiny)


SPARSE = 2.9
"""Power of the lags over that of the dense guess, above which objects are bright points (docs/notes/imaging.md)."""
FEW = 0.17
"""Share of the lags that stand out of the noise, up to which points are few."""
BEND = 1.5
"""Power of the bend over that of the noise, above which division helps (docs/notes/imaging.md)."""
_VISIBLE = 0.3  # C_I below which a lag says little of R


def choice(lags: Tensor, memory_effect: Tensor, variance: Tensor, *, side: float, grain: Tensor) -> list[Division]:
    """Return whether to divide, and by which guess, for each image; arguments as for :func:`weights`.

    The expected residual of weights of 1 has two parts: the bend, ``sum_l (1 - C)^2 R^2``, which division removes, and
    the noise, ``sum_l s^2``, which division adds to. Both are summed over lags as far as they show an object, which is
    where a division acts. An object is sparse if those lags hold far more power than a dense object's would that is as
    bright beside the grain's peak. Of few points, whose pairs fill few of the lags, the empirical guess keeps the
    pairs; of many it would lose the weaker ones, and lags are divided down to C = 0.1.
    """
    c, noise = memory_effect.to(lags).expand_as(lags), variance.to(lags)[:, None, None]
    length = torch.from_numpy(distances(lags.shape[-1])).to(lags)
    counted = ((length > _BESIDE[0] * grain.to(lags)[:, None, None]) & (length < _REACH * side)).to(lags)
    shown = _kept(lags, noise, grain) * counted
    seen = shown * lags.square()
    dense = c.square() * dense_power(lags, c, side, grain) * counted
    sparse = seen.sum((1, 2)) / dense.sum((1, 2)).clamp_min(torch.finfo(lags.dtype).tiny)
    bend = ((1 / c.clamp_min(_VISIBLE) - 1).square() * seen).sum((1, 2))
    divide = bend > BEND * (noise * shown).sum((1, 2))
    filled = shown.sum((1, 2)) / counted.sum((1, 2))
    kinds: list[Division] = [
        "dense" if power <= SPARSE else "empirical" if share <= FEW else "floor"
        for power, share in zip(sparse.tolist(), filled.tolist(), strict=True)
    ]
    return [kind if yes else "none" for kind, yes in zip(kinds, divide.tolist(), strict=True)]


def dense_power(lags: Tensor, memory_effect: Tensor, side: float, grain: Tensor) -> Tensor:
    """R^2 of a dense object: from its level beside the grain's peak down to 0, real[B, n, n].

    The level is that of P over C there, by least squares.
    """
    length = torch.from_numpy(distances(lags.shape[-1])).to(lags)
    near, far = (bound * grain.to(lags)[:, None, None] for bound in _BESIDE)
    beside = ((length >= near) & (length <= far.clamp_min(near + 1.5))).to(lags)
    c = memory_effect.to(lags)
    level = (lags * c * beside).sum((1, 2)) / (c.square() * beside).sum((1, 2)).clamp_min(1e-6)
    return (level[:, None, None] * (1 - length / (_REACH * side)).clamp_min(0).square()).square()


def _kept(lags: Tensor, noise: Tensor, grain: Tensor) -> Tensor:
    """Share of the power of every lag that is not noise."""
    power = _smoothed(lags, grain).square()
    return (power - noise).clamp_min(0) / power.clamp_min(torch.finfo(lags.dtype).tiny)


def _smoothed(lags: Tensor, grain: Tensor) -> Tensor:
    """Gaussian mean over neighbouring lags, which wrap."""
    steps = torch.fft.fftfreq(lags.shape[-1], device=lags.device).to(lags)
    one = torch.exp(-2 * (torch.pi * _SMOOTH * grain.to(lags)[:, None] * steps).square())
    return torch.fft.ifft2(torch.fft.fft2(lags) * one[:, :, None] * one[:, None]).real
