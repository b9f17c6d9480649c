"""Decrease of an error with run time: the slope of a straight part, and the crossing of two curves.

log error = c + s log time,    s = -1/2 for independent samples
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import digamma, polygamma

from specklegen.core.errors import reject


@dataclass(frozen=True)
class Trend:
    """Slope of a power law.

    Attributes
    ----------
    slope, slope_error : float
        With its standard error from the scatter that the errors themselves have.
    decades : float
        Decades of time fitted.
    """

    slope: float
    slope_error: float
    decades: float


def fit_trend(seconds: ArrayLike, errors: ArrayLike, freedom: ArrayLike) -> Trend:
    """Fit a power law by weighted least squares in logarithms.

    Parameters
    ----------
    seconds, errors
        float[n], above 0.
    freedom
        float[n], independent squares behind each root mean square error. Its logarithm then has the variance
        psi'(freedom / 2) / 4, and lies low by (log(freedom / 2) - psi(freedom / 2)) / 2, which is put back: 0.64 for
        a single run, enough to steepen a slope whose longest runs are the fewest.
    """
    x, y, freedom = (np.asarray(each, dtype=np.float64) for each in (seconds, errors, freedom))
    for name, values in (("seconds", x), ("errors", y), ("freedom", freedom)):
        if not (np.isfinite(values) & (values > 0)).all():
            reject(f"fit_trend {name}", "greater than 0", values)
    if len(np.unique(x)) < 2:
        reject("fit_trend seconds", "at least two different times", x)
    half = freedom / 2
    x, y, weight = np.log(x), np.log(y) + (np.log(half) - digamma(half)) / 2, 4 / polygamma(1, half)
    mean = np.average(x, weights=weight)
    spread = (weight * (x - mean) ** 2).sum()
    slope = (weight * (x - mean) * y).sum() / spread
    return Trend(float(slope), float(spread**-0.5), float(np.ptp(x) / np.log(10)))


def crossover(
    one: tuple[ArrayLike, ArrayLike], other: tuple[ArrayLike, ArrayLike], margin: float = 1.0
) -> tuple[float, float] | None:
    """Return the crossing (seconds, error) of two curves (seconds float[n], errors float[n]), or None.

    Interpolated between measured points in logarithms, over the times that both cover; of several crossings the last.
    A crossing counts where on either side the errors differ somewhere by the factor ``margin`` at least.
    """
    curves = [tuple(np.log(np.asarray(part, dtype=np.float64)) for part in curve) for curve in (one, other)]
    low, high = max(x.min() for x, _ in curves), min(x.max() for x, _ in curves)
    if not low < high:
        return None
    times = np.unique(np.clip(np.concatenate([x for x, _ in curves]), low, high))
    first, second = (np.interp(times, *_sorted(*curve)) for curve in curves)
    gap = first - second
    changes = np.flatnonzero(gap[:-1] * gap[1:] < 0)
    least = np.log(margin)
    changes = [n for n in changes if min(np.abs(gap[: n + 1]).max(), np.abs(gap[n + 1 :]).max()) >= least]
    if not changes:
        return None
    n = changes[-1]
    share = gap[n] / (gap[n] - gap[n + 1])
    return (
        float(np.exp(times[n] + share * (times[n + 1] - times[n]))),
        float(np.exp(first[n] + share * (first[n + 1] - first[n]))),
    )


def _sorted(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(x)
    return x[order], y[order]
