"""The phase function of von Mises and Fisher, the Gaussian of the sphere."""

import math
from typing import Literal

import numpy as np
from pydantic import Field
from scipy.special import i0e, i1e, ive

from specklegen.core.arguments import real_array
from specklegen.core.quadrature import gauss_legendre
from specklegen.scene.scatterers.scatterer import Dimensions, Row, _WithAnisotropy


class VonMisesFisher(_WithAnisotropy):
    """A phase function that is Gaussian where it is narrow: rho proportional to e^(kappa cos), in 3D and in flatland.

    The amplitude is its root, real and positive.

    Parameters
    ----------
    concentration
        kappa, about one over the variance of the angle along one axis; above 0 and at most 1e10: a narrower
        phase function has no room between the cosine's roundings.

    Examples
    --------
    >>> import specklegen as sg
    >>> narrow = sg.media.VonMisesFisher(concentration=100.0)
    >>> round(narrow.g, 3)
    0.99
    """

    type: Literal["VonMisesFisher"] = "VonMisesFisher"
    concentration: float = Field(gt=0, le=1e10, allow_inf_nan=False, kw_only=False)

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle, ``I_(d/2)(kappa) / I_(d/2 - 1)(kappa)`` of modified Bessel functions."""
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
        drop = 1 - real_array("amplitude cos", cos)
        return np.sqrt(self.forward_power(dimensions)) * np.exp(-0.5 * self.concentration * drop)

    def row(self, dimensions: Dimensions) -> Row:
        """Return what the kernels read: kappa, the power forward, and in flatland bins of theta."""
        parameters = (self.concentration, self.forward_power(dimensions))
        return Row("fisher", parameters, *(_bins(self.concentration) if dimensions == 2 else ()))


def _bins(concentration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bins of a von Mises phase function, up to the angle beyond which less than e^-100 of it is left.

    So narrow that five points of Gauss and Legendre find the place in a bin to 2e-14 (2e-11 for the last billionths of
    the light at either side).
    """
    nodes = np.linspace(0.0, 2 * math.asin(math.sqrt(min(1.0, 50 / concentration))), 129)
    x, w = gauss_legendre(12)
    theta = (nodes[:-1] + nodes[1:])[:, None] / 2 + np.diff(nodes)[:, None] / 2 * x
    sums = np.cumsum(np.append(0.0, np.exp(-2 * concentration * np.sin(theta / 2) ** 2) @ w))
    return nodes, np.zeros(nodes.size, np.complex128), sums / sums[-1]
