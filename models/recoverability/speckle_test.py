"""Test that images are speckle of a setup at all: what a periodogram, and with it the likelihood, never looks at.

The intensity behind an object that shines incoherently is a sum of squares of Gaussian fields:
``I = sum_i w_i |z_i|^2`` with ``w_i > 0`` of sum 1. Source: Goodman, *Speckle Phenomena in Optics* (2007): sections 3.3
and 4.7. Four numbers are looked at:

- *contrast*: c^2 = sum_i w_i^2, which a reconstruction predicts from its own spectrum; the likelihood fits brightness.
- *law of intensities*: the skewness is ``2 sum w^3 / c^3``, and by Cauchy and Schwarz ``sum w^3 sum w >= (sum w^2)^2``;
  so it is **at least 2 c** whatever the object, the slab, the window, and whatever weights >= 0 the image is averaged
  with. Of a Gaussian texture it is 0, of camera frames anything.
- *bispectrum*: that of speckle of one point has no phase and is positive, that of the image is it times
  O(f) O(g) O*(f + g) of the object's transform O. So what is left of an image when the object is taken out of it is
  skewed to the bright side; if the object is taken the wrong way round it is, as measured, not skewed to the dark.
- *deviance*: of the most probable image that was found.

Each is stated in spreads of its own: the scatter of a finite image, and the error of a reconstruction that is not
right. The sum of their squares, ``score``, is compared with a bound that one of a hundred images of true speckle
exceeds; see docs/notes/likelihood.md for how well it tells camera frames, textures and noise from speckle.
"""

from typing import NamedTuple, Self

import numpy as np
import torch
from torch import Tensor

from specklegen.core.display.repr import short
from specklegen.models.likelihood.likelihood import SpeckleLikelihood, expected_deviance

REFUSED = 20.0
"""Score from which on images are refused."""
_BRIGHTNESS = 0.25  # error of the logarithm of the contrast squared that a reconstruction predicts
_SKEWNESS = 0.1  # error of the skewness over the smallest possible one, besides that of a finite image
_TURNED = 0.08  # error of the skewness without the object
_DEVIANCE = 0.06  # excess of the deviance that a reconstruction has by itself
_SMOOTHED = 0.5  # grains, sigma of the mean that camera noise is lowered by before third moments are taken
_BAND = 0.8  # frequencies that the object is taken out of, over the highest that the window passes
_REGULAR = 0.1  # of the mean power of the object there: what keeps noise from being amplified
_TELLING = 2.0  # spreads from which on a piece of evidence is put in words


class SpeckleTest(NamedTuple):
    """Statistics of one object's images.

    Attributes
    ----------
    contrast, predicted, spread : float
        Measured contrast without camera noise; what the reconstruction predicts; and the standard error of that.
    skewness, least : float
        Of the intensities, noise lowered; and the smallest that speckle of this contrast may have.
    turned : float
        Skewness of the images without the object, the object as it is or turned by 180 degrees, whichever is lower.
    excess : float
        Deviance above its expectation.
    evidence : tuple of float
        Of contrast, law of intensities, bispectrum and deviance, how many spreads speckle is away.

    Examples
    --------
    >>> from specklegen.models.recoverability.speckle_test import SpeckleTest
    >>> found = SpeckleTest(0.41, 0.23, 0.03, 0.1, 0.82, 0.0, 0.01, (6.0, 4.0, 0.0, 0.3))
    >>> found.passes
    False
    >>> found.words.split("; ")[0]
    'contrast 0.41 where the reconstruction predicts 0.23 +- 0.03'
    """

    contrast: float
    predicted: float
    spread: float
    skewness: float
    least: float
    turned: float
    excess: float
    evidence: tuple[float, float, float, float]

    __repr__ = short

    @property
    def score(self) -> float:
        """Sum of the squares of the evidence."""
        return float(np.square(self.evidence).sum())

    @property
    def passes(self) -> bool:
        """True if the images may be speckle of the setup."""
        return self.score < REFUSED

    @property
    def words(self) -> str:
        """Evidence against speckle, as text; empty where nothing does."""
        sentences = (
            f"contrast {self.contrast:.2g}, but the reconstruction predicts {self.predicted:.2g} +- {self.spread:.1g}",
            f"skewness {self.skewness:.2g}, but speckle has at least {self.least:.2g}",
            f"skewness {self.turned:.2g} without the object, but that of speckle is above 0",
            f"deviance {self.excess:.2g} above that of the true object",
        )
        bound = min(_TELLING, max(self.evidence))
        text = "; ".join(line for line, far in zip(sentences, self.evidence, strict=True) if far >= bound and far > 0)
        return f"{text}: this is no speckle of this setup" if text and not self.passes else text

    @classmethod
    def of(cls, numbers: "Measured", contrast: tuple[float, float]) -> Self:
        """Judge what was measured, the contrast of one point's speckle being within two ends."""
        ratio = np.log(np.maximum(numbers.variance, _TINY) / np.maximum(numbers.predicted, _TINY))
        low, high = 2 * np.log(contrast)
        nearest = float(np.clip(ratio, low, high))
        brightness = float(np.hypot(np.sqrt(2 / numbers.cells), _BRIGHTNESS))
        least = 2 * np.sqrt(numbers.smoothed)
        # Of n Gaussian numbers the skewness has the variance 6 / n; cells of a third moment are smaller: a half of it.
        skewness = float(np.hypot(_SKEWNESS, 0.5 * np.sqrt(6 / numbers.cells) / least))
        predicted = float(np.sqrt(numbers.predicted * np.exp(nearest)))
        return cls(
            float(np.sqrt(numbers.variance)), predicted, predicted * brightness / 2, numbers.skewness, float(least),
            numbers.turned, numbers.excess,
            (
                float(abs(ratio - nearest) / brightness), max(0.0, 1 - numbers.skewness / float(least)) / skewness,
                max(0.0, -numbers.turned) / _TURNED,
                max(0.0, numbers.excess) / float(np.hypot(_DEVIANCE, numbers.scatter)),
            ),
        )  # fmt: skip


_TINY = 1e-12


class Measured(NamedTuple):
    """Numbers of one object's images that are judged.

    Attributes
    ----------
    variance, predicted : float
        Of the images over their mean in the window's band, without noise; and that of the reconstruction's speckle.
    cells : float
        Independent cells of the images.
    smoothed, skewness : float
        Variance and skewness of the images after a mean over half a grain.
    turned, excess : float
        As in :class:`SpeckleTest`.
    scatter : float
        Of the deviance of the true object.
    """

    variance: float
    predicted: float
    cells: float
    smoothed: float
    skewness: float
    turned: float
    excess: float
    scatter: float


def speckle_test(
    images: Tensor, objects: Tensor, deviance: Tensor, likelihood: SpeckleLikelihood, between: Tensor,
    contrast: tuple[float, float] = (1.0, 1.0),
) -> tuple[SpeckleTest, ...]:  # fmt: skip
    """Test whether camera images are speckle of a setup.

    Parameters
    ----------
    images
        real[B, F, H, W], F frames of B objects.
    objects
        Their reconstructions, real[B, n, n].
    deviance
        Of the most probable images near those, real[B].
    likelihood
        Of the images' periodograms, for objects of that shape.
    between
        C_I between the pixels of an object, real[B, 2 n - 1, 2 n - 1].
    contrast
        Smallest and largest contrast of the speckle of one point: polarisation, bandwidth, light not taken off.
    """
    alone = likelihood.object_spectrum(objects[:, None], between[:, None])[:, 0]
    used, pixels = likelihood.used, likelihood.tile[0] * likelihood.tile[1]
    both = (likelihood.power - likelihood.noise[:, None, None], alone)
    variance, predicted = (2 * torch.where(used, each, 0.0).sum((-2, -1)).double() / pixels for each in both)
    cells = (variance.square() / likelihood.lag_variance().double()).clamp_min(1.0)
    count = likelihood.looks * likelihood.frequencies
    scatter = likelihood.spread / count
    return tuple(
        SpeckleTest.of(
            Measured(
                float(variance[n].clamp_min(0)), float(predicted[n]), float(cells[n]),
                *smoothed_moments(images[n], float(likelihood.grain[n]), float(likelihood.noise[n])),
                min(without(images[n], objects[n], float(likelihood.step[n]), float(likelihood.grain[n]))),
                float(deviance[n]) - expected_deviance(likelihood.looks), float(scatter[n]),
            ),
            contrast,
        )
        for n in range(len(images))
    )  # fmt: skip


def smoothed_moments(frames: Tensor, grain: float, noise: float) -> tuple[float, float]:
    """Variance (at least 1e-12) without camera noise, and skewness, of frames real[F, H, W] over their mean.

    A mean with weights at least 0 leaves speckle above its bound, and of white noise ``1 / (4 pi sigma^2)``.
    """
    sigma = _SMOOTHED * grain
    light = frames.double() / frames.double().mean((-2, -1), keepdim=True)
    rows = torch.fft.fftfreq(light.shape[-2], dtype=torch.float64)
    columns = torch.fft.rfftfreq(light.shape[-1], dtype=torch.float64)
    passed = torch.exp(-2 * (torch.pi * sigma) ** 2 * (rows[:, None].square() + columns.square()))
    slow = torch.fft.irfft2(torch.fft.rfft2(light) * passed, s=light.shape[-2:]) - 1
    variance = max(float(slow.square().mean()) - noise * float(_mean_square(passed, light.shape[-1])), _TINY)
    return variance, float(slow.pow(3).mean()) / variance**1.5


def _mean_square(passed: Tensor, columns: int) -> Tensor:
    """Mean of the square of a filter over all frequencies, given for those of ``rfft2``."""
    twice = torch.full(passed.shape[-1:], 2.0, dtype=passed.dtype)
    twice[0] = 1.0
    if columns % 2 == 0:
        twice[-1] = 1.0
    return (passed.square() * twice).sum() / (passed.shape[-2] * columns)


def without(frames: Tensor, brightness: Tensor, step: float, grain: float) -> tuple[float, float]:
    """Skewness of frames real[F, H, W] with an object real[n, n] taken out, as it is and turned by 180 degrees."""
    light = frames.double() / frames.double().mean((-2, -1), keepdim=True) - 1
    rows = torch.fft.fftfreq(light.shape[-2], dtype=torch.float64)
    columns = torch.fft.rfftfreq(light.shape[-1], dtype=torch.float64)
    shares = brightness.double() / brightness.double().sum().clamp_min(_TINY)
    down, across = (
        torch.exp(-2j * torch.pi * step * f[:, None] * torch.arange(n))
        for f, n in zip((rows, columns), shares.shape, strict=True)
    )
    seen = down @ shares.to(down.dtype) @ across.mT
    inside = torch.maximum(rows.abs()[:, None], columns) < _BAND / grain
    power = seen.abs().square()
    weights = torch.where(inside, 1 / (power + _REGULAR * power[inside].mean()).clamp_min(_TINY), 0.0)
    spectrum = torch.fft.rfft2(light) * weights
    left = (torch.fft.irfft2(spectrum * each, s=light.shape[-2:]) for each in (seen.conj(), seen))
    as_it_is, turned = (float(x.pow(3).mean() / x.square().mean().clamp_min(_TINY) ** 1.5) for x in left)
    return as_it_is, turned
