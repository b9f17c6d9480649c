"""Contrast of speckle that moves while a camera exposes it, from the classes of momentum transfer of its light.

    K^2(T) = 2 int_0^1 (1 - u) |g1(uT)|^2 du = sum_ab p_a p_b F(2 (Y_a + Y_b) x(T)),    F(y) = 2 (e^-y - 1 + y) / y^2

the second where ``x = k^2 <Dr^2(tau)> / 6`` is in proportion to the lag (:mod:`specklegen.theory.speckle_contrast`). Of
one polarisation, one wavelength, and pixels far below a grain; what pixels and light leave of the contrast at rest,
beta, multiplies it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import array_from_zero
from specklegen.core.display.plot import Pictured, draw_curve
from specklegen.core.display.repr import short
from specklegen.core.labelled import Labelled, Labels
from specklegen.core.memory import require_memory
from specklegen.core.statistics import jackknife
from specklegen.paths.momentum import momentum_classes
from specklegen.scene.motion import Motion, reduced_time
from specklegen.theory.speckle_contrast import exposure_nodes

_EXPOSURE_BYTES = 8 * 2**20  # of one exposure: sums of 64 batches at its nodes, with their jackknife


@dataclass(frozen=True, repr=False)
class ExposureContrast(Pictured, Labelled):
    """Squared contrast of speckle over exposures.

    Attributes
    ----------
    exposures : float64[...]
        How long the camera looks, in the unit of time of the motion.
    x : float64[...]
        k^2 <Dr^2(T)> / 6, of the fastest particles: T / tau0 = D k^2 T of Brownian motion.
    squared : float64[...]
        K^2 = <I^2> / <I>^2 - 1 of the intensity over an exposure: 1 at rest.
    standard_error : float64[...]
        Of ``squared``, as of a :class:`specklegen.results.TemporalCorrelation`.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(
    ...     thickness=100.0, mean_free_path=10.0, scatterer=sg.media.Isotropic(),
    ...     motion=sg.media.Brownian(diffusion=1.0)
    ... )
    >>> curve = sg.statistics.temporal_correlation(slab, wavelength=6.283185, lags=[0.0], paths=20_000)
    >>> curve.contrast([0.01, 0.05]).squared.round(2)  # T / tau0
    array([0.54, 0.18])
    """

    exposures: np.ndarray
    x: np.ndarray
    squared: np.ndarray
    standard_error: np.ndarray

    _named = {"exposures": "exposures", "K^2": "squared", "standard error": "standard_error"}

    @property
    def contrast(self) -> np.ndarray:
        """K float64[...]."""
        return np.sqrt(np.maximum(self.squared, 0.0))

    def _arrays(self) -> Mapping[str, Labels]:
        along = ("exposures",) if self.exposures.ndim == 1 else tuple(f"axis_{n}" for n in range(self.exposures.ndim))
        return {
            "exposures": Labels(along, self.exposures, "time of the motion", coordinate=True),
            "x": Labels(along, self.x, coordinate=True), "squared": Labels(along, self.squared),
            "standard_error": Labels(along, self.standard_error),
        }  # fmt: skip

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """K^2 over the exposure, with bars of two standard errors."""
        order = np.argsort(self.exposures, axis=None)
        exposures, squared, error = (a.ravel()[order] for a in (self.exposures, self.squared, self.standard_error))
        scales = {"xscale": "log", "yscale": "log"}
        draw_curve(axes, exposures, squared, error, label, xlabel="exposure", ylabel=r"$K^2$", **scales)


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
    """

    shares: np.ndarray
    transfer: np.ndarray
    motion: Motion | None
    wavelength: float

    __repr__ = short

    @property
    def weights(self) -> np.ndarray:
        """Shares float64[C] of a single batch."""
        return self.shares[0]

    def reduced_time(self, field: str, times: np.ndarray) -> np.ndarray:
        """X of times, float64[...]."""
        return 0.0 * times if self.motion is None else reduced_time(field, self.motion, self.wavelength, times)

    def fields(self, field: str, times: np.ndarray) -> np.ndarray:
        """Sums over the light of what is left of its field at times float64[n], of each batch, real[batches, n]."""
        return self.shares @ np.exp(-2 * np.outer(self.transfer, self.reduced_time(field, times)))

    def contrast(self, owner: str, exposures: ArrayLike) -> ExposureContrast:
        """K^2 of exposures float64[...], for the method that owns it."""
        return _contrast(self, self.shares.sum(axis=1, keepdims=True), owner, exposures)


@dataclass(frozen=True)
class LightPaths:
    """Light of particles that flow, path by path: phases that have turned often are no classes.

    Attributes
    ----------
    weights, transfer, doppler : float64[M]
        Intensity, momentum transfer Y and Doppler shift D of each connection.
    batch : int64[M]
        Its batch of independent paths.
    motion, wavelength
        As of :class:`LightClasses`.
    """

    weights: np.ndarray
    transfer: np.ndarray
    doppler: np.ndarray
    batch: np.ndarray
    batches: int
    motion: Motion | None
    wavelength: float

    __repr__ = short

    def reduced_time(self, field: str, times: np.ndarray) -> np.ndarray:
        """X of times, float64[...]."""
        return 0.0 * times if self.motion is None else reduced_time(field, self.motion, self.wavelength, times)

    def fields(self, field: str, times: np.ndarray) -> np.ndarray:
        """Sums over the light of what is left of its field at times float64[n], of each batch, complex[batches, n]."""
        k, sums = 2 * np.pi / self.wavelength, np.empty((len(times), self.batches), np.complex128)
        for n, (x, time) in enumerate(zip(self.reduced_time(field, times), times, strict=True)):
            left = self.weights * np.exp(-2 * x * self.transfer - 1j * k * time * self.doppler)
            sums[n] = np.bincount(self.batch, left.real, self.batches)
            sums[n] += 1j * np.bincount(self.batch, left.imag, self.batches)
        return sums.T

    def contrast(self, owner: str, exposures: ArrayLike) -> ExposureContrast:
        """K^2 of exposures float64[...], for the method that owns it."""
        return _contrast(self, np.bincount(self.batch, self.weights, self.batches)[:, None], owner, exposures)


def _contrast(light: LightClasses | LightPaths, lit: np.ndarray, owner: str, exposures: ArrayLike) -> ExposureContrast:
    """K^2 of exposures float64[...] of light whose batches sum up to float64[batches, 1]."""
    field = f"{owner} exposures"
    asked = np.atleast_1d(array_from_zero(field, exposures, finite=True))
    require_memory(field, "held", _EXPOSURE_BYTES * asked.size, f"{asked.size} exposures", "Use fewer at a time.")
    u, weight = exposure_nodes()
    sums = np.concatenate([*(light.fields(field, time * u) for time in asked.ravel()), lit], axis=1)

    def squared(total: np.ndarray) -> np.ndarray:
        return np.square(np.abs(total[:-1] / total[-1])).reshape(-1, len(u)) @ weight

    with np.errstate(invalid="ignore", divide="ignore"):  # of light that there is none of
        value, error = jackknife(sums, squared)
    x = light.reduced_time(field, asked)
    return ExposureContrast(asked, x, value.reshape(asked.shape), error.reshape(asked.shape))


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
