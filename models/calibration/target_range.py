"""The memory-effect range from camera frames of a known target: how soon the light of its parts stops moving together.

Pairs of the target's points that lie a distance d apart on the camera are seen with the weight C_I(d). Of a slab that
nobody knows C_I has no known shape either. It begins as a Gaussian function, and goes on as an exponential one, as a
power of the distance, or in between, sooner or later:

    C_I(d) = 2^(-f(d / range) / f(1)),    f(x) = (1 + (x / bend)^2)^(power / 2) - 1,

a Gaussian function at a power of 2, 2^(-(d / range)^power) at a small bend. Of slabs by paths this form leaves less
than 0.02 of C_I from an optical depth of 5 on; less than 4 % of the range (docs/notes/measured.md). Bend and power are
the likeliest at each range. The likelihood is a profile, over how much further the scores scatter from tile to tile
than its curvature says (Chandler and Bate, *Biometrika* 94, 167 (2007)).
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


class Fall(NamedTuple):
    """Shape of C_I: where it stops being a Gaussian function, in ranges, and the power of its tail."""

    bend: float
    power: float


GAUSSIAN = Fall(1.0, 2.0)
BOUNDS = ((np.log(0.1), np.log(4.0)), (0.05, 2.0))
"""Of ln(bend) and power."""
_FALLS = (*(Fall(bend, power) for bend in (0.1, 0.3, 1.0, 2.5) for power in (0.1, 0.7, 1.3)), GAUSSIAN)
_NUMBERS = 6
_SHAPE = 0.03
"""Spread of ln(range): what the form leaves of a slab's."""
_STEPS = 25
_REACH = 0.25, 8.0
"""Shortest range tried in steps of the target; longest in extents of it."""
_FINE, _LIKELY = 10, 30.0
"""Ranges about the best of those; how much less likely others are that are not looked at again, in ln L."""
_LARGEST = 128
"""Cells along a target at most: what is long and sharp costs its square."""


class Target(NamedTuple):
    """Target.

    Attributes
    ----------
    bare : float64[2 h - 1, 2 w - 1]
        Its autocorrelation, of sum 1, lag 0 in the middle.
    step : float
        Camera pixels between its cells.
    shape : tuple of int
        (h, w).
    reach, fall : float, Fall
        Range of the medium before it, of none infinite, and how its C_I falls.
    """

    bare: Tensor
    step: float
    shape: tuple[int, int]
    reach: float = np.inf
    fall: Fall = GAUSSIAN

    @property
    def lags(self) -> Tensor:
        """The autocorrelation, each lag seen with the weight of C_I."""
        if not np.isfinite(self.reach):
            return self.bare
        down, across = (np.arange(1 - n, n) * self.step for n in self.shape)
        return self.bare * torch.from_numpy(decay(np.hypot(down[:, None], across) / self.reach, self.fall))

    @property
    def extent(self) -> float:
        """Camera pixels along its longer side."""
        return self.step * max(self.shape)

    @property
    def half_width(self) -> float:
        """Camera pixels at which the autocorrelation has fallen to a half, over both axes; 0 of a point."""
        widths = []
        for line in (self.bare[self.shape[0] - 1], self.bare[:, self.shape[1] - 1]):
            below = np.flatnonzero(line[len(line) // 2 :].numpy() < float(line[len(line) // 2]) / 2)
            widths.append(float(below[0]) if len(below) else len(line) / 2)
        return self.step * float(np.mean(widths)) if self.shape != (1, 1) else 0.0

    def behind(self, reach: float, fall: Fall = GAUSSIAN) -> "Target":
        """Return the target behind a medium of such a range, camera pixels; infinity leaves it unchanged."""
        return self._replace(reach=float(reach), fall=Fall(*map(float, fall)))


class RangeProfile(NamedTuple):
    """Profile likelihood of the range.

    Attributes
    ----------
    ranges : float64[n]
        Camera pixels; the longest are as good as infinite.
    falls : tuple of Fall
        The likeliest at each.
    likely : float64[n]
        Logarithm of the likelihood less the highest, over the scatter's share.
    tiles : int
        Whose scatter that is.
    """

    ranges: np.ndarray
    falls: tuple[Fall, ...]
    likely: np.ndarray
    tiles: int

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
    def fall(self) -> Fall:
        """Fall at the likeliest range."""
        return self.falls[self._likeliest]

    @property
    def _likeliest(self) -> int:
        """Place of the likeliest range, of several the longest."""
        return len(self.likely) - 1 - int(np.argmax(self.likely[::-1]))

    def interval(self, level: float) -> tuple[float, float]:
        """Ends of an interval; 0 and infinity where no range tried is short, or long, enough to be excluded."""
        return scan.interval(self.ranges, scan.blurred(self.ranges, self.likely, _SHAPE), level, self.tiles - _NUMBERS)

    def told(self, level: float) -> str:
        """The interval in words."""
        low, high = self.interval(level)
        if np.isinf(high):
            return f"above {low:.3g}"
        return f"{low:.3g} to {high:.3g}" if low else f"below {high:.3g}"


def decay(distance: np.ndarray, fall: Fall) -> np.ndarray:
    """C_I at distances over the range."""
    bent = np.log1p(np.square(np.asarray(distance, np.float64) / fall.bend))
    half = np.log1p(fall.bend**-2.0)
    return np.asarray(2.0 ** -(np.expm1(fall.power / 2 * bent) / np.expm1(fall.power / 2 * half)))


def target_of(owner: str, target: object, step: float) -> Target:
    """Check a target: brightness real[h, w], at least 0, and the camera pixels between its cells."""
    light = real_array(f"{owner} target", target)  # type: ignore[arg-type]
    if light.ndim != 2 or not light.size or max(light.shape) > _LARGEST:
        reject(f"{owner} target", f"an image of one to {_LARGEST} cells a side", light.shape,
               "Use fewer, coarser cells, and a longer target_step.")  # fmt: skip
    if not np.isfinite(light).all() or light.min() < 0 or not light.max() > 0:
        reject(f"{owner} target", "at least 0, and above 0 somewhere", light)
    rows, columns = (np.flatnonzero(light.any(axis)) for axis in (1, 0))
    light = light[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    lags = autocorrelation_of(torch.from_numpy(np.ascontiguousarray(light, np.float64))[None])[0]
    return Target(lags / lags.sum(), step, (light.shape[0], light.shape[1]))


def profile_of(
    target: Target, quick: Callable[[list[Target]], np.ndarray],
    fitted: Callable[[float, Fall], tuple[float, Fall, np.ndarray]],
    scatter: Callable[[np.ndarray, np.ndarray], float], tiles: int,
) -> RangeProfile:  # fmt: skip
    """Profile a range: coarsely with all but the brightness held, then anew about the best.

    Parameters
    ----------
    target
        What is photographed.
    quick
        Minus the logarithm of the likelihood of all tiles, of targets behind media, the grain held.
    fitted
        The same at a range, all other numbers fitted from a fall to start with; the fall, and the spectrum.
    scatter
        Variance of the tiles' ratios of likelihoods of two spectra over what the likelihood itself expects; at least 1.
    tiles
        How many there are.
    """
    tried = np.geomspace(_REACH[0] * target.step, _REACH[1] * target.extent, _STEPS)  # camera pixels
    first = np.array([quick([target.behind(reach, fall) for fall in _FALLS]) for reach in tried])
    costs, falls = first.min(1), [_FALLS[n] for n in first.argmin(1)]
    n = int(np.clip(costs.argmin(), 1, len(tried) - 2))
    fine = np.geomspace(tried[n - 1], tried[n + 1], _FINE)[1:-1]
    at = np.searchsorted(tried, fine)
    tried, costs = np.insert(tried, at, fine), np.insert(costs, at, np.full(len(fine), costs[n]))
    for place in at[::-1]:
        falls.insert(int(place), falls[n])
    spectra = {}
    for m in np.flatnonzero(costs < costs.min() + _LIKELY):
        costs[m], falls[m], spectra[m] = fitted(float(tried[m]), falls[m])
    best = int(np.argmin(costs))
    shares = {m: scatter(spectrum, spectra[best]) for m, spectrum in spectra.items() if m != best}
    nearest = [min(shares, key=lambda m, own=own: abs(m - own)) for own in range(len(tried))]
    spread = np.array([shares[m] for m in nearest])
    return RangeProfile(tried, tuple(falls), (costs.min() - costs) / spread, tiles)
