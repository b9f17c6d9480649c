"""Shadows on edges: the part of an edge that light from a point may reach, by mirrors in turn.

A point and an edge span a plane. A triangle that the plane cuts between the two hides a part of the edge. A mirror
shows the point in the part only that its own triangles cut out. By mirrors each leg runs from the image of the point in
those before it to the image of the edge in those behind it.

Doubt counts as light: shadows are taken a little short, and triangles that nearly lie in the plane cast none. So what
is dark here is dark to every ray, and no path to it need be tried.
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.wavetracing.kernels.cone_bvh import DEPTH, LEAF
from specklegen.wavetracing.kernels.edge_geometry import ALONG, LENGTH, along, dot, height, moved
from specklegen.wavetracing.kernels.ray_bvh import NO
from specklegen.wavetracing.kernels.surfaces import WALL

_SHORT = 2.5e-3  # of `Graph.raised`, by which shadows are shorter: 1e-9 of the scene
_ASLANT = 1e-6  # square of the sine between a side and the plane, below which it is in doubt where they meet
_NEAREST = 1e-3  # of the way from the point to the edge, within which nothing casts a shadow
_WAITING = 64  # shadows that wait for one beside them


@inlined
def _cut(f, g, low, high):
    """The part from low to high on which a linear function, f at the start and g at the end, is not negative."""
    if f < 0.0 and g < 0.0:
        return 1.0, 0.0
    at = f / (f - g) if f != g else 0.0
    return (max(low, at) if f < 0.0 else low), (min(high, at) if g < 0.0 else high)


@kernel
def _section(corners, f, apex, across, slack):
    """Segment, from the apex, in which a plane through it of a unit normal cuts a triangle; how many ends; doubt."""
    count, doubt, one, two = 0, False, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for j in range(3):
        i, k = 3 * j, 3 * ((j + 1) % 3)
        p = (corners[f, i] - apex[0], corners[f, i + 1] - apex[1], corners[f, i + 2] - apex[2])
        q = (corners[f, k] - apex[0], corners[f, k + 1] - apex[1], corners[f, k + 2] - apex[2])
        side = (q[0] - p[0], q[1] - p[1], q[2] - p[2])
        g, rise = dot(p, across), dot(side, across)
        doubt = doubt or abs(g) <= slack
        if g * (g + rise) < 0.0:
            doubt = doubt or rise * rise <= _ASLANT * dot(side, side)
            one, two = two, moved(p, side, -g / rise)
            count += 1
    return one, two, count, doubt


@inlined
def _off(boxes, node, low, high, apex, across, slack):
    """Return whether a box lies beside a box [low, high], or beside a plane through the apex."""
    reach = slack - abs(
        (boxes[node, 0] - apex[0]) * across[0] + (boxes[node, 1] - apex[1]) * across[1]
        + (boxes[node, 2] - apex[2]) * across[2]
    )  # fmt: skip
    off = False
    for c in range(3):
        middle, half = boxes[node, c], boxes[node, 3 + c] + slack
        reach += half * abs(across[c])
        off = off or middle - half > high[c] or middle + half < low[c]
    return off or reach < 0.0


@kernel
def _leg_part(apex, start, ahead, part, mirrors, e, graph, tree):
    """The part of an edge's line, within ``part``, on which a leg of light may end.

    apex, start, ahead : the point, the start of the edge and its direction, or their images
    mirrors : planes at which the leg starts and ends; NO for none
    """
    low, high = part
    before, after = mirrors
    boxes, link, corners = tree
    slack, planes, sides = _SHORT * graph.raised, graph.planes, graph.sides
    t = dot((apex[0] - start[0], apex[1] - start[1], apex[2] - start[2]), ahead)
    foot = moved(start, ahead, t)
    up = (foot[0] - apex[0], foot[1] - apex[1], foot[2] - apex[2])
    apart = math.sqrt(dot(up, up))
    near = -height(planes, before, apex) if before >= 0 else 1.0
    far = height(planes, after, apex) if after >= 0 else 1.0
    if link.shape[0] == 0 or not min(apart, abs(near), abs(far)) > 4.0 * slack:
        return low, high
    near, far, up = math.copysign(1.0, near), math.copysign(1.0, far), moved((0.0, 0.0, 0.0), up, 1.0 / apart)
    across = (
        ahead[1] * up[2] - ahead[2] * up[1], ahead[2] * up[0] - ahead[0] * up[2], ahead[0] * up[1] - ahead[1] * up[0],
    )  # fmt: skip
    a, b = moved(start, ahead, low), moved(start, ahead, high)
    least = (min(apex[0], a[0], b[0]), min(apex[1], a[1], b[1]), min(apex[2], a[2], b[2]))
    most = (max(apex[0], a[0], b[0]), max(apex[1], a[1], b[1]), max(apex[2], a[2], b[2]))
    shown, until = (math.inf, -math.inf) if before >= 0 else (-math.inf, math.inf)
    waiting, node, depth = np.empty(DEPTH, np.int64), 0, 0
    shadows, count = np.empty((_WAITING, 2)), 0
    while node >= 0:
        child = -1
        if _off(boxes, node, least, most, apex, across, slack):
            pass
        elif link[node] >= 0:
            child = node + 1
            waiting[depth] = link[node]
            depth += 1
        else:
            first = -1 - link[node]
            for f in range(first, min(first + LEAF, corners.shape[0])):
                m = graph.plane[f]
                if m != before and (
                    m == after or m == sides[e, 0] or m == sides[e, 1] or m == sides[e, 2]
                    or graph.materials[graph.row[f], 0] == WALL
                ):  # fmt: skip
                    continue
                one, two, ends, doubt = _section(corners, f, apex, across, slack)
                y, z = dot(one, up) / apart, dot(two, up) / apart
                if m == before:
                    if doubt or (ends == 2 and min(y, z) < _NEAREST):
                        shown, until = -math.inf, math.inf
                    elif ends == 2:
                        x, w = t + dot(one, ahead) / y, t + dot(two, ahead) / z
                        shown, until = min(shown, x, w), max(until, x, w)
                    continue
                if ends < 2 or doubt:
                    continue
                x, w, begin, end = dot(one, ahead), dot(two, ahead), 0.0, 1.0
                begin, end = _cut(y - _NEAREST, z - _NEAREST, begin, end)
                begin, end = _cut(1.0 - 1e-6 - y, 1.0 - 1e-6 - z, begin, end)
                one, two = moved(one, apex, 1.0), moved(two, apex, 1.0)
                if before >= 0:
                    g, h = near * height(planes, before, one), near * height(planes, before, two)
                    begin, end = _cut(g - slack, h - slack, begin, end)
                if after >= 0:
                    g, h = far * height(planes, after, one), far * height(planes, after, two)
                    begin, end = _cut(g - slack, h - slack, begin, end)
                if not begin < end:
                    continue
                u = t + (x + begin * (w - x)) / (y + begin * (z - y))
                v = t + (x + end * (w - x)) / (y + end * (z - y))
                u, v = min(u, v) + slack, max(u, v) - slack
                if u <= low + 4.0 * slack:
                    low = max(low, v)
                elif v >= high - 4.0 * slack:
                    high = min(high, u)
                elif u < v and count < _WAITING:
                    shadows[count, 0], shadows[count, 1] = u, v
                    count += 1
                if not low < high:
                    return low, high
        node = child
        if node < 0 and depth > 0:
            depth -= 1
            node = waiting[depth]
    low, high = max(low, shown - slack), min(high, until + slack)
    changed = True
    while changed:
        changed = False
        for n in range(count):
            if shadows[n, 0] <= low + 4.0 * slack and shadows[n, 1] > low:
                low, changed = shadows[n, 1], True
            if shadows[n, 1] >= high - 4.0 * slack and shadows[n, 0] < high:
                high, changed = shadows[n, 0], True
    return low, high


@kernel
def lit_part(point, e, q, graph, tree):
    """Ends of the part of an edge that light from a point may reach by mirrors in turn ``q``; reversed if unlit."""
    edge, turns, planes = graph.edges[e], graph.turns, graph.planes
    apexes, count = np.empty((turns.shape[1], 3)), turns[q, 0]
    apexes[0] = point
    for i in range(count):
        m = turns[q, i + 1]
        apexes[i + 1] = moved(apexes[i], planes[m], -2.0 * height(planes, m, apexes[i]))
    start, ahead = along(edge, 0.0), (edge[ALONG], edge[ALONG + 1], edge[ALONG + 2])
    part, after = (0.0, edge[LENGTH]), NO
    for leg in range(count, -1, -1):
        before = turns[q, leg] if leg > 0 else NO
        part = _leg_part(apexes[leg], start, ahead, part, (before, after), e, graph, tree)
        if not part[0] < part[1]:
            return 1.0, 0.0
        if leg > 0:
            start = moved(start, planes[before], -2.0 * height(planes, before, start))
            ahead = moved(ahead, planes[before], -2.0 * dot(ahead, planes[before]))
            after = before
    slack = 4.0 * _SHORT * graph.raised + 1e-9 * edge[LENGTH]
    return part[0] - slack, part[1] + slack
