"""Quantile functions: one uniform number in, one normal or Poisson number out, monotone in both.

Normal: Wichura's rational functions, relative error 1e-16. Poisson of a mean below 32: the sum of the probabilities
from 0. Above, the real x at which the regularised incomplete Gamma function Gamma(x, mean) / Gamma(x) is u, rounded
down, is the exact quantile; with w the normal quantile and s = w / sqrt(mean)

    x = mean + sqrt(mean) w + w^2 a(s) + c_0(s) + c_1(s) / mean + c_2(s) / mean^2

the uniform expansion of Temme, whose functions a and c_n are interpolated by polynomials on |s| <= 0.9 (beyond, where
less than one number in a million lies, they are held). The error of x is below 1e-6, so that as many numbers in a
million, at most, are off, and by 1 (tests/kernels/test_quantiles.py).

Sources: Wichura, *Applied Statistics* 37, 477 (1988), AS 241; Temme, *SIAM J. Math. Anal.* 10, 757 (1979); Giles,
*ACM Trans. Math. Softw.* 42, 7 (2016), from whom the idea of the expansion in the normal quantile is. The coefficients
are new: fitted to solutions of 60 digits.
"""

import math

import numpy as np

from specklegen.kernels import ROOM, inlined, kernel
from specklegen.kernels.arithmetic import exponential, fma, minus_log
from specklegen.kernels.rng import philox

SUMMED = 32.0
"""Mean below which probabilities are added up."""
HELD = 0.9
"""|s| beyond which the functions of s are held."""
LEAST = 1e-17
"""Probability that no sum of them notices; above it lies all of the rise of a mean below 32."""
QUADRATIC = (
    0.16666666508624325, -0.012499993912872317, 0.0030001104110358922, -0.0009704774894891345, 0.00036519256509730036,
    -0.0001511142490772495, 7.265708238926752e-05, -3.5614088287447545e-05, 6.586411162884957e-06,
    -1.5186995586274268e-06, 1.0221532974466211e-05, -5.957293224440687e-06,
)  # fmt: skip
CONSTANT = (
    0.33333343728877757, -0.025000351876614174, 0.006995004366333862, -0.00256200886352983, 0.00112253371011979,
    -0.0005350064220364648, 0.00014771036927872165, -5.085043054873254e-05, 0.00015621365646151884,
    -9.470233213283284e-05,
)  # fmt: skip
INVERSE = (
    -0.01973757842225879, 0.01548373902055921, -0.010761009775515348, 0.007173011083204162, -0.002052934906219229,
    0.000667421674900782, -0.00438541694967293, 0.003131990276421754,
)  # fmt: skip
SQUARE = (
    -0.0007795754493019583, 0.002116185168398221, 0.00012774067401150014, -0.0006457849233878622,
    -0.00732800335169967, 0.006618170264444974,
)  # fmt: skip
CENTRE = (
    (3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3, 1.3731693765509461125e4,
     4.5921953931549871457e4, 6.7265770927008700853e4, 3.3430575583588128105e4, 2.5090809287301226727e3),
    (1.0, 4.2313330701600911252e1, 6.8718700749205790830e2, 5.3941960214247511077e3,
     2.1213794301586595867e4, 3.9307895800092710610e4, 2.8729085735721942674e4, 5.2264952788528545610e3),
)  # fmt: skip
MIDDLE = (
    (1.42343711074968357734e0, 4.63033784615654529590e0, 5.76949722146069140550e0, 3.64784832476320460504e0,
     1.27045825245236838258e0, 2.41780725177450611770e-1, 2.27238449892691845833e-2, 7.74545014278341407640e-4),
    (1.0, 2.05319162663775882187e0, 1.67638483018380384940e0, 6.89767334985100004550e-1,
     1.48103976427480074590e-1, 1.51986665636164571966e-2, 5.47593808499534494600e-4, 1.05075007164441684324e-9),
)  # fmt: skip
TAIL = (
    (6.65790464350110377720e0, 5.46378491116411436990e0, 1.78482653991729133580e0, 2.96560571828504891230e-1,
     2.65321895265761230930e-2, 1.24266094738807843860e-3, 2.71155556874348757815e-5, 2.01033439929228813265e-7),
    (1.0, 5.99832206555887937690e-1, 1.36929880922735805310e-1, 1.48753612908506148525e-2,
     7.86869131145613259100e-4, 1.84631831751005468180e-5, 1.42151175831644588870e-7, 2.04426310338993978564e-15),
)  # fmt: skip

# Constants by name: a loop over a tuple would stay a loop.
_A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7, _A8, _A9, _A10, _A11 = QUADRATIC
_C0, _C1, _C2, _C3, _C4, _C5, _C6, _C7, _C8, _C9 = CONSTANT
_D0, _D1, _D2, _D3, _D4, _D5, _D6, _D7 = INVERSE
_E0, _E1, _E2, _E3, _E4, _E5 = SQUARE
_CENTRE, _MIDDLE, _TAIL = (np.array(part) for part in (CENTRE, MIDDLE, TAIL))
_11 = np.uint64(11)
_32 = np.uint64(32)
_LOW = np.uint64(0xFFFFFFFF)
_0 = np.uint64(0)


@inlined
def _ratio(table, r):
    above, below = table[0, 7], table[1, 7]
    for n in range(6, -1, -1):
        above = above * r + table[0, n]
        below = below * r + table[1, n]
    return above / below


@inlined
def normal_quantile(u):
    """W with Phi(w) = u, for u in (0, 1)."""
    q = u - 0.5
    if abs(q) <= 0.425:
        return q * _ratio(_CENTRE, 0.180625 - q * q)
    r = math.sqrt(minus_log(u if q < 0.0 else 1.0 - u))
    w = _ratio(_MIDDLE, r - 1.6) if r <= 5.0 else _ratio(_TAIL, r - 5.0)
    return -w if q < 0.0 else w


@inlined
def _poisson_by_sum(mean, u):
    term = exponential(-mean)
    total, count = term, 0.0
    while total < u and term > LEAST:  # rounding may keep the sum below the largest u
        count += 1.0
        term *= mean / count
        total += term
    return count


@inlined
def _poisson_by_expansion(mean, u):
    w = normal_quantile(u)
    root = math.sqrt(mean)
    t = min(max(w / root, -HELD), HELD) * (1.0 / HELD)
    a = fma(t, fma(t, fma(t, fma(t, fma(t, fma(t, _A11, _A10), _A9), _A8), _A7), _A6), _A5)
    a = fma(t, fma(t, fma(t, fma(t, fma(t, a, _A4), _A3), _A2), _A1), _A0)
    c = fma(t, fma(t, fma(t, fma(t, fma(t, _C9, _C8), _C7), _C6), _C5), _C4)
    c = fma(t, fma(t, fma(t, fma(t, c, _C3), _C2), _C1), _C0)
    d = fma(t, fma(t, fma(t, fma(t, fma(t, fma(t, fma(t, _D7, _D6), _D5), _D4), _D3), _D2), _D1), _D0)
    e = fma(t, fma(t, fma(t, fma(t, fma(t, _E5, _E4), _E3), _E2), _E1), _E0)
    inverse = 1.0 / mean
    return max(0.0, math.floor(fma(w * w, a, fma(root, w, mean)) + fma(inverse, fma(inverse, e, d), c)))


@inlined
def poisson_quantile(mean, u):
    """Smallest whole k with P(N <= k) >= u, N of Poisson's law with a mean of at least 0, for u in ``(0, 1)``."""
    return _poisson_by_sum(mean, u) if mean < SUMMED else _poisson_by_expansion(mean, u)


@inlined
def _unit(high, low):
    """Middle of one of ``2^52`` cells of ``(0, 1)``, from two words of 32 bits: never 0 or 1, exactly a double."""
    return (float(((high << _32) | low) >> np.uint64(12)) + 0.5) * 2.0**-52


@inlined
def _fill_units(key0, key1, first, count, units):
    """``units`` of the pixels ``2 first, 2 first + 1, ...``: two from each of ``count`` blocks, in two halves."""
    for n in range(count):
        a, b, c, d = philox(key0, key1, _0, np.uint64(first + n) & _LOW, np.uint64(first + n) >> _32, _0)
        units[n] = _unit(a, b)
        units[ROOM + n] = _unit(c, d)


@kernel
def add_poisson(key0, key1, mean, out):
    """Add to ``out`` float64[n] Poisson numbers of the means float64[n], pixel m by the uniform number m of a key."""
    units = np.empty(2 * ROOM)
    for first in range(0, (len(out) + 1) // 2, ROOM):
        count = min(ROOM, (len(out) + 1) // 2 - first)
        _fill_units(np.uint64(key0), np.uint64(key1), first, count, units)
        for m in range(2 * first, min(2 * (first + count), len(out))):
            out[m] += poisson_quantile(mean[m], units[(m & 1) * ROOM + (m >> 1) - first])


@kernel
def add_tabulated(key0, key1, cumulative, guide, out):
    """Add to ``out`` float64[n] numbers of one law, given by its table.

    Parameters
    ----------
    key0, key1
        Key of the uniform numbers.
    cumulative : float64[k]
        P(N <= 0), P(N <= 1), ..., the last above any uniform number.
    guide : int64[g]
        For each of g equal parts of (0, 1) the smallest number that its uniform numbers can give.
    out : float64[n]
    """
    units = np.empty(2 * ROOM)
    for first in range(0, (len(out) + 1) // 2, ROOM):
        count = min(ROOM, (len(out) + 1) // 2 - first)
        _fill_units(np.uint64(key0), np.uint64(key1), first, count, units)
        for m in range(2 * first, min(2 * (first + count), len(out))):
            u = units[(m & 1) * ROOM + (m >> 1) - first]
            number = guide[int(u * len(guide))]
            while cumulative[number] < u:
                number += 1
            out[m] += number


@kernel
def add_normal(key0, key1, deviation, out):
    """Add to ``out`` float64[n] normal numbers of a standard deviation, pixel m by the uniform number m of a key."""
    units = np.empty(2 * ROOM)
    for first in range(0, (len(out) + 1) // 2, ROOM):
        count = min(ROOM, (len(out) + 1) // 2 - first)
        _fill_units(np.uint64(key0), np.uint64(key1), first, count, units)
        for m in range(2 * first, min(2 * (first + count), len(out))):
            out[m] += deviation * normal_quantile(units[(m & 1) * ROOM + (m >> 1) - first])
