"""Scatterers: how the particles of a medium redistribute light.

A particle has an amplitude s(cos theta), complex in general, with the integral of |s|^2 over all directions
(4 pi, or 2 pi in flatland) equal to 1; its phase function is |s|^2. A :class:`Mixture` is several types of
particle side by side.
"""

import math
from typing import Annotated, Literal, NoReturn, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.values import UnitInterval, Value
from specklegen.scene.scatterers.closed_form import Dimensions, HenyeyGreenstein, Isotropic, VonMisesFisher
from specklegen.scene.scatterers.mie import Mie
from specklegen.scene.scatterers.tabulated import Tabulated

Particle = Isotropic | HenyeyGreenstein | VonMisesFisher | Tabulated | Mie


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

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> NoReturn:
        """Refuse: a mixture has a phase function, the mean of its types', but no one amplitude."""
        reject("Mixture.amplitude", "asked of one of its types", self.type, "Use mixture.types[n].amplitude(cos).")


Scatterer = Annotated[Particle | Mixture, Field(discriminator="type")]


def is_henyey_greenstein(scatterer: Particle | Mixture) -> bool:
    """Whether g says it all: what the fast slab engine, which knows this one lobe, can trace."""
    return isinstance(scatterer, Isotropic | HenyeyGreenstein)


def anisotropy_alone(scatterer: Particle | Mixture) -> float:
    """Return g of a scatterer that it describes fully.

    Raises
    ------
    RuleError
        For any other scatterer.
    """
    if not is_henyey_greenstein(scatterer):
        reject("Slab.scatterer", "Isotropic or HenyeyGreenstein for this engine", scatterer.type)
    return scatterer.g


def components(scatterer: Particle | Mixture) -> tuple[tuple[Particle, ...], tuple[float, ...]]:
    """Particle types of a scatterer and their shares of sigma_s."""
    return (scatterer.types, scatterer.fractions) if isinstance(scatterer, Mixture) else ((scatterer,), (1.0,))
