"""Bessel's J0, and mixtures of it: what every memory-effect kernel is made of.

    x < 8:   J0(x) = p(x^2 / 32 - 1)
    x >= 8:  J0(x) = sqrt(2 / (pi x)) [P cos(x - pi/4) - Q / x sin(x - pi/4)],   P, Q functions of (8 / x)^2

with p, P and Q the Chebyshev interpolants of the exact functions cut below 1e-17 and written as polynomials of an
argument in ``[-1, 1]``, whose coefficients add up to less than 5: no cancellation. Absolute error below 2e-15
(tests/kernels/test_bessel.py). The same numbers serve torch, whose own J0 is wrong by 4e-7 about x = 5. Source:
Abramowitz and Stegun, *Handbook of Mathematical Functions*, section 9.2.
"""

import math

from specklegen.kernels import inlined, kernel
from specklegen.kernels.arithmetic import fma
from specklegen.kernels.trigonometry import sincos_turns

NEAR = 8.0
"""Argument at which one form gives way to the other."""
SMALL = (
    0.04582966485981377, 0.9303012472958572, -0.6484692830871837, -0.8080888076696872, 1.0383794611437211,
    -0.5074680458471, 0.14598884856759264, -0.028472718610882047, 0.004058078989140991, -0.0004435459224311503,
    3.8473197855944365e-05, -2.717749223632098e-06, 1.5956109104549218e-07, -7.91532308295207e-09,
    3.3634475788173604e-10, -1.243301171273326e-11, 4.0037632815796753e-13,
)  # fmt: skip
COSINE = (
    0.9994572757882519, -0.0005363673192129672, 6.137416080109497e-06, -2.0527448261170675e-07, 1.280376144080092e-08,
    -1.2121098178951377e-09, 1.5500565496632596e-10, -2.491146535471666e-11, 4.786995821368028e-12,
    -1.0157485021065676e-12, 2.4531772967345006e-13, -1.0251790052831013e-13, 3.339452259070809e-14,
)  # fmt: skip
SINE = (
    -0.12444091103610816, 0.0005466519279472034, -1.1817110660715592e-05, 5.684971972265847e-07,
    -4.5349736139769986e-08, 5.1461591930522475e-09, -7.57586453075858e-10, 1.364832378469862e-10,
    -2.8840344824996496e-11, 6.538016467992787e-12, -1.6783779045026498e-12, 7.915216052472428e-13,
    -2.7338449247237154e-13,
)  # fmt: skip

_TWO_OVER_PI = 2.0 / math.pi
_TO_TURNS = 0.5 / math.pi


# Constants by name: a loop over a tuple would not become a vector loop.
_A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7, _A8, _A9, _A10, _A11, _A12, _A13, _A14, _A15, _A16 = SMALL
_P0, _P1, _P2, _P3, _P4, _P5, _P6, _P7, _P8, _P9, _P10, _P11, _P12 = COSINE
_Q0, _Q1, _Q2, _Q3, _Q4, _Q5, _Q6, _Q7, _Q8, _Q9, _Q10, _Q11, _Q12 = SINE


@inlined
def j0_near(x):
    """J0 for 0 <= x < 8."""
    t = x * x * (1.0 / 32.0) - 1.0
    high = fma(t, fma(t, fma(t, fma(t, fma(t, fma(t, fma(t, _A16, _A15), _A14), _A13), _A12), _A11), _A10), _A9)
    low = fma(t, fma(t, fma(t, fma(t, fma(t, high, _A8), _A7), _A6), _A5), _A4)
    return fma(t, fma(t, fma(t, fma(t, low, _A3), _A2), _A1), _A0)


@inlined
def j0_far(x):
    """J0 for x >= 8."""
    inverse = 1.0 / x
    y = NEAR * inverse
    t = 2.0 * y * y - 1.0
    high = fma(t, fma(t, fma(t, fma(t, fma(t, fma(t, _P12, _P11), _P10), _P9), _P8), _P7), _P6)
    p = fma(t, fma(t, fma(t, fma(t, fma(t, fma(t, high, _P5), _P4), _P3), _P2), _P1), _P0)
    high = fma(t, fma(t, fma(t, fma(t, fma(t, fma(t, _Q12, _Q11), _Q10), _Q9), _Q8), _Q7), _Q6)
    q = fma(t, fma(t, fma(t, fma(t, fma(t, fma(t, high, _Q5), _Q4), _Q3), _Q2), _Q1), _Q0)
    sine, cosine = sincos_turns(x * _TO_TURNS - 0.125)
    return math.sqrt(_TWO_OVER_PI * inverse) * (p * cosine - q * inverse * sine)


@kernel
def bessel_mixture(q, radius, share, out):
    """Fill ``out`` float64[n] with sum_m share[m] J0(q[n] radius[m]).

    Parameters
    ----------
    q : float64[n]
        At least 0; fastest where ascending.
    radius, share : float64[m]
        Radii, at least 0, and their shares.
    out : float64[n]
        The sums, added up in the order of the radii.
    """
    count = len(q)
    out[:] = 0.0
    for m in range(len(radius)):
        r, weight = radius[m], share[m]
        # A run of arguments on one side of 8 is a vector loop.
        first = 0
        while first < count:
            near = q[first] * r < NEAR
            last = first + 1
            while last < count and (q[last] * r < NEAR) == near:
                last += 1
            if near:
                for n in range(first, last):
                    out[n] += weight * j0_near(q[n] * r)
            else:
                for n in range(first, last):
                    out[n] += weight * j0_far(q[n] * r)
            first = last
