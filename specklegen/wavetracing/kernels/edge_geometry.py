"""Edges as kernels know them: a row of floats each, angles about it, and where paths by it turn."""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined

# An edge, float64[EDGE]: start, unit vector along, length, n, unit normal of the 0-face, unit vector into that face.
START, ALONG, LENGTH, WEDGE, NORMAL, INWARD, EDGE = 0, 3, 6, 7, 8, 11, 14


class EdgeTable(NamedTuple):
    """Edges that diffract.

    Attributes
    ----------
    at : int32[n, 3]
        Edge at each side of a place in the leaves; -1 for none.
    edges : float64[E, EDGE]
        Start, unit vector along, length, n, unit normal of the 0-face, unit vector into that face.
    facets, rows : int32[E, 2]
        Plane facets of the two faces, of a boundary both sides of its one face; and their rows of materials.
    """

    at: np.ndarray
    edges: np.ndarray
    facets: np.ndarray
    rows: np.ndarray


@inlined
def dot(p, q):
    """Scalar product."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@inlined
def moved(p, direction, length):
    """A point moved along a direction."""
    return p[0] + length * direction[0], p[1] + length * direction[1], p[2] + length * direction[2]


@inlined
def height(planes, m, p):
    """Height of a point over plane m of float64[*, 4], unit normal and distance from the origin."""
    return planes[m, 0] * p[0] + planes[m, 1] * p[1] + planes[m, 2] * p[2] - planes[m, 3]


@inlined
def along(edge, t):
    """The point at t along an edge."""
    return edge[START] + t * edge[ALONG], edge[START + 1] + t * edge[ALONG + 1], edge[START + 2] + t * edge[ALONG + 2]


@inlined
def turn(edge, dx, dy, dz):
    """Angle of a direction about an edge, from the 0-face, in ``[0, 2 pi]``."""
    phi = math.atan2(
        dx * edge[NORMAL] + dy * edge[NORMAL + 1] + dz * edge[NORMAL + 2],
        dx * edge[INWARD] + dy * edge[INWARD + 1] + dz * edge[INWARD + 2],
    )
    return phi if phi >= 0.0 else phi + 2.0 * math.pi


@inlined
def in_the_air(edge, phi, slack):
    """Angle ``phi`` about an edge, within ``slack`` of a face on it; -1 inside the wedge."""
    top = edge[WEDGE] * math.pi
    if phi <= top:
        return phi
    if phi - top <= slack:
        return top
    return 0.0 if 2.0 * math.pi - phi <= slack else -1.0


@inlined
def polar(edge, x, y, z):
    """A point about an edge: its angle, distance from the line, and coordinate along it."""
    x, y, z = x - edge[START], y - edge[START + 1], z - edge[START + 2]
    t = x * edge[ALONG] + y * edge[ALONG + 1] + z * edge[ALONG + 2]
    up = x * edge[NORMAL] + y * edge[NORMAL + 1] + z * edge[NORMAL + 2]
    aside = x * edge[INWARD] + y * edge[INWARD + 1] + z * edge[INWARD + 2]
    phi = math.atan2(up, aside)
    return phi if phi >= 0.0 else phi + 2.0 * math.pi, math.sqrt(up * up + aside * aside), t
