"""Size of a hidden object: the distance up to which the autocovariance of camera frames exceeds its error.

Of frames of N pixels, C(l) the mean over the pairs of pixels l apart, n(l) of them, what is no signal scatters by

    var C(l) = sum_k C(k)^2 / n(l)                    (Bartlett, *J. R. Stat. Soc. Suppl.* 8, 27 (1946)),

and by Parseval's theorem sum_k C(k)^2 = mean of the squared power spectrum, half of that of a squared periodogram. So
the scatter of every lag is known, however far an object reaches, and no lags without an object have to be found. An
autocovariance of which the lags beyond a distance R are set to 0 has a mean squared error of

    sum over |l| > R of signal^2  +  sum over |l| < R of scatter^2,

where ``signal^2`` is ``C^2`` less ``scatter^2``: the R of the smallest error is where ``sum (C^2 - 2 scatter^2)`` over
``|l| < R`` is largest (Stein, *Ann. Stat.* 9, 1135 (1981)). A distance far off that rises by chance has to pay for all
those before it, and no grain needs to be known, so that blur does not matter.

An autocovariance falls to 0 as the object's overlap with itself does, so its last lags lie below their scatter. For an
overlap that falls as ``(1 - l / D)^2``, that of a square along its diagonal, a peak of p scatters reaches 1 scatter at
``l = D (1 - 1 / sqrt(p))``.

That R is the distance up to which lags are worth keeping. Of many points each pair is fainter than its lag's scatter,
and not worth it; but hundreds of such lags have a mean square that is surely above the scatter's. So the farthest
annulus is found, outer radius 1.6 times the inner one, whose mean square lies 3.5 standard errors above that. They are
sqrt(2 / m) for a mean of m squares of Gaussian numbers; m are the independent cells of lags in the annulus (each has
the area sum_k rho(k)^2, rho the correlation of lags, again by Parseval's theorem); and those of the scatter itself,
which a mean of squares of exponential numbers gives. The diameter is the outer radius of that annulus, or D, whichever
is larger.
"""

from typing import NamedTuple

import numpy as np

_FARTHEST = 0.75  # of the frame's shorter side: beyond, few pairs of pixels are left
_FAINTEST = 2.0  # scatters of a peak below which nothing is said of what lies hidden
_ANNULUS = 1.6  # outer over inner radius
_NEAREST, _RADII = 4.0, 40  # pixels, the smallest outer radius; how many of them
_SURE = 3.5  # standard deviations of a mean square, from which on there is signal


class Extent(NamedTuple):
    """Estimates from the lags of camera frames.

    Attributes
    ----------
    seen : float
        Longest distance at which the autocovariance says more than it errs, pixels.
    whole : float
        The object's diameter, pixels: with what is hidden below the scatter of single lags.
    scatter : float
        Standard deviation of the autocovariance where there is no signal, of a lag with all its pairs.
    """

    seen: float
    whole: float
    scatter: float


def background(frames: np.ndarray) -> float:
    """Variance of a lag with all its pairs, of frames float64[n, h, w] that are realizations of their own."""
    square, _ = _moments(frames)
    return square / frames.size


def find_extent(lags: np.ndarray, frames: np.ndarray, variance: float) -> Extent:
    """Find it from the autocovariance float64[h, w] of frames, lag 0 first, by the pairs that each lag has."""
    rows, columns = frames.shape[1:]
    down, across = (np.abs(np.rint(np.fft.fftfreq(side) * side)) for side in lags.shape)
    distance = np.hypot(down[:, None], across)
    pairs = np.outer(np.maximum(rows - down, 0), np.maximum(columns - across, 0)) / (rows * columns)
    level = max(background(frames), 1e-30)
    inside = distance < _FARTHEST * min(rows, columns)
    order = np.argsort(distance[inside], kind="stable")
    away, squares = distance[inside][order], (np.square(lags) * pairs)[inside][order]
    total = np.concatenate([[0.0], np.cumsum(squares)])
    gain = total[1:] - 2 * level * np.arange(1, len(total))
    seen = max(1.0, float(away[np.argmax(gain)]))
    scatter = float(np.sqrt(level))
    kept = seen / (1 - 1 / np.sqrt(max(variance / scatter, _FAINTEST)))
    return Extent(seen, max(kept, _farthest(away, total / level, _cell(frames), frames.size)), scatter)


def _farthest(away: np.ndarray, total: np.ndarray, cell: float, pixels: int) -> float:
    """Outer radius of the farthest annulus with signal, of distances in order and sums of squares before each; or 0."""
    outer = np.geomspace(_NEAREST, max(float(away[-1]), _NEAREST), _RADII)
    first, last = np.searchsorted(away, outer / _ANNULUS), np.searchsorted(away, outer)
    number = np.maximum(last - first, 1)
    above = (total[last] - total[first]) / number - 1
    # Lags l and -l are one; and x^2 / 2 of an exponential number x of mean 1 has the variance 5.
    error = np.sqrt(4 * cell / number + 10 * cell / pixels)
    signal = above > _SURE * error
    return float(outer[signal].max(initial=0.0))


def _cell(frames: np.ndarray) -> float:
    """Number of lags that count for one."""
    square, fourth = _moments(frames)
    return max(1.0, fourth / max(square**2, 1e-300))


def _moments(frames: np.ndarray) -> tuple[float, float]:
    """Means over all frequencies of the second and fourth power of the spectrum, of frames float64[n, h, w]."""
    light = frames - frames.mean((1, 2), keepdims=True)
    power = np.square(np.abs(np.fft.rfft2(light))).mean(0) / frames[0].size
    fx = np.fft.rfftfreq(frames.shape[2])
    twice = np.where((fx == 0) | (fx == 0.5), 1.0, 2.0)
    # Of a mean of n exponential numbers of mean S, E x^k is S^k times the product of 1 + j / n over j < k.
    square, fourth = (
        float((power**k * twice).sum()) / frames[0].size / float(np.prod(1 + np.arange(k) / len(frames)))
        for k in (2, 4)
    )
    return square, fourth
