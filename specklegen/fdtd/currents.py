"""Mean currents of the first two Born orders: in-phase, out-of-phase, and the single-delay replacement.

The mean of the first order is driven by <kappa_m> E_inc. The mean of the second is driven by
<kappa_m E1_m> ([Tan13] Eqs. 27-29), which on the grid is exactly

    <kappa_m E1_m> = g q_m E_inc,m,     g = -i tan(theta/2),     q_m = A_m + P_m,

    A_m = sum_{k <= m} C_mk                               in phase with the incident field
    P_m = sum_{k > m}  C_mk exp(-2 i theta (k - m))       out of phase: delayed by twice the way to k

with C_mk = <kappa_m kappa_k>. (g is k dx/2i of the continuum; the self term k = m counts once, in phase.)
Where the layer is stationary both are running sums over the lag: O(N) a frequency; else O(N^2).
"""

from dataclasses import dataclass

import numpy as np

from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.fdtd.layers import Moments

_HALVINGS = 11  # a 32nd of a period to 1e-4 rad, where the fit is flat to 1e-8


def in_phase(moments: Moments) -> np.ndarray:
    """Sum the second moments over the cells up to each cell: A float64[N].

    Parameters
    ----------
    moments
        Of a layer (:class:`Moments`).

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, in_phase
    >>> in_phase(RandomLayer(correlation_length=0.02, n_points=50).moments()).shape
    (50,)
    """
    if moments.second.ndim == 1:
        return np.cumsum(moments.second)
    return np.tril(moments.second).sum(axis=1)


def out_of_phase(moments: Moments, theta: np.ndarray) -> np.ndarray:
    """Sum the delayed second moments over the cells beyond each cell: P complex128[F, N].

    Parameters
    ----------
    moments
        Of a layer (:class:`Moments`).
    theta
        Phase a cell, float64[F], radians.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.fdtd import RandomLayer, out_of_phase
    >>> out_of_phase(RandomLayer(correlation_length=0.02, n_points=50).moments(), np.array([0.03, 0.04])).shape
    (2, 50)
    """
    cells = moments.mean.size
    theta = np.asarray(theta)[:, None]
    if moments.second.ndim == 1:
        terms = moments.second[1:] * np.exp(-2j * theta * np.arange(1, cells))
        sums = np.concatenate([np.zeros((len(theta), 1)), np.cumsum(terms, axis=1)], axis=1)
        return sums[:, ::-1]
    phase = np.exp(-2j * theta * np.arange(cells))
    beyond = np.tril(moments.second.T, -1)  # [k, m], k > m
    return (np.real(phase) @ beyond + 1j * (np.imag(phase) @ beyond)) / phase


@dataclass(frozen=True)
class SingleDelay:
    """P_m(omega) replaced by alpha_m exp(-i omega d_m): one delayed copy of the incident field.

    Attributes
    ----------
    amplitude : float64[N]
        alpha.
    delay : float64[N]
        d, in time steps.
    error : float64[N]
        Relative error of P over the band, root of the weighted mean square; 0 where P is 0.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.fdtd import single_delay
    >>> omega = np.linspace(0.1, 0.2, 20)
    >>> delayed = 2.0 * np.exp(-1j * omega * 5.0)[:, None]
    >>> found = single_delay(delayed, omega, np.ones(20), longest=10.0)
    >>> found.amplitude.round(3), found.delay.round(3)
    (array([2.]), array([5.]))
    """

    amplitude: np.ndarray
    delay: np.ndarray
    error: np.ndarray

    __repr__ = short

    def out_of_phase(self, omega: np.ndarray) -> np.ndarray:
        """Return the replaced P complex128[F, N]; ``omega`` float64[F] in radians a step."""
        return self.amplitude * np.exp(-1j * np.asarray(omega)[:, None] * self.delay)


def single_delay(p: np.ndarray, omega: np.ndarray, weight: np.ndarray, longest: float) -> SingleDelay:
    """Fit a real amplitude and one delay to the out-of-phase sums over a band ([Tan13] Eqs. 33-35).

    For a given delay the best amplitude is Re<P e^{i omega d}>, and what it explains is its square; the delay
    maximises that, first among delays a 32nd of the band's fastest period apart, then by bisection.

    Parameters
    ----------
    p : complex128[F, N]
    omega : float64[F]
        Radians a step.
    weight : float64[F]
        Of each line; the pulse's power spectrum.
    longest : float
        Longest delay tried, time steps: the round trip of the layer.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.fdtd import single_delay
    >>> omega = np.linspace(0.1, 0.2, 20)
    >>> delayed = 2.0 * np.exp(-1j * omega * 5.0)[:, None]
    >>> found = single_delay(delayed, omega, np.ones(20), longest=10.0)
    >>> found.amplitude.round(3), found.delay.round(3)
    (array([2.]), array([5.]))
    """
    omega, weight = np.asarray(omega, dtype=float), np.asarray(weight, dtype=float)
    if not weight.sum() > 0:
        reject("single_delay.weight", "non-negative with a positive sum", weight)
    weight = weight / weight.sum()
    weighted = weight[:, None] * p

    def amplitude(delay: np.ndarray) -> np.ndarray:
        return np.real(weighted * np.exp(1j * omega[:, None] * delay)).sum(axis=0)

    step = np.pi / (16 * omega.max())  # fine enough to tell neighbouring half periods apart
    coarse = np.arange(0, longest + step, step)
    scan = np.abs(np.real(weighted.T @ np.exp(1j * omega[:, None] * coarse)))
    delay = coarse[scan.argmax(axis=1)]
    for _ in range(_HALVINGS):
        step /= 2
        trial = np.stack([delay - step, delay, delay + step])
        explained = np.stack([np.abs(amplitude(d)) for d in trial])
        delay = np.take_along_axis(trial, explained.argmax(axis=0)[None], axis=0)[0]
    alpha = amplitude(delay)
    power = (weight[:, None] * np.abs(p) ** 2).sum(axis=0)
    left = np.maximum(power - alpha**2, 0)
    error = np.sqrt(np.divide(left, power, out=np.zeros_like(power), where=power > 0))
    return SingleDelay(alpha, delay, error)


def mean_polarisation(moments: Moments, theta: np.ndarray, order: int, p: np.ndarray | None = None) -> np.ndarray:
    """Mean of kappa E over the incident field, cell by cell, to Born order ``order``: complex128[F, N].

    ``p`` replaces the out-of-phase sums (a single delay). Order 1 is <kappa_m>; order 2 adds g q_m.
    """
    if order not in (1, 2):
        reject("order", "1 or 2", order)
    first = np.broadcast_to(moments.mean.astype(complex), (len(theta), moments.mean.size))
    if order == 1:
        return first
    g = -1j * np.tan(np.asarray(theta) / 2)[:, None]
    p = out_of_phase(moments, theta) if p is None else p
    return first + g * (in_phase(moments) + p)


def radiated(polarisation: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fields that a polarisation over E_inc radiates to the first and to the last cell, over E_inc there.

    r = g sum_m pi_m e^{-2 i theta m} and t - 1 = g sum_m pi_m: complex128[F] each.
    """
    g = -1j * np.tan(np.asarray(theta) / 2)
    there_and_back = np.exp(-2j * np.asarray(theta)[:, None] * np.arange(polarisation.shape[1]))
    return g * (polarisation * there_and_back).sum(axis=1), g * polarisation.sum(axis=1)
