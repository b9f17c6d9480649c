"""Scattering by particles far smaller than the wavelength: Lord Rayleigh, Phil. Mag. 41, 107 (1871)."""

from typing import Literal

import numpy as np

from specklegen.core.arguments import real_array
from specklegen.scene.scatterers.scatterer import Dimensions, _WithAnisotropy


class Rayleigh(_WithAnisotropy):
    """A particle far smaller than the wavelength: ``rho = 3 (1 + cos^2) / (16 pi)`` of unpolarised light.

    Its amplitudes are S1 = a, S2 = a cos: it sends nothing along the field. In flatland ``rho = (1 + cos^2) / (3 pi)``.

    Examples
    --------
    >>> import specklegen as sg
    >>> air = sg.media.Rayleigh()
    >>> (abs(air.amplitude([1.0, 0.0])) ** 2).round(4)  # per steradian
    array([0.1194, 0.0597])
    >>> air.g
    0.0
    """

    type: Literal["Rayleigh"] = "Rayleigh"

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle, in 3D or in flatland: 0."""
        return 0.0

    def shape(self, cos: np.ndarray, dimensions: Dimensions = 3) -> np.ndarray:
        """Amplitude of unpolarised light, up to a factor."""
        return np.sqrt(1 + np.square(cos))

    def amplitude_matrix(self, cos: np.ndarray | float) -> np.ndarray:
        """S1 and S2, complex128[2, ...], per root steradian."""
        cos = real_array("amplitude_matrix cos", cos)
        return np.sqrt(3 / (8 * np.pi)) * np.stack([np.ones_like(cos), cos]).astype(np.complex128)
