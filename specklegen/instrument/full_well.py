"""Saturation level of a camera: the heap of counts at the upper end of bright frames.

Charges above the full well are all read as one, W counts, blurred by the read noise sigma; below it the light's own
density goes on, over a few sigma a straight line. A count c is then found

    S [Phi]_(c - 1/2)^(c + 1/2) + int_(c - 1/2)^(c + 1/2) (rho0 + rho1 (x - W)) Phi((W - x) / sigma) dx

times; S, rho0, rho1 and W are fitted to the histogram, counts being Poisson numbers. A heap is one where a pixel that
is at the end in one frame of a pair is there in the other, too: light of no full well falls back by its shot noise, so
that nothing can be said where that is not wider than the read noise.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.special import ndtr, xlogy

_SPAN = 10.0  # standard deviations below the heap that are fitted
_FEWEST = 50  # pixels at the end
_WIDER = 2.0  # times the read noise: differences of unsaturated light, at least
_SHARP = 0.3  # counts of read noise below which all of the heap may be one count
_CLEAR = 6.0


class Knee(NamedTuple):
    """Counts of a full pixel, their error, and the least count that may be one's."""

    counts: float
    standard_error: float
    limit: float


def knee_of(pairs: list[np.ndarray], offset: float, noise: float, top: float) -> Knee | None:
    """Find the full well of pairs counts[2, N]; None where there is none below the largest count ``top``.

    Parameters
    ----------
    pairs
        Of each level, the pixels of its two frames.
    offset
        Mean of dark counts.
    noise
        Standard deviation of dark counts, rounding included.
    top
        Largest count that the converter knows.
    """
    sigma = np.sqrt(max(noise**2 - 1 / 12, 0.0))
    blur = max(sigma, 0.5)
    highest = max(float(pair.max()) for pair in pairs)
    if highest >= top:
        return None
    # The darker half of the levels says how much shot noise a count has.
    darker = sorted(pairs, key=lambda pair: float(pair.mean()))[: (len(pairs) + 1) // 2]
    slopes = [(np.square(pair[0] - pair[1]).mean() / 2 - noise**2) / (pair.mean() - offset) for pair in darker]
    if np.median(slopes) * (highest - offset) < (_WIDER * blur) ** 2:
        return None
    at_end = [np.abs(pair[0] - pair[1])[pair[0] > highest - 8 * blur] for pair in pairs]
    others = [pair[1][pair[0] > highest - 8 * blur] for pair in pairs]
    apart = np.concatenate(at_end)
    if len(apart) < _FEWEST or np.median(apart) > _WIDER * 0.6745 * np.sqrt(2) * blur:
        return None
    start = float(np.median(np.concatenate(others)))
    low = int(np.floor(start - _SPAN * blur))
    bins = np.arange(low, int(np.ceil(max(highest, start + 6 * blur))) + 1)
    heights = sum(np.bincount(_within(pair.ravel(), bins), minlength=len(bins))[: len(bins)] for pair in pairs)
    counts, error = _fitted(bins, np.asarray(heights, np.float64), start, max(sigma, 0.05))
    if sigma < _SHARP:
        error = float(np.hypot(error, np.sqrt(1 / 12)))
    return Knee(counts, error, counts - _CLEAR * blur)


def _within(values: np.ndarray, bins: np.ndarray) -> np.ndarray:
    return (values[(values >= bins[0]) & (values <= bins[-1])] - bins[0]).astype(np.int64)


def _fitted(bins: np.ndarray, found: np.ndarray, start: float, sigma: float) -> tuple[float, float]:
    """W and its standard error, by least deviance."""
    edges = np.append(bins - 0.5, bins[-1] + 0.5)

    def expected(numbers: np.ndarray) -> np.ndarray:
        heap, level, slope, where = numbers
        z = (where - edges) / sigma
        spike = -np.diff(ndtr(z))
        held = -np.diff(sigma * (z * ndtr(z) + np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)))
        return np.maximum(heap * spike + (level + slope * (bins - where)) * held, 1e-6)

    def deviance(numbers: np.ndarray) -> np.ndarray:
        mean = expected(numbers)
        twice = 2 * (xlogy(found, found / mean) - found + mean)
        return np.sign(found - mean) * np.sqrt(np.maximum(twice, 0.0))

    ahead = bins > start - 3 * max(sigma, 0.5)
    level = float(found[~ahead].mean()) if (~ahead).any() else 0.0
    first = np.array([max(float(found[ahead].sum()), 1.0), max(level, 0.1), 0.0, start])
    scale = np.array([first[0], first[1] + 1.0, (first[1] + 1.0) / (_SPAN * sigma), sigma])
    fit = least_squares(deviance, first, x_scale=scale, method="trf")
    # The information of Poisson numbers, by central differences: slopes of a signed root are ill at its zero.
    steps = 1e-4 * scale
    slopes = np.array([(expected(fit.x + step) - expected(fit.x - step)) / (2 * step.max())
                       for step in np.diag(steps)])  # fmt: skip
    information = (slopes / expected(fit.x)) @ slopes.T
    covariance = np.linalg.pinv(information / np.outer(1 / scale, 1 / scale)) * np.outer(scale, scale)
    return float(fit.x[3]), float(np.sqrt(max(covariance[3, 3], 0.0)))
