"""Receivers that rays cross: where, and in which pixel.

A receiver is a row float64[15]: centre, unit vectors along columns, along rows and across, pitch, rows, columns.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined

RECEIVER = 15


class Receivers(NamedTuple):
    """Receivers float64[R, RECEIVER], and the number int64[R + 1] of the first cell of each in what they count."""

    planes: np.ndarray
    first_cell: np.ndarray


@inlined
def crossing(px, py, pz, dx, dy, dz, reach, planes, r):
    """Crossing of a ray with receiver r within ``reach``: its pixel, -1 for none, the distance, and 1 / |cos|."""
    along = dx * planes[r, 9] + dy * planes[r, 10] + dz * planes[r, 11]
    x, y, z = planes[r, 0] - px, planes[r, 1] - py, planes[r, 2] - pz
    t = (x * planes[r, 9] + y * planes[r, 10] + z * planes[r, 11]) / along
    if not (t > 0.0 and t <= reach and t < math.inf):
        return -1, t, 0.0
    x, y, z = t * dx - x, t * dy - y, t * dz - z
    u = (x * planes[r, 3] + y * planes[r, 4] + z * planes[r, 5]) / planes[r, 12] + 0.5 * planes[r, 14]
    v = (x * planes[r, 6] + y * planes[r, 7] + z * planes[r, 8]) / planes[r, 12] + 0.5 * planes[r, 13]
    if u >= 0.0 and u < planes[r, 14] and v >= 0.0 and v < planes[r, 13]:
        return int(v) * int(planes[r, 14]) + int(u), t, 1.0 / abs(along)
    return -1, t, 0.0


@inlined
def balance(density, away, steep, planes, r):
    """Weight of light that a matt surface sends to a receiver, by chance or aimed at it: the balance heuristic.

    density : cos / pi, of the direction by chance;  away, steep : distance, and 1 / |cos| at the receiver
    """
    return density / (density + away * away * steep / (planes[r, 12] * planes[r, 12] * planes[r, 13] * planes[r, 14]))
