"""Sine and cosine of an angle in turns.

Phases are kept in turns, so that reduction to one period is exact (subtract the nearest integer) at any
distance from the origin; both functions come from two short polynomials without a table or a branch
that the compiler cannot turn into a select. Absolute error below 2e-15 (tests/test_kernels.py).
"""

import numpy as np

from specklegen.kernels import inlined
from specklegen.kernels.arithmetic import fma

# Taylor coefficients in (2 pi x)^2 for |x| <= 1/8 turn; the first term left out is below 1e-16.
TAU = 6.283185307179586
_S = (-1.0 / 6, 1.0 / 120, -1.0 / 5040, 1.0 / 362880, -1.0 / 39916800, 1.0 / 6227020800, -1.0 / 1307674368000)
_C = (-0.5, 1.0 / 24, -1.0 / 720, 1.0 / 40320, -1.0 / 3628800, 1.0 / 479001600, -1.0 / 87178291200)
_S0, _S1, _S2, _S3, _S4, _S5, _S6 = _S
_C0, _C1, _C2, _C3, _C4, _C5, _C6 = _C


@inlined
def sincos_turns(turns):
    """Return (sin, cos) of ``2 pi turns``, for ``|turns| < 2^52``."""
    quarter = np.rint(4.0 * turns)
    x = (turns - 0.25 * quarter) * TAU
    y = x * x
    odd = fma(y, fma(y, fma(y, fma(y, fma(y, fma(y, _S6, _S5), _S4), _S3), _S2), _S1), _S0)
    even = fma(y, fma(y, fma(y, fma(y, fma(y, fma(y, _C6, _C5), _C4), _C3), _C2), _C1), _C0)
    sine = fma(x * y, odd, x)
    cosine = fma(y, even, 1.0)
    q = int(quarter) & 3
    a = cosine if q & 1 else sine
    b = sine if q & 1 else cosine
    return (-a if q & 2 else a), (-b if (q + 1) & 2 else b)
