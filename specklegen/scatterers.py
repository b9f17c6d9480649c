"""Scatterers: how one particle redistributes light.

A particle has an amplitude s(cos theta), complex in general, with the integral of |s|^2 over all directions
(4 pi, or 2 pi in flatland) equal to 1; its phase function is |s|^2. A :class:`Mixture` is several types of
particle side by side.
"""

import math
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator
from scipy.special import i0e, i1e, ive

from specklegen.values import Positive, UnitInterval, Value, reject

Dimensions = Literal[2, 3]


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
        kappa, about one over the variance of the angle along one axis; greater than 0.
    """

    type: Literal["VonMisesFisher"] = "VonMisesFisher"
    concentration: Positive

    @property
    def g(self) -> float:
        """Anisotropy: mean cosine of the scattering angle in 3D, coth kappa - 1/kappa."""
        return self.mean_cosine(3)

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle: I_(d/2)(kappa) / I_(d/2 - 1)(kappa), I the modified Bessel function."""
        kappa = self.concentration
        if dimensions == 2:
            return float(i1e(kappa) / i0e(kappa))
        # coth kappa - 1/kappa cancels below 1, and its Bessel functions give out above 1e9.
        return float(ive(1.5, kappa) / ive(0.5, kappa)) if kappa < 1 else 1 / math.tanh(kappa) - 1 / kappa

    def forward_power(self, dimensions: Dimensions = 3) -> float:
        """Phase function at cos = 1, the highest."""
        kappa = self.concentration
        return 1 / (2 * math.pi * float(i0e(kappa) if dimensions == 2 else -math.expm1(-2 * kappa) / kappa))

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> np.ndarray:
        """Scattering amplitude s, per root steradian (root radian in 2D), at the cosine of the scattering angle."""
        drop = 1 - np.asarray(cos, dtype=np.float64)
        return np.sqrt(self.forward_power(dimensions)) * np.exp(-0.5 * self.concentration * drop)


Particle = Isotropic | HenyeyGreenstein | VonMisesFisher


class Mixture(Value):
    """Several types of particle in one medium, each scattering on its own.

    Types of fraction 0 are dropped, so that they change nothing, not even the fingerprint.

    Parameters
    ----------
    types
        The particle types; a mixture of mixtures is refused.
    fractions
        Share of each type in the scattering coefficient sigma_s; they sum to 1 (to 1e-9).
    """

    type: Literal["Mixture"] = "Mixture"
    types: tuple[Annotated[Particle, Field(discriminator="type")], ...] = Field(min_length=1)
    fractions: tuple[UnitInterval, ...]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(self.fractions) != len(self.types):
            reject("Mixture.fractions", f"one a type, {len(self.types)} in all", self.fractions)
        total = math.fsum(self.fractions)
        if abs(total - 1) > 1e-9:
            reject(
                "Mixture.fractions", "numbers that sum to 1 within 1e-9", self.fractions,
                f"They sum to {total:.12g}: divide them by that.",
            )  # fmt: skip
        present = [pair for pair in zip(self.types, self.fractions, strict=True) if pair[1] > 0]
        types, fractions = zip(*present, strict=True)
        self.__dict__.update(types=types, fractions=fractions)  # a frozen value, not yet handed out
        return self

    @property
    def g(self) -> float:
        """Anisotropy: mean cosine of the scattering angle in 3D."""
        return self.mean_cosine(3)

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle: the mean over the types, by their fractions."""
        return math.fsum(f * t.mean_cosine(dimensions) for t, f in zip(self.types, self.fractions, strict=True))

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> np.ndarray:
        """Refuse: a mixture has a phase function, the mean of its types', but no one amplitude."""
        reject("Mixture.amplitude", "asked of one of its types", self.type, "Use mixture.types[n].amplitude(cos).")


Scatterer = Annotated[Particle | Mixture, Field(discriminator="type")]


def all_directions(dimensions: Dimensions) -> float:
    """Measure of all directions: 4 pi in three dimensions, 2 pi in flatland."""
    return {2: 2 * math.pi, 3: 4 * math.pi}[dimensions]


def is_henyey_greenstein(scatterer: Particle | Mixture) -> bool:
    """Whether g says it all: what the fast slab engine, which knows this one lobe, can trace."""
    return isinstance(scatterer, Isotropic | HenyeyGreenstein)


def components(scatterer: Particle | Mixture) -> tuple[tuple[Particle, ...], tuple[float, ...]]:
    """Particle types of a scatterer and their shares of sigma_s."""
    return (scatterer.types, scatterer.fractions) if isinstance(scatterer, Mixture) else ((scatterer,), (1.0,))
