"""The memory-effect range of a slab that nobody knows, from several images behind it, of objects that nobody knows.

Of the slab only the *shape* of C_I is taken from elsewhere. For each image a network
(:mod:`specklegen.models.learning.networks.range_net`) tells how likely its lags are for objects of any extent over the
range; the images are independent, so that their logarithms add. What they do not know together is the shape: the sum is
taken as the likelihood of a range that differs from the true one by a factor of spread ``SHAPE``. An interval holds all
ranges whose likelihood is within exp(-q / 2) of the highest, q the quantile of chi squared with one degree of freedom
(Wilks, *Ann. Math. Statist.* 9, 60 (1938)). Images of objects far within their range do not tell how far: such an
interval has no upper end.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch

from specklegen.core.errors import reject
from specklegen.models.learning.networks.range_net import extents, likelihoods
from specklegen.models.learning.solver import EXTENT, MemoryEffect, Solver, described, lags_of
from specklegen.models.likelihood import scan
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.likelihood.scan import SHAPE

FACTORS = tuple(float(x) for x in np.geomspace(0.2, 5.0, 129))
"""Ranges tried, over that of the memory effect that is given."""
_REACH = np.geomspace(1e-2, 1e4, 2001)  # distances in object pixels among which C_I falls to one half


class RangeFit(NamedTuple):
    """Result of the search.

    Attributes
    ----------
    factor : float
        Range over that of the memory effect that was given.
    low, high : float
        Ends of the 95 % interval; 0 and infinity where it is open: where no range tried is short, or long, enough to be
        excluded.
    tried : dict[float, float]
        Log-likelihood of all images for each factor tried, less the best one's.
    """

    factor: float
    low: float
    high: float
    tried: dict[float, float]

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Ends of the interval of a level between 0 and 1, as ``low`` and ``high``."""
        return scan.interval(np.array(list(self.tried)), np.array(list(self.tried.values())), level)


def scaled(c_i: MemoryEffect, factor: float) -> MemoryEffect:
    """Memory effect of a range ``factor`` times as long."""
    return lambda distance: c_i(np.asarray(distance) / factor)


def range_of(c_i: MemoryEffect) -> float:
    """Distance in object pixels at which C_I is one half."""
    values = np.asarray(c_i(_REACH))
    below = np.flatnonzero(values < 0.5)
    if not len(below) or below[0] == 0:
        reject("fit_range memory", "a memory effect that falls to one half", (float(values[0]), float(values[-1])),
               "Take it from a thicker medium, or leave the range alone: it is beyond every object.")  # fmt: skip
    near = slice(below[0] - 1, below[0] + 1)
    return float(np.exp(np.interp(-0.5, -values[near], np.log(_REACH[near]))))


def fit_range(
    solver: Solver, seen: Periodogram, optics: Optics, memory: Sequence[MemoryEffect], *,
    factors: Sequence[float] = FACTORS,
) -> RangeFit:  # fmt: skip
    """Fit one range to the images of B objects behind one slab.

    Raise a `RuleError` if there is not one memory effect for each object, or one does not fall to one half.

    Parameters
    ----------
    solver
        Whose network reads ranges.
    seen, optics, memory
        As in :meth:`Solver.solve`; the memory effect gives the shape of C_I.
    factors
        Ranges to try, over that of ``memory``.
    """
    if len(memory) != len(seen.power):
        reject("fit_range memory", f"one for each of {len(seen.power)} objects", len(memory))
    n = solver.network.frame
    seen = seen._replace(power=seen.power.float(), noise=seen.noise.float())
    likelihood = SpeckleLikelihood(seen, (n, n), optics)
    lags, variance, grain = lags_of(likelihood)
    with torch.no_grad():
        numbers = described(variance, grain, seen.looks)
        curves = likelihoods(solver.ranges(torch.fft.fftshift(lags, dim=(-2, -1)), numbers).double()).numpy()
    tried = np.sort(np.asarray(factors, np.float64))
    at = [np.log(EXTENT / range_of(c)) - np.log(tried) for c in memory]
    each = np.stack([np.interp(x, np.log(extents()), row) for x, row in zip(at, curves, strict=True)], axis=1)
    total = scan.blurred(tried, each.sum(1), SHAPE)
    likely = dict(zip(tried.tolist(), (total - total.max()).tolist(), strict=True))
    return RangeFit(_peak(tried, total), *scan.interval(tried, total, 0.95), likely)


def _peak(factors: np.ndarray, values: np.ndarray) -> float:
    """Mean of the logarithm under the likelihood, as a factor: steadier than its highest point."""
    weights = np.exp(values - values.max())
    return float(np.exp((np.log(factors) * weights).sum() / weights.sum()))
