"""Measured statistics, each with its error from independent batches."""

from collections.abc import Callable
from math import prod

import numpy as np
from scipy.special import ndtri, stdtrit

BATCHES = 64
"""Independent batches behind every standard error; fewer give the heavy tails of Student's t."""
_HEAVY = 5.0
"""Excess kurtosis from which batches count as heavy-tailed; 5e-5 of 64 normal ones show as much."""
_NORMAL_95 = 0.975
_BEND = 2.0


def batch_sums(values: np.ndarray, paths: np.ndarray, count: int) -> np.ndarray:
    """Sums over batches of equally many paths, complex128[n, ...], n = 64 or, where there are fewer paths, ``count``.

    Parameters
    ----------
    values
        float64 or complex128[..., M], what each connection adds.
    paths
        int64[M], the path of each connection, from 0.
    count
        Number of paths.
    """
    batches = min(BATCHES, count)
    batch = paths * batches // count
    rows = values.reshape(prod(values.shape[:-1]), len(paths))  # not -1: there may be no connections
    sums = [np.bincount(batch, row.real, batches) + 1j * np.bincount(batch, row.imag, batches) for row in rows]
    return np.array(sums).T.reshape(batches, *values.shape[:-1])


def jackknife(batches: np.ndarray, function: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Value and standard error of a smooth function of sums over independent batches.

    Leaving out one batch at a time removes the bias of order 1/n that a ratio or a squared modulus of
    noisy sums carries (|K|^2 from a mean is too high by its own variance).

    Parameters
    ----------
    batches
        float64 or complex128[n, ...], what each batch adds to the sums.
    function
        Maps sums [...] to values [...]; a function of ratios of sums, since it is called with a batch less.

    Returns
    -------
    value, standard_error
        The bias-corrected value, and an error of which 1.96 hold the truth in 95 % of cases: sqrt(E|error|^2) where
        batches are normal and the function is straight over their spread. Heavy tails make it larger
        (:func:`tail_factor`), and so does a bend: twice the bias that it makes is added. The slope of |K|^2 is then
        that at one standard error above |K|: its own is next to 0 where the estimate of K happens to be, and too little
        wherever it happens to be low (a real K of 3 standard errors: 89 % where 95 are meant, with it 96).
        Where one batch holds all there is, or n < 2, the value is left as it is and the standard error is NaN.
    """
    n = len(batches)
    total = batches.sum(axis=0)
    value = function(total)
    if n < 2:
        return value, np.full(np.shape(value), np.nan)
    # Sums of the others, not the total less one batch: that would leave rounding where a batch holds nearly all.
    none = np.zeros_like(batches[:1])
    before = np.cumsum(np.concatenate([none, batches[:-1]]), axis=0)
    after = np.cumsum(np.concatenate([none, batches[:0:-1]]), axis=0)[::-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.array([function(others) for others in before + after])
        mean = left.mean(axis=0)
        variance = (n - 1) / n * np.square(np.abs(left - mean)).sum(axis=0)
        known = np.isfinite(variance)
        bias = (n - 1) * (mean - value)
        error = np.sqrt(variance) * tail_factor(left - mean) + _BEND * np.abs(bias)
        return np.where(known, value - bias, value), np.where(known, error, np.nan)


def effective_count(deviations: np.ndarray) -> np.ndarray:
    """Number of independent values that carry their variance, ``(sum |d|^2)^2 / sum |d|^4`` along the first axis.

    The variance of n values is known to one over its root; n/3 of normal ones, n of two that are as likely. Infinite
    where nothing varies.
    """
    size = np.abs(deviations)
    size = size / np.maximum(size.max(axis=0, initial=0.0), 1e-300)  # fourth powers of faint light underflow
    squares, fourths = np.square(size).sum(axis=0), np.square(np.square(size)).sum(axis=0)
    return np.divide(np.square(squares), fourths, out=np.full(np.shape(squares), np.inf), where=fourths > 0)


def rarity(deviations: np.ndarray) -> np.ndarray:
    """Relative variance of what n batches' deviations float64[n, ...] show of their variance, beyond normal ones'; 0
    where their tails may be normal.

    A batch sums many paths. Where few of these carry all its variance, it is one over how many do in all batches.
    """
    excess = 1 / effective_count(deviations) - 3 / max(len(deviations), 1)
    return np.where(excess * len(deviations) > _HEAVY, excess, 0.0)


def tail_factor(deviations: np.ndarray) -> np.ndarray:
    """Factor of standard errors from n deviations, so that 1.96 of them cover 95 %.

    It is little above 1 for normal ones. It is at most 3.5, where one of 64 holds nearly all. Rare paths of great
    weight are missed by most samples, which show too little variance, though not on average: 1.5 standard errors of the
    variance are added to it (by one the median of what is stated would be about right, but samples that are low state
    less than others). What is left of the doubt is Student's: the variance is known as that of nu + 1 normal deviations
    is, with ``2 / nu`` its relative variance. Measured in docs/trust.md.
    """
    n, share = len(deviations), 1 / effective_count(deviations)
    return doubt_factor(share - 3 / max(n, 1), share - 1 / max(n, 1), n)


def doubt_factor(unseen: np.ndarray, whole: np.ndarray, n: int = BATCHES) -> np.ndarray:
    """Factor of standard errors whose variance has a relative variance ``whole``, ``unseen`` of it by rare values."""
    added = 1.5 * np.sqrt(np.maximum(unseen, 0))
    freedom = 2 / np.maximum(whole, 2 / max(n - 1, 1))
    return np.sqrt(1 + added) * stdtrit(freedom, _NORMAL_95) / ndtri(_NORMAL_95)


def autocorrelation(image: np.ndarray) -> np.ndarray:
    """Autocorrelation of an image's fluctuations, float64[2H - 1, 2W - 1], zero lag in the middle and equal to 1.

    The mean is taken off, the image is padded so that nothing wraps around, and every lag is divided by the
    number of pixel pairs that it has.
    """
    from scipy.signal import correlate

    fluctuation = np.asarray(image, dtype=np.float64) - np.mean(image)
    ones = np.ones_like(fluctuation)
    pairs = np.asarray(correlate(ones, ones, method="fft"), dtype=np.float64).round()
    lags = np.asarray(correlate(fluctuation, fluctuation, method="fft"), dtype=np.float64) / pairs
    peak = lags[lags.shape[0] // 2, lags.shape[1] // 2]
    return lags / peak if peak > 0 else lags
