"""Diffraction by two edges in turn, uniform where each lies near a shadow boundary of the other.

One uniform coefficient after the other is wrong there: the wave that meets the second edge is no ray. Near the
boundaries the field behind two edges is a quadrant of a complex Gaussian: of
``exp(-(h^2 - 2 rho h g + g^2)/2(1 - rho^2))`` over ``h' > h, g' > g``; rho is how far the edges share one Fresnel zone.
The part of its corner is

    C = s(a + rho b) s(b) J(|a + rho b|, r |b|) + s(b + rho a) s(a) J(|b + rho a|, r |a|),   r = sqrt(1 - rho^2),
    J(x, y) = 1/2pi int_0^inf e^{i pi/4} x e^{2 i e^{i pi/4} y v - v^2} / (x^2 + (y + e^{i pi/4} v)^2) dv,

s the sign: Owen's T function beyond its diagonal, for a complex argument. Each edge has four terms cot(d/2n), of direct
waves and images, d their angle into the shadow; a = sqrt(2 k L) sin(beta) sin(d/2), L1 = s1 (s2 + s3) / S,
L2 = (s1 + s2) s3 / S, S = s1 + s2 + s3; rho = sqrt(s1 s3 / ((s1 + s2) (s2 + s3))) times the cosine between the
directions into the lit sides of both terms, across the ray between the edges. Each product of two cotangents is
multiplied by -4 pi i r a b C, which is 1 far from all boundaries. Source and receiver may change places.

Source: F. Capolino, S. Maci, IEEE Trans. Antennas Propag. 45, 1354 (1997); M. Albani, IEEE Trans. Antennas Propag.
53, 702 (2005) (two edges in any arrangement); L. E. Vogler, Radio Sci. 17, 1541 (1982) (the integral for knife edges);
D. B. Owen, Ann. Math. Stat. 27, 1075 (1956).
"""

import cmath
import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel

_STEPS = np.linspace(-3.6, 21.0, 165)
_NODES = np.exp(_STEPS - np.exp(-_STEPS))
_WEIGHTS = _NODES * (1 + np.exp(-_STEPS)) * (_STEPS[1] - _STEPS[0])
_FEW = 42  # nodes that serve from x, y of 1 on, to 1e-9
_LAGUERRE = np.array([np.pad(np.array(np.polynomial.laguerre.laggauss(n)), ((0, 0), (0, 16 - n))) for n in (4, 8, 16)])
"""Nodes and weights that serve from y = 10, 5 and 3 on, to 1e-9, 1e-10 and 1e-9."""
_TURN = complex(math.sqrt(0.5), math.sqrt(0.5))
_SMALLEST = 1e-8  # of x and y, below which both count as this much


class Bend(NamedTuple):
    """A ray's bend at an edge.

    Attributes
    ----------
    n, angle, outer : float
        Exterior angle over pi; angles of the leg towards the other edge and of the outer leg, from the 0-face.
    sine : float
        Of the angle between ray and edge.
    weights : complex128[2, 3]
        Soft and hard, of the direct wave and the images in the 0-face and the n-face.
    """

    n: float
    angle: float
    outer: float
    sine: float
    weights: np.ndarray


@kernel
def _tail(x, y):
    """Return J(x, y) of numbers of at least 0.

    Where y is large the path of integration is turned, v = e^{i pi/4} s, so that the integrand falls as e^{-2 y s}.
    """
    total = complex(0.0, 0.0)
    if y >= 3.0:
        rule = 0 if y >= 10.0 else (1 if y >= 5.0 else 2)
        for n in range(4 << rule):
            s = 0.5 * _LAGUERRE[rule, 0, n] / y
            total += _LAGUERRE[rule, 1, n] * complex(math.cos(s * s), -math.sin(s * s)) / (x * x + complex(y, s) ** 2)
        return total * complex(0.0, x / (4.0 * math.pi * y))
    size = math.sqrt(x * x + y * y)
    if size < _SMALLEST:
        x, y = (x * _SMALLEST / size, y * _SMALLEST / size) if size > 0.0 else (0.0, _SMALLEST)
    m = min(max(size, _SMALLEST), 1.0) / max(1.0, y)
    for n in range(_FEW if size >= 1.0 else _NODES.shape[0]):
        v = m * _NODES[n]
        w = _TURN * v
        total += _WEIGHTS[n] * cmath.exp(complex(-v * v, 0.0) + 2j * y * w) / (x * x + (y + w) * (y + w))
    return _TURN * (x * m / (2.0 * math.pi)) * total


@inlined
def _sign(x):
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)


@inlined
def corner_share(a, b, rho):
    """Return ``C e^{-i (a^2 + 2 rho a b + b^2)}``; on a boundary its mean."""
    r, over_a, over_b = math.sqrt(1.0 - rho * rho), a + rho * b, b + rho * a
    one, two = _sign(over_a) * _sign(b), _sign(over_b) * _sign(a)
    total = complex(0.0, 0.0)
    if one != 0.0:
        total += one * _tail(abs(over_a), r * abs(b))
    if two != 0.0:
        total += two * _tail(abs(over_b), r * abs(a))
    return total


@kernel
def _term(bend, number, root):
    """One of four terms: a, a cot(d / 2n), whether the lit side is where the angle grows, and its column."""
    image, sign = number // 2, 1.0 if number % 2 == 0 else -1.0
    turned = sign * math.pi + bend.angle + (bend.outer if image else -bend.outer)
    d = -sign * (turned - 2.0 * math.pi * bend.n * np.rint(turned / (2.0 * math.pi * bend.n)))
    sine = math.sin(0.5 * d)
    cot = sine / math.tan(0.5 * d / bend.n) if d != 0.0 else bend.n
    return root * sine, root * cot, sign, 0 if image == 0 else (2 if sign > 0.0 else 1)


@kernel
def double_diffraction(first, second, s1, s2, s3, cosine, k, out):
    """Fill ``out`` complex128[2, 2]: D of two edges, soft or hard at the first, then at the second.

    cosine : between the directions across the leg between the edges in which ``angle`` grows at either edge
    """
    total = s1 + s2 + s3
    shared = math.sqrt(s1 * s3 / ((s1 + s2) * (s2 + s3))) * cosine
    one = math.sqrt(2.0 * k * s1 * (s2 + s3) / total) * first.sine
    two = math.sqrt(2.0 * k * s3 * (s1 + s2) / total) * second.sine
    scale = 1j / (8.0 * math.pi * k * first.n * second.n * first.sine * second.sine)
    out[:, :] = 0.0
    for m in range(4):
        a, cot_a, side_a, column_a = _term(first, m, one)
        if first.weights[0, column_a] == 0.0 and first.weights[1, column_a] == 0.0:
            continue
        for n in range(4):
            b, cot_b, side_b, column_b = _term(second, n, two)
            if second.weights[0, column_b] == 0.0 and second.weights[1, column_b] == 0.0:
                continue
            rho = min(max(side_a * side_b * shared, -1.0 + 1e-15), 1.0 - 1e-15)
            value = scale * (-4j * math.pi * math.sqrt(1.0 - rho * rho) * cot_a * cot_b) * corner_share(a, b, rho)
            for p in range(2):
                for q in range(2):
                    out[p, q] += first.weights[p, column_a] * second.weights[q, column_b] * value
