"""Henyey and Greenstein's phase function: Astrophysical Journal 93, 70 (1941)."""

import math
from typing import Literal

import numpy as np
from pydantic import Field, field_validator

from specklegen.core.arguments import real_array
from specklegen.core.errors import reject
from specklegen.scene.scatterers.scatterer import Dimensions, Row, Scatterer, all_directions


class HenyeyGreenstein(Scatterer):
    """Henyey and Greenstein's phase function, ``rho = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2))``.

    In flatland its counterpart of the same mean cosine, ``rho = (1 - g^2) / (2 pi (1 + g^2 - 2 g cos))``. The amplitude
    is its root, real and positive.

    Parameters
    ----------
    g
        Anisotropy, the mean cosine of the scattering angle; -1 < g < 1.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> tissue = sg.media.HenyeyGreenstein(0.9)
    >>> np.abs(tissue.amplitude([1.0, 0.0, -1.0])).round(3)  # at cosines of the scattering angle
    array([3.888, 0.079, 0.047])
    """

    type: Literal["HenyeyGreenstein"] = "HenyeyGreenstein"
    g: float = Field(kw_only=False)

    @field_validator("g")
    @classmethod
    def _open_interval(cls, g: float) -> float:
        if not -1 < g < 1:
            reject(
                "HenyeyGreenstein.g",
                "between -1 and 1, both excluded",
                g,
                "With g = 1 light does not scatter: use a longer mean free path. Fog has at most 0.999.",
            )
        return g

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle, in 3D or in flatland: g."""
        return self.g

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> np.ndarray:
        """Scattering amplitude s, per root steradian (root radian in 2D), at the cosine of the scattering angle."""
        g, sign = abs(self.g), math.copysign(1.0, self.g)
        base = (1 - g) ** 2 + 2 * g * (1 - sign * real_array("amplitude cos", cos))
        return np.sqrt((1 - g**2) / (all_directions(dimensions) * base ** (dimensions / 2)))

    def row(self, dimensions: Dimensions) -> Row:
        """Return what the kernels read: g."""
        return Row("henyey", (self.g, 0.0))
