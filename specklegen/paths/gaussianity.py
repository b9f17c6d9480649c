"""Gaussianity of a field: number of contributions that it sums, and its kurtosis.

A field u of N paths, each with connections of contribution w_B and independent phases, has

    E|u|^4 / (E|u|^2)^2 - 2 = [ 2 Var w - E sum_B w_B^2 ] / (N (E w)^2),    w = sum_B w_B

which is 0 for circular Gaussian speckle: its contrast is then 1 and its intensity exponential (physics.md 2).
"""

from dataclasses import dataclass

import numpy as np

from specklegen.core.statistics import effective_count
from specklegen.paths.rare_paths import ENOUGH

TOLERANCE = 0.02
"""Kurtosis excess below which a stack counts as Gaussian: contrast^2 within 2 % of 1."""


@dataclass(frozen=True)
class Gaussianity:
    """Gaussianity of a stack, at the worst of a few lights and views.

    Attributes
    ----------
    contributions : float
        Effective number of contributions to a field, (sum w)^2 / sum w^2 over its connections; infinite where
        the field is drawn from Gaussian numbers, and 0 where phases are drawn and no Gaussian statistics are assumed.
    kurtosis_excess : float
        E|u|^4 / (E|u|^2)^2 - 2.
    """

    contributions: float
    kurtosis_excess: float

    @property
    def enough(self) -> bool:
        """True if the stack used enough paths to be Gaussian within ``TOLERANCE``."""
        return abs(self.kurtosis_excess) <= TOLERANCE

    def __str__(self) -> str:
        if np.isinf(self.contributions):
            return "Gaussian by construction."
        if not self.contributions:
            return "not Gaussian, as phases are drawn."
        decision = "enough paths to be Gaussian" if self.enough else "TOO FEW paths to be Gaussian: use more"
        return (
            f"{decision} (about {self.contributions:.3g} effective contributions to each field, kurtosis excess "
            f"{self.kurtosis_excess:+.2g})."
        )


EXACT, DRAWN = Gaussianity(np.inf, 0.0), Gaussianity(0.0, np.nan)


@dataclass(frozen=True)
class PathMoments:
    """Moments of one path's weights, at one light and view.

    Attributes
    ----------
    relative_variance : float
        Var w / (E w)^2 of the whole path.
    concentration : float
        E sum_B w_B^2 / (E w)^2.
    effective_paths : float
        How many of the paths carry the variance.
    """

    relative_variance: float
    concentration: float
    effective_paths: float = np.inf

    @classmethod
    def of(cls, weights: np.ndarray, paths: np.ndarray, count: int) -> "PathMoments":
        """Moments of connections of weight float64[M] on paths int64[M], of ``count`` paths traced."""
        seen, mean = _over_mean(weights, paths, count)
        if not mean > 0:
            return cls(0.0, 0.0)
        return cls(float(seen.var()), float(np.square(weights / mean).sum() / count), float(effective_count(seen - 1)))

    def stated(self) -> "PathMoments":
        """Return the excess, one standard error of the variance higher if fewer than ``ENOUGH`` paths carry it.

        Most samples have too few of rare paths, so that half of all variances would be understated, and by more than
        others are overstated.
        """
        if self.effective_paths >= ENOUGH:
            return self
        more = 1 + self.effective_paths**-0.5
        return PathMoments(self.relative_variance * more, self.concentration * more, self.effective_paths)

    @property
    def image_variance(self) -> float:
        """Excess correlation of intensities times N: (Var w, ``E w^2 - E sum_B w_B^2``) over ``(E w)^2``.

        The second part is speckle between the connections of one path, which share their entrance; at its most, for
        views within a grain of each other.
        """
        return self.relative_variance + max(0.0, self.relative_variance + 1 - self.concentration)

    def paths_for(self, rel_error: float, *, within_image: bool = False) -> int:
        """Return the paths that leave sqrt(Var w / (N (E w)^2)) at ``rel_error``, or the same within an image."""
        variance = self.image_variance if within_image else self.relative_variance
        return max(1, int(np.ceil(variance / rel_error**2)))

    def gaussianity(self, paths: int) -> Gaussianity:
        """Return the Gaussianity of a field of so many paths."""
        if self.concentration == 0:
            return EXACT
        excess = (2 * self.relative_variance - self.concentration) / paths
        return Gaussianity(paths / self.concentration, excess)


def relative_variance(weights: np.ndarray, paths: np.ndarray, count: int) -> float:
    """Return that of :meth:`PathMoments.of` alone, which tells the worst light and view."""
    seen, mean = _over_mean(weights, paths, count)
    return float(seen.var()) if mean > 0 else 0.0


def _over_mean(weights: np.ndarray, paths: np.ndarray, count: int) -> tuple[np.ndarray, float]:
    """Weights float64[count] of paths over their mean, before they are squared: that of faint light underflows."""
    whole = np.bincount(paths, weights, count)
    mean = float(whole.mean())
    return whole / mean if mean > 0 else whole, mean
