"""Rays through the hierarchy of `specklegen.wavetracing.kernels.cone_bvh`, without leaks.

Triangles are met by the watertight test of Woop, Benthin and Wald (*Watertight ray/triangle intersection*, JCGT 2013):
two triangles that share an edge judge it by the same products in the same order, in strict arithmetic, so a ray
cannot pass between them.
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.wavetracing.kernels.cone_bvh import DEPTH, LEAF, push_nearer_last

_HUGE = 1e300  # one over a component that is zero: products stay defined, 0 * huge = 0


@inlined
def inverse(component):
    """One over a component of a direction, large but finite where it vanishes."""
    return 1.0 / component if abs(component) > 1.0 / _HUGE else math.copysign(_HUGE, component)


@inlined
def box_entry(px, py, pz, ix, iy, iz, near, far, boxes, node):
    """Distance at which a ray enters a box; inf where it surely misses it between near and far."""
    x, y, z = boxes[node, 0] - px, boxes[node, 1] - py, boxes[node, 2] - pz
    hx, hy, hz = boxes[node, 3], boxes[node, 4], boxes[node, 5]
    # The difference of centre and origin is rounded once; the half extents take it in.
    hx, hy, hz = hx + 4e-16 * abs(px), hy + 4e-16 * abs(py), hz + 4e-16 * abs(pz)
    ax, bx = (x - hx) * ix, (x + hx) * ix
    ay, by = (y - hy) * iy, (y + hy) * iy
    az, bz = (z - hz) * iz, (z + hz) * iz
    enter = max(min(ax, bx), min(ay, by), min(az, bz))
    leave = min(max(ax, bx), max(ay, by), max(az, bz))
    leave += 4e-15 * abs(leave)
    enter -= 4e-15 * abs(enter)
    if enter > leave or leave < near or enter > far:
        return math.inf
    return max(enter, near)


@inlined
def largest_axis(dx, dy, dz):
    """Number of the axis along which a direction is largest."""
    ax, ay, az = abs(dx), abs(dy), abs(dz)
    if az >= ax and az >= ay:
        return 2
    return 1 if ay >= ax else 0


@inlined
def ray_triangle(px, py, pz, dx, dy, dz, axis, corners, f):
    """Distance along a ray to a triangle, in units of the direction's length; inf for a miss. Edges belong to both."""
    if axis == 2:
        u, v, w = 0, 1, 2
        pu, pv, pw, du, dv, dw = px, py, pz, dx, dy, dz
    elif axis == 1:
        u, v, w = 2, 0, 1
        pu, pv, pw, du, dv, dw = pz, px, py, dz, dx, dy
    else:
        u, v, w = 1, 2, 0
        pu, pv, pw, du, dv, dw = py, pz, px, dy, dz, dx
    shear_u, shear_v, scale = du / dw, dv / dw, 1.0 / dw
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
def nearest(px, py, pz, dx, dy, dz, near, far, skip, other, facet, tree):
    """Nearest triangle on a ray in (near, far]: distance, place (-1: none), nodes visited.

    skip  : facet whose triangles are not met, for a ray that starts on it, nor those of ``other``; -1 for none
    facet : int32[n], the plane facet that each place belongs to
    """
    boxes, link, corners = tree
    best, place, visited = far, -1, 0
    n = corners.shape[0]
    if link.shape[0] == 0:
        return math.inf, -1, 0
    ix, iy, iz = inverse(dx), inverse(dy), inverse(dz)
    axis = largest_axis(dx, dy, dz)
    stack = np.empty(DEPTH, np.int32)
    depths = np.empty(DEPTH)
    stack[0], depths[0], height = 0, near, 1
    if box_entry(px, py, pz, ix, iy, iz, near, far, boxes, 0) == math.inf:
        return math.inf, -1, 1
    while height > 0:
        height -= 1
        if depths[height] > best:
            continue
        node = stack[height]
        visited += 1
        if link[node] < 0:
            first = -1 - link[node]
            for f in range(first, min(first + LEAF, n)):
                t = ray_triangle(px, py, pz, dx, dy, dz, axis, corners, f)
                if t > near and t < math.inf and (skip < 0 or (facet[f] != skip and facet[f] != other)):
                    if t < best or (t == best and place < 0):
                        best, place = t, f
            continue
        left, right = node + 1, link[node]
        a = box_entry(px, py, pz, ix, iy, iz, near, best, boxes, left)
        b = box_entry(px, py, pz, ix, iy, iz, near, best, boxes, right)
        height = push_nearer_last(stack, depths, height, left, a, right, b)
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
            near, math.inf, -1, -1, facet, tree,
        )  # fmt: skip
        visited += count
    return visited
