"""The memory-effect range of a slab that nobody knows, from several images behind it.

The objects are unknown, too: for every range tried, each image is reconstructed and settled, and the deviances are
added, weighted by their frequencies. Where the range is wrong no object explains the images as well. Of the slab only
the *shape* of C_I is taken from elsewhere; distances are measured in units of its range.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from specklegen.core.random_streams import Seed
from specklegen.models.learning.solver import MemoryEffect, Solution, Solver
from specklegen.models.likelihood.likelihood import Optics
from specklegen.models.likelihood.periodogram import Periodogram

FACTORS = tuple(float(x) for x in np.geomspace(0.4, 2.5, 9))
"""Ranges tried first, over that of the memory effect that is given."""
RESAMPLES = 400
"""Of the images, for the interval."""
FINER = 4
"""Ranges tried between the two neighbours of the best."""


class RangeFit(NamedTuple):
    """What was found.

    Attributes
    ----------
    factor : float
        Range over that of the memory effect that was given.
    low, high : float
        Ends of the 95 % interval, by resampling images: it holds what a reconstruction that went wrong does to the fit.
    tried : dict[float, float]
        Log-likelihood of all images for each factor tried, less the best one's.
    solution : Solution
        Reconstructions at the best factor tried.
    """

    factor: float
    low: float
    high: float
    tried: dict[float, float]
    solution: Solution


def scaled(c_i: MemoryEffect, factor: float) -> MemoryEffect:
    """Memory effect of a range ``factor`` times as long."""
    return lambda distance: c_i(np.asarray(distance) / factor)


def fit_range(
    solver: Solver, seen: Periodogram, optics: Optics, memory: Sequence[MemoryEffect], *,
    factors: Sequence[float] = FACTORS, seed: Seed = 0,
) -> RangeFit:  # fmt: skip
    """Fit one range to the images of B objects behind one slab.

    Parameters
    ----------
    solver
        What reconstructs them.
    seen, optics, memory, seed
        As in :meth:`Solver.solve`; the memory effect gives the shape of C_I.
    factors
        Ranges to try first, over that of ``memory``.
    """
    solutions: dict[float, Solution] = {}
    values: dict[float, float] = {}

    def attempt(factor: float) -> None:
        solutions[factor] = solver.solve(seen, optics, [scaled(c, factor) for c in memory], seed=seed)
        values[factor] = float(solutions[factor].log_likelihood.double().sum())

    for factor in factors:
        attempt(factor)
    ordered = sorted(values)
    best = max(values, key=lambda f: values[f])
    place = ordered.index(best)
    ends = ordered[max(place - 1, 0)], ordered[min(place + 1, len(ordered) - 1)]
    for factor in np.geomspace(*ends, FINER + 2)[1:-1]:
        attempt(float(factor))
    tried = np.array(sorted(values))
    each = np.stack([solutions[f].log_likelihood.double().numpy() for f in tried])
    chosen = np.random.default_rng(0).multinomial(each.shape[1], np.full(each.shape[1], 1 / each.shape[1]), RESAMPLES)
    low, high = np.quantile([_peak(tried, each @ counts) for counts in chosen], [0.025, 0.975])
    total = each.sum(1)
    best = int(total.argmax())
    return RangeFit(
        _peak(tried, total), float(low), float(high),
        dict(zip(tried.tolist(), (total - total[best]).tolist(), strict=True)), solutions[float(tried[best])],
    )  # fmt: skip


def _peak(factors: np.ndarray, values: np.ndarray) -> float:
    """Where a parabola in the logarithm through the five values about the best has its peak."""
    x, best = np.log(factors), int(values.argmax())
    near = slice(max(best - 2, 0), best + 3)
    bend, slope, _ = np.polyfit(x[near] - x[best], values[near] - values[best], 2)
    shift = np.clip(-slope / (2 * bend), x[near][0] - x[best], x[near][-1] - x[best]) if bend < 0 else 0.0
    return float(np.exp(x[best] + shift))

