"""Which way up an object is: what a periodogram forgets, and the third order of a camera image remembers.

An object and the same turned by 180 degrees have one autocorrelation, so that neither lags nor the likelihood of
periodograms can tell them apart. Speckle is skewed, though. Within the memory effect a camera sees the object turned,
x(v) = sum_j o(j) s(v + j), and the bispectrum of the image is that of s, the speckle of one point; it has no phase;
times O*(f) O*(g) O(f + g) of the object's transform O: of the turned object it is the conjugate. To lowest order in
the skewness (Edgeworth's series; McCullagh, *Tensor Methods in Statistics*, 1987, chapter 5) the image x is the more
probable the larger

    T = mean y^3,     Y(f) = X(f) O(f) h(f) / S(f),     S = a |O|^2 H + noise

with H the window's transfer function, h the factor of the bispectrum of one point's speckle, a product of three,
which for a Gaussian window is H^(2/3) exactly; to S a share of its mean is added, since where a reconstruction has
hardly any light its phases are wrong. T is computed with the object as it is and turned; the difference, over the
spread that it would have were the image Gaussian, is what tells the turn. The larger of the two skewnesses of Y tells
whether it is the object at all: without the right one Y is no speckle of one point.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import choice, flag, host_tensor, instance, real_array
from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.core.shielded import shielded
from specklegen.models.likelihood.likelihood import BAND, Optics, each_of
from specklegen.models.retrieval.edges import edge_taper
from specklegen.scene.window import PROFILES, Window

SLOPE = 1.0
"""Logarithm of the odds that a spread of the difference is worth; see docs/notes/likelihood.md."""
CLAIMED = 0.9
"""Probability from which on a turn is told."""
_REGULAR = 0.3
"""Of the mean of S, added to it: chosen on images of the solver (docs/notes/likelihood.md)."""
_TAPERED = 0.5
"""Of a camera's side, over which the window falls to zero that T is taken under: edges cut objects off."""
_TINY = 1e-30
_ALIKE = 1e-6  # of their variances, that of the difference of two third moments at least
_FEWEST = 8  # frequencies inside the window's band
_FLAT = 1e-20  # mean square of an image that is even but for rounding
_LEAST = 1e-4  # of H: below, frequencies are left out


class Turn(NamedTuple):
    """Which way up B objects are.

    Attributes
    ----------
    turned : bool[B]
        Whether the object turned by 180 degrees explains the image better than the object as it was given.
    probability : float64[B]
        That this is right, 0.5 to 1.
    spreads : float64[B]
        Difference of the third moments over its spread, above 0 for the object as it was given.
    """

    turned: Tensor
    probability: Tensor
    spreads: Tensor

    __repr__ = short


@shielded()
def turn_of(images: Tensor, objects: Tensor, optics: Optics, noise: Tensor | float = 0.0) -> Turn:
    """Tell which way up objects are from the third order of their camera images.

    Parameters
    ----------
    images
        real[B, F, H, W], F frames of each object through other states of the medium.
    objects
        Brightness, real[B, h, w]; their place does not matter. The camera is taken to show them as the samples of a
        recipe do.
    optics
        Steps, grains, window.
    noise
        Variance that camera noise adds to a pixel, over the squared mean; one number or real[B].

    Raises
    ------
    RuleError
        If there is not one object for each of the images, one of them is dark or even, or the camera holds no grains.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import Optics, turn_of
    >>> images, objects = torch.rand(2, 1, 64, 64), torch.rand(2, 8, 8)
    >>> turn_of(images, objects, Optics(step=2.0, grain=3.0)).turned.shape
    torch.Size([2])
    """
    moments = third_moments(images, objects, optics, noise)[:, 0]
    return Turn(moments < 0, (SLOPE * moments.abs()).sigmoid(), moments)


@shielded()
def third_moments(images: Tensor, objects: Tensor, optics: Optics, noise: Tensor | float = 0.0) -> Tensor:
    """Return what :func:`turn_of`, which see, tells the turn by, and the larger skewness of Y, float64[B, 2]."""
    images, objects = host_tensor("turn_of images", images), host_tensor("turn_of objects", objects)
    instance("turn_of optics", optics, Optics)
    choice("Optics.profile", optics.profile, PROFILES)
    flag("Optics.pixel_integration", optics.pixel_integration)
    if images.ndim != 4 or objects.ndim != 3 or len(images) != len(objects) or not images.numel():
        reject("turn_of images, objects", "[B, F, H, W] and [B, h, w]", (tuple(images.shape), tuple(objects.shape)))
    if not (images.isfinite().all() and objects.isfinite().all()):
        reject("turn_of images, objects", "finite", "other values")
    if not (images.double().mean((-2, -1)) > 0).all() or not (objects.double().sum((-2, -1)) > 0).all():
        reject("turn_of images, objects", "above 0 in the mean", "a dark image")
    if (objects < 0).any():
        reject("turn_of objects", "at least 0", float(objects.min()))
    steps, grains = (
        each_of(f"Optics.{name}", getattr(optics, name), len(images), torch.float64).tolist()
        for name in ("step", "grain")
    )
    given = host_tensor("turn_of noise", noise).detach().numpy() if isinstance(noise, Tensor) else noise
    noises = real_array("turn_of noise", given)
    if noises.shape not in ((), (len(images),)) or not (np.isfinite(noises) & (noises >= 0)).all():
        reject("turn_of noise", f"finite and at least 0, one number or one for each of {len(images)} objects", noise)
    noises = np.broadcast_to(noises, len(images)).astype(np.float64).tolist()
    return torch.tensor([
        _moments(images[n].double(), objects[n].double(), steps[n], grains[n], noises[n], optics)
        for n in range(len(images))
    ], dtype=torch.float64)  # fmt: skip


def _moments(
    frames: Tensor, brightness: Tensor, step: float, grain: float, noise: float, optics: Optics
) -> tuple[float, float]:
    """Difference of the third moments over its spread, under a window, and the larger skewness, without."""
    light = frames / frames.mean((-2, -1), keepdim=True) - 1
    sides = light.shape[-2:]
    rows = torch.fft.fftfreq(sides[0], dtype=torch.float64)
    columns = torch.fft.rfftfreq(sides[1], dtype=torch.float64)
    shares = (brightness / brightness.sum().clamp_min(_TINY)).to(torch.complex128)
    down, across = (
        torch.exp(-2j * torch.pi * step * f[:, None] * torch.arange(n))
        for f, n in zip((rows, columns), shares.shape, strict=True)
    )
    seen = down @ shares @ across.mT
    window = Window(optics.profile, 1.0)
    passed = torch.from_numpy(window.overlap((columns * grain).numpy(), (rows[:, None] * grain).numpy()))
    if optics.pixel_integration:
        passed = passed * torch.from_numpy(np.sinc(rows[:, None].numpy()) * np.sinc(columns.numpy())) ** 2
    inside = passed > _LEAST
    if window.sharp:
        inside &= torch.maximum(rows.abs()[:, None], columns) < BAND / grain
    if int(inside.sum()) < _FEWEST or not float(light.square().mean()) > _FLAT:
        reject("turn_of images", "images with contrast, several speckle grains wide", tuple(frames.shape))
    alone = seen.abs().square() * passed
    edge = [torch.from_numpy(np.sqrt(edge_taper(n, _TAPERED))) for n in sides]
    pairs, excesses = [], []
    for taper in (edge[0][:, None] * edge[1], torch.ones(1, 1, dtype=torch.float64)):
        own = light * taper
        spectrum = torch.fft.rfft2(own - own.mean((-2, -1), keepdim=True))
        power = spectrum.abs().square().mean(0) / (sides[0] * sides[1]) / taper.square().mean()
        lit = (power[inside].sum() - noise * inside.sum()).clamp_min(0.01 * power[inside].sum())
        expected = lit / alone[inside].sum().clamp_min(_TINY) * alone + noise
        expected = expected + _REGULAR * expected[inside].mean()
        weight = torch.where(inside, passed.clamp_min(0) ** (2 / 3) / expected, 0.0)
        reach = torch.fft.irfft2(weight * seen * expected.clamp_min(0).sqrt(), s=sides).square()
        here = torch.fft.irfft2(torch.fft.rfft2(taper.square().expand(sides)) * torch.fft.rfft2(reach), s=sides)
        excesses.append(here.pow(3).mean() / here.mean().clamp_min(_TINY) ** 3)
        pairs.append([torch.fft.irfft2(spectrum * weight * each, s=sides) for each in (seen, seen.conj())])
    (one, other), whole = pairs
    uneven = excesses[0]
    # The covariance of y^3 and z^3 of Gaussian y, z at a lag is 6 R^3 + 9 R s^4; sums over R vanish, the mean being 0.
    # Under a taper the variance v of y differs from place to place, and R with it: the mean of R^3 exceeds the cube of
    # the mean R as that of v^3 does.
    chosen = ((one, one), (other, other), (one, other))
    own, turned, both = (6 * _correlation(a, b).pow(3).sum() for a, b in chosen)
    # Of an object that is its own turn both are one, but for rounding: then nothing is told.
    variance = torch.maximum(own + turned - 2 * both, _ALIKE * (own + turned)).clamp_min(_TINY)
    spread = (variance * uneven / (len(light) * sides[0] * sides[1])).sqrt()
    skewness = max(float(x.pow(3).mean() / x.square().mean().clamp_min(_TINY) ** 1.5) for x in whole)
    return float((one.pow(3).mean() - other.pow(3).mean()) / spread), skewness


def _correlation(one: Tensor, other: Tensor) -> Tensor:
    """Mean product at every cyclic lag, over frames, real[H, W]."""
    spectra = (torch.fft.rfft2(one) * torch.fft.rfft2(other).conj()).mean(0)
    return torch.fft.irfft2(spectra, s=one.shape[-2:]) / (one.shape[-2] * one.shape[-1])
