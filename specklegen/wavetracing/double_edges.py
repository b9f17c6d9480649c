"""Diffraction by two edges in turn, uniform where each lies near a shadow boundary of the other.

One uniform coefficient after the other is wrong there: the wave that meets the second edge is no ray. Near the
boundaries the field behind two edges is a quadrant of a complex Gaussian: of exp(-(h^2 - 2 rho h g + g^2)/2(1 - rho^2))
over h' > h, g' > g; rho is how far the edges share one Fresnel zone. The part of its corner is

    C = s(a + rho b) s(b) J(|a + rho b|, r |b|) + s(b + rho a) s(a) J(|b + rho a|, r |a|),   r = sqrt(1 - rho^2),
    J(x, y) = 1/2pi int_0^inf e^{i pi/4} x e^{2 i e^{i pi/4} y v - v^2} / (x^2 + (y + e^{i pi/4} v)^2) dv,

s the sign: Owen's T function beyond its diagonal, for a complex argument. Each edge has four terms cot(d/2n), of direct
waves and images, d their angle into the shadow, a = sqrt(2 k L) sin(beta) sin(d/2), L1 = s1 (s2 + s3) / S,
L2 = (s1 + s2) s3 / S, S = s1 + s2 + s3, and rho = sqrt(s1 s3 / ((s1 + s2) (s2 + s3))) times the cosine between the
directions into the lit sides of both terms, across the ray between the edges. Each product of two cotangents is
multiplied by -4 pi i r a b C, which is 1 far from all boundaries. Source and receiver may change places.

Source: F. Capolino, S. Maci, IEEE Trans. Antennas Propag. 45, 1354 (1997); M. Albani, IEEE Trans. Antennas Propag. 53,
702 (2005) (two edges in any arrangement); L. E. Vogler, Radio Sci. 17, 1541 (1982) (the integral for knife edges);
D. B. Owen, Ann. Math. Stat. 27, 1075 (1956).
"""

from typing import NamedTuple

import numpy as np

_STEPS = np.linspace(-3.6, 21.0, 165)
_NODES = np.exp(_STEPS - np.exp(-_STEPS))
_WEIGHTS = _NODES * (1 + np.exp(-_STEPS)) * (_STEPS[1] - _STEPS[0])
_FEW = 48  # nodes that serve from x, y of 1 on
_TURN = np.exp(0.25j * np.pi)
_SMALLEST = 1e-8  # of x and y, below which both count as this much


class Bend(NamedTuple):
    """A ray's bend at an edge, over points: angles float64[P] of the leg towards the other edge and of the outer leg.

    ``angle``, ``outer`` from the 0-face; ``across`` float64[P, 3]: where ``angle`` grows, across the leg between the
    edges; ``sine``: of the angle between ray and edge; ``weights`` complex128[P, 3]: of the direct wave and the images
    in the 0-face and the n-face.
    """

    n: float
    angle: np.ndarray
    outer: np.ndarray
    across: np.ndarray
    sine: np.ndarray
    weights: np.ndarray


def double_diffraction(first: Bend, second: Bend, s1, s2, s3, k: float) -> np.ndarray:
    """Return D of two edges, complex128[P]: a length, that of two coefficients of `wedge_coefficients` multiplied.

    s1, s2, s3 : lengths float64[P] of the ray's legs
    """
    total = s1 + s2 + s3
    shared = np.sqrt(s1 * s3 / ((s1 + s2) * (s2 + s3)))
    one = _terms(first, np.sqrt(2 * k * s1 * (s2 + s3) / total) * first.sine)
    two = _terms(second, np.sqrt(2 * k * s3 * (s1 + s2) / total) * second.sine)
    cosine = (first.across * second.across).sum(axis=1)
    coefficient = np.zeros(len(total), complex)
    for a, cot_a, side_a, weight_a in one:
        for b, cot_b, side_b, weight_b in two:
            weight = weight_a * weight_b
            there = np.flatnonzero(weight)
            if len(there):
                rho = (side_a * side_b * shared * cosine)[there]
                corner = corner_share(a[there], b[there], rho)
                scale = -4j * np.pi * np.sqrt(1 - rho**2)
                coefficient[there] += weight[there] * cot_a[there] * cot_b[there] * scale * corner
    return coefficient * 1j / (8 * np.pi * k * first.n * second.n * first.sine * second.sine)


def _terms(bend: Bend, root: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, float, np.ndarray]]:
    """Return a, a cot(d / 2n), and whether the lit side is where ``angle`` grows, of the four terms of an edge."""
    terms, n = [], bend.n
    for image, sign, column in ((0, 1, 0), (0, -1, 0), (1, -1, 1), (1, 1, 2)):
        turned = sign * np.pi + bend.angle + (bend.outer if image else -bend.outer)
        d = -sign * (turned - 2 * np.pi * n * np.rint(turned / (2 * np.pi * n)))
        a = root * np.sin(d / 2)
        cot = np.divide(np.sin(d / 2), np.tan(d / (2 * n)), out=np.full(d.shape, n, float), where=d != 0)
        terms.append((a, root * cot, float(sign), bend.weights[:, column]))
    return terms


def corner_share(a: np.ndarray, b: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """Return C e^{-i (a^2 + 2 rho a b + b^2)}, complex128[P], of float64[P] each; on a boundary its mean."""
    r = np.sqrt(1 - rho**2)
    over_a, over_b = a + rho * b, b + rho * a
    one = np.sign(over_a) * np.sign(b) * _tail(np.abs(over_a), r * np.abs(b))
    return one + np.sign(over_b) * np.sign(a) * _tail(np.abs(over_b), r * np.abs(a))


def _tail(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return J(x, y) for float64[P] of at least 0."""
    size = np.hypot(x, y)
    small = size < _SMALLEST
    x, y = (np.where(small, np.where(size > 0, v / np.where(size > 0, size, 1), 0.0) * _SMALLEST, v) for v in (x, y))
    m = np.clip(size, _SMALLEST, 1) / np.maximum(1, y)
    integral = np.empty(len(x), complex)
    for part, nodes in ((size >= 1, _FEW), (size < 1, len(_NODES))):
        here, v = y[part, None], m[part, None] * _NODES[:nodes]
        with np.errstate(under="ignore"):
            decay = np.exp(2j * _TURN * here * v - v * v)
        below = x[part, None] ** 2 + (here + _TURN * v) ** 2
        integral[part] = np.divide(decay, below, out=np.zeros_like(decay), where=below != 0) @ _WEIGHTS[:nodes]
    return _TURN * x * m * integral / (2 * np.pi)
