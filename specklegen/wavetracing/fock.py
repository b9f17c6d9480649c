"""Fock's functions of smooth bodies: what their shadows and their reflections near grazing incidence need.

Formulas with their sources stand in comments below.
"""

# With time e^{-i omega t}, the field near the boundary of the shadow is (up to factors) the integral
#
#     pi^{-1/2} / (-2i) int conj(W) / W e^{i x t + i eta t^2} dt = p - i eta p_2 - eta^2 p_4 / 2 ... - (F's part),
#     p(x) = pi^{-1/2} [ int_0^inf V / W e^{i x t} dt + int_{-inf}^0 conj(W) / (-2i W) e^{i x t} dt ],
#
# V = sqrt(pi) Ai(t), W = sqrt(pi) (Bi + i Ai)(t), derivatives of both for hard bodies; eta is how far from the body the
# source and the point are, p_n the n-th derivative. In the shadow, x > 0, it is a sum over zeros -q of Ai (Ai' if
# hard), where W = 0,
#
#     -e^{-i pi/6} / (2 sqrt(pi)) sum of w e^{-x q e^{-i pi/6} + i eta q^2 e^{2 i pi/3}},
#
# w = Ai'(-q)^{-2}, or 1 / (q Ai(-q)^2) if hard. Source: P. H. Pathak, W. D. Burnside, R. J. Marhefka, IEEE Trans.
# Antennas Propag. 28, 631 (1980), conjugated, without eta; V. A. Fock, *Electromagnetic Diffraction and Propagation
# Problems* (1965).

from functools import cache

import numpy as np
from scipy.special import ai_zeros, airy

STEP, LOWEST, MIDDLE = 0.02, -8.0, 0.7
"""Pitch of the table of p; where it begins and ends."""
_BENT = np.exp(0.3j)  # direction in which the integral over negative t leaves the axis


def _by_integral(x: np.ndarray) -> np.ndarray:
    """p, p'' and p'''' at x, soft and hard in turn, complex128[n, 6]."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    ahead, behind = 6.0 * (nodes + 1), -15.0 * (nodes + 1) * _BENT
    first, second = np.exp(-1j * np.outer(x, ahead)), np.exp(-1j * np.outer(x, behind))
    values = []
    for order in (0, 2, 4):
        for part, twist in ((0, np.exp(-2j * np.pi / 3)), (1, np.exp(2j * np.pi / 3))):
            above, below = (airy(behind * np.exp(s * 2j * np.pi / 3))[part] for s in (1, -1))
            ai, bi = airy(ahead)[part], airy(ahead)[2 + part]
            lit = ai / (bi - 1j * ai) * (-1j * ahead) ** order
            dark = -twist * above / below / 2j * (-1j * behind) ** order
            total = first @ (6.0 * weights * lit) + second @ (15.0 * weights * _BENT * dark)
            values.append(total.conj() / np.sqrt(np.pi))
    return np.stack(values, axis=1)


@cache
def fock_tables() -> tuple[np.ndarray, np.ndarray]:
    """Return p and its derivatives, complex128[n, 6], two nodes more at both ends; and (q, w) float64[80, 4]."""
    soft, hard, ai_hard, slope = ai_zeros(80)
    x = np.arange(round((MIDDLE - LOWEST) / STEP) + 5) * STEP + LOWEST - 2 * STEP
    return _by_integral(x), np.column_stack([-soft, slope**-2.0, -hard, -1 / (hard * ai_hard**2)])
