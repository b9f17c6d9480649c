"""How large a hidden object is: the distance up to which the autocovariance of photographs says more than it errs.

Of frames of N pixels, C(l) the mean over the pairs of pixels l apart, n(l) of them, what is no signal scatters by

    var C(l) = sum_k C(k)^2 / n(l)                    (Bartlett, *J. R. Stat. Soc. Suppl.* 8, 27 (1946)),

and by Parseval's theorem sum_k C(k)^2 = mean of the squared power spectrum, half of that of a squared periodogram. So
the scatter of every lag is known, however far an object reaches, and no lags without an object have to be found. An
autocovariance of which the lags beyond a distance R are set to 0 has a mean squared error of

    sum over |l| > R of signal^2  +  sum over |l| < R of scatter^2,

where signal^2 is C^2 less scatter^2: the R of the smallest error is where sum (C^2 - 2 scatter^2) over |l| < R is
largest (Stein, *Ann. Stat.* 9, 1135 (1981)). A distance far off that rises by chance has to pay for all those before
it, and no grain needs to be known, so that blur does not matter.

An autocovariance falls to 0 as the object's overlap with itself does, so its last lags lie below their scatter. For an
overlap that falls as (1 - l / D)^2, that of a square along its diagonal, a peak of p scatters reaches 1 scatter at
l = D (1 - 1 / sqrt(p)): D is what is returned.
"""

from typing import NamedTuple

import numpy as np

_FARTHEST = 0.75  # of the frame's shorter side: beyond, few pairs of pixels are left
_FAINTEST = 2.0  # scatters of a peak below which nothing is said of what lies hidden


class Extent(NamedTuple):
    """What the lags of photographs say.

    Attributes
    ----------
    seen : float
        Longest distance at which the autocovariance says more than it errs, pixels.
    whole : float
        The object's diameter, pixels: with what is hidden below the scatter.
    scatter : float
        Standard deviation of the autocovariance where there is no signal, of a lag with all its pairs.
    """

    seen: float
    whole: float
    scatter: float


def background(frames: np.ndarray) -> float:
    """Variance of a lag with all its pairs, of frames float64[n, h, w] that are realizations of their own."""
    count = len(frames)
    light = frames - frames.mean((1, 2), keepdims=True)
    power = np.square(np.abs(np.fft.rfft2(light))).mean(0) / frames[0].size
    fx = np.fft.rfftfreq(frames.shape[2])
    twice = np.where((fx == 0) | (fx == 0.5), 1.0, 2.0)
    # Of a mean of n exponential numbers the mean square is (1 + 1 / n) times the square of their mean.
    square = float((np.square(power) * twice).sum()) / frames[0].size / (1 + 1 / count)
    return square / (count * frames[0].size)


def find_extent(lags: np.ndarray, frames: np.ndarray, variance: float) -> Extent:
    """Find it from the autocovariance float64[h, w] of frames, lag 0 first, by the pairs that each lag has."""
    rows, columns = frames.shape[1:]
    down, across = (np.abs(np.rint(np.fft.fftfreq(side) * side)) for side in lags.shape)
    distance = np.hypot(down[:, None], across)
    pairs = np.outer(np.maximum(rows - down, 0), np.maximum(columns - across, 0)) / (rows * columns)
    level = max(background(frames), 1e-30)
    inside = distance < _FARTHEST * min(rows, columns)
    order = np.argsort(distance[inside], kind="stable")
    gain = np.cumsum((np.square(lags) * pairs)[inside][order] - 2 * level)
    seen = max(1.0, float(distance[inside][order][np.argmax(gain)]))
    scatter = float(np.sqrt(level))
    return Extent(seen, seen / (1 - 1 / np.sqrt(max(variance / scatter, _FAINTEST))), scatter)
