"""Bounding-volume hierarchy over triangles, and its cone queries.

Nodes are split where the areas of both parts' boxes, each times its leaves, add up to least [J. Goldsmith, J. Salmon,
IEEE Comput. Graph. Appl. 7(5), 14 (1987)], and far down in the middle. Nodes stand in depth-first order: the left child
of node i is i + 1. ``link[i]`` is the right child, or -1 - (first triangle) of a leaf; triangles stand in the order of
the leaves. Sizes of the left parts are multiples of LEAF, so that all leaves but the last are full.

`closest` visits the nearer child first and shrinks its far depth; `collect` counts first and fills when asked again
with a list large enough, so that nothing is cut off silently.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel, returning, spliced
from specklegen.wavetracing.kernels.cones import box_depth, rounding, triangle_in_cone

LEAF = 4
DEPTH = 64
"""Nodes that wait at most: `_MIDDLE_FROM` levels, and the depth of a median split of 2^31 triangles."""
_MIDDLE_FROM = 32
_BINS = 8


class Tree(NamedTuple):
    """Triangles in their hierarchy.

    Attributes
    ----------
    boxes, link : float64[m, 6], int32[m]
        Centre and half extents of each node, and its right child or first triangle.
    corners : float64[n, 9]
        Of the triangles, in the order of the leaves.
    """

    boxes: np.ndarray
    link: np.ndarray
    corners: np.ndarray


@kernel
def _select(rows, first, last, middle, axis):
    """Put the rows [first, last) in such an order that those before ``middle`` are no larger along ``axis``."""
    low, high = first, last - 1
    while low < high:
        pivot = rows[(low + high) // 2, axis]
        i, j = low, high
        while i <= j:
            while rows[i, axis] < pivot:
                i += 1
            while rows[j, axis] > pivot:
                j -= 1
            if i <= j:
                for c in range(4):
                    rows[i, c], rows[j, c] = rows[j, c], rows[i, c]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@kernel
def _split(rows, sides, first, last, best_area, bins, beyond):
    """Axis along which to split the rows [first, last), and where: by least area, or in the middle of the longest.

    sides  : float64[n, 6], least and greatest coordinates of each triangle, by its number
    bins   : float64[_BINS, 7], beyond : float64[_BINS], workspace: count and box of each bin, cost of those from it on
    """
    count, least = last - first, math.inf
    axis, left, longest = 0, count // 2, -1.0
    for c in range(3):
        lower, upper = math.inf, -math.inf
        for r in range(first, last):
            lower, upper = min(lower, rows[r, c]), max(upper, rows[r, c])
        if not best_area and upper - lower > longest:
            axis, longest = c, upper - lower
        if not best_area or not upper > lower:
            continue
        for b in range(_BINS):
            bins[b, 0] = 0.0
            bins[b, 1:4], bins[b, 4:7] = math.inf, -math.inf
        for r in range(first, last):
            b, f = min(int(_BINS * ((rows[r, c] - lower) / (upper - lower))), _BINS - 1), int(rows[r, 3])
            bins[b, 0] += 1.0
            for d in range(3):
                bins[b, 1 + d], bins[b, 4 + d] = min(bins[b, 1 + d], sides[f, d]), max(bins[b, 4 + d], sides[f, 3 + d])
        for forwards in range(2):
            held, x, y, z, u, v, w = 0.0, math.inf, math.inf, math.inf, -math.inf, -math.inf, -math.inf
            for n in range(_BINS - 1):
                b = n if forwards else _BINS - 1 - n
                held += bins[b, 0]
                x, y, z = min(x, bins[b, 1]), min(y, bins[b, 2]), min(z, bins[b, 3])
                u, v, w = max(u, bins[b, 4]), max(v, bins[b, 5]), max(w, bins[b, 6])
                area = (u - x) * (v - y) + (v - y) * (w - z) + (w - z) * (u - x)
                cost = area * math.ceil(held / LEAF) if held > 0.0 else 0.0
                if not forwards:
                    beyond[b] = cost
                elif cost + beyond[b + 1] < least:  # the first bin and the last hold a triangle each
                    axis, left, least = c, int(held), cost + beyond[b + 1]
    return axis, first + LEAF * max(1, min((left + LEAF // 2) // LEAF, (count - 1) // LEAF))


@kernel
def node_count(triangles):
    """Nodes of a tree over so many triangles."""
    leaves = (triangles + LEAF - 1) // LEAF
    return 2 * leaves - 1 if leaves > 0 else 0


@kernel
def build(vertices, faces, boxes, link, order):
    """Build the tree.

    vertices : float64[V, 3]
    faces    : int32[n, 3]
    boxes    : float64[m, 6]   out, centre and half extents of each node, m = node_count(n)
    link     : int32[m]        out
    order    : int32[n]        out, the face that stands at each place of the leaves
    """
    n = faces.shape[0]
    rows = np.empty((n, 4))  # centroid and number, side by side, so that selecting reads memory in order
    sides, bins, beyond = np.empty((n, 6)), np.empty((_BINS, 7)), np.empty(_BINS)
    for f in range(n):
        for c in range(3):
            rows[f, c] = (vertices[faces[f, 0], c] + vertices[faces[f, 1], c] + vertices[faces[f, 2], c]) / 3.0
        rows[f, 3] = f
        for c in range(3):
            x, y, z = vertices[faces[f, 0], c], vertices[faces[f, 1], c], vertices[faces[f, 2], c]
            sides[f, c], sides[f, 3 + c] = min(x, y, z), max(x, y, z)
    waiting = np.empty((DEPTH, 4), np.int64)  # first, last, the node whose right child this is, its level
    depth, nodes = 0, 0
    if n > 0:
        waiting[0, 0], waiting[0, 1], waiting[0, 2], waiting[0, 3] = 0, n, -1, 0
        depth = 1
    while depth > 0:
        depth -= 1
        first, last, parent, level = waiting[depth, 0], waiting[depth, 1], waiting[depth, 2], waiting[depth, 3]
        node = nodes
        nodes += 1
        if parent >= 0:
            link[parent] = node
        if last - first <= LEAF:
            link[node] = -1 - first
            continue
        axis, middle = _split(rows, sides, first, last, level < _MIDDLE_FROM, bins, beyond)
        _select(rows, first, last, middle, axis)
        waiting[depth, 0], waiting[depth, 1], waiting[depth, 2], waiting[depth, 3] = middle, last, node, level + 1
        depth += 1
        waiting[depth, 0], waiting[depth, 1], waiting[depth, 2], waiting[depth, 3] = first, middle, -1, level + 1
        depth += 1
    for place in range(n):
        order[place] = np.int32(rows[place, 3])
    _bound(vertices, faces, boxes, link, order)


@kernel
def _bound(vertices, faces, boxes, link, order):
    """Boxes of all nodes, children before their parents."""
    n, m = faces.shape[0], link.shape[0]
    corners = np.empty((m, 6))
    for node in range(m - 1, -1, -1):
        if link[node] < 0:
            first = -1 - link[node]
            for c in range(3):
                lower, upper = math.inf, -math.inf
                for place in range(first, min(first + LEAF, n)):
                    for v in range(3):
                        value = vertices[faces[order[place], v], c]
                        lower, upper = min(lower, value), max(upper, value)
                corners[node, c], corners[node, 3 + c] = lower, upper
        else:
            for c in range(3):
                corners[node, c] = min(corners[node + 1, c], corners[link[node], c])
                corners[node, 3 + c] = max(corners[node + 1, 3 + c], corners[link[node], 3 + c])
        for c in range(3):
            centre = 0.5 * corners[node, c] + 0.5 * corners[node, 3 + c]
            boxes[node, c] = centre
            half = max(corners[node, 3 + c] - centre, centre - corners[node, c])
            # The centre and the difference are rounded: three units in the last place keep the box around its corners.
            boxes[node, 3 + c] = half * (1.0 + 1e-15) + 4e-16 * abs(centre)


@kernel
def lay_out(vertices, faces, order, corners):
    """Fill ``corners`` float64[n, 9] with the corners of the triangles in the order of the leaves."""
    for place in range(order.shape[0]):
        for v in range(3):
            for c in range(3):
                corners[place, 3 * v + c] = vertices[faces[order[place], v], c]


def tree_over(vertices, faces):
    """Return the Tree over faces int32[n, 3], and int32[n], the face that stands at each place of the leaves."""
    nodes, order = node_count(len(faces)), np.empty(len(faces), np.int32)
    tree = Tree(np.empty((nodes, 6)), np.empty(nodes, np.int32), np.empty((len(faces), 9)))
    build(vertices, faces, tree.boxes, tree.link, order)
    lay_out(vertices, faces, order, tree.corners)
    return tree, order


@spliced
def _box(cone, span, slack, slack_y, near, far, boxes, node):
    lx, ux, ly, uy, lz, uz = span
    if (
        boxes[node, 0] - boxes[node, 3] > ux or boxes[node, 0] + boxes[node, 3] < lx
        or boxes[node, 1] - boxes[node, 4] > uy or boxes[node, 1] + boxes[node, 4] < ly
        or boxes[node, 2] - boxes[node, 5] > uz or boxes[node, 2] + boxes[node, 5] < lz
    ):  # fmt: skip
        return math.inf
    return box_depth(cone, slack, slack_y, near, far, boxes, node)


@inlined
def unpacked(cone):
    """Components of a cone float64[CONE] as a tuple."""
    return (
        cone[0], cone[1], cone[2], cone[3], cone[4], cone[5], cone[6], cone[7], cone[8], cone[9], cone[10], cone[11],
        cone[12], cone[13],
    )  # fmt: skip


@inlined
def _reach(origin, across, ahead, a, t, near, far, slack):
    """Least and greatest coordinate of the cone in [near, far] along one axis, which is ``across`` its unit circle."""
    first = max(near, -a / t) if t > 0.0 else near
    grows, falls = ahead + t * across, ahead - t * across
    upper = a * across + (far if grows > 0.0 else first) * grows
    lower = (far if falls < 0.0 else first) * falls - a * across
    return origin + lower - 1e-12 * abs(lower) - slack, origin + upper + 1e-12 * abs(upper) + slack


@inlined
def _span(cone, near, far, slack):
    """Box along the axes of space that holds a cone in [near, far]: least and greatest x, y, z."""
    ox, oy, oz, xx, xy, xz, yx, yy, yz, zx, zy, zz, a, t = cone
    square = yx * yx + yy * yy + yz * yz  # of the stretch, which the scaled y brings twice
    yx, yy, yz = yx / square, yy / square, yz / square
    lx, ux = _reach(ox, math.sqrt(xx * xx + yx * yx), zx, a, t, near, far, slack)
    ly, uy = _reach(oy, math.sqrt(xy * xy + yy * yy), zy, a, t, near, far, slack)
    lz, uz = _reach(oz, math.sqrt(xz * xz + yz * yz), zz, a, t, near, far, slack)
    return lx, ux, ly, uy, lz, uz


@inlined
def next_waiting(waiting, height, best):
    """The last of the waiting nodes (number, depth) not beyond ``best``, -1 for none, and how many wait still."""
    while height > 0:
        height -= 1
        if waiting[height, 1] <= best:
            return int(waiting[height, 0]), height
    return -1, 0


@kernel
def closest(packed, near, far, tree):
    """Least depth in [near, far] at which the cone meets a triangle, and the triangle's place; (inf, -1) for none.

    packed : float64[CONE]

    Return also the number of nodes visited.
    """
    boxes, link, corners = tree
    best, place, visited = math.inf, -1, 1
    if link.shape[0] == 0:
        return best, place, 0
    cone, slack = unpacked(packed), rounding(packed, boxes)
    slack_y, span = slack * (abs(cone[6]) + abs(cone[7]) + abs(cone[8])), _span(cone, near, far, slack)
    if _box(cone, span, slack, slack_y, near, far, boxes, 0) == math.inf:
        return best, place, visited
    waiting, node, height = np.empty((DEPTH, 2)), 0, 0
    while node >= 0:
        one = math.inf
        if link[node] < 0:
            first = -1 - link[node]
            for f in range(first, min(first + LEAF, corners.shape[0])):
                low, _ = triangle_in_cone(cone, near, far, corners, f)
                if low < best:
                    best, place, far = low, f, low
            if best <= near:
                break  # nothing comes before the beginning
        else:
            left, right = node + 1, link[node]
            one = _box(cone, span, slack, slack_y, near, far, boxes, left)
            two = _box(cone, span, slack, slack_y, near, far, boxes, right)
            if one > two:
                left, right, one, two = right, left, two, one
            if two < math.inf:
                waiting[height, 0], waiting[height, 1] = right, two
                height += 1
            node = left
        if one == math.inf:
            node, height = next_waiting(waiting, height, best)
        visited += node >= 0
    return best, place, visited


@kernel
def collect(packed, near, far, tree, out):
    """Places of all triangles that the cone meets in [near, far]: their number, and as many in ``out`` as it holds.

    packed : float64[CONE]
    out    : int64[room]

    Return also the number of nodes visited.
    """
    boxes, link, corners = tree
    n, found, visited = corners.shape[0], 0, 0
    if link.shape[0] == 0:
        return found, visited
    cone, slack = unpacked(packed), rounding(packed, boxes)
    slack_y, span = slack * (abs(cone[6]) + abs(cone[7]) + abs(cone[8])), _span(cone, near, far, slack)
    if _box(cone, span, slack, slack_y, near, far, boxes, 0) == math.inf:
        return found, visited
    stack = np.empty(DEPTH, np.int32)
    stack[0], height = 0, 1
    while height > 0:
        height -= 1
        node = stack[height]
        visited += 1
        if link[node] < 0:
            first = -1 - link[node]
            for f in range(first, min(first + LEAF, n)):
                low, _ = triangle_in_cone(cone, near, far, corners, f)
                if low < math.inf:
                    if found < out.shape[0]:
                        out[found] = f
                    found += 1
            continue
        left, right = node + 1, link[node]
        if _box(cone, span, slack, slack_y, near, far, boxes, right) < math.inf:
            stack[height] = right
            height += 1
        if _box(cone, span, slack, slack_y, near, far, boxes, left) < math.inf:
            stack[height] = left
            height += 1
    return found, visited


@returning
def collect_all(packed, near, far, tree, places):
    """`collect` into ``places`` int64[room], or into a longer list where it has no room: the list and their number."""
    count, _ = collect(packed, near, far, tree, places)
    if count > places.shape[0]:
        places = np.empty(2 * count, np.int64)
        count, _ = collect(packed, near, far, tree, places)
    return places, count
