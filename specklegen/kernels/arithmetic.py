"""Arithmetic that vectorises: the fused multiply-add by name, and the logarithm without a library call."""

import math

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
_R0, _R1, _R2, _R3, _R4, _R5, _R6 = _R


@intrinsic
def fma(typing_context, a, b, c):
    """Compute a b + c with one rounding, on every machine."""

    def generate(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return float64(float64, float64, float64), generate


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
    """Return -log(1 - t) for t in (0, 1), with the relative precision of t."""
    u = 1.0 - t
    lost = 1.0 - u  # what of t the difference kept (Kahan)
    return minus_log(u) * (t / lost) if lost > 0.0 else t
