"""Intervals from log-likelihoods at scanned values of one positive number, such as a memory-effect range."""

import numpy as np
from scipy.special import logsumexp, ndtr
from scipy.stats import t

SHAPE = 0.1
"""Spread of the logarithm of a range read off C_I of another shape (docs/notes/networks.md, measured.md)."""


def blurred(at: np.ndarray, likely: np.ndarray, spread: float) -> np.ndarray:
    """Log-likelihoods where the logarithm of the value has an error of such a spread; the ends go on as they are.

    Parameters
    ----------
    at : float64[n]
        Values, rising.
    likely : float64[n]
        Their log-likelihoods.
    """
    steps = np.log(at)
    edges = np.concatenate([[-np.inf], (steps[1:] + steps[:-1]) / 2, [np.inf]])
    weights = np.diff(ndtr((edges - steps[:, None]) / spread), axis=1)
    return np.asarray(logsumexp(np.broadcast_to(likely, weights.shape), axis=1, b=weights))


def interval(at: np.ndarray, likely: np.ndarray, level: float, freedom: float = np.inf) -> tuple[float, float]:
    """Shortest and longest value whose log-likelihood is near enough to the highest (Wilks); 0 and inf at the ends.

    Likelihoods over a scatter that was measured have its degrees of freedom: Student's quantile takes the normal one's
    place.
    """
    near = likely - likely.max() + t.ppf((1 + level) / 2, freedom) ** 2 / 2
    inside = np.flatnonzero(near >= 0)
    steps = np.log(at)

    def crossing(inner: int, outer: int) -> float:
        share = near[inner] / (near[inner] - near[outer])
        return float(np.exp(steps[inner] + share * (steps[outer] - steps[inner])))

    first, last = int(inside[0]), int(inside[-1])
    low = 0.0 if first == 0 else crossing(first, first - 1)
    high = float("inf") if last == len(at) - 1 else crossing(last, last + 1)
    return low, high
