"""The envelope of the light over a frame: a smooth fit whose order the evidence chooses.

Speckle that is averaged over a block of pixels is a gamma number whose mean is the envelope there and whose relative
variance is the same everywhere. So the logarithm of the envelope is taken for a polynomial of total degree d in the two
coordinates, and fitted as the mean of gamma numbers (McCullagh and Nelder, *Generalized Linear Models*, 2nd ed. 1989,
chapter 8). Of the orders that one is taken whose scaled deviance + k log(N) is least: k coefficients, N independent
blocks, twice the negative logarithm of the evidence to leading order (Schwarz, *Ann. Stat.* 6, 461 (1978)). Blocks that
are correlated, since grains or the object are larger, count for as many fewer.
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggrid2d, legvander2d

from specklegen.core.errors import reject

HIGHEST = 8
"""Highest total degree."""
_BLOCKS = 48  # along the longer side
_FILLED = 0.5  # share of a block's pixels that have to be good
_NEAR = 2  # blocks, over which their correlation is summed
_STEPS = 100


class Envelope(NamedTuple):
    """A fitted envelope.

    Attributes
    ----------
    values : ndarray
        float64[h, w], of mean 1.
    order : int
        Total degree of the polynomial; 0 is even light.
    standard_error : float
        Root mean square of its relative error over the frame, if its form is right.
    """

    values: np.ndarray
    order: int
    standard_error: float


class _Fit(NamedTuple):
    coefficients: np.ndarray
    mean: np.ndarray
    deviance: float


def fit_envelope(light: np.ndarray, good: np.ndarray, field: str) -> Envelope:
    """Fit the envelope of a mean image[h, w] by its good pixels, bool[h, w].

    Raise a `RuleError` if some part of the image has no light, or hardly any pixel is good.
    """
    at_y, at_x, means, weights, places = _blocks(light, good)
    if len(means) < 12:
        reject(f"{field} envelope", "fitted to an image with more good pixels", f"{len(means)} blocks of good pixels")
    if not (means > 0).all():
        remedy = "Give the illuminated region and the black level."
        reject(f"{field} envelope", "fitted to light that is above the black level everywhere", means.min(), remedy)
    orders = [order for order in range(HIGHEST + 1) if 10 * _terms(order) <= len(means)]
    fits = {order: _fit(at_y, at_x, means, weights, order) for order in orders}
    best = fits[orders[-1]]
    alone = _dispersion(best, means, weights, _terms(orders[-1]))
    shared = _shared(means / best.mean - 1, places, _terms(orders[-1]))
    independent = len(means) / shared
    orders = [order for order in orders if order == 0 or 4 * _terms(order) <= independent]

    def evidence(order: int) -> float:
        return fits[order].deviance / (alone * shared) + _terms(order) * np.log(independent)

    order = min(orders, key=evidence)
    chosen = fits[order]
    shared = _shared(means / chosen.mean - 1, places, _terms(order))  # fewer terms took less of it away
    error = _dispersion(chosen, means, weights, _terms(order)) * (_terms(order) - 1) * shared / len(means)
    values = np.exp(leggrid2d(_centres(light.shape[0]), _centres(light.shape[1]), chosen.coefficients))
    return Envelope(values / values[good].mean(), order, float(np.sqrt(error)))


def _terms(order: int) -> int:
    return (order + 1) * (order + 2) // 2


def _centres(pixels: int) -> np.ndarray:
    """Centres of pixels on -1 ... 1."""
    return (2 * np.arange(pixels) + 1) / pixels - 1


def _blocks(light: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, ...]:
    """Centres y and x, means and relative weights of blocks with enough good pixels, and their places on a grid."""
    side = max(1, -(-max(light.shape) // _BLOCKS))
    edges = [np.arange(0, pixels - pixels % side or pixels, side) for pixels in light.shape]

    def summed(values: np.ndarray) -> np.ndarray:
        rows = np.add.reduceat(values, edges[0], axis=0)  # what is left over at the end goes to the last block
        return np.add.reduceat(rows, edges[1], axis=1)

    number, light_sum = summed(good.astype(float)), summed(np.where(good, light, 0.0))
    enough = number >= _FILLED * side**2
    y, x = (
        np.add.reduceat(_centres(pixels), edge) / np.add.reduceat(np.ones(pixels), edge)
        for pixels, edge in zip(light.shape, edges, strict=True)
    )
    places = np.nonzero(enough)
    counts = number[enough]
    return y[places[0]], x[places[1]], light_sum[enough] / counts, counts / counts.mean(), np.stack(places)


def _fit(y: np.ndarray, x: np.ndarray, means: np.ndarray, weights: np.ndarray, order: int) -> _Fit:
    """Fisher's scoring; with a logarithmic link its matrix is the same at every step."""
    kept = np.add.outer(np.arange(order + 1), np.arange(order + 1)) <= order
    design = legvander2d(y, x, (order, order))[:, kept.ravel()]
    root = np.sqrt(weights)[:, None]
    inverse = np.linalg.pinv(design * root)
    solution = inverse @ (root[:, 0] * np.log(means))
    for _ in range(_STEPS):
        residual = means * np.exp(-design @ solution) - 1
        step = inverse @ (root[:, 0] * residual)
        step *= min(1.0, 1 / max(1e-300, np.abs(design @ step).max()))
        solution = solution + step
        if np.abs(step).max() < 1e-10:
            break
    mean = np.exp(design @ solution)
    ratio = means / mean
    coefficients = np.zeros((order + 1, order + 1))
    coefficients[kept] = solution
    return _Fit(coefficients, mean, float(2 * (weights * (ratio - 1 - np.log(ratio))).sum()))


def _dispersion(fit: _Fit, means: np.ndarray, weights: np.ndarray, terms: int) -> float:
    """Relative variance of a block."""
    return max(1e-24, float((weights * np.square(means / fit.mean - 1)).sum() / (len(means) - terms)))


def _shared(residual: np.ndarray, places: np.ndarray, terms: int) -> float:
    """Number of blocks that count for one: the sum of their correlation over near distances, at least 1.

    The fit has taken its terms' power, which is slow, from the correlation at each of these distances.
    """
    grid = np.zeros(places.max(axis=1) + 1)
    there = np.zeros_like(grid)
    grid[tuple(places)], there[tuple(places)] = residual, 1.0
    total = 0.0
    for dy in range(0, _NEAR + 1):
        for dx in range(-_NEAR, _NEAR + 1):
            if (dy, dx) > (0, 0):
                one, other = (_shifted(each, dy, dx) for each in (grid, there))
                pairs = (there * other).sum()
                total += 2 * float((grid * one).sum() / pairs) if pairs else 0.0
    left = max(0.3, 1 - (2 * _NEAR + 1) ** 2 * terms / len(residual))
    return max(1.0, (1 + total / max(1e-300, float(np.square(residual).mean()))) / left)


def _shifted(grid: np.ndarray, dy: int, dx: int) -> np.ndarray:
    moved = np.zeros_like(grid)
    height, width = grid.shape
    if dy < height and abs(dx) < width:
        moved[: height - dy, max(0, -dx) : width - max(0, dx)] = grid[dy:, max(0, dx) : width - max(0, -dx)]
    return moved
