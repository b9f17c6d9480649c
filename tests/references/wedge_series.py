"""A plane wave and a perfect wedge or half plane: exact solutions.

Angles are measured from one face (the 0-face) through the air to the other at n pi; the wave comes *from* the angle
phi' (its incidence), time e^{-i omega t}, incident field e^{-ikr cos(phi - phi')}. The upper sign is soft (u = 0 on
the faces), the lower hard (du/dn = 0).

    wedge       u = (1/n) sum_m eps_m e^{-i pi m / 2n} J_{m/n}(kr) [cos(m (phi - phi')/n) -+ cos(m (phi + phi')/n)]
    half plane  u = U(phi - phi') -+ U(phi + phi'),  U(y) = (1/2) e^{-ikr cos y} erfc(-e^{-i pi/4} sqrt(2kr) cos(y/2))

with eps_0 = 1 and eps_m = 2 otherwise. A wave at the angle beta to the edge has k sin(beta) for k and, at the
distance z along the edge, the factor e^{ik z cos(beta)}.
Source: Bowman, Senior, Uslenghi, *Electromagnetic and Acoustic Scattering by Simple Shapes* (1987), 6.2 and 8.2;
Sommerfeld (1896).
"""

from typing import Literal

import numpy as np
from scipy.special import jv, wofz

Boundary = Literal["soft", "hard"]


def _sign(boundary: Boundary) -> float:
    return -1.0 if boundary == "soft" else 1.0


def wedge_series(
    n: float, phi: np.ndarray, incidence: np.ndarray, distance: float, k: float, boundary: Boundary
) -> np.ndarray:
    """Total field complex128[...] at one distance r from the edge, for angles that broadcast; 0.5 <= n <= 2. The orders
    of the Bessel functions run to kr + 14 (kr)^(1/3) + 30, where they are below 1e-20; the work grows like kr for every
    angle."""
    sign, x = _sign(boundary), k * distance
    m = np.arange(int(np.ceil(n * (x + 14 * np.cbrt(x) + 30))))
    weights = np.where(m == 0, 1, 2) / n * np.exp(-0.5j * np.pi * (m / n)) * jv(m / n, x)
    phi, incidence = np.broadcast_arrays(np.asarray(phi, float), np.asarray(incidence, float))
    below, above = ((phi - incidence) / n).ravel(), ((phi + incidence) / n).ravel()
    total = np.empty(below.shape, complex)
    for some in np.array_split(np.arange(below.size), 1 + below.size * m.size // (1 << 22)):
        total[some] = (np.cos(below[some, None] * m) + sign * np.cos(above[some, None] * m)) @ weights
    return total.reshape(phi.shape)


def half_plane(
    phi: np.ndarray,
    incidence: np.ndarray,
    distance: np.ndarray,
    k: float,
    boundary: Boundary,
    beta: float = np.pi / 2,
    z: float = 0.0,
) -> np.ndarray:
    """Total field complex128[...] of a half plane at distances r from the edge, 0 <= phi <= 2 pi. Exact to rounding of
    the phase, 1e-16 kr. ``beta`` is the angle between the wave's direction and the edge."""
    kr = k * np.sin(beta) * np.asarray(distance, float)
    below, above = _shadowed(np.subtract(phi, incidence), kr), _shadowed(np.add(phi, incidence), kr)
    return (below + _sign(boundary) * above) * np.exp(1j * k * np.cos(beta) * z)


def _shadowed(angle: np.ndarray, kr: np.ndarray) -> np.ndarray:
    """U(y): with s = sqrt(2kr) cos(y/2), half of e^{ikr} w(e^{i pi/4} |s|), off the plane wave where s > 0."""
    s = np.sqrt(2 * kr) * np.cos(angle / 2)
    tail = 0.5 * np.exp(1j * kr) * wofz(np.exp(0.25j * np.pi) * np.abs(s))
    return np.where(s > 0, np.exp(-1j * kr * np.cos(angle)) - tail, tail)


def transition_function(x: np.ndarray) -> np.ndarray:
    """F-bar(X) = sqrt(pi X) e^{-i pi/4} w(e^{i pi/4} sqrt(X)), complex128[...], by the Faddeeva function. The complex
    conjugate of Kouyoumjian and Pathak, Proc. IEEE 62, 1448 (1974), Eq. 26, whose time is e^{+i omega t}."""
    root = np.sqrt(np.asarray(x, float))
    return np.sqrt(np.pi) * root * np.exp(-0.25j * np.pi) * wofz(np.exp(0.25j * np.pi) * root)
