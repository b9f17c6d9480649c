"""Times and shares at rest from contrasts of several exposures: the multi-exposure model, turned round.

    K^2(T) = beta {rho^2 F(2x) + 2 rho (1 - rho) F(x) + (1 - rho)^2},    x = T / tau_c

of light whose share rho moves with one exponential, g1 = e^(-tau / tau_c), and the rest of which stands still
(:func:`~specklegen.theory.speckle_contrast.exponential_contrast_squared`; Parthasarathy et al., Opt. Express
16, 1975 (2008), Eq. 6). What is fitted is K^2 over the measured one, since its error is in proportion to it. Light that
scatters often has no single exponential: what the model then says of it is in docs/contrast.md.
"""

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import array_from_zero, real_number
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.units import TIME
from specklegen.theory.speckle_contrast import exposure_average

REACH = 100.0
"""By how much a time may lie outside of the exposures, over the shortest or the longest."""
_TIMES, _SHARES = 65, 21  # of the table that begins
_BLOCK, _STEPS = 1024, 60


class MultiExposureFit(NamedTuple):
    """Result of a fit of the multi-exposure model to contrasts.

    Attributes
    ----------
    correlation_time : float64[...]
        tau_c, in the unit of the exposures; at either end of its range where no exposure tells it.
    dynamic_share : float64[...]
        rho, 0 to 1: 1 less the share of the light that stands still.
    misfit : float64[...]
        Root mean square of the model's K^2 over the measured one, less 1.
    """

    correlation_time: np.ndarray
    dynamic_share: np.ndarray
    misfit: np.ndarray


@with_units
def multi_exposure_fit(
    contrast_squared: ArrayLike, exposures: Annotated[ArrayLike, TIME], *, beta: float = 1.0,
) -> MultiExposureFit:  # fmt: skip
    """Fit the multi-exposure model to K^2 of several exposures, by relative least squares.

    From the best of a table, damped Gauss-Newton steps (Levenberg and Marquardt) in log tau_c and rho; the share is
    held within 0 and 1, and the time within a hundredth of the shortest exposure and a hundred times the longest. Raise
    a `RuleError` for a number outside its range, or of shapes that do not go together.

    Parameters
    ----------
    contrast_squared
        K^2 > 0, float64[..., T]: of a map of any shape, an exposure along the last axis.
    exposures
        float64[T] > 0, in any unit of time, two different ones at least.
    beta
        K^2 of the light at rest, above 0 and at most 1.

    Examples
    --------
    >>> from specklegen.theory.multi_exposure import multi_exposure_fit
    >>> from specklegen.theory.speckle_contrast import exponential_contrast_squared
    >>> exposures = [1e-4, 1e-3, 1e-2]
    >>> measured = exponential_contrast_squared(exposures, 5e-4, dynamic_share=0.8)
    >>> found = multi_exposure_fit(measured, exposures)
    >>> round(float(found.correlation_time), 9), round(float(found.dynamic_share), 6)
    (0.0005, 0.8)
    """
    times = array_from_zero("multi_exposure_fit exposures", exposures, above=True, finite=True)
    squared = array_from_zero("multi_exposure_fit contrast_squared", contrast_squared, above=True, finite=True)
    if times.ndim != 1 or len(np.unique(times)) < 2:
        reject("multi_exposure_fit exposures", "a list of at least two different exposures", times)
    if squared.shape[-1:] != times.shape:
        reject("multi_exposure_fit contrast_squared", f"of {len(times)} exposures along the last axis", squared.shape)
    if not 0 < real_number("multi_exposure_fit beta", beta) <= 1:
        reject("multi_exposure_fit beta", "above 0 and at most 1", beta)
    rows = squared.reshape(-1, len(times)) / beta
    parts = [_fitted(rows[n : n + _BLOCK], times) for n in range(0, len(rows), _BLOCK)]
    parameters = np.concatenate(parts) if parts else np.empty((0, 3))
    return MultiExposureFit(*parameters.T.reshape(3, *squared.shape[:-1]))


def _fitted(squared: np.ndarray, exposures: np.ndarray) -> np.ndarray:
    """tau_c, rho and misfit of rows float64[n, T], float64[n, 3]."""
    ends = np.log(exposures.min() / REACH), np.log(exposures.max() * REACH)
    time, share = (a.ravel() for a in np.meshgrid(np.linspace(*ends, _TIMES), np.linspace(0, 1, _SHARES)))
    table = _model(time, share, exposures)[0]
    # |m / k - 1|^2 of every row k and model m, but for a constant.
    best = (np.square(table) @ (squared.T**-2) - 2 * table @ (1 / squared.T)).argmin(axis=0)
    time, share = time[best], share[best]
    damping = np.full(len(squared), 1e-3)
    model, by_time, by_share = _model(time, share, exposures)
    cost = np.square(model / squared - 1).sum(axis=1)
    for _ in range(_STEPS):
        reach = np.where(time <= ends[0], -1, 0) + (time >= ends[1])
        step = _step((model / squared - 1, by_time / squared, by_share / squared), reach, share, damping)
        tried = np.clip(time + step[0], *ends), np.clip(share + step[1], 0.0, 1.0)
        there = _model(*tried, exposures)
        after = np.square(there[0] / squared - 1).sum(axis=1)
        better = after < cost
        time, share = np.where(better, tried[0], time), np.where(better, tried[1], share)
        model, by_time, by_share = (
            np.where(better[:, None], new, old) for new, old in zip(there, (model, by_time, by_share), strict=True)
        )
        cost, damping = np.where(better, after, cost), np.where(better, damping / 8, np.minimum(damping * 4, 1e12))
    return np.stack([np.exp(time), share, np.sqrt(cost / len(exposures))], axis=1)


def _step(
    linear: tuple[np.ndarray, np.ndarray, np.ndarray], reach: np.ndarray, share: np.ndarray, damping: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Damped Gauss-Newton step in log tau_c and rho of misfits and their slopes, each float64[n, T].

    A share at 0 or 1 that would leave its range stays, so that the time goes on alone; and the other way round of a
    time at an end of its range (``reach`` -1 or 1).
    """
    misfit, by_time, by_share = linear
    down = np.sum(by_share * misfit, axis=1)
    held = ((share <= 0) & (down > 0)) | ((share >= 1) & (down < 0))
    by_share = np.where(held[:, None], 0.0, by_share)
    ended = reach * np.sum(by_time * misfit, axis=1) < 0
    by_time = np.where(ended[:, None], 0.0, by_time)
    a, b, c = (np.sum(one * other, axis=1) for one, other in
               ((by_time, by_time), (by_time, by_share), (by_share, by_share)))  # fmt: skip
    a, c = a * (1 + damping) + 1e-30, c * (1 + damping) + 1e-30
    over = np.maximum(a * c - b * b, 1e-300)
    g, h = np.sum(by_time * misfit, axis=1), np.sum(by_share * misfit, axis=1)
    return (b * h - c * g) / over, (b * g - a * h) / over


def _model(log_time: np.ndarray, share: np.ndarray, exposures: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K^2 over beta and its slopes with log tau_c and rho, each float64[n, T]."""
    x, rho = exposures * np.exp(-log_time[:, None]), share[:, None]
    once, twice = exposure_average(x), exposure_average(2 * x)
    value = rho**2 * twice + 2 * rho * (1 - rho) * once + (1 - rho) ** 2
    by_share = 2 * (rho * twice + (1 - 2 * rho) * once - (1 - rho))
    return value, rho**2 * _rise(2 * x, twice) + 2 * rho * (1 - rho) * _rise(x, once), by_share


def _rise(y: np.ndarray, average: np.ndarray) -> np.ndarray:
    """-y F'(y); far below 1 only its first digits are right, which is enough for a step."""
    return 2 * (np.expm1(-y) / y + average)
