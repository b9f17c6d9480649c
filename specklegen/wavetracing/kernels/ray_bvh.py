"""Rays through the hierarchy of `specklegen.wavetracing.kernels.cone_bvh`, without leaks.

Triangles are met by the watertight test of Woop, Benthin and Wald (*Watertight ray/triangle intersection*, JCGT 2013):
two triangles that share an edge judge it by the same products in the same order, in strict arithmetic, so a ray
cannot pass between them.
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.wavetracing.kernels.cone_bvh import DEPTH, LEAF, next_waiting

NO = np.int64(-1)
"""No facet, to be skipped by a ray."""
_HUGE = 1e300  # one over a component that is zero: products stay defined, 0 * huge = 0


@inlined
def inverse(component):
    """One over a component of a direction, large but finite where it vanishes."""
    return 1.0 / component if abs(component) > 1.0 / _HUGE else math.copysign(_HUGE, component)


@inlined
def _box_entry(origin, slack, over, near, far, boxes, node):
    """Distance at which a ray enters a box; inf where it surely misses it between near and far.

    slack : 4e-16 of the origin's components; the difference of centre and origin is rounded once
    over  : `inverse` of the direction's components
    """
    x, y, z = boxes[node, 0] - origin[0], boxes[node, 1] - origin[1], boxes[node, 2] - origin[2]
    hx, hy, hz = boxes[node, 3] + slack[0], boxes[node, 4] + slack[1], boxes[node, 5] + slack[2]
    ax, bx = (x - hx) * over[0], (x + hx) * over[0]
    ay, by = (y - hy) * over[1], (y + hy) * over[1]
    az, bz = (z - hz) * over[2], (z + hz) * over[2]
    enter = max(min(ax, bx), min(ay, by), min(az, bz))
    leave = min(max(ax, bx), max(ay, by), max(az, bz))
    leave += 4e-15 * abs(leave)
    enter = max(enter - 4e-15 * abs(enter), near)
    return enter if enter <= min(leave, far) else math.inf


@inlined
def _sheared(px, py, pz, dx, dy, dz):
    """A ray seen along the axis w on which its direction is largest: numbers of three axes, origin, and its slopes."""
    ax, ay, az = abs(dx), abs(dy), abs(dz)
    if az >= ax and az >= ay:
        return 0, 1, 2, px, py, pz, dx / dz, dy / dz, 1.0 / dz
    if ay >= ax:
        return 2, 0, 1, pz, px, py, dz / dy, dx / dy, 1.0 / dy
    return 1, 2, 0, py, pz, px, dy / dx, dz / dx, 1.0 / dx


@inlined
def _ray_triangle(ray, corners, f):
    """Distance along a ray, `_sheared`, to a triangle; inf for a miss. Edges belong to both that share them."""
    u, v, w, pu, pv, pw, shear_u, shear_v, scale = ray
    az, bz, cz = corners[f, w] - pw, corners[f, 3 + w] - pw, corners[f, 6 + w] - pw
    ax, ay = (corners[f, u] - pu) - shear_u * az, (corners[f, v] - pv) - shear_v * az
    bx, by = (corners[f, 3 + u] - pu) - shear_u * bz, (corners[f, 3 + v] - pv) - shear_v * bz
    cx, cy = (corners[f, 6 + u] - pu) - shear_u * cz, (corners[f, 6 + v] - pv) - shear_v * cz
    e0, e1, e2 = cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax
    if (e0 < 0.0 or e1 < 0.0 or e2 < 0.0) and (e0 > 0.0 or e1 > 0.0 or e2 > 0.0):
        return math.inf
    total = e0 + e1 + e2
    if total == 0.0:
        return math.inf
    return (e0 * az + e1 * bz + e2 * cz) * scale / total


@kernel
def nearest(px, py, pz, dx, dy, dz, near, far, skip, facet, tree):
    """Nearest triangle on a ray in (near, far]: distance, place (-1: none), nodes visited.

    skip  : tuple of facets whose triangles are not met, for a ray that starts or ends on them; -1 for none
    facet : int32[n], the plane facet that each place belongs to
    """
    boxes, link, corners = tree
    best, place, visited = far, -1, 1
    if link.shape[0] == 0:
        return math.inf, -1, 0
    origin, slack = (px, py, pz), (4e-16 * abs(px), 4e-16 * abs(py), 4e-16 * abs(pz))
    over, ray = (inverse(dx), inverse(dy), inverse(dz)), _sheared(px, py, pz, dx, dy, dz)
    if _box_entry(origin, slack, over, near, far, boxes, 0) == math.inf:
        return math.inf, -1, 1
    waiting, node, height = np.empty((DEPTH, 2)), 0, 0
    while node >= 0:
        one = math.inf
        if link[node] < 0:
            first = -1 - link[node]
            for f in range(first, min(first + LEAF, corners.shape[0])):
                t = _ray_triangle(ray, corners, f)
                if t > near and (t < best or (t == best and place < 0 and t < math.inf)):
                    met = True
                    for one_of in skip:
                        met = met and (one_of < 0 or facet[f] != one_of)
                    if met:
                        best, place = t, f
        else:
            left, right = node + 1, link[node]
            one = _box_entry(origin, slack, over, near, best, boxes, left)
            two = _box_entry(origin, slack, over, near, best, boxes, right)
            if one > two:
                left, right, one, two = right, left, two, one
            if two < math.inf:
                waiting[height, 0], waiting[height, 1] = right, two
                height += 1
            node = left
        if one == math.inf:
            node, height = next_waiting(waiting, height, best)
        visited += node >= 0
    if place < 0:
        return math.inf, -1, visited
    return best, place, visited


@kernel
def nearest_of(origins, directions, near, facet, tree, distance, place):
    """`nearest` of many rays: fill ``distance`` float64[n] and ``place`` int64[n]; return the nodes visited."""
    visited = 0
    for n in range(origins.shape[0]):
        distance[n], place[n], count = nearest(
            origins[n, 0], origins[n, 1], origins[n, 2], directions[n, 0], directions[n, 1], directions[n, 2],
            near, math.inf, (NO, NO), facet, tree,
        )  # fmt: skip
        visited += count
    return visited
