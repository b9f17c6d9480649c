"""Arithmetic that vectorises: the fused multiply-add by name, logarithm, exponential and a power without calls."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import float64
from numba.extending import intrinsic

from specklegen.kernels import inlined

_LN2 = math.log(2.0)
_ROOT_HALF = np.float64(math.sqrt(0.5)).view(np.int64)
_MANTISSA = np.int64(52)
# log((1 + s) / (1 - s)) = 2 s + s R(s^2) on |f| < 0.42, error below 2^-58: the coefficients of FreeBSD's e_log.c.
_R = (
    0.6666666666666735130, 0.3999999999940941908, 0.2857142874366239149, 0.2222219843214978396,
    0.1818357216161805012, 0.1531383769920937332, 0.1479819860511658591,
)  # fmt: skip
# Taylor coefficients of e^r on |r| <= log(2) / 2; the first term left out is below 5e-18.
_E2, _E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12, _E13 = (1.0 / math.factorial(n) for n in range(2, 14))
_LOG2_E = 1.0 / _LN2
_LN2_HIGH = float.fromhex("0x1.62e42fefa3800p-1")  # its product with any exponent is exact
_LN2_LOW = float.fromhex("0x1.ef35793c76730p-45")
_TO_INTEGER = 1.5 * 2.0**52  # adding it leaves the nearest whole number in the last bits
_TWO = np.int64(2)
# 1.25 times the bias of the exponent, less what makes the error |1 - x y^4| of the first guess at most 0.13.
_FOURTH_ROOT = np.int64((1.25 * 1023 - 0.065) * 2**52)
_LEAST = -708.0  # e^-708 is the last to be a normal number

_R0, _R1, _R2, _R3, _R4, _R5, _R6 = _R


def _fma(typing_context, a, b, c):
    """Compute a b + c with one rounding, on every machine."""

    def generate(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return float64(float64, float64, float64), generate


fma: Callable[..., Any] = intrinsic(_fma)


@inlined
def minus_log(x):
    """Return -log x for a normal x > 0, to one unit in the last place."""
    bits = np.float64(x).view(np.int64)
    exponent = (bits - _ROOT_HALF) >> _MANTISSA  # leaves a mantissa in [sqrt(1/2), sqrt 2)
    f = np.int64(bits - (exponent << _MANTISSA)).view(np.float64) - 1.0
    s = f / (2.0 + f)
    z = s * s
    r = z * fma(z, fma(z, fma(z, fma(z, fma(z, fma(z, _R6, _R5), _R4), _R3), _R2), _R1), _R0)
    half = 0.5 * f * f
    return fma(-_LN2, float(exponent), (half - s * (half + r)) - f)


@inlined
def minus_log1m(t):
    """Return ``-log(1 - t)`` for t in ``(0, 1)``, with the relative precision of t."""
    u = 1.0 - t
    lost = 1.0 - u  # what of t the difference kept (Kahan)
    return minus_log(u) * (t / lost) if lost > 0.0 else t


@inlined
def exponential(x):
    """Return e^x for x <= 700, to two units in the last place; 0 below -708."""
    y = max(x, _LEAST)
    shifted = fma(y, _LOG2_E, _TO_INTEGER)
    n = shifted - _TO_INTEGER
    r = fma(-n, _LN2_LOW, fma(-n, _LN2_HIGH, y))
    p = fma(r, fma(r, fma(r, fma(r, fma(r, fma(r, _E13, _E12), _E11), _E10), _E9), _E8), _E7)
    p = fma(r, fma(r, fma(r, fma(r, fma(r, fma(r, fma(r, p, _E6), _E5), _E4), _E3), _E2), 1.0), 1.0)
    bits = np.float64(p).view(np.int64) + (np.float64(shifted).view(np.int64) << _MANTISSA)
    return np.int64(bits).view(np.float64) if x > _LEAST else 0.0


@inlined
def power_minus_three_quarters(x):
    """Return ``x^(-3/4)`` for a normal x > 0, to a few units in the last place, without root or division.

    From the exponent's quarter, two steps of ``y (1 - e)^(-1/4)``, ``e = 1 - x y^4``, as a series in e.
    """
    y = np.int64(_FOURTH_ROOT - (np.float64(x).view(np.int64) >> _TWO)).view(np.float64)
    e = fma(-x, (y * y) * (y * y), 1.0)
    y = fma(y * e, fma(e, fma(e, fma(e, 195.0 / 2048, 15.0 / 128), 5.0 / 32), 0.25), y)
    e = fma(-x, (y * y) * (y * y), 1.0)
    y = fma(y * e, fma(e, 5.0 / 32, 0.25), y)
    return y * (y * y)
