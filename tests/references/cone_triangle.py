"""A cone against a triangle by minimising, slice by slice: slow, and without a quadratic equation.

In coordinates in which the cone is { hypot(x, y) <= a + t z }, the slice of a triangle at depth z is a segment. The
gap g(z) = distance of that segment from the axis - (a + t z) is convex (a partial minimum of a function convex in all
variables), so golden sections find its least value, and bisection the first depth at which it is not positive.
"""

import math

import numpy as np
from numba import njit

_GOLDEN = 0.6180339887498949


@njit
def _segment_distance(p, q, r, s):
    """Distance of the origin from a segment (p, q) (r, s) of the plane."""
    dx, dy = r - p, s - q
    square = dx * dx + dy * dy
    along = min(max(-(p * dx + q * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
    return math.hypot(p + along * dx, q + along * dy)


@njit
def _at(p, q, z):
    """Point of the line from p to q, corners float64[3], at depth z."""
    rise = q[2] - p[2]
    s = min(max((z - p[2]) / rise, 0.0), 1.0) if rise > 0.0 else 0.0
    return p[0] + s * (q[0] - p[0]), p[1] + s * (q[1] - p[1])


@njit
def _gap(a, t, triangle, z):
    """g(z) of a triangle float64[3, 3] whose corners rise in z, z within its depths. A triangle across the axis is its
    own slice; its interior counts."""
    low, middle, high = triangle[0], triangle[1], triangle[2]
    if low[2] != high[2]:
        one, two = _at(low, high, z), _at(low, middle, z) if z <= middle[2] else _at(middle, high, z)
        return _segment_distance(one[0], one[1], two[0], two[1]) - (a + t * z)
    turns = np.array([low[0] * middle[1] - low[1] * middle[0], middle[0] * high[1] - middle[1] * high[0],
                      high[0] * low[1] - high[1] * low[0]])  # fmt: skip
    area = turns.sum()
    if area != 0.0 and (np.sign(turns) == np.sign(area)).all():
        return -(a + t * z)
    return min(_segment_distance(low[0], low[1], middle[0], middle[1]),
               _segment_distance(middle[0], middle[1], high[0], high[1]),
               _segment_distance(high[0], high[1], low[0], low[1])) - (a + t * z)  # fmt: skip


@njit
def _first_depth(a, t, near, far, triangle, steps):
    """`first_depth` of one cone and one triangle whose corners rise in z."""
    apex = -a / t if t > 0.0 else -np.inf
    start, stop = max(near, apex, triangle[0, 2]), min(far, triangle[2, 2])
    if start > stop:
        return np.inf, np.inf
    low, high = start, stop
    p, q = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_p, at_q = _gap(a, t, triangle, p), _gap(a, t, triangle, q)
    for _ in range(steps):
        if at_p < at_q:
            high = q
        else:
            low = p
        p, q = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_p, at_q = _gap(a, t, triangle, p), _gap(a, t, triangle, q)
    at_start, at_stop = _gap(a, t, triangle, start), _gap(a, t, triangle, stop)
    least, inner = at_p, p
    for gap, depth in ((at_q, q), (at_start, start), (at_stop, stop)):
        if gap < least:
            least, inner = gap, depth
    if least > 0.0:
        return least, np.inf
    if at_start <= 0.0:
        return least, start
    low, high = start, inner
    for _ in range(steps):
        middle = (low + high) / 2
        if _gap(a, t, triangle, middle) <= 0.0:
            high = middle
        else:
            low = middle
    return least, high


@njit
def _first_depths(a, t, near, far, triangles, steps, gap, depth):
    for n in range(len(a)):
        gap[n], depth[n] = _first_depth(a[n], t[n], near[n], far[n], triangles[n], steps)


def first_depth(
    a: np.ndarray, t: np.ndarray, near: np.ndarray, far: np.ndarray, triangles: np.ndarray, steps: int = 90
) -> tuple[np.ndarray, np.ndarray]:
    """Least gap, and least depth in [near, far] at which a triangle meets the cone on its nappe a + t z >= 0.

    Parameters
    ----------
    a, t, near, far : float64[n]
        Half-width, slope and slab of each cone.
    triangles : float64[n, 3, 3]
        Corners in scaled local coordinates.

    Returns
    -------
    gap, depth : float64[n]
        Gap inf where the slab misses the triangle; depth inf where the gap is positive.
    """
    triangles = np.take_along_axis(triangles, np.argsort(triangles[:, :, 2], axis=1)[:, :, None], axis=1)
    gap, depth = np.empty((2, len(a)))
    _first_depths(a, t, near, far, triangles, steps, gap, depth)
    return gap, depth
