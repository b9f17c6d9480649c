"""Scores of a reconstruction against its object, and their confidence intervals.

An autocorrelation tells neither where an object lies nor which of two ways up it is, so every score comes after
:func:`align`: all cyclic shifts and the 180-degree flip are searched jointly, by FFT. On a frame with an empty margin
as wide as the object, cyclic shifts are plain shifts. Brightness has no scale of its own either: PSNR, SSIM and the
Jaccard index are of ``a * image + b``, a >= 0, fitted to the target by least squares (:func:`affine_fit`).

Images and targets are float[..., H, W] of one shape, in torch; scores are float[...]. Images of one batch are
independent. Targets have brightness 0 to 1.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from specklegen.core.arguments import real_array, real_number, real_tensor, whole_number
from specklegen.core.errors import reject

_WINDOW, _SIGMA = 11, 1.5  # of Wang et al. 2004
_K1, _K2 = 0.01, 0.03


class Alignment(NamedTuple):
    """Motion that takes an image onto a target: first the flip (bool[...]), then the shift (int64[..., 2])."""

    flipped: Tensor
    shift: Tensor


def alignment(image: Tensor, target: Tensor) -> Alignment:
    """Find the flip and the cyclic shift with the largest correlation, which is also the largest Pearson's."""
    _require_alike(image, target)
    rows, columns = image.shape[-2:]
    with torch.no_grad():
        # Without their means the peaks stand out of rounding; constants shift no peak.
        a, b = (torch.fft.rfft2(x - x.mean((-2, -1), keepdim=True)) for x in (image, target))
        # A flip about pixel (0, 0) conjugates the transform.
        lags = torch.fft.irfft2(torch.stack([a.conj() * b, a * b], dim=-3), s=(rows, columns))
        best = lags.flatten(-3).argmax(-1)
    flipped, place = best >= rows * columns, best % (rows * columns)
    shift = torch.stack([place // columns, place % columns], dim=-1)
    # torch.flip turns about the middle of the frame, one pixel past the turn about pixel (0, 0).
    return Alignment(flipped, (shift + flipped[..., None]) % torch.tensor([rows, columns], device=shift.device))


def move(image: Tensor, motion: Alignment) -> Tensor:
    """Flip and shift each image [..., H, W] cyclically; exact, and differentiable in the image."""
    rows, columns = image.shape[-2:]
    turned = torch.where(motion.flipped[..., None, None], image.flip((-2, -1)), image)
    down, right = motion.shift[..., 0, None], motion.shift[..., 1, None]
    y = (torch.arange(rows, device=image.device) - down) % rows
    x = (torch.arange(columns, device=image.device) - right) % columns
    places = (y[..., :, None] * columns + x[..., None, :]).flatten(-2)
    return turned.flatten(-2).gather(-1, places).reshape(image.shape)


def align(image: Tensor, target: Tensor) -> Tensor:
    """Move each image onto its target by the best of all cyclic shifts, flipped by 180 degrees or not.

    Parameters
    ----------
    image
        real[..., H, W], to be moved.
    target
        real[..., H, W], which stays.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import align
    >>> image = torch.zeros(8, 8)
    >>> image[2, 3] = 1.0
    >>> torch.equal(align(image.roll((3, 1), (0, 1)), image), image)
    True
    """
    return move(image, alignment(image, target))


def pearson(image: Tensor, target: Tensor) -> Tensor:
    """Pearson correlation, float[...]; 0 where one of the two is constant, since it then tells nothing."""
    _require_alike(image, target)
    a, b = (x.flatten(-2) - x.mean((-2, -1))[..., None] for x in (image, target))
    power = (a.square().sum(-1) * b.square().sum(-1)).clamp_min(torch.finfo(a.dtype).tiny)
    return (a * b).sum(-1) / power.sqrt()


def affine_fit(image: Tensor, target: Tensor) -> Tensor:
    """Return ``a * image + b``, a >= 0, closest to the target in the mean square: float[..., H, W].

    A negative slope would count an inverted image as a reconstruction; there the best is the target's mean.
    """
    _require_alike(image, target)
    centred = image - image.mean((-2, -1), keepdim=True)
    mean = target.mean((-2, -1), keepdim=True)
    power = centred.square().sum((-2, -1), keepdim=True).clamp_min(torch.finfo(image.dtype).tiny)
    slope = (centred * (target - mean)).sum((-2, -1), keepdim=True) / power
    return slope.clamp_min(0) * centred + mean


def psnr(image: Tensor, target: Tensor) -> Tensor:
    """Peak signal-to-noise ratio after the affine fit, decibels float[...]; inf for a perfect image."""
    error = (affine_fit(image, target) - target).square().mean((-2, -1))
    return 10 * torch.log10(1 / error)


def ssim(image: Tensor, target: Tensor) -> Tensor:
    """Structural similarity after the affine fit, float[...]: see :func:`structural_similarity`."""
    return structural_similarity(affine_fit(image, target), target)


def structural_similarity(image: Tensor, target: Tensor) -> Tensor:
    """Mean structural similarity of Wang et al. (2004), as it stands: Gaussian window of 11 pixels, sigma 1.5.

    Only windows wholly inside the frame count, as in scikit-image, whose function has no gradient: this one is a loss
    too, on any device.
    """
    _require_alike(image, target)
    if min(image.shape[-2:]) < _WINDOW:
        reject("structural_similarity image", f"at least {_WINDOW} pixels a side", tuple(image.shape))
    steps = torch.arange(_WINDOW, dtype=image.dtype, device=image.device) - _WINDOW // 2
    weights = torch.exp(-0.5 * (steps / _SIGMA).square())
    weights = weights / weights.sum()

    def smooth(x: Tensor) -> Tensor:
        flat = x.reshape(-1, 1, *x.shape[-2:])
        return functional.conv2d(functional.conv2d(flat, weights.view(1, 1, -1, 1)), weights.view(1, 1, 1, -1))

    a, b = smooth(image), smooth(target)
    spread_a, spread_b = smooth(image.square()) - a.square(), smooth(target.square()) - b.square()
    shared = smooth(image * target) - a * b
    top = (2 * a * b + _K1**2) * (2 * shared + _K2**2)
    bottom = (a.square() + b.square() + _K1**2) * (spread_a + spread_b + _K2**2)
    return (top / bottom).mean((-3, -2, -1)).reshape(image.shape[:-2])


def jaccard(image: Tensor, target: Tensor) -> Tensor:
    """Jaccard index float[...] of what is brighter than one half, after the affine fit; 1 if nothing is."""
    a, b = affine_fit(image, target) > 0.5, target > 0.5
    union = (a | b).sum((-2, -1))
    return torch.where(union > 0, (a & b).sum((-2, -1)) / union.clamp_min(1), 1.0)


SCORES = {"pearson": pearson, "psnr": psnr, "ssim": ssim, "jaccard": jaccard}
"""Name of a score to its function of (aligned image, target)."""


def scores(image: Tensor, target: Tensor) -> dict[str, Tensor]:
    """Align images to targets, then every score of `SCORES`, float[...] each.

    Parameters
    ----------
    image
        real[..., H, W], up to a shift and a turn by 180 degrees, in any unit and with any offset.
    target
        real[..., H, W], what it should be.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import scores
    >>> image = torch.rand(16, 16, generator=torch.Generator().manual_seed(0))
    >>> round(float(scores(image.roll(2, 0), image)["pearson"]), 3)
    1.0
    """
    aligned = align(image, target)
    return {name: score(aligned, target) for name, score in SCORES.items()}


class Interval(NamedTuple):
    """A mean and the ends of its confidence interval."""

    mean: float
    low: float
    high: float


def bootstrap(
    values: np.ndarray, media: np.ndarray, characters: np.ndarray | None = None, *, confidence: float = 0.95,
    resamples: int = 4000, seed: int = 0,
) -> Interval:
    """Mean of scores, with a percentile interval from resampling whole media.

    Images behind one medium share its speckle, so they are no independent evidence: a resample draws media with
    replacement and takes all their images. For a difference of two methods, pass the difference of their scores.
    Images of one character, too, are alike: where several are given they are resampled as well, and an image counts as
    often as its medium and its character have been drawn together (Owen, Annals of Applied Statistics 1, 386 (2007)).
    One without a character is like no other, and counts as often as its medium.

    Parameters
    ----------
    values : float[n]
        Scores.
    media : int[n]
        Medium of each.
    characters : int[n], optional
        Character of each; -1 where there is none.
    confidence
        Coverage of the interval.
    resamples
        Number of resamples.
    seed
        Of the resampling.

    Raises
    ------
    RuleError
        If there are fewer than two media, a value is not finite, or the confidence is not between 0 and 1.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.models import bootstrap
    >>> found = bootstrap(np.array([0.8, 0.9, 0.7, 0.6]), media=np.array([0, 0, 1, 1]))
    >>> round(found.mean, 3)
    0.75
    """
    values, media = real_array("bootstrap.values", values), real_array("bootstrap.media", media)
    if values.shape != media.shape or values.ndim != 1:
        reject("bootstrap.media", f"one for each of the {values.shape} values", media.shape)
    if not np.isfinite(values).all():
        reject("bootstrap.values", "finite", values)
    confidence = real_number("bootstrap.confidence", confidence)
    resamples = whole_number("bootstrap.resamples", resamples, 1, 10**7)
    if not 0 < confidence < 1:
        reject("bootstrap.confidence", "between 0 and 1", confidence)
    names, which = np.unique(media, return_inverse=True)
    if len(names) < 2:
        reject("bootstrap.media", "at least two different media", names, "Intervals are computed over media: use more.")
    rng = np.random.default_rng(np.random.SeedSequence(whole_number("bootstrap.seed", seed)))
    drawn = rng.multinomial(len(names), np.full(len(names), 1 / len(names)), size=resamples)
    shown = np.full(len(media), -1) if characters is None else real_array("bootstrap.characters", characters)
    if shown.shape != media.shape:
        reject("bootstrap.characters", f"one for each of the {values.shape} values", shown.shape)
    kinds, kind = np.unique(shown[shown >= 0], return_inverse=True)
    if len(kinds) < 2:
        means = (drawn @ np.bincount(which, values)) / (drawn @ np.bincount(which))
    else:
        each = rng.multinomial(len(kinds), np.full(len(kinds), 1 / len(kinds)), size=resamples)
        weights = drawn[:, which]
        weights[:, shown >= 0] *= each[:, kind]
        weights = weights[weights.any(1)]  # few media of few characters may miss one another
        means = (weights @ values) / weights.sum(1)
    low, high = np.quantile(means, [(1 - confidence) / 2, (1 + confidence) / 2])
    return Interval(float(values.mean()), float(low), float(high))


def _require_alike(image: Tensor, target: Tensor) -> None:
    real_tensor("image", image)
    real_tensor("target", target)
    if image.shape != target.shape or image.ndim < 2:
        reject("image", f"of the target's shape [..., H, W], {tuple(target.shape)}", tuple(image.shape))
