"""The coherent (mean) transmitted wave of a weakly scattering layer, and the bulk medium equivalent to it.

With c(u) the centred covariance of kappa, k the wave number in the background and L the thickness, the
second cumulant of the transmission of a layer gives

    ln <t> = -i k L <kappa>/2 - (k^2/4) int_0^L (L - u) c(u) [1 + e^{-2 i k u}] du                      (1)

Its real part is half an optical depth, |<t>| = e^{-OD/2}, of two parts: the variance V of the forward
phase, and the power that is scattered back,

    OD = (k^2/2) int_0^L (L - u) c(u) [1 + cos 2 k u] du,     OD/L -> sigma = (k^2/4) [S(0) + S(2k)]    (2)

for L >> L_c, S(q) = int c(u) cos(q u) du the power spectrum. sigma is a scattering coefficient: forward
scattering S(0) and backward S(2k) each take power from the coherent wave. For exponential correlation

    S(q) = 2 L_c [ a^2/(1 + q^2 L_c^2) + b^2/(1 + q^2 L_c^2/4) ].

The equivalent `Slab` of the engine has the thickness L, the mean free path 1/sigma and albedo 1; its mean
is e^{-OD/2} of the incident wave. Compare moduli only: the engine's mean free path knows no index, so the
phase of <t> beyond the background's (the mean index shift) is not in it.

(1) drops cumulants beyond the second. The forward phase is Gaussian up to the small quadratic part of kappa, so V may
be large, for any L/L_c; what limits (1) is rms_index/n_b (against the transfer matrix at ``OD = 2``: right within 1 %
up to 0.07; 4 % too large at 0.17 with ``L_c = 0.02`` for ``wavelength = 0.6``). (2), hence Beer's law, also needs L >>
L_c: the forward part falls short by L_c/L of itself, and a layer thinner than L_c is a random phase screen, OD = V ~
L^2, which has no equivalent slab. Only the mean at normal incidence is equivalent: a layer that varies along one axis
scatters into two directions, not into a speckle pattern.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from specklegen.core.arguments import real_number
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.units import WAVELENGTH
from specklegen.fdtd.currents import in_phase, out_of_phase
from specklegen.fdtd.layers import Moments, RandomLayer
from specklegen.fdtd.transfer_matrices import transfer_matrix

_BLOCK = 256
THICK = 20.0  # smallest L/L_c at which Beer's law is called valid: OD then falls short by 5 %
WEAK = 0.1  # largest rms_index/n_b at which the second cumulant is: OD then off by 2 %


@dataclass(frozen=True)
class CoherentTransmission:
    """Mean transmission amplitude over the incident wave at the exit face.

    Attributes
    ----------
    amplitude : complex
        <t>, over the wave that would be there without the layer.
    standard_error : float
        Root of E|mean - <t>|^2; 0 for the closed form, NaN for one realization.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, coherent_transmission
    >>> found = coherent_transmission(RandomLayer(correlation_length=0.02), wavelength=0.6)
    >>> round(found.optical_depth, 4), found.standard_error
    (0.0204, 0.0)
    """

    amplitude: complex
    standard_error: float

    @property
    def optical_depth(self) -> float:
        """Effective attenuation of the mean, -2 ln|<t>|."""
        return -2 * math.log(abs(self.amplitude))


@dataclass(frozen=True)
class EquivalentSlab:
    """A bulk scattering medium with the same coherent transmission, in the limit of `coherent`, Eq. 2.

    Attributes
    ----------
    thickness : float
        L, in the layer's unit of length.
    forward_coefficient, backward_coefficient : float
        sigma_f = k^2 S(0)/4 and sigma_b = k^2 S(2k)/4, 1/length.
    optical_depth_of_layer : float
        OD of the finite layer, Eq. 2 before the limit, on its grid.
    valid : bool
        Whether Beer's law with the sum of the two describes this layer.
    reason : str
        Why not; empty where it does.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, equivalent_slab
    >>> found = equivalent_slab(RandomLayer(correlation_length=0.02), wavelength=0.6)
    >>> found.valid, round(found.thickness, 3)
    (True, 3.0)
    """

    thickness: float
    forward_coefficient: float
    backward_coefficient: float
    optical_depth_of_layer: float
    valid: bool
    reason: str

    @property
    def scattering_coefficient(self) -> float:
        """The sum sigma_f + sigma_b, 1/length."""
        return self.forward_coefficient + self.backward_coefficient

    @property
    def mean_free_path(self) -> float:
        """1/sigma (inf without fluctuation)."""
        return 1 / self.scattering_coefficient if self.scattering_coefficient > 0 else math.inf

    @property
    def optical_depth(self) -> float:
        """OD = sigma L."""
        return self.scattering_coefficient * self.thickness


@with_units
def coherent_transmission(
    layer: RandomLayer, wavelength: Annotated[float, WAVELENGTH],
    method: Literal["cumulant", "transfer_matrix"] = "cumulant", *, n_realizations: int = 4000, seed: int = 0,
) -> CoherentTransmission:  # fmt: skip
    """Mean transmission of a plane wave of vacuum ``wavelength`` through the layer.

    Parameters
    ----------
    layer
        The layer: its grid, its background, and the law of its index.
    wavelength
        In vacuum, in the layer's unit of length.
    method : {"cumulant", "transfer_matrix"}
        Eq. 1 on the layer's grid, or the mean of the exact solution over ``n_realizations`` media.
    n_realizations
        Media of that mean, whose error falls with the root of their number.
    seed
        Of these media, a whole number.

    Raises
    ------
    RuleError
        If the grid has fewer than 8 cells a wavelength in the background, or a choice is unknown.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, coherent_transmission
    >>> found = coherent_transmission(RandomLayer(correlation_length=0.02), wavelength=0.6)
    >>> round(abs(found.amplitude), 4)
    0.9898
    """
    theta = _phase_per_cell(layer, wavelength)
    if method == "cumulant":
        return CoherentTransmission(complex(np.exp(_cumulants(layer, theta))), 0.0)
    if method != "transfer_matrix":
        reject("coherent_transmission.method", "one of 'cumulant', 'transfer_matrix'", method)
    if n_realizations < 1:
        reject("coherent_transmission.n_realizations", "at least 1", n_realizations)
    blocks = range(0, n_realizations, _BLOCK)
    media = (layer.sample(min(_BLOCK, n_realizations - first), seed, first) for first in blocks)
    draws = np.concatenate([transfer_matrix(kappa, theta)[1][:, 0] for kappa in media])
    error = math.sqrt(draws.var() / (n_realizations - 1)) if n_realizations > 1 else math.nan
    return CoherentTransmission(complex(draws.mean()), error)


@with_units
def equivalent_slab(layer: RandomLayer, wavelength: Annotated[float, WAVELENGTH]) -> EquivalentSlab:
    """Find the bulk medium that has the coherent transmission of ``layer``, and say whether there is one.

    Parameters
    ----------
    layer
        The layer: its grid, its background, and the law of its index.
    wavelength
        In vacuum, in the layer's unit of length.

    Raises
    ------
    RuleError
        If the grid has fewer than 8 cells a wavelength in the background.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, equivalent_slab
    >>> found = equivalent_slab(RandomLayer(correlation_length=0.02), wavelength=0.6)
    >>> round(found.mean_free_path, 1)
    146.4
    """
    theta = _phase_per_cell(layer, wavelength)
    k = 2 * math.pi * layer.n_background / wavelength
    forward, backward = (k**2 / 4 * _power_spectrum(layer, q) for q in (0.0, 2 * k))
    of_layer = -2 * float(_cumulants(layer, theta).real)
    reasons = []
    if layer.rms_index > 0 and layer.length < THICK * layer.correlation_length:
        reasons.append(f"thinner than {THICK:g} correlation lengths")
    if layer.rms_index > WEAK * layer.n_background:
        reasons.append(f"rms_index above {WEAK:g} of the background index")
    if layer.rms_index > 0 and layer.correlation_length < layer.dx:
        reasons.append("white from cell to cell: Eq. 2 does not resolve the grid")
    return EquivalentSlab(layer.length, forward, backward, of_layer, not reasons, "; ".join(reasons))


def _phase_per_cell(layer: RandomLayer, wavelength: float) -> np.ndarray:
    wavelength = real_number("wavelength", wavelength)
    if wavelength == math.inf:
        reject("wavelength", "finite", wavelength)
    if not wavelength >= 8 * layer.dx * layer.n_background:
        reject("wavelength", "at least 8 cells in the background", wavelength, "Use a smaller dx.")
    # at S = 1 the background of the grid has no dispersion
    return np.array([2 * math.pi * layer.n_background * layer.dx / wavelength])


def _cumulants(layer: RandomLayer, theta: np.ndarray) -> complex:
    """First and second cumulant of ln t on the grid: the sums of `currents` with the centred covariance."""
    moments = layer.moments()
    centred = Moments(np.zeros_like(moments.mean), moments.second - moments.mean[0] ** 2)
    g = -1j * np.tan(theta[0] / 2)
    pairs = in_phase(centred) + out_of_phase(centred, theta)[0]
    return g * moments.mean.sum() + g**2 * pairs.sum()


def _power_spectrum(layer: RandomLayer, q: float) -> float:
    """S(q) of the centred kappa; diverges for an infinite correlation length."""
    lc = layer.correlation_length
    a, b = 2 * layer.rms_index / layer.n_background, (layer.rms_index / layer.n_background) ** 2
    if math.isinf(lc):
        return math.inf if q == 0 and a > 0 else 0.0
    return 2 * lc * (a**2 / (1 + (q * lc) ** 2) + b**2 / (1 + (q * lc / 2) ** 2))
