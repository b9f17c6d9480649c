"""Particles with a phase function in closed form, whose amplitude s is its square root: real and positive."""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator
from scipy.special import i0e, i1e, ive

from specklegen.core.errors import reject
from specklegen.core.values import Value

Dimensions = Literal[2, 3]


def all_directions(dimensions: Dimensions) -> float:
    """Measure of all directions: 4 pi in three dimensions, 2 pi in flatland."""
    if dimensions not in (2, 3):
        reject("dimensions", "2 or 3", dimensions)
    return 2 * math.pi * (dimensions - 1)


class Isotropic(Value):
    """A particle that scatters equally into all directions."""

    type: Literal["Isotropic"] = "Isotropic"

    @property
    def g(self) -> float:
        """Anisotropy: mean cosine of the scattering angle."""
        return 0.0

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle, in 3D or in flatland."""
        return 0.0

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> np.ndarray:
        """Scattering amplitude s, per root steradian (root radian in 2D), at the cosine of the scattering angle."""
        return np.full_like(np.asarray(cos, dtype=np.float64), np.sqrt(1 / all_directions(dimensions)))


class HenyeyGreenstein(Value):
    """Henyey and Greenstein's phase function, rho = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2)).

    In flatland its counterpart of the same mean cosine, rho = (1 - g^2) / (2 pi (1 + g^2 - 2 g cos)).

    Parameters
    ----------
    g
        Anisotropy, the mean cosine of the scattering angle; -1 < g < 1.
    """

    type: Literal["HenyeyGreenstein"] = "HenyeyGreenstein"
    g: float

    @field_validator("g")
    @classmethod
    def _open_interval(cls, g: float) -> float:
        if not -1 < g < 1:
            reject(
                "HenyeyGreenstein.g",
                "between -1 and 1, both excluded",
                g,
                "g = 1 would not scatter at all: use a longer mean free path; 0.999 is as forward as fog gets.",
            )
        return g

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle, in 3D or in flatland: g."""
        return self.g

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> np.ndarray:
        """Scattering amplitude s, per root steradian (root radian in 2D), at the cosine of the scattering angle."""
        g, sign = abs(self.g), math.copysign(1.0, self.g)
        base = (1 - g) ** 2 + 2 * g * (1 - sign * np.asarray(cos, dtype=np.float64))
        return np.sqrt((1 - g**2) / (all_directions(dimensions) * base ** (dimensions / 2)))


class VonMisesFisher(Value):
    """A lobe that is Gaussian where it is narrow: rho proportional to e^(kappa cos), in 3D and in flatland.

    Parameters
    ----------
    concentration
        kappa, about one over the variance of the angle along one axis; above 0 and at most 1e10: a narrower
        lobe has no room between the cosine's roundings.
    """

    type: Literal["VonMisesFisher"] = "VonMisesFisher"
    concentration: Annotated[float, Field(gt=0, le=1e10, allow_inf_nan=False)]

    @property
    def g(self) -> float:
        """Anisotropy: mean cosine of the scattering angle in 3D, coth kappa - 1/kappa."""
        return self.mean_cosine(3)

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle: I_(d/2)(kappa) / I_(d/2 - 1)(kappa), I the modified Bessel function."""
        kappa = self.concentration
        if dimensions == 2:
            return float(i1e(kappa) / i0e(kappa))
        # coth kappa - 1/kappa cancels below 1, and SciPy's Bessel functions of half order give out above 1e9.
        return float(ive(1.5, kappa) / ive(0.5, kappa)) if kappa < 1 else 1 / math.tanh(kappa) - 1 / kappa

    def forward_power(self, dimensions: Dimensions = 3) -> float:
        """Phase function at cos = 1, the highest."""
        kappa = self.concentration
        return 1 / (2 * math.pi * float(i0e(kappa) if dimensions == 2 else -math.expm1(-2 * kappa) / kappa))

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> np.ndarray:
        """Scattering amplitude s, per root steradian (root radian in 2D), at the cosine of the scattering angle."""
        drop = 1 - np.asarray(cos, dtype=np.float64)
        return np.sqrt(self.forward_power(dimensions)) * np.exp(-0.5 * self.concentration * drop)
