"""When the mean field of a low Born order may be believed.

The index fluctuation along the layer gives a transmitted wave the phase k0 int dn dx, of variance

    V = k0^2 sigma_n^2 dx^2 sum_mk rho_mk    (= 2 k0^2 sigma_n^2 [L_c L - L_c^2 (1 - e^{-L/L_c})], L_c >> dx)

Forward, the mean is ``e^{-V/2}`` and second order keeps ``1 - V/2``: the relative error of the scattered field is the
next term over the one before, V/4. Back, an echo from depth x loses e^{-2 V(x)} on its way in and out, which second
order leaves out altogether; over the layer the error of the mean is close to ``3 V`` (measured, within a factor of 2.1,
for the reference layer and pulse and any V below 0.9). So the back direction fails at a twelfth of the phase variance.

A pulse is judged by V at the root mean square wave number of its scattered field of second order, k^4
times its own power spectrum: a pulse without carrier is then rightly judged by its low frequencies.

First order alone is judged by what it leaves out: the second order, of the same power of sigma_n.
"""

import warnings
from typing import Annotated

import numpy as np

from specklegen.core.arguments import real_number
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.units import INVERSE_LENGTH
from specklegen.fdtd.currents import mean_polarisation, radiated
from specklegen.fdtd.incidence import Incidence
from specklegen.fdtd.layers import RandomLayer
from specklegen.fdtd.scattered import Validity

FORWARD_TOLERANCE = 0.01  # V < 0.04
BACK_TOLERANCE = 0.1  # V < 0.033: the mean back field is small, and brute force seldom knows it better


@with_units
def phase_variance(layer: RandomLayer, wavenumber: Annotated[float, INVERSE_LENGTH]) -> float:
    """Variance V (radians squared) of the phase through the layer, at a vacuum wave number k0.

    Parameters
    ----------
    layer
        The layer: its grid, its background, and the law of its index.
    wavenumber
        k0 = 2 pi over the wavelength in vacuum, at least 0.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.fdtd import RandomLayer, phase_variance
    >>> round(phase_variance(RandomLayer(correlation_length=0.02), 2 * np.pi / 0.6), 4)
    0.0118
    """
    if not 0 <= real_number("phase_variance wavenumber", wavenumber) < np.inf:
        reject("phase_variance wavenumber", "at least 0 and finite", wavenumber)
    lags = np.arange(1, layer.n_points)
    pairs = layer.n_points + 2 * ((layer.n_points - lags) * layer.index_correlation()[1:]).sum()
    return float((wavenumber * layer.rms_index * layer.dx) ** 2 * pairs)


def pulse_phase_variance(layer: RandomLayer, incidence: Incidence) -> float:
    """V at the root mean square wave number of the scattered pulse."""
    k = incidence.wavenumber
    weight = np.abs(incidence.spectrum) ** 2 * k**4
    return phase_variance(layer, float(np.sqrt((weight * k**2).sum() / weight.sum())))


def judge(layer: RandomLayer, incidence: Incidence, order: int) -> Validity:
    """Predict the relative errors of a mean field of Born order 1 or 2, and give the judgement on each side."""
    v = pulse_phase_variance(layer, incidence)
    forward_error, back_error = v / 4, 3 * v
    if order == 1 and layer.rms_index > 0:
        back_error, forward_error = _left_out_by_first_order(layer, incidence)
    return Validity(phase_variance=v, forward_error=forward_error, back_error=back_error,
                    forward=forward_error <= FORWARD_TOLERANCE, back=back_error <= BACK_TOLERANCE)  # fmt: skip


def _left_out_by_first_order(layer: RandomLayer, incidence: Incidence) -> tuple[float, float]:
    moments, theta = layer.moments(), incidence.theta
    first = radiated(mean_polarisation(moments, theta, 1), theta)
    both = radiated(mean_polarisation(moments, theta, 2), theta)
    weight = np.abs(incidence.spectrum)
    back, forward = (
        np.linalg.norm(weight * (b - a)) / np.linalg.norm(weight * b) for a, b in zip(first, both, strict=True)
    )
    return float(back), float(forward)


def warn_if_not_valid(validity: Validity, order: int) -> None:
    """Say in a warning which direction is not to be believed, and why."""
    failed = [side for side in ("back", "forward") if not validity[side]]
    if failed:
        name = {1: "first", 2: "second"}[order]
        errors = ", ".join(f"{side} {validity[f'{side}_error']:.2g}" for side in failed)
        warnings.warn(
            f"{name} order not valid: expected relative error {errors}, at a phase variance "
            f"V = {validity['phase_variance']:.3g}. Use monte_carlo_mean for this layer.",
            stacklevel=3,
        )
