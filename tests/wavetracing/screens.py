"""Screens with holes for the tests, and the field behind them by the integral over the rim."""

import numpy as np

from specklegen.wavetracing import Geometry, perforated_screen

FAR = 1e5
OUTLINE = np.array([[-FAR, -FAR], [FAR, -FAR], [FAR, FAR], [-FAR, FAR]])
_ANGLE = np.pi / 6 * np.arange(12)
_RADIUS = np.where(np.arange(12) % 2, 6 / np.sqrt(3), 6.0)
HEXAGRAM = np.stack([_RADIUS * np.cos(_ANGLE), _RADIUS * np.sin(_ANGLE)], axis=1)
HEXAGRAM_AREA = 6 * 6 * 6 / np.sqrt(3) * 0.5 * 2 * np.sin(np.pi / 6)


def slit(centre, width=5.0, length=20.0):
    x, y = width / 2, length / 2
    return np.array([[centre - x, -y], [centre + x, -y], [centre + x, y], [centre - x, y]])


def screen(*holes, **options) -> Geometry:
    return Geometry(perforated_screen(OUTLINE, holes, **options))


def rim_intensity(corners, points, z, nodes=32):
    """|u|^2 at points float64[P, 2] a distance z behind a hole under a plane wave at right angles; wavelength 1.

    u = w e^{ikz} - (1 / 2 pi) int (z / R) e^{ikR} dphi around the rim (Rayleigh-Sommerfeld I), the winding number w
    written as such an integral too, so that nothing is singular when P's foot is near the rim.
    """
    x, weight = np.polynomial.legendre.leggauss(nodes)
    x, weight = (x + 1) / 2, weight / 2
    total = np.zeros(len(points), complex)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        d = b - a
        r = a + x[:, None] * d - points[:, None]
        square = (r * r).sum(axis=-1)
        turn = (r[..., 0] * d[1] - r[..., 1] * d[0]) / square
        distance = np.sqrt(square + z * z)
        phase = 2j * np.pi * square / (distance + z)
        total -= (turn * (z / distance * np.exp(phase) - 1) * weight).sum(axis=1) / (2 * np.pi)
    return np.abs(total) ** 2
