"""Mean scattered field from one run: single-realization stochastic FDTD [Tan13].

Instead of averaging many runs, march the mean field once, in the background, driven by the mean currents
of the first two Born orders (Eq. 31),

    e_m -= S (jump of h) + [pi_m E_inc]^{n+1} - [pi_m E_inc]^n,     pi = <kappa> + g q   (`currents`).

The currents are made on the grid's own dispersion, so that the march equals its closed form r1 + r2,
t1 + t2 up to the Mur ends. The same mean without a march ("frequency") costs a thousandth.
"""

from typing import Literal

import numpy as np

from specklegen.core.errors import reject
from specklegen.fdtd.courant import check_courant, check_kappa
from specklegen.fdtd.currents import mean_polarisation, out_of_phase, radiated, single_delay
from specklegen.fdtd.incidence import MARGIN, Incidence, Pulse, illuminate
from specklegen.fdtd.layers import Moments, RandomLayer, sample_moments
from specklegen.fdtd.scattered import ScatteredField
from specklegen.fdtd.validity import judge, warn_if_not_valid
from specklegen.kernels.fdtd import march_currents

_BLOCK = 64  # cells whose currents are transformed together


def single_realization(
    layer: RandomLayer, order: int = 2, method: Literal["fdtd", "frequency"] = "fdtd",
    covariance: Literal["stationary", "sample"] = "stationary", *, kappa: np.ndarray | None = None,
    delays: Literal["all", "single"] = "all", pulse: Pulse | None = None, courant: float | None = None,
    margin: int = MARGIN,
) -> ScatteredField:  # fmt: skip
    """Mean scattered field to Born order 1 or 2.

    Parameters
    ----------
    layer
        The layer: its grid, its background, and the law of its index.
    order : {1, 2}
        2 is consistent to sigma_n^2; 1 alone never is, except where it vanishes.
    method : {"fdtd", "frequency"}
        One march with mean currents, or its closed form on the same grid.
    covariance : {"stationary", "sample"}
        Exact moments of the layer, O(N) a frequency, or those of the media ``kappa``, O(N^2).
    kappa : float64[R, N]
        The sample, for covariance="sample", and without use otherwise.
    delays : {"all", "single"}
        Keep every delay of the out-of-phase current, or replace it by one delayed source a cell.
    pulse
        The light that comes in; by default the reference pulse, ``Pulse()``.
    courant
        Courant number of the background, at most 1; by default 1/n_b, which is 1 in vacuum. Smaller is slower.
    margin
        Cells between the layer and each end of the grid, at least as many as the source takes.

    Raises
    ------
    RuleError
        If a choice is unknown, the sample is missing or does not fit, or the Courant number exceeds 1 (or the
        limit of the sample, so that brute force may share it).

    Warns
    -----
    UserWarning
        If the order is not valid for this layer and pulse; ``validity`` of the result holds the judgement.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, single_realization
    >>> found = single_realization(RandomLayer(correlation_length=0.02), method="frequency")
    >>> found.back.shape == found.time.shape
    True
    """
    incidence = illuminate(layer, pulse, courant, margin)
    moments = _moments(layer, covariance, kappa, incidence.courant)
    delayed = _delayed(moments, incidence, delays) if order == 2 else None
    polarisation = mean_polarisation(moments, incidence.theta, order, delayed)
    if method == "frequency":
        back, forward = closed_form(polarisation, incidence)
    elif method == "fdtd":
        back, forward = _march(polarisation, incidence)
    else:
        reject("single_realization.method", "one of 'fdtd', 'frequency'", method)
    validity = judge(layer, incidence, order)
    warn_if_not_valid(validity, order)
    incident = incidence.series(np.ones(incidence.bins.size))
    return ScatteredField(incidence.time, incident, back, forward, validity)


def closed_form(polarisation: np.ndarray, incidence: Incidence) -> tuple[np.ndarray, np.ndarray]:
    """Fields at the first and at the last cell, in time, that ``polarisation`` complex128[F, N] radiates."""
    back, forward = radiated(polarisation, incidence.theta)
    to_last = np.exp(-1j * incidence.theta * (polarisation.shape[1] - 1))
    return incidence.series(back), incidence.series(forward * to_last)


def mean_currents(polarisation: np.ndarray, incidence: Incidence) -> np.ndarray:
    """Currents float64[T, N] of the march: the step-to-step change of the mean of kappa E_inc + kappa E1."""
    cells = polarisation.shape[1]
    step = 1 - np.exp(-1j * incidence.omega)
    currents = np.empty((incidence.steps, cells))
    for start in range(0, cells, _BLOCK):
        block = np.arange(start, min(start + _BLOCK, cells))
        response = polarisation[:, block].T * step * np.exp(-1j * np.outer(block, incidence.theta))
        currents[:, block] = incidence.series(response).T
    return currents


def _march(polarisation: np.ndarray, incidence: Incidence) -> tuple[np.ndarray, np.ndarray]:
    back, forward = np.empty((2, incidence.steps))
    grid = incidence.courant, incidence.mur, incidence.margin
    march_currents(mean_currents(polarisation, incidence), *grid, back, forward)
    return back, forward


def _moments(layer: RandomLayer, covariance: str, kappa: np.ndarray | None, courant: float) -> Moments:
    if covariance == "stationary":
        if kappa is not None:
            reject("single_realization.kappa", "absent for covariance='stationary'", kappa.shape)
        return layer.moments()
    if covariance != "sample":
        reject("single_realization.covariance", "one of 'stationary', 'sample'", covariance)
    if kappa is None:
        reject("single_realization.kappa", "given for a sample covariance", None, "Use layer.sample(n, seed).")
    kappa = np.atleast_2d(check_kappa(kappa))
    if kappa.shape[1] != layer.n_points:
        reject("single_realization.kappa", f"of shape [R, {layer.n_points}]", kappa.shape)
    check_courant(courant, kappa)
    return sample_moments(kappa)


def _delayed(moments: Moments, incidence: Incidence, delays: str) -> np.ndarray:
    full = out_of_phase(moments, incidence.theta)
    if delays == "all":
        return full
    if delays == "single":
        round_trip = 2 * full.shape[1] / incidence.courant
        fit = single_delay(full, incidence.omega, np.abs(incidence.spectrum) ** 2, round_trip)
        return fit.out_of_phase(incidence.omega)
    reject("single_realization.delays", "one of 'all', 'single'", delays)
