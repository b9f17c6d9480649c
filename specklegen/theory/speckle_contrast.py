"""Contrast of speckle that moves during an exposure: closed forms of laser speckle contrast imaging.

A camera that integrates the intensity over an exposure T sees ``K^2 = <I^2>/<I>^2 - 1``, for Gaussian fields of
correlation g1(tau) (Bandyopadhyay et al., Rev. Sci. Instrum. 76, 093110 (2005), Eq. 5; u = tau / T, beta = 1)

    K^2(T) = 2 int_0^1 (1 - u) |g1(uT)|^2 du,       F(y) = 2 int_0^1 (1 - u) e^(-yu) du = 2 (e^-y - 1 + y) / y^2

One exponential, ``|g1|^2 = e^(-2 tau / tau_c)``, thus has ``K^2 = F(2T / tau_c)``. A medium whose light belongs to
classes of shares p_a and momentum transfers Y_a, ``g1 = sum_a p_a e^(-2 Y_a tau / tau0)``, has
``sum_ab p_a p_b F(2 (Y_a + Y_b) T / tau0)``, ``tau0 = 1 / (D k^2)``. n frames at the midpoints of n parts of the
exposure, added up, are the trapezoidal rule of the same integral: as ``(1 - u) |g1|^2`` is convex they overstate
``K^2``, by an amount of order ``1 / n^2``.

Functions that end in ``_squared`` return K^2; beta, what pixels, polarisation and bandwidth leave of the contrast of
light at rest, multiplies it. The static share's model: Parthasarathy et al., Opt. Express 16, 1975 (2008), Eq. 6.
"""

from collections.abc import Callable
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import toeplitz
from scipy.special import gammainc

from specklegen.core.arguments import array_from_zero, number_from_zero, real_number, whole_number
from specklegen.core.errors import reject
from specklegen.core.quadrature import gauss_legendre
from specklegen.core.quantities import with_units
from specklegen.core.units import TIME

FieldCorrelation = Callable[[np.ndarray], np.ndarray]
"""g1 of lags float64[n] >= 0, real or complex[n], 1 at lag 0."""

_SERIES_BELOW, _TERMS = 1.0, 18  # 1 / 20! = 4e-19
_NODES = 16  # a panel; every panel is as long as all before it
_HALVINGS = 60  # panels from the whole exposure down to 1e-18 of it
_BLOCK = 1 << 20  # of values of g1 that are held at once
_MOST_FRAMES, _MOST_SIDE = 1 << 20, 2048
_TRACES = 1e-3  # relative error of the traces of g1


def exposure_average(y: ArrayLike) -> np.ndarray:
    """Return ``F(y) = 2 (e^-y - 1 + y) / y^2`` of an array: the mean of ``e^-(y |s - t|)`` over the unit square.

    It is 1 at y = 0; about ``2 / y`` far above 1; right to rounding everywhere.

    Examples
    --------
    >>> from specklegen.theory.speckle_contrast import exposure_average
    >>> [round(float(f), 4) for f in exposure_average([0.0, 1e-9, 2.0, float("inf")])]
    [1.0, 1.0, 0.5677, 0.0]
    """
    return _average(array_from_zero("exposure_average y", y))


def _average(y: np.ndarray) -> np.ndarray:
    series = np.zeros_like(y)
    small = np.minimum(y, _SERIES_BELOW)
    for n in range(_TERMS, 0, -1):  # Horner's rule: 2 sum_n (-y)^n / (n + 2)!
        series = -small / (n + 2) * (1 + series)
    large = np.maximum(y, _SERIES_BELOW)
    return np.where(y < _SERIES_BELOW, 1 + series, 2 / large * (1 + np.expm1(-large) / large))


@with_units
def exponential_contrast_squared(
    exposure: Annotated[ArrayLike, TIME], correlation_time: Annotated[ArrayLike, TIME], *, dynamic_share: float = 1.0,
    beta: float = 1.0,
) -> np.ndarray:  # fmt: skip
    """K^2 of one exponential beside light that stands still, float64 of the broadcast shape.

    ``beta {rho^2 F(2x) + 2 rho (1 - rho) F(x) + (1 - rho)^2}``, ``x = T / tau_c``: the multi-exposure model without its
    noise.

    Parameters
    ----------
    exposure, correlation_time
        T >= 0 and tau_c > 0, g1 = e^(-tau / tau_c) of the light that moves, in one unit of time.
    dynamic_share
        rho, share of the light's mean that moves, 0 to 1.
    beta
        K^2 of the light at rest, above 0 and at most 1.

    Examples
    --------
    >>> from specklegen.theory.speckle_contrast import exponential_contrast_squared
    >>> float(exponential_contrast_squared(5e-3, 5e-3).round(4))  # seconds
    0.5677
    """
    exposure = array_from_zero("exponential_contrast_squared exposure", exposure)
    x = exposure / array_from_zero("exponential_contrast_squared correlation_time", correlation_time, above=True)
    rho, beta = _shares("exponential_contrast_squared", dynamic_share, beta)
    return beta * _shared(rho, x)


def _shared(rho: float, x: np.ndarray) -> np.ndarray:
    return rho**2 * _average(2 * x) + 2 * rho * (1 - rho) * _average(x) + (1 - rho) ** 2


@with_units
def correlation_time(
    contrast_squared: ArrayLike, exposure: Annotated[ArrayLike, TIME], *, dynamic_share: float = 1.0, beta: float = 1.0
) -> np.ndarray:
    """tau_c of a measured K^2, float64 of the broadcast shape: the inverse of :func:`exponential_contrast_squared`.

    By Newton's rule from below: the model is convex and falls, so that every step stays below the root. A noisy K^2 may
    lie outside what the model reaches: at or above beta nothing has moved (infinity), at or below ``beta (1 - rho)^2``
    all that moves is infinitely fast (0).

    Parameters
    ----------
    contrast_squared
        K^2 >= 0, of a map of any shape.
    exposure
        T > 0.
    dynamic_share, beta
        As in :func:`exponential_contrast_squared`; a share above 0.

    Examples
    --------
    >>> from specklegen.theory.speckle_contrast import correlation_time
    >>> [float(tau) for tau in correlation_time([0.0, 0.56766764, 1.2], 5e-3).round(6)]
    [0.0, 0.005, inf]
    """
    squared = array_from_zero("correlation_time contrast_squared", contrast_squared)
    exposure = array_from_zero("correlation_time exposure", exposure, above=True)
    rho, beta = _shares("correlation_time", dynamic_share, beta)
    if rho == 0:
        reject("correlation_time dynamic_share", "above 0", dynamic_share,
               "For a medium at rest the time is undefined.")
    squared, exposure = np.broadcast_arrays(squared, exposure)
    floor = (1 - rho) ** 2
    target = squared / beta
    inside = (target > floor) & (target < 1)
    aim = np.where(inside, np.maximum(target, 1e-300), (1 + floor) / 2)
    # F(y) >= 1 / (1 + y / 2), hence all that moves is at least (1 - floor) / (1 + x).
    x = np.maximum((1 - aim) / (aim - floor), 0.0)
    for _ in range(60):  # quadratic, after a few doublings where little is left above the floor
        step = (aim - _shared(rho, x)) / (rho**2 * _log_slope(2 * x) + 2 * rho * (1 - rho) * _log_slope(x))
        x = x * np.maximum(1 + step, 0.5)
        if np.all(np.abs(step) <= 1e-15):
            break
    with np.errstate(divide="ignore"):
        tau = exposure / x
    return np.where(inside, tau, np.where(target >= 1, np.inf, 0.0))


def _log_slope(y: np.ndarray) -> np.ndarray:
    """Log-slope ``y F'(y) = -2 y int u (1 - u) e^(-yu) du``; above 1 as ``2 (1 - e^-y) / y - 2 F``."""
    series = np.zeros_like(y)
    small = np.minimum(y, _SERIES_BELOW)
    for n in range(_TERMS, 0, -1):  # F' = -2 sum_n (n + 1) (-y)^n / (n + 3)!
        series = -small * (n + 1) / (n * (n + 3)) * (1 + series)
    large = np.maximum(y, _SERIES_BELOW)
    return np.where(y < _SERIES_BELOW, -y * (1 + series) / 3, -2 * (np.expm1(-large) / large + _average(large)))


@with_units
def diffusing_contrast_squared(
    exposure: Annotated[ArrayLike, TIME], tau0: Annotated[ArrayLike, TIME], *, gamma: float = 5 / 3,
) -> np.ndarray:  # fmt: skip
    """K^2 of light that diffuses back from a half space, g1 = e^(-gamma sqrt(6 tau / tau0)), float64 of that shape.

    ``4 {[1 - e^-b (1 + b)] / b^2 - [6 - e^-b (b^3 + 3 b^2 + 6 b + 6)] / b^4}``, ``b = 2 gamma sqrt(6 T / tau0)``:
    incomplete gamma functions of 2 and 4, without cancellation.

    Parameters
    ----------
    exposure, tau0
        T >= 0, and tau0 = 1 / (D k^2) > 0, in one unit of time.
    gamma
        About 5/3 where all polarisations are seen.

    Examples
    --------
    >>> from specklegen.theory.speckle_contrast import diffusing_contrast_squared
    >>> [float(k) for k in diffusing_contrast_squared([0.001, 0.01, 0.1, 1.0], 1.0).round(4)]
    [0.8728, 0.6576, 0.297, 0.0546]
    """
    exposure = array_from_zero("diffusing_contrast_squared exposure", exposure)
    share = exposure / array_from_zero("diffusing_contrast_squared tau0", tau0, above=True)
    b = 2 * number_from_zero("diffusing_contrast_squared gamma", gamma, above=True) * np.sqrt(6 * share)
    safe = np.clip(b, 1e-8, 1e75)  # b^4 stays a number; below, the first term of the series is exact
    squared = 4 * (gammainc(2, safe) / safe**2 - 6 * gammainc(4, safe) / safe**4)
    return np.where(b < 1e-8, 1 - 8 / 15 * b, np.where(b > 1e75, 0.0, squared))


@with_units
def contrast_squared(field: FieldCorrelation, exposure: Annotated[float, TIME]) -> float:
    """Squared contrast of any field correlation, ``2 int_0^1 (1 - u) |g1(uT)|^2 du``.

    On Gauss panels that shrink towards lag 0: to about 1e-13 for sums of exponentials and e^-sqrt, of whatever times.
    Raise a `RuleError` for an exposure outside its range, or a correlation that is no number somewhere.

    Parameters
    ----------
    field
        g1 of lags float64[n], real or complex[n].
    exposure
        T >= 0, in the lags' unit.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.theory.speckle_contrast import contrast_squared
    >>> round(contrast_squared(lambda lag: np.exp(-lag / 5e-3), 5e-3), 4)  # one exponential
    0.5677
    """
    exposure = number_from_zero("contrast_squared exposure", exposure)
    u, weight = exposure_nodes()
    return float(weight @ _power("contrast_squared field", field, exposure * u))


def class_contrast_squared(transfer: ArrayLike, shares: ArrayLike, exposure: ArrayLike) -> np.ndarray:
    """K^2 = sum_ab p_a p_b F(2 (Y_a + Y_b) T / tau0) of classes of light, float64 of the shape of ``exposure``.

    By one quadrature for all pairs, in about ``n (60 + 5 log10 Y T)`` steps where their matrix takes ``n^2``: a hundred
    thousand paths are as good as ten classes.

    Parameters
    ----------
    transfer
        Momentum transfers Y_a >= 0, float64[n].
    shares
        Weights of the classes or paths, float64[n], at least 0; brought to a sum of 1.
    exposure
        T / tau0 >= 0.

    Examples
    --------
    >>> from specklegen.theory.speckle_contrast import class_contrast_squared
    >>> float(class_contrast_squared([0.0, 1.0], [0.2, 0.8], 0.5).round(4))  # a fifth stands still
    0.6388
    """
    y, p = _classes("class_contrast_squared", transfer, shares)
    exposure = array_from_zero("class_contrast_squared exposure", exposure)
    squared = np.empty(exposure.shape)
    for at, time in np.ndenumerate(exposure):
        fastest = 4 * float(y.max()) * float(time)
        u, weight = exposure_nodes(min(int(np.ceil(np.log2(max(fastest, 1.0)))) + 1, _HALVINGS))
        squared[at] = weight @ np.square(_decay(y, p, time * u))
    return squared


def class_field(transfer: ArrayLike, shares: ArrayLike) -> FieldCorrelation:
    """g1 of classes of light as a function of x = tau / tau0: sum_a p_a e^(-2 x Y_a).

    Parameters
    ----------
    transfer, shares
        As in :func:`class_contrast_squared`.

    Examples
    --------
    >>> from specklegen.theory.speckle_contrast import class_field, sub_frames
    >>> sub_frames(class_field([3.0, 10.0], [0.5, 0.5]), 0.2, tolerance=0.01)  # exposure of 0.2 tau0
    18
    """
    y, p = _classes("class_field", transfer, shares)
    return lambda lags: _decay(y, p, array_from_zero("class_field lag", lags).ravel())


@with_units
def sub_frame_contrast_squared(field: FieldCorrelation, exposure: Annotated[float, TIME], frames: int) -> float:
    """K^2 of an exposure made of ``frames`` instants at the midpoints of as many parts, of equal weight.

    ``(1/n) [|g1(0)|^2 + 2 sum_m (1 - m/n) |g1(mT/n)|^2]``, ``m = 1 ... n - 1``; one instant has K^2 = 1.

    Parameters
    ----------
    field, exposure
        As in :func:`contrast_squared`.
    frames
        n, 1 to 2**20.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.theory.speckle_contrast import exponential_contrast_squared, sub_frame_contrast_squared
    >>> whole = float(exponential_contrast_squared(3.0, 1.0))
    >>> [round(sub_frame_contrast_squared(lambda t: np.exp(-t), 3.0, n) / whole - 1, 3) for n in (4, 8, 16)]
    [0.25, 0.065, 0.016]
    """
    frames = whole_number("sub_frame_contrast_squared frames", frames, 1, _MOST_FRAMES)
    exposure = number_from_zero("sub_frame_contrast_squared exposure", exposure)
    share = np.arange(frames) / frames
    weight = np.where(share > 0, 2 * (1 - share), 1.0) / frames
    return float(weight @ _power("sub_frame_contrast_squared field", field, exposure * share))


@with_units
def sub_frames(field: FieldCorrelation, exposure: Annotated[float, TIME], *, tolerance: float) -> int:
    """Fewest sub-frames whose K^2 is above the exposure's by at most ``tolerance`` of it.

    Raise a `RuleError` for a number outside its range, or where 2**20 frames would not do.

    Parameters
    ----------
    field, exposure
        As in :func:`contrast_squared`; |g1|^2 falls and is convex.
    tolerance
        Relative, above 0.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.theory.speckle_contrast import sub_frames
    >>> sub_frames(lambda t: np.exp(-t), 3.0, tolerance=0.01)
    21
    """
    tolerance = number_from_zero("sub_frames tolerance", tolerance, above=True)
    allowed = (1 + tolerance) * contrast_squared(field, exposure)

    def held(count: int) -> bool:
        return sub_frame_contrast_squared(field, exposure, count) <= allowed

    enough = 1
    while not held(enough):
        enough *= 2
        if enough > _MOST_FRAMES:
            reject("sub_frames tolerance", f"reachable with {_MOST_FRAMES} frames", tolerance, "Shorten the exposure.")
    low = enough // 2
    while enough - low > 1:
        middle = (low + enough) // 2
        low, enough = (low, middle) if held(middle) else (middle, enough)
    return enough


class ContrastEstimate(NamedTuple):
    """Law of s^2 / m^2, the sample variance over the squared sample mean of N independent grains.

    Attributes
    ----------
    mean, standard_deviation : float64
        Of the estimate of K^2; the mean is below K^2.
    """

    mean: np.ndarray
    standard_deviation: np.ndarray


def contrast_estimate(contrast_squared: ArrayLike, grains: ArrayLike) -> ContrastEstimate:
    """Mean and standard deviation of a K^2 that is estimated from N independent grains, by its value alone.

    Integrated intensity as a gamma law of ``M = 1 / K^2`` equal modes: exact at rest (M = 1) and of M equal modes. The
    mean of such numbers is independent of their ratios, so that both moments are exact at every N: those of ``s^2`` and
    ``s^4`` over those of ``m^2`` and ``m^4``. For large N the variance is ``2 K^4 (1 + K^2) / N``. Modes that are not
    equal vary more: of one exponential field correlation the standard deviation is low by a sixth at T = 3 tau_c, the
    most (:func:`motion_contrast_estimate` has them all).

    Parameters
    ----------
    contrast_squared
        K^2, above 0 and at most 1, any shape.
    grains
        N >= 2: independent ones; pixels of one grain count together.

    Examples
    --------
    >>> from specklegen.theory.speckle_contrast import contrast_estimate
    >>> found = contrast_estimate(1.0, 49)  # developed speckle, 49 grains
    >>> round(float(found.mean), 3), round(float(found.standard_deviation), 3)
    (0.98, 0.269)
    """
    squared = array_from_zero("contrast_estimate contrast_squared", contrast_squared, above=True)
    n = _grains("contrast_estimate", grains)
    if (squared > 1).any():
        reject("contrast_estimate contrast_squared", "at most 1", squared)
    # Of a gamma law of mean 1 and variance K^2: fourth central moment 3 K^4 + 6 K^6.
    fourth = 3 * squared**2 + 6 * squared**3
    square_of_variance = fourth / n - squared**2 * (n - 3) / (n * (n - 1)) + squared**2
    step = squared / n
    mean = squared / (1 + step)
    second = square_of_variance / ((1 + step) * (1 + 2 * step) * (1 + 3 * step))
    return ContrastEstimate(mean, np.sqrt(np.maximum(second - mean**2, 0.0)))


@with_units
def motion_contrast_estimate(
    field: FieldCorrelation, exposure: Annotated[float, TIME], grains: ArrayLike,
) -> ContrastEstimate:  # fmt: skip
    """Mean and standard deviation of a K^2 that is estimated from N independent grains, of a known g1.

    With S_n = sum_i lambda_i^n of the eigenvalues of g1(s - t) over the exposure (sum 1), the integrated intensity has
    the cumulants (n - 1)! S_n, hence K^2 = S_2, and in first order of 1/N

        mean = S_2 + (3 S_2^2 - 4 S_3) / N,   variance = S_2^2 [2 + 6 S_4 / S_2^2 + 4 S_2 - 8 S_3 / S_2] / N

    Compare Skipetrov et al., Opt. Express 18, 14519 (2010). The traces are those of a matrix of sub-frames, to 0.1 %.
    Raise a `RuleError` for a number outside its range, or an exposure of so many correlation times that 2048 sub-frames
    would not do.

    Parameters
    ----------
    field, exposure
        As in :func:`contrast_squared`.
    grains
        N >= 2; the next order is about 10 / N of it.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.theory.speckle_contrast import contrast_estimate, motion_contrast_estimate
    >>> found = motion_contrast_estimate(lambda t: np.exp(-t), 3.0, 400)
    >>> by_value = contrast_estimate(0.278, 400)
    >>> round(float(found.standard_deviation), 4), round(float(by_value.standard_deviation), 4)
    (0.0268, 0.0222)
    """
    n = _grains("motion_contrast_estimate", grains)
    if sub_frame_contrast_squared(field, exposure, _MOST_SIDE) > (1 + _TRACES) * contrast_squared(field, exposure):
        reject("motion_contrast_estimate exposure", f"so short that {_MOST_SIDE} sub-frames are enough", exposure,
               "For the value of such a small contrast use contrast_estimate.")  # fmt: skip
    count = max(sub_frames(field, exposure, tolerance=_TRACES), 2)
    matrix = toeplitz(np.asarray(field(exposure / count * np.arange(count)))) / count
    twice = matrix @ matrix
    two, four = float(np.trace(twice).real), float(np.square(np.abs(twice)).sum())
    three = float((twice * matrix.conj()).sum().real)
    variance = 2 * two**2 + 6 * four + 4 * two**3 - 8 * three * two
    return ContrastEstimate(two + (3 * two**2 - 4 * three) / n, np.sqrt(variance / n))


def exposure_nodes(halvings: int = _HALVINGS) -> tuple[np.ndarray, np.ndarray]:
    """Lags over the exposure u and weights float64[n], so that ``K^2 = sum weights |g1(uT)|^2`` (of ``2 (1 - u) du``).

    Gauss panels that halve towards lag 0 so often.

    Examples
    --------
    >>> from specklegen.theory.speckle_contrast import exposure_nodes
    >>> u, weight = exposure_nodes()
    >>> round(float(weight.sum()), 12)
    1.0
    """
    u, weight = _graded(halvings)
    return u, 2 * weight * (1 - u)


def _graded(halvings: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss nodes and weights on the unit interval, on panels that halve towards 0 so often."""
    edges = np.append(0.0, 0.5 ** np.arange(halvings, -1, -1.0))
    node, weight = gauss_legendre(_NODES)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (1 + node)).ravel(), (half * weight).ravel()


def _decay(y: np.ndarray, p: np.ndarray, x: np.ndarray) -> np.ndarray:
    step = max(1, _BLOCK // len(y))
    return np.concatenate([np.exp(-2 * np.outer(x[n : n + step], y)) @ p for n in range(0, len(x), step)])


def _power(owner: str, field: FieldCorrelation, lags: np.ndarray) -> np.ndarray:
    values = np.asarray(field(lags))
    if values.shape != lags.shape or not np.isfinite(values).all():
        reject(owner, f"finite, one number for each of {len(lags)} lags", values)
    return np.square(np.abs(values))


def _classes(owner: str, transfer: ArrayLike, shares: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    y, p = array_from_zero(f"{owner} transfer", transfer), array_from_zero(f"{owner} shares", shares)
    if y.ndim != 1 or not len(y) or p.shape != y.shape:
        reject(f"{owner} shares", "one number for each transfer, and at least one", (y.shape, p.shape))
    if not np.isfinite(y).all() or not np.isfinite(p).all() or not p.any():
        reject(f"{owner} shares", "finite and not all 0, of finite transfers", p)
    p = p / p.max()
    return y, p / p.sum()


def _shares(owner: str, dynamic_share: float, beta: float) -> tuple[float, float]:
    rho, beta = real_number(f"{owner} dynamic_share", dynamic_share), real_number(f"{owner} beta", beta)
    if not 0 <= rho <= 1:
        reject(f"{owner} dynamic_share", "from 0 to 1", dynamic_share)
    if not 0 < beta <= 1:
        reject(f"{owner} beta", "above 0 and at most 1", beta)
    return rho, beta


def _grains(owner: str, grains: ArrayLike) -> np.ndarray:
    n = array_from_zero(f"{owner} grains", grains)
    if not (np.isfinite(n) & (n >= 2)).all():
        reject(f"{owner} grains", "finite and at least 2", grains)
    return n
