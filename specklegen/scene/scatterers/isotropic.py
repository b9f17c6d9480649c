"""Isotropic scattering, as of particles far smaller than the wavelength in scalar light."""

import math
from typing import Literal

import numpy as np

from specklegen.core.arguments import real_array
from specklegen.scene.scatterers.scatterer import Dimensions, Row, _WithAnisotropy, all_directions


class Isotropic(_WithAnisotropy):
    """A particle that scatters equally into all directions.

    Examples
    --------
    >>> import specklegen as sg
    >>> sg.media.Isotropic().g
    0.0
    """

    type: Literal["Isotropic"] = "Isotropic"

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle, in 3D or in flatland: 0."""
        return 0.0

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> np.ndarray:
        """Scattering amplitude s, per root steradian (root radian in 2D), at the cosine of the scattering angle."""
        return np.full_like(real_array("amplitude cos", cos), np.sqrt(1 / all_directions(dimensions)))

    def row(self, dimensions: Dimensions) -> Row:
        """Return what the kernels read: power and amplitude."""
        power = 1 / all_directions(dimensions)
        return Row("isotropic", (power, math.sqrt(power)))
