"""Several types of particle side by side in one medium."""

import math
from typing import Literal, NoReturn, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.values import UnitInterval
from specklegen.scene.scatterers.scatterer import AnyScatterer, Dimensions, Row, Scatterer, _WithAnisotropy


class Mixture(_WithAnisotropy):
    """Several types of particle in one medium, each scattering on its own.

    Types of fraction 0 are dropped, so that they change nothing, not even the fingerprint.

    Parameters
    ----------
    types
        The particle types; a mixture of mixtures is refused.
    fractions
        Share of each type in the scattering coefficient sigma_s; they sum to 1 (to 1e-9).

    Examples
    --------
    >>> import specklegen as sg
    >>> both = sg.media.Mixture(types=[sg.media.HenyeyGreenstein(0.9), sg.media.Isotropic()], fractions=[0.75, 0.25])
    >>> round(both.g, 3)
    0.675
    """

    type: Literal["Mixture"] = "Mixture"
    types: tuple[AnyScatterer, ...] = Field(min_length=1)
    fractions: tuple[UnitInterval, ...]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if any(isinstance(each, Mixture) for each in self.types):
            reject("Mixture.types", "types of particle, none of them a Mixture", self.types,
                   "List the types of the inner mixture.")
        if len(self.fractions) != len(self.types):
            reject("Mixture.fractions", f"one for each of the {len(self.types)} types", self.fractions)
        total = math.fsum(self.fractions)
        if abs(total - 1) > 1e-9:
            reject("Mixture.fractions", "numbers that sum to 1 within 1e-9", self.fractions,
                   f"They sum to {total:.12g}: divide them by this number.")  # fmt: skip
        present = [pair for pair in zip(self.types, self.fractions, strict=True) if pair[1] > 0]
        types, fractions = zip(*present, strict=True)
        self.__dict__.update(types=types, fractions=fractions)  # a frozen value, not yet handed out
        return self

    @property
    def components(self) -> tuple[tuple[Scatterer, float], ...]:
        """Types of particle, and their shares of sigma_s."""
        return tuple(zip(self.types, self.fractions, strict=True))

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle: the mean over the types, by their fractions."""
        return math.fsum(share * each.mean_cosine(dimensions) for each, share in self.components)

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> NoReturn:
        """Refuse: a mixture has a phase function, the mean of its types', but no one amplitude."""
        reject("Mixture.amplitude", "computed for one of its types", self.type, "Use mixture.types[n].amplitude(cos).")

    def row(self, dimensions: Dimensions) -> Row:
        """Refuse: its types have one each."""
        reject("Mixture.row", "computed for one of its types", self.type, "Use mixture.types[n].row(dimensions).")
