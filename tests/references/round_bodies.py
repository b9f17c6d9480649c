"""Perfectly soft and hard cylinders and spheres in the light of a line or a point, by their series of eigenfunctions.

Time e^{-i omega t}. M. Abramowitz, I. A. Stegun, *Handbook of Mathematical Functions*, 9.1.79 and 10.1.45 (addition
theorems); the coefficient of each wave makes u, or its normal derivative, 0 on the surface.
"""

import numpy as np
from scipy.special import eval_legendre, h1vp, hankel1, jv, jvp, spherical_jn, spherical_yn


def cylinder_series(points, distance, radius, hard, k=2 * np.pi):
    """Field over the incident one at points float64[P, 2+], of a line at (-distance, 0) by a cylinder about z."""
    n = np.arange(-int(k * radius + 60), int(k * radius + 60) + 1)[:, None]
    x, y = points[:, 0], points[:, 1]
    lit = hankel1(0, k * np.hypot(x + distance, y))
    own = jvp(n, k * radius) / h1vp(n, k * radius) if hard else jv(n, k * radius) / hankel1(n, k * radius)
    waves = own * hankel1(n, k * distance) * hankel1(n, k * np.hypot(x, y)) * np.exp(1j * n * np.arctan2(-y, -x))
    return 1 - waves.sum(axis=0) / lit


def sphere_series(points, distance, radius, hard, k=2 * np.pi):
    """Field over the incident one at points float64[P, 3], of a point at (-distance, 0, 0) by a sphere."""
    n = np.arange(int(k * radius + 4 * (k * radius) ** (1 / 3) + 20))[:, None]

    def outgoing(x, slope=False):
        return spherical_jn(n, x, slope) + 1j * spherical_yn(n, x, slope)

    r, away = np.linalg.norm(points, axis=1), np.linalg.norm(points + [distance, 0, 0], axis=1)
    own = spherical_jn(n, k * radius, hard) / outgoing(k * radius, hard)
    waves = (2 * n + 1) * own * outgoing(k * distance) * outgoing(k * r[None]) * eval_legendre(n, -points[:, 0] / r)
    return 1 - 1j * k * waves.sum(axis=0) * away / np.exp(1j * k * away)
