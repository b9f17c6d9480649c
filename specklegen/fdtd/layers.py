"""Random layers with exponentially correlated index, and the moments of their permittivity.

The index is n(x) = n_b + sigma_n g(x), g a stationary Gaussian process with <g g'> = exp(-|x - x'|/L_c): on a grid
exactly the autoregression AR(1). The scattering potential is ``kappa = (n/n_b)^2 - 1 = a g + b g^2``, with
``a = 2 sigma_n/n_b`` and ``b = sigma_n^2/n_b^2``, hence

    <kappa> = b,        <kappa kappa'> = a^2 rho + b^2 (1 + 2 rho^2),        rho = exp(-|x - x'|/L_c).

<kappa> is not zero although <n> = n_b: the first Born order is O(sigma^2), like the second.

Lengths in one unit (the examples use micrometres). [Tan13] Tan, Taflove, Backman.
"""

import math
import warnings
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.arguments import finite_numbers
from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.core.units import LENGTH
from specklegen.core.values import NonNegative, Positive, PositiveInt, Value
from specklegen.kernels.fdtd import correlated_normals

_STREAM = 0x1DF5  # keeps these draws apart from every other use of the same seed


@dataclass(frozen=True)
class Moments:
    """First and second moments of kappa over the N cells of a layer.

    Attributes
    ----------
    mean : float64[N]
        <kappa_m>.
    second : float64[N] or float64[N, N]
        <kappa_m kappa_k>, not centred: by lag |m - k| where the layer is stationary, else in full.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer
    >>> moments = RandomLayer(correlation_length=0.02).moments()
    >>> moments.mean.shape
    (1500,)
    """

    mean: np.ndarray
    second: np.ndarray

    __repr__ = short


class RandomLayer(Value):
    """A layer of ``n_points`` cells with a Gaussian index of exponential correlation in a uniform background.

    Parameters
    ----------
    n_background
        Index around the layer, and the mean index inside.
    n_points
        Cells of the layer: its thickness is ``n_points * dx``.
    dx
        Width of a cell, in the unit of all lengths; at most an eighth of the wavelength in the background.
    rms_index
        Standard deviation sigma_n of the index.
    correlation_length
        L_c, in the same unit; 0 is white from cell to cell, inf one index for the whole layer.
    correlation
        Law of the correlation: "exponential" is the one there is.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer
    >>> layer = RandomLayer(correlation_length=0.02)
    >>> round(layer.length, 6)
    3.0
    >>> layer.sample(2, seed=0).shape
    (2, 1500)
    """

    n_background: Positive = 1.45
    n_points: PositiveInt = 1500
    dx: Annotated[Positive, LENGTH] = 0.002
    rms_index: NonNegative = 0.03
    correlation_length: Annotated[Annotated[float, Field(ge=0)], LENGTH]
    correlation: Literal["exponential"] = "exponential"

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.rms_index < self.n_background:
            reject("RandomLayer.rms_index", f"less than n_background = {self.n_background:g}", self.rms_index)
        if self.correlation_length < self.dx and self.rms_index > 0:
            warnings.warn(
                f"RandomLayer.correlation_length = {self.correlation_length:g} is below dx = {self.dx:g}: "
                "the layer is white from cell to cell, and what it scatters depends on dx (rms_index^2 dx).",
                stacklevel=4,
            )
        return self

    @property
    def length(self) -> float:
        """Thickness, n_points dx."""
        return self.n_points * self.dx

    @property
    def step_correlation(self) -> float:
        """Correlation rho of the index between neighbouring cells."""
        return math.exp(-self.dx / self.correlation_length) if self.correlation_length > 0 else 0.0

    def index_correlation(self) -> np.ndarray:
        """Correlation of the index by lag, float64[N]."""
        lags = np.arange(self.n_points) * self.dx
        if self.correlation_length == 0:
            return (lags == 0).astype(float)
        return np.exp(-lags / self.correlation_length)

    def sample(self, n: int, seed: int, first: int = 0) -> np.ndarray:
        """Draw realizations ``first`` to ``first + n - 1`` of kappa = (n/n_b)^2 - 1, float64[n, N].

        Realization r is a pure function of (layer, seed, r), whatever ``n`` and ``first``.
        """
        if n < 1:
            reject("RandomLayer.sample.n", "at least 1", n)
        if first < 0:
            reject("RandomLayer.sample.first", "at least 0", first)
        key0, key1 = np.random.SeedSequence([seed, _STREAM]).generate_state(2).astype(np.uint64)
        g = np.empty((n, self.n_points))
        lc = self.correlation_length
        innovation = math.sqrt(-math.expm1(-2 * self.dx / lc)) if lc > 0 else 1.0
        correlated_normals(key0, key1, first, self.step_correlation, innovation, g)
        scale = self.rms_index / self.n_background
        if 1 + scale * g.min() <= 0:
            reject("RandomLayer.rms_index", "small enough that every index drawn is positive", self.rms_index,
                   f"The smallest index drawn is {self.n_background * (1 + scale * g.min()):.3g}.")  # fmt: skip
        g *= scale
        return g * (2 + g)

    def moments(self) -> Moments:
        """Exact moments of kappa, the second by lag (see the head of this module)."""
        a, b = 2 * self.rms_index / self.n_background, (self.rms_index / self.n_background) ** 2
        rho = self.index_correlation()
        return Moments(np.full(self.n_points, b), a**2 * rho + b**2 * (1 + 2 * rho**2))


def sample_moments(kappa: np.ndarray) -> Moments:
    """Moments of a sample of media float64[R, N], the second in full (N x N): no stationarity assumed.

    Parameters
    ----------
    kappa : float64[R, N]
        The media, a row each: kappa = (n/n_b)^2 - 1 in every cell.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, sample_moments
    >>> sample_moments(RandomLayer(correlation_length=0.02, n_points=50).sample(8, seed=0)).second.shape
    (50, 50)
    """
    kappa = finite_numbers("sample_moments kappa", kappa, 2)
    if not kappa.size:
        reject("sample_moments kappa", "at least one medium of at least one cell", kappa.shape)
    return Moments(kappa.mean(axis=0), kappa.T @ kappa / len(kappa))
