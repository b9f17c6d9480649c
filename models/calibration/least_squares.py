"""Nonlinear least squares with bounds, many small problems at once: Levenberg and Marquardt's steps.

All problems have one model and one set of data; they differ in where they start, and in which combination of the
unknowns is held: starts of a fit, and points of its profiles. Levenberg, Q. Appl. Math. 2, 164 (1944); Marquardt,
J. SIAM 11, 431 (1963).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

STEPS = 60
_ENOUGH = 1e-4  # change of chi squared; convergence is quadratic, so that less is left
_WHOLE, _HIGHEST = 0.03, 1e6  # damping

Model = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Residuals over their errors float64[B, M] and their derivatives float64[B, M, n], at unknowns float64[B, n]."""


class Held(NamedTuple):
    """A combination of the unknowns that keeps its value: of problem b, ``weights[b] @ u``, which ``pivot[b]`` settles.

    Attributes
    ----------
    weights : float64[B, n]
        0 where nothing is held.
    pivot : int64[B]
        The unknown that follows from the others; -1 where nothing is held.
    values : float64[B]
    """

    weights: np.ndarray
    pivot: np.ndarray
    values: np.ndarray

    def select(self, some: np.ndarray) -> "Held":
        """Return those of some problems."""
        return Held(self.weights[some], self.pivot[some], self.values[some])


class Minimum(NamedTuple):
    """Unknowns float64[B, n] and the sum of squares float64[B] there, inf where none were found."""

    at: np.ndarray
    cost: np.ndarray


def nothing_held(count: int, unknowns: int) -> Held:
    """Return problems without a constraint."""
    return Held(np.zeros((count, unknowns)), np.full(count, -1), np.zeros(count))


def settled(at: np.ndarray, held: Held) -> np.ndarray:
    """Unknowns with those that are held put where they belong."""
    at = at.copy()
    rows = np.flatnonzero(held.pivot >= 0)
    pivot = held.pivot[rows]
    lead = held.weights[rows, pivot]
    rest = np.einsum("bn,bn->b", held.weights[rows], at[rows]) - lead * at[rows, pivot]
    at[rows, pivot] = (held.values[rows] - rest) / lead
    return at


def minimize(
    model: Model, start: np.ndarray, low: np.ndarray, high: np.ndarray, held: Held, moved: np.ndarray | None = None
) -> Minimum:  # fmt: skip
    """Minimise sums of squares from ``start`` float64[B, n], unknowns between ``low`` and ``high`` float64[n].

    ``moved`` float64[B, M] is taken off the residuals: data that differ from problem to problem.
    """
    at = settled(np.clip(start, low, high), held)
    damping = np.full(len(at), 1e-3)
    moved = np.zeros((len(at), 1)) if moved is None else moved
    residual, slope = model(at)
    residual = residual - moved
    cost = np.where(_inside(at, low, high), np.square(residual).sum(-1), np.inf)
    going = np.isfinite(cost)
    for _ in range(STEPS):
        some = np.flatnonzero(going)
        if not len(some):
            break
        mine = held.select(some)
        trial = at[some] + _steps(at[some], residual[some], slope[some], damping[some], mine, low, high)
        trial = settled(np.clip(trial, low, high), mine)
        inside = _inside(trial, low, high)
        misfit, turned = model(np.where(inside[:, None], trial, at[some]))
        misfit = misfit - moved[some]
        new = np.where(inside, np.square(misfit).sum(-1), np.inf)
        better = new < cost[some]
        gain = cost[some] - new
        # A small gain says that the minimum is near only of a step that damping did not shorten.
        whole = damping[some] < _WHOLE
        done = (np.abs(gain) < _ENOUGH * (1 + cost[some] / 100)) & whole
        done |= ~better & (damping[some] > _HIGHEST)
        damping[some] = np.where(better, damping[some] / 10, damping[some] * 10)
        taken = some[better]
        at[taken], cost[taken] = trial[better], new[better]
        residual[taken], slope[taken] = misfit[better], turned[better]
        going[some[done]] = False
    return Minimum(at, cost)


def _inside(at: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.all((at >= low - 1e-12) & (at <= high + 1e-12), axis=-1)


def _steps(
    at: np.ndarray, residual: np.ndarray, slope: np.ndarray, damping: np.ndarray, held: Held, low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Steps float64[B, n] of what is neither held nor at a bound that it is pushed against."""
    slope = slope.copy()
    rows = np.flatnonzero(held.pivot >= 0)
    pivot = held.pivot[rows]
    # The pivot follows the others: du_k = -sum_j (c_j / c_k) du_j.
    follow = held.weights[rows] / held.weights[rows, pivot][:, None]
    slope[rows] -= slope[rows, :, pivot][:, :, None] * follow[:, None, :]
    downhill = -np.einsum("bmn,bm->bn", slope, residual)
    free = ~(((at <= low) & (downhill < 0)) | ((at >= high) & (downhill > 0)))
    free[rows, pivot] = False
    square = np.einsum("bmn,bmp->bnp", slope, slope) * free[:, :, None] * free[:, None, :]
    scale = np.einsum("bnn->bn", square)
    scale = np.where(free, np.maximum(scale, 1e-12 * scale.max(-1, keepdims=True)), 0.0)
    unit = np.eye(at.shape[-1])
    square = square + unit * (damping[:, None] * scale + ~free)[:, :, None]
    return np.linalg.solve(square + 1e-300 * unit, (downhill * free)[..., None])[..., 0]
