"""A cone against a triangle by minimising, slice by slice: slow, and without a quadratic equation.

In coordinates in which the cone is { hypot(x, y) <= a + t z }, the slice of a triangle at depth z is a segment. The
gap g(z) = distance of that segment from the axis - (a + t z) is convex (a partial minimum of a function convex in all
variables), so golden sections find its least value, and bisection the first depth at which it is not positive.
"""

import numpy as np

_GOLDEN = 0.6180339887498949


def _segment_distance(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Distance of the origin from segments p q, float64[n, 2] each."""
    d = q - p
    square = (d * d).sum(axis=1)
    s = np.clip(np.divide(-(p * d).sum(axis=1), square, out=np.zeros(len(p)), where=square > 0), 0, 1)
    return np.linalg.norm(p + s[:, None] * d, axis=1)


def gap(a: np.ndarray, t: np.ndarray, triangles: np.ndarray, z: np.ndarray) -> np.ndarray:
    """g(z) of triangles float64[n, 3, 3] whose corners rise in z; z float64[n] within their depths.

    A triangle across the axis is its own slice; its interior counts.
    """
    low, middle, high = triangles[:, 0], triangles[:, 1], triangles[:, 2]

    def at(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        rise = q[:, 2] - p[:, 2]
        s = np.clip(np.divide(z - p[:, 2], rise, out=np.zeros(len(z)), where=rise > 0), 0, 1)
        return p[:, :2] + s[:, None] * (q[:, :2] - p[:, :2])

    one = at(low, high)
    two = np.where((z <= middle[:, 2])[:, None], at(low, middle), at(middle, high))
    distance = _segment_distance(one, two)
    across = low[:, 2] == high[:, 2]
    if across.any():
        pairs = [(p[across, :2], q[across, :2]) for p, q in ((low, middle), (middle, high), (high, low))]
        sides = [_segment_distance(p, q) for p, q in pairs]
        turns = [p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in pairs]
        area = sum(turns)
        inside = np.all([np.sign(turn) == np.sign(area) for turn in turns], axis=0) & (area != 0)
        distance[across] = np.where(inside, 0.0, np.minimum.reduce(sides))
    return distance - (a + t * z)


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
    apex = np.divide(-a, t, out=np.full(len(a), -np.inf), where=t > 0)
    start = np.maximum(np.maximum(near, apex), triangles[:, 0, 2])
    stop = np.minimum(far, triangles[:, 2, 2])
    empty = start > stop
    low, high = start.copy(), np.where(empty, start, stop)
    p, q = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_p, at_q = gap(a, t, triangles, p), gap(a, t, triangles, q)
    for _ in range(steps):
        left = at_p < at_q
        high, low = np.where(left, q, high), np.where(left, low, p)
        p, q = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_p, at_q = gap(a, t, triangles, p), gap(a, t, triangles, q)
    candidates = np.stack([p, q, start, np.where(empty, start, stop)])
    gaps = np.stack([at_p, at_q, gap(a, t, triangles, candidates[2]), gap(a, t, triangles, candidates[3])])
    best = gaps.argmin(axis=0)
    least = np.take_along_axis(gaps, best[None], axis=0)[0]
    inner = np.take_along_axis(candidates, best[None], axis=0)[0]
    low, high = start.copy(), inner
    already = gaps[2] <= 0
    for _ in range(steps):
        middle = (low + high) / 2
        hit = gap(a, t, triangles, middle) <= 0
        high, low = np.where(hit, middle, high), np.where(hit, low, middle)
    depth = np.where(already, start, high)
    return np.where(empty, np.inf, least), np.where(empty | (least > 0), np.inf, depth)
