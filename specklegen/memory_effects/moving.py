"""The memory effect of a slab on the axis in time: K(q, x) as what it is, a joint distribution of r and Y.

    K(q, x) = E[w J0(q r) e^(-2 x Y)] / E[w],     g1 = K(0, x),     x = k^2 <Dr^2(tau)> / 6

r the lateral distance of a path and Y the momentum that it gives to what moves (:mod:`specklegen.paths.momentum`).
Paths that wander far scatter often, so that K(q, x) is not K(q) g1(x). Whatever the bins, it is a mixture of products
of correlations, so positive semidefinite over any beams and times.
"""

from dataclasses import dataclass

import numpy as np

from specklegen.core.random_streams import Seed
from specklegen.memory_effects.correlation import axial_tracer, lateral_distance
from specklegen.paths.analog_walk import axial_light
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.momentum import geometric_classes, momentum_transfer
from specklegen.paths.steps import refracting_layers
from specklegen.scene.media import Slab

_BINS = 257  # of either: 6 % wide, so that the mean Y of a bin for that of each path is 1e-4 off in g1, and r in K
_LEAST, _MOST = -80.0, 80.0  # logarithms of x times the mean Y between which a root is looked for


@dataclass(frozen=True)
class MovingCorrelation:
    """K(q, x) of a slab whose particles move.

    Attributes
    ----------
    radius : float64[m]
        Root mean square lateral distance of each bin; 0 for single scattering.
    transfer : float64[n]
        Mean momentum transfer Y of each bin; 0 of the first one, which nothing moves.
    joint : float64[m, n]
        Share of the light by both, of sum 1.
    """

    radius: np.ndarray
    transfer: np.ndarray
    joint: np.ndarray

    def shares(self, x: np.ndarray) -> np.ndarray:
        """Shares float64[n, m] of the light, by bins of r, that are left at x float64[n]: K(q, x) = shares J0(q r).

        At infinity those of what nothing moves.
        """
        return self._left(x) @ self.joint.T

    def field(self, x: np.ndarray) -> np.ndarray:
        """g1 float64[...] at x float64[...]."""
        return self._left(x) @ self.joint.sum(axis=0)

    def _left(self, x: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):  # of an endless time at rest
            return np.exp(-2 * np.where(self.transfer > 0, np.asarray(x)[..., None] * self.transfer, 0.0))

    @property
    def static_share(self) -> float:
        """Share of the light whose paths nothing moves."""
        return float(self.joint[:, 0].sum())

    def decay(self, level: float = np.exp(-1)) -> float:
        """X at which g1 falls to a level; inf where what rests keeps it above."""
        from scipy.optimize import root_scalar  # which takes longer to load than it is used for

        if self.static_share >= level:
            return np.inf
        mean = self.transfer @ self.joint.sum(axis=0)
        above = lambda log_x: float(self.field(np.exp(log_x) / mean)) - level  # noqa: E731
        return float(np.exp(root_scalar(above, bracket=(_LEAST, _MOST), xtol=1e-12).root) / mean)


def estimate_moving_correlation(
    medium: Slab, paths: int, seed: Seed, *, threads: int | None = None
) -> MovingCorrelation:
    """Estimate K(q, x) of a slab or layers that move, in transmission along the axis, from ``paths`` paths.

    With the seed of :func:`estimate_correlation` it is made from the same paths. Neither wavelength nor diffusion
    decides anything: q r and x Y do. Of layers the fastest has the Y of its paths, others that times their speed
    beside it.
    """
    if refracting_layers(medium):
        light = axial_light(medium, paths, seed, threads)
        weight, radius, turned = light.weight, np.hypot(*light.displacement.T), light.transfer
    else:
        tracer = axial_tracer(medium, True)
        bank = tracer.trace(seed, paths, threads=threads)
        weight, radius = contributions(tracer.layout, bank), lateral_distance(bank)
        turned = momentum_transfer(tracer.layout, bank)
    far, often = geometric_classes(radius, _BINS), geometric_classes(turned, _BINS)
    joint = np.bincount(far * _BINS + often, weight, _BINS**2).reshape(_BINS, _BINS)
    mean = lambda sums, weights: np.divide(sums, weights, out=np.zeros(_BINS), where=weights > 0)  # noqa: E731
    return MovingCorrelation(
        radius=np.sqrt(mean(np.bincount(far, weight * radius**2, _BINS), joint.sum(axis=1))),
        transfer=mean(np.bincount(often, weight * turned, _BINS), joint.sum(axis=0)),
        joint=joint / max(joint.sum(), 1e-300),
    )
