"""The memory-effect range from photographs of a known target: how soon the light of its parts stops moving together.

Pairs of the target's points that lie a distance d apart on the camera are seen with the weight C_I(d). Of a slab that
nobody knows C_I has no known shape either: from slab to slab it falls as a Gaussian function, as an exponential one, or
in between, and so it is taken for

    C_I(d) = 2^(-(d / range)^p),    p between the ends of ``POWERS``,

of which the likeliest is taken at each range. The likelihood is a profile, over how much further the scores scatter
from tile to tile than its curvature says (Chandler and Bate, *Biometrika* 94, 167 (2007)). That C_I is no such power is
an error of the range of spread ``scan.SHAPE``, as where `reconstruct` fits one.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import real_array
from specklegen.core.errors import reject
from specklegen.models.likelihood import scan
from specklegen.models.likelihood.spectrum import autocorrelation_of

POWERS = 0.75, 1.0, 1.25, 1.5, 1.75, 2.0
_STEPS = 25
_REACH = 0.25, 8.0
"""Shortest range tried in steps of the target; longest in extents of it."""
_FINE, _LIKELY = 10, 60.0
"""Ranges about the best of those; how much less likely others are that are not looked at again, in ln L."""
_LARGEST = 128
"""Cells along a target at most: what is long and sharp costs its square."""


class Target(NamedTuple):
    """What is photographed.

    Attributes
    ----------
    bare : float64[2 h - 1, 2 w - 1]
        Its autocorrelation, of sum 1, lag 0 in the middle.
    step : float
        Camera pixels between its cells.
    shape : tuple of int
        (h, w).
    reach, power : float
        Range and power of the medium before it; of none an infinite range.
    """

    bare: Tensor
    step: float
    shape: tuple[int, int]
    reach: float = np.inf
    power: float = 2.0

    @property
    def lags(self) -> Tensor:
        """The autocorrelation, each lag seen with the weight of C_I."""
        if not np.isfinite(self.reach):
            return self.bare
        down, across = (np.arange(1 - n, n) * self.step for n in self.shape)
        return self.bare * torch.from_numpy(decay(np.hypot(down[:, None], across) / self.reach, self.power))

    @property
    def extent(self) -> float:
        """Camera pixels along its longer side."""
        return self.step * max(self.shape)

    @property
    def half_width(self) -> float:
        """Camera pixels at which the autocorrelation has fallen to a half, over both axes; 0 of a point."""
        found = []
        for line in (self.bare[self.shape[0] - 1], self.bare[:, self.shape[1] - 1]):
            below = np.flatnonzero(line[len(line) // 2 :].numpy() < float(line[len(line) // 2]) / 2)
            found.append(float(below[0]) if len(below) else len(line) / 2)
        return self.step * float(np.mean(found)) if self.shape != (1, 1) else 0.0

    def behind(self, reach: float, power: float = 2.0) -> "Target":
        """The same, behind a medium of such a range, camera pixels; infinity leaves it as it is."""
        return self._replace(reach=float(reach), power=float(power))


class RangeProfile(NamedTuple):
    """How the likelihood falls with the range.

    Attributes
    ----------
    ranges : float64[n]
        Camera pixels; the longest are as good as infinite.
    powers : float64[n]
        The likeliest power at each.
    likely : float64[n]
        Logarithm of the likelihood less the highest, over the scatter's share.
    """

    ranges: np.ndarray
    powers: np.ndarray
    likely: np.ndarray

    @property
    def best(self) -> float:
        """The likeliest range, between those tried; infinity where the longest is."""
        n = self._likeliest
        if n == len(self.ranges) - 1:
            return float("inf")
        if n == 0:
            return float(self.ranges[0])
        x, y = np.log(self.ranges[n - 1 : n + 2]), self.likely[n - 1 : n + 2]
        curve, slope, _ = np.polyfit(x - x[1], y, 2)
        return float(np.exp(x[1] + np.clip(-slope / (2 * curve), x[0] - x[1], x[2] - x[1]) if curve < 0 else x[1]))

    @property
    def power(self) -> float:
        """The power of the likeliest range."""
        return float(self.powers[self._likeliest])

    @property
    def _likeliest(self) -> int:
        """Place of the likeliest range, of several the longest."""
        return len(self.likely) - 1 - int(np.argmax(self.likely[::-1]))

    def interval(self, level: float) -> tuple[float, float]:
        """Ends of an interval; 0 and infinity where no range tried is short, or long, enough to be excluded."""
        return scan.interval(self.ranges, scan.blurred(self.ranges, self.likely, scan.SHAPE), level)

    def told(self, level: float) -> str:
        """The interval in words."""
        low, high = self.interval(level)
        if np.isinf(high):
            return f"above {low:.3g}"
        return f"{low:.3g} to {high:.3g}" if low else f"below {high:.3g}"


def decay(distance: np.ndarray, power: float) -> np.ndarray:
    """C_I at distances over the range."""
    return np.asarray(2.0 ** -(np.asarray(distance, np.float64) ** power))


def target_of(owner: str, target: object, step: float) -> Target:
    """Check a target: brightness real[h, w], at least 0, and the camera pixels between its cells.

    Raises
    ------
    RuleError
        Of another shape, without light, below 0, or too large.
    """
    light = real_array(f"{owner} target", target)  # type: ignore[arg-type]
    if light.ndim != 2 or not light.size or max(light.shape) > _LARGEST:
        reject(f"{owner} target", f"an image of one to {_LARGEST} cells a side", light.shape,
               "Take fewer, coarser cells, and a longer target_step.")  # fmt: skip
    if not np.isfinite(light).all() or light.min() < 0 or not light.max() > 0:
        reject(f"{owner} target", "at least 0, and above 0 somewhere", light)
    rows, columns = (np.flatnonzero(light.any(axis)) for axis in (1, 0))
    light = light[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    lags = autocorrelation_of(torch.from_numpy(np.ascontiguousarray(light, np.float64))[None])[0]
    return Target(lags / lags.sum(), step, (light.shape[0], light.shape[1]))


def ranges_of(target: Target) -> np.ndarray:
    """Ranges that are tried first, camera pixels."""
    return np.geomspace(_REACH[0] * target.step, _REACH[1] * target.extent, _STEPS)


def profile_of(
    target: Target, quick: Callable[[Target], float],
    cost: Callable[[Callable[[float], Target], float], tuple[float, float]],
    scatter: Callable[[Target, Target], float],
) -> RangeProfile:  # fmt: skip
    """Profile a range: coarsely with all but the brightness held, then anew about the best.

    Parameters
    ----------
    target
        What is photographed.
    quick
        Minus the logarithm of the likelihood of all tiles, the grain held.
    cost
        The same with all other numbers fitted, and the power of least cost, of a target that is a function of the
        power; the second argument is a power to start from.
    scatter
        Variance of the scores over that of the likelihood's own curvature, of what tells two targets apart; at least 1.
    """
    tried = ranges_of(target)
    first = np.array([[quick(target.behind(reach, power)) for power in POWERS] for reach in tried])
    costs, powers = first.min(1), np.array(POWERS)[first.argmin(1)]
    n = int(np.clip(costs.argmin(), 1, len(tried) - 2))
    fine = np.geomspace(tried[n - 1], tried[n + 1], _FINE)[1:-1]
    at = np.searchsorted(tried, fine)
    tried, costs, powers = (np.insert(each, at, new) for each, new in (
        (tried, fine), (costs, np.full(len(fine), costs[n])), (powers, np.full(len(fine), powers[n])),
    ))  # fmt: skip
    for m in np.flatnonzero(costs < costs.min() + _LIKELY):
        costs[m], powers[m] = cost(lambda power, reach=tried[m]: target.behind(reach, power), powers[m])
    best = int(np.clip(costs.argmin(), 1, len(tried) - 2))
    spread = scatter(*(target.behind(tried[m], powers[m]) for m in (best - 1, best)))
    return RangeProfile(tried, powers, (costs.min() - costs) / spread)
