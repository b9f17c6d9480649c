"""Contrast of speckle that moves while a camera exposes it, from the classes of momentum transfer of its light.

    K^2(T) = 2 int_0^1 (1 - u) |g1(uT)|^2 du = sum_ab p_a p_b F(2 (Y_a + Y_b) x(T)),    F(y) = 2 (e^-y - 1 + y) / y^2

the second where x = k^2 <Dr^2(tau)> / 6 is in proportion to the lag (:mod:`specklegen.theory.speckle_contrast`). Of one
polarisation, one wavelength, and pixels far below a grain; what pixels and light leave of the contrast at rest, beta,
multiplies it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import real_array
from specklegen.core.display.plot import Pictured
from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.core.memory import require_memory
from specklegen.core.statistics import jackknife
from specklegen.paths.momentum import momentum_classes
from specklegen.scene.motion import Motion, reduced_time
from specklegen.theory.speckle_contrast import exposure_nodes

_EXPOSURE_BYTES = 8 * 2**20  # of one exposure: sums of 64 batches at its nodes, with their jackknife


@dataclass(frozen=True)
class ExposureContrast(Pictured):
    """Squared contrast of speckle over exposures.

    Attributes
    ----------
    exposures : float64[...]
        As asked for.
    x : float64[...]
        k^2 <Dr^2(T)> / 6, of the fastest particles: T / tau0 = D k^2 T of Brownian motion.
    squared : float64[...]
        K^2 = <I^2> / <I>^2 - 1 of the intensity over an exposure: 1 at rest.
    standard_error : float64[...]
        Of ``squared``, as of a :class:`specklegen.TemporalCorrelation`.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(
    ...     thickness=100.0, mean_free_path=10.0, scatterer=sg.Isotropic(), motion=sg.Brownian(diffusion=1.0)
    ... )
    >>> curve = sg.temporal_correlation(slab, wavelength=6.283185, lags=[0.0], paths=20_000)
    >>> curve.contrast([0.01, 0.05]).squared.round(2)  # T / tau0
    array([0.54, 0.18])
    """

    exposures: np.ndarray
    x: np.ndarray
    squared: np.ndarray
    standard_error: np.ndarray

    __repr__ = short

    @property
    def contrast(self) -> np.ndarray:
        """K float64[...]."""
        return np.sqrt(np.maximum(self.squared, 0.0))

    def _facts(self) -> Mapping[str, object]:
        return {
            "exposures": f"{self.exposures.size}, up to {self.exposures.max(initial=0.0):.4g}",
            "K^2": f"{self.squared.min(initial=1.0):.4g} to {self.squared.max(initial=0.0):.4g}",
            "largest standard error": float(self.standard_error.max(initial=0.0)),
        }

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """K^2 over the exposure, with bars of two standard errors."""
        order = np.argsort(self.exposures, axis=None)
        exposures, found, bars = (a.ravel()[order] for a in (self.exposures, self.squared, 2 * self.standard_error))
        axes.errorbar(exposures, found, bars, fmt="o-", ms=3, lw=1, label=label)
        axes.set(xlabel="exposure", ylabel=r"$K^2$", xscale="log", yscale="log")
        axes.grid(alpha=0.3)


@dataclass(frozen=True)
class LightClasses:
    """Light by the momentum that it gave to what moves, so finely that nobody sees the classes.

    Attributes
    ----------
    shares : float64[batches, C]
        Intensity of each class in independent batches of paths; where both ways of paths interfere, what it adds to
        the intensity, which may be below 0.
    transfer : float64[C]
        Y of each class.
    motion : Motion or None
        The fastest; None where all rests.
    wavelength : float
    """

    shares: np.ndarray
    transfer: np.ndarray
    motion: Motion | None
    wavelength: float

    __repr__ = short

    def reduced_time(self, field: str, times: np.ndarray) -> np.ndarray:
        """X of times, float64[...]."""
        return 0.0 * times if self.motion is None else reduced_time(field, self.motion, self.wavelength, times)

    def contrast(self, owner: str, exposures: ArrayLike) -> ExposureContrast:
        """K^2 of exposures float64[...], for the method that owns it."""
        field = f"{owner} exposures"
        asked = np.atleast_1d(real_array(field, exposures))
        if not (np.isfinite(asked).all() and (asked >= 0).all()):
            reject(field, "at least 0", asked)
        require_memory(field, "held", _EXPOSURE_BYTES * asked.size, f"{asked.size} exposures", "Ask for fewer at once.")
        u, weight = exposure_nodes()
        powers = [self.shares @ np.exp(-2 * np.outer(self.transfer, self.reduced_time(field, time * u)))
                  for time in asked.ravel()]  # fmt: skip
        sums = np.concatenate([*powers, self.shares.sum(axis=1, keepdims=True)], axis=1)

        def squared(total: np.ndarray) -> np.ndarray:
            return np.square(total[:-1] / total[-1]).reshape(-1, len(u)) @ weight

        with np.errstate(invalid="ignore", divide="ignore"):  # of light that there is none of
            value, error = jackknife(sums, squared)
        return ExposureContrast(
            asked, self.reduced_time(field, asked), value.reshape(asked.shape), error.reshape(asked.shape)
        )  # fmt: skip


def light_classes(
    weights: np.ndarray, transfer: np.ndarray, batch: np.ndarray, batches: int, motion: Motion | None, wavelength: float
) -> LightClasses:
    """Classes of light of weights float64[M], also below 0, that gave the momentum float64[M], in batches int64[M]."""
    bins = momentum_classes(transfer)
    there, number = np.unique(bins, return_inverse=True)
    size = np.bincount(number, np.abs(weights), len(there))
    mean = np.bincount(number, np.abs(weights) * transfer, len(there))
    transfer = np.divide(mean, size, where=size > 0, out=np.zeros(len(there)))
    shares = np.bincount(batch * len(there) + number, weights, batches * len(there)).reshape(batches, len(there))
    return LightClasses(shares, transfer, motion, wavelength)
