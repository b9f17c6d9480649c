"""Scatterers: how one particle redistributes light.

A scatterer has a complex amplitude s(cos theta) with integral of |s|^2 over the sphere equal to 1; the
phase function is |s|^2.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator

from specklegen.values import Value, reject


class Isotropic(Value):
    """A particle that scatters equally into all directions."""

    type: Literal["Isotropic"] = "Isotropic"

    @property
    def g(self) -> float:
        """Anisotropy: mean cosine of the scattering angle."""
        return 0.0

    def amplitude(self, cos: np.ndarray | float) -> np.ndarray:
        """Scattering amplitude s, per root steradian, at the cosine of the scattering angle."""
        return np.full_like(np.asarray(cos, dtype=np.float64), np.sqrt(1 / (4 * np.pi)))


class HenyeyGreenstein(Value):
    """Henyey and Greenstein's phase function, rho = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2)).

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

    def amplitude(self, cos: np.ndarray | float) -> np.ndarray:
        """Scattering amplitude s, per root steradian, at the cosine of the scattering angle."""
        base = (1 - self.g) ** 2 + 2 * self.g * (1 - np.asarray(cos, dtype=np.float64))
        return np.sqrt((1 - self.g**2) / (4 * np.pi * base * np.sqrt(base)))


Scatterer = Annotated[Isotropic | HenyeyGreenstein, Field(discriminator="type")]
