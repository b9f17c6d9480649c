"""All paths from a point to another by mirrors and edges, each with its amplitude.

A path is light from S to P by a number of plane mirrors, and past up to two edges. Mirrors unfold: a leg between two
stations by mirrors is a straight line from an image of its start. About an edge, all images of a point have an angle,
a distance rho and a coordinate z along the edge; the path past one edge turns at the point that divides z as the
distances do. Past two edges the length is a convex function of both turning points, and has one least value.

Paths past edges are many, and most are in the dark: only those parts of edges are tried that both ends may light
(`specklegen.wavetracing.kernels.shadows`). Of the others most are weak. Each is first bounded from its geometry alone;
then, from the largest bound on, sight is asked for and the coefficient computed, until the power of all bounds that are
left is below a share of the power that was found.
"""

import cmath
import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel, returning
from specklegen.wavetracing.kernels.creeping import (
    COSINE,
    FIELD,
    KIND,
    OUTWARD,
    REACH,
    SIDE,
    TOUCH,
    WAY,
    WAYS,
    Bodies,
    ways_by,
)
from specklegen.wavetracing.kernels.double_edges import Bend, double_diffraction
from specklegen.wavetracing.kernels.edge_geometry import (
    ALONG,
    INWARD,
    LENGTH,
    NORMAL,
    WEDGE,
    along,
    dot,
    height,
    in_the_air,
    moved,
    polar,
)
from specklegen.wavetracing.kernels.ray_bvh import NO, nearest
from specklegen.wavetracing.kernels.shadows import lit_part
from specklegen.wavetracing.kernels.surfaces import WALL, field_coefficients, field_transmission
from specklegen.wavetracing.kernels.wedges import boundary_term, geometric_weights

MIRRORS = 4
"""Most mirrors on a path."""
MET = MIRRORS + 2
CURVED = 1 << 24
"""Added to the number of a mesh that reflects as a smooth body, or that light creeps around."""
TOTAL, ARRIVAL, STATIONS, SURFACES, PAIR, VALUES = 4, 5, 8, 32, 56, 64
"""Columns of a path: from 0 on its amplitudes, soft and hard (re, im); its length; direction at P; stations from S to
P; coefficients of what is met, soft and hard; those of its edges by polarisation at the first and the last."""
_SLACK = 1e-9  # radians within which a direction counts as along a face
_ALONG = 1e-7  # radians from a face, within which a leg from edge to edge runs along it
_ROUNDING = 1e-12  # radians from a boundary at which its angle, not a query of the ray, says what is seen
_FIRST, _ROUNDS = 2, 60
_STILL = 1e-13  # of a path's length: a step of unfolding that is none
_NEAR = 1e-7  # of a leg: how far a mirror may be from where it is met
_OPEN = np.int64(-2)


class Graph(NamedTuple):
    """Edges, mirrors and faces of a scene at a wavelength.

    Attributes
    ----------
    edges : float64[E, EDGE]
        See `specklegen.wavetracing.kernels.edge_geometry`.
    numbers : int64[E]
        Of each edge in `Geometry.edges`; of two that were joined, the first.
    sides, rows : int64[E, 3], int32[E, 2]
        Planes of an edge's faces (and of the strip between two edges that were joined), and their materials.
    planes, fronts : float64[M, 4], bool[M, 2]
        Unit normal and distance from the origin of all planes that faces lie in; whether faces are seen from -n and +n.
    windows, first_window : float64[W, 6], int64[M + 1]
        Boxes of the faces in each plane.
    plane, row, mesh : int64[n], int32[n], int32[n]
        Of the triangles at each place: plane, material, number of the mesh.
    anyone : int64[M]
        A place of each plane.
    materials : float64[L, 4]
        See `specklegen.wavetracing.kernels.surfaces`.
    turns, images : int64[Q, MIRRORS + 1], float64[Q, 3, 4]
        Mirrors in turn, behind their number; and what they make of points, x -> A x + b.
    legs : int64[B, 3]
        Pairs of edges between which light may run, and by which mirrors.
    raised : float
        How far a point on a face is taken off it to see what it sees (a length).
    bodies : Bodies
        Smooth bodies; faces that stand for curved surfaces are no mirrors.
    """

    edges: np.ndarray
    numbers: np.ndarray
    sides: np.ndarray
    rows: np.ndarray
    planes: np.ndarray
    fronts: np.ndarray
    windows: np.ndarray
    first_window: np.ndarray
    plane: np.ndarray
    row: np.ndarray
    mesh: np.ndarray
    anyone: np.ndarray
    materials: np.ndarray
    turns: np.ndarray
    images: np.ndarray
    legs: np.ndarray
    raised: float
    bodies: Bodies


class Rules(NamedTuple):
    """Most mirrors and edges of a path, wavenumber, and the share of power that may be left out."""

    mirrors: int
    edges: int
    k: float
    share: float


class Views(NamedTuple):
    """Positions of a point and its images about the edges that they may light.

    Attributes
    ----------
    point, seen : float64[3]
        The point; and taken off the surface that it lies on.
    first, turn, polar : int64[E + 1], int64[*, 1], float64[*, 5]
        Of each edge: mirrors in turn from the point on; angle, distance and coordinate of its image by them; and from
        where to where along the edge light may come, past shadows.
    """

    point: np.ndarray
    seen: np.ndarray
    first: np.ndarray
    turn: np.ndarray
    polar: np.ndarray


class Way(NamedTuple):
    """Workspace of one path.

    Attributes
    ----------
    met, names : int64[MET], int32[MET]
        Planes in turn, edges as -1 - edge; and what to call them, 1 + edge or -1 - mesh.
    at, images : float64[MET + 2, 3]
        Stations, and images of the start of a leg.
    coefficients, through : complex128[MET, 2], complex128[2]
        Soft and hard, of each mirror, and of all walls that let light through.
    """

    met: np.ndarray
    names: np.ndarray
    at: np.ndarray
    images: np.ndarray
    coefficients: np.ndarray
    through: np.ndarray


@inlined
def _step(p, q):
    x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    return x, y, z, math.sqrt(x * x + y * y + z * z)


@inlined
def _image(a, p, point):
    """Apply mirrors, float64[3, 4], to a point (1) or a direction (0)."""
    return (
        a[0, 0] * p[0] + a[0, 1] * p[1] + a[0, 2] * p[2] + point * a[0, 3],
        a[1, 0] * p[0] + a[1, 1] * p[1] + a[1, 2] * p[2] + point * a[1, 3],
        a[2, 0] * p[0] + a[2, 1] * p[1] + a[2, 2] * p[2] + point * a[2, 3],
    )  # fmt: skip


@inlined
def _polar(edge, p):
    return polar(edge, p[0], p[1], p[2])


@inlined
def _planes_of(sides, e):
    return sides[e, 0], sides[e, 1], sides[e, 2]


@inlined
def _clipped(planes, m, side, a, b):
    """The part of a segment on a side, 1 or -1, of a plane: whether there is one, and its ends."""
    g, h = side * height(planes, m, a), side * height(planes, m, b)
    cut = moved(a, (b[0] - a[0], b[1] - a[1], b[2] - a[2]), g / (g - h) if g != h else 0.0)
    return g > 0.0 or h > 0.0, (cut if g < 0.0 else a), (cut if h < 0.0 else b)


@kernel
def _framed(graph, e, m, side, a, b):
    """True if light from a segment's image on the side -1 or 1 of a mirror may go through it to an edge on the other.

    The lines from end to end meet the plane in four points; their box and those of faces decide, conservatively.
    """
    planes, sides, edge = graph.planes, graph.sides, graph.edges[e]
    if sides[e, 0] == m or sides[e, 1] == m or sides[e, 2] == m or not graph.fronts[m, 1 if side < 0.0 else 0]:
        return False
    there, a, b = _clipped(planes, m, side, a, b)
    here, p, q = _clipped(planes, m, -side, along(edge, 0.0), along(edge, edge[LENGTH]))
    if not (there and here):
        return False
    low, high, slack = (math.inf, math.inf, math.inf), (-math.inf, -math.inf, -math.inf), 0.0
    for i in range(4):
        one, two = a if i < 2 else b, p if i % 2 == 0 else q
        g, h = height(planes, m, one), height(planes, m, two)
        x, y, z, _ = _step(one, two)
        at = moved(one, (x, y, z), min(max(g / (g - h), 0.0), 1.0) if g != h else 1.0)
        low = (min(low[0], at[0]), min(low[1], at[1]), min(low[2], at[2]))
        high = (max(high[0], at[0]), max(high[1], at[1]), max(high[2], at[2]))
        slack = max(slack, 1e-9 * (abs(at[0]) + abs(at[1]) + abs(at[2])))
    for w in range(graph.first_window[m], graph.first_window[m + 1]):
        box, good = graph.windows[w], True
        for c in range(3):
            good = good and box[c] - slack <= high[c] and box[3 + c] + slack >= low[c]
        if good:
            return True
    return False


@kernel
def _in_sight(edge, a, b):
    """Return whether one of two points lies in the air about an edge."""
    phi, rho, _ = _polar(edge, a)
    psi, tau, _ = _polar(edge, b)
    return (rho > 0.0 and in_the_air(edge, phi, _ALONG) >= 0.0) or (tau > 0.0 and in_the_air(edge, psi, _ALONG) >= 0.0)


@kernel
def edge_legs(graph, legs):
    """List the pairs of edges between which light may run, and by which mirrors: their number, and as many as fit."""
    edges, turns, count = graph.edges, graph.turns, 0
    for e in range(edges.shape[0]):
        start, stop = along(edges[e], 0.0), along(edges[e], edges[e, LENGTH])
        for q in range(turns.shape[0]):
            a, b = _image(graph.images[q], start, 1.0), _image(graph.images[q], stop, 1.0)
            last = turns[q, turns[q, 0]] if turns[q, 0] > 0 else -1
            if last >= 0 and graph.sides[e, 0] == turns[q, 1] or graph.sides[e, 1] == turns[q, 1] and last >= 0:
                continue
            for f in range(edges.shape[0]):
                if last < 0:
                    good = e != f and _in_sight(edges[e], along(edges[f], 0.0), along(edges[f], edges[f, LENGTH]))
                else:
                    good = _framed(graph, f, last, 1.0, a, b) or _framed(graph, f, last, -1.0, a, b)
                if good and _in_sight(edges[f], a, b):
                    if count < legs.shape[0]:
                        legs[count, 0], legs[count, 1], legs[count, 2] = e, f, q
                    count += 1
    return count


@kernel
def raise_points(points, towards, graph, tree, out):
    """Fill ``out`` float64[P, 3] with points, those on a face a little off it: into the air, or towards a point."""
    out[:] = points
    for n in range(points.shape[0]):
        for m in range(graph.planes.shape[0]):
            if abs(height(graph.planes, m, points[n])) > 0.02 * graph.raised:
                continue
            side = 1.0 if height(graph.planes, m, towards) >= 0.0 else -1.0
            side = side if graph.fronts[m, 1 if side > 0.0 else 0] else -side
            x, y, z = moved((0.0, 0.0, 0.0), graph.planes[m], side * graph.raised)
            p = (points[n, 0] + x, points[n, 1] + y, points[n, 2] + z)
            _, place, _ = nearest(p[0], p[1], p[2], -x, -y, -z, 0.0, 2.0, (NO, NO), graph.plane, tree)
            if place >= 0 and graph.plane[place] == m:
                out[n, 0], out[n, 1], out[n, 2] = out[n, 0] + x, out[n, 1] + y, out[n, 2] + z


@returning
def grown(array, count):
    """An array with room for one row more than ``count``: itself, or a copy twice as long."""
    if count < array.shape[0]:
        return array
    longer = np.empty((2 * array.shape[0] + 8, array.shape[1]), array.dtype)
    longer[: array.shape[0]] = array
    return longer


@returning
def views_of(point, seen, graph, tree):
    """`Views` of a point."""
    edges, turns = graph.edges, graph.turns
    first, count = np.empty(edges.shape[0] + 1, np.int64), 0
    turn, polars = np.empty((64, 1), np.int64), np.empty((64, 5))
    for e in range(edges.shape[0]):
        first[e] = count
        for q in range(turns.shape[0]):
            phi, rho, t = _polar(edges[e], _image(graph.images[q], point, 1.0))
            psi, _, _ = _polar(edges[e], _image(graph.images[q], seen, 1.0))
            if abs(phi - psi) > math.pi:  # on a sheet: on the side from which it is seen
                phi = 0.0 if phi > psi else edges[e, WEDGE] * math.pi
            phi = in_the_air(edges[e], phi, _SLACK)
            if phi < 0.0 or rho == 0.0:
                continue
            if turns[q, 0] > 0:
                away, m = _image(graph.images[q], seen, 1.0), turns[q, turns[q, 0]]
                side = 1.0 if height(graph.planes, m, away) > 0.0 else -1.0
                if not _framed(graph, e, m, side, away, away):
                    continue
            low, high = lit_part(seen, e, q, graph, tree)
            if not low < high:
                continue
            turn, polars = grown(turn, count), grown(polars, count)
            turn[count, 0] = q
            polars[count, 0], polars[count, 1], polars[count, 2], polars[count, 3], polars[count, 4] = (
                phi, rho, t, low, high,
            )  # fmt: skip
            count += 1
    first[edges.shape[0]] = count
    return Views(point, seen, first, turn, polars)


@kernel
def _run(start, step, until, target, skip, way, graph, tree):
    """Go along a ray to ``until``, through walls that transmit: the place of the face in plane ``target`` there.

    _OPEN without target, where nothing stands in the way; -1 where something does, or the target is missing.
    """
    x, y, z = step
    size, near = math.sqrt(x * x + y * y + z * z), 0.0
    while True:
        far = until if target == NO else 2.0
        near, place, _ = nearest(start[0], start[1], start[2], x, y, z, near, far, skip, graph.plane, tree)
        if place < 0:
            return _OPEN if target == NO else -1
        m = graph.plane[place]
        if m == target:
            return place if abs(near - until) <= _NEAR else -1
        if graph.materials[graph.row[place], 0] != WALL:
            return -1
        te, tm = field_transmission(graph.materials, graph.row[place], abs(dot(graph.planes[m], step)) / size)
        way.through[0] *= te
        way.through[1] *= tm


@kernel
def _leg_clear(a, b, low, high, skip, share, way, graph, tree):
    """Return whether light gets from a to b by the mirrors met[low:high] in turn; fill where it meets them, and how.

    skip   : planes in which a lies, then those in which b lies: three each, -1 for none
    share  : of the wave that is known to be there; -1 for nothing, or fill all of it, whatever stands in the way
    """
    images, planes, clear = way.images, graph.planes, True
    images[low] = a
    for i in range(low, high):
        images[i + 1] = moved(images[i], planes[way.met[i]], -2.0 * height(planes, way.met[i], images[i]))
    here, behind = b, (skip[3], skip[4], skip[5])
    for i in range(high - 1, low - 1, -1):
        m, h, g = way.met[i], height(planes, way.met[i], here), height(planes, way.met[i], images[i + 1])
        if h * g >= 0.0 and (share < 0.0 or h == g):
            return False
        x, y, z, r = _step(here, images[i + 1])
        t = h / (h - g)
        place = _run(here, (x, y, z), t, m, (NO, NO, NO, behind[0], behind[1], behind[2]), way, graph, tree)
        if place < 0:
            if share < 0.0:
                return False
            clear, place = False, graph.anyone[m]
        te, tm = field_coefficients(graph.materials, graph.row[place], abs(dot(planes[m], (x, y, z))) / r)
        way.coefficients[i, 0], way.coefficients[i, 1], way.names[i] = te, tm, -1 - graph.mesh[place]
        here, behind = moved(here, (x, y, z), t), (m, NO, NO)
        way.at[i + 1] = here
    x, y, z, r = _step(here, a)
    if r == 0.0:
        return clear
    around = (skip[0], skip[1], skip[2], behind[0], behind[1], behind[2])
    return clear and _run(here, (x, y, z), 1.0, NO, around, way, graph, tree) == _OPEN


@inlined
def _put(way, low, turns, q, backwards):
    """Write the mirrors of a sequence from ``low`` on; return where they end."""
    count = turns[q, 0]
    for i in range(count):
        way.met[low + i] = turns[q, count - i if backwards else i + 1]
    return low + count


@inlined
def _part_within(t, length):
    """1 within an edge, 0 beyond its ends, one half on them: there another edge may begin."""
    slack = 1e-9 * length
    if t < -slack or t > length + slack:
        return 0.0
    return 1.0 if slack < t < length - slack else 0.5


@inlined
def _grows(edge, phi):
    """Direction about an edge in which the angle grows."""
    c, s = math.cos(phi), math.sin(phi)
    return (
        c * edge[NORMAL] - s * edge[INWARD], c * edge[NORMAL + 1] - s * edge[INWARD + 1],
        c * edge[NORMAL + 2] - s * edge[INWARD + 2],
    )  # fmt: skip


@inlined
def _level(edge, phi):
    """1 or -1 where an angle is that of one of an edge's faces, and the air is where it grows, or falls; else 0."""
    return 1.0 if phi < _ALONG else (-1.0 if edge[WEDGE] * math.pi - phi < _ALONG else 0.0)


@returning
def _bend(graph, e, inner, outer, sine, weights):
    """A ray's bend at an edge, between the angles of its two legs."""
    edge, rows, materials = graph.edges[e], graph.rows[e], graph.materials
    low, high = abs(sine * math.sin(min(inner, outer))), abs(sine * math.sin(edge[WEDGE] * math.pi - max(inner, outer)))
    weights[0, 1], weights[1, 1] = field_coefficients(materials, rows[0], low)
    weights[0, 2], weights[1, 2] = field_coefficients(materials, rows[1], high)
    weights[0, 0] = weights[1, 0] = 1.0
    if edge[WEDGE] == 2.0 and rows[0] == rows[1] and materials[rows[0], 0] == WALL:  # behind it there is light, too
        te, tm = field_transmission(materials, rows[0], low)
        weights[0, 0], weights[1, 0] = 1.0 - te, 1.0 - tm
    return Bend(edge[WEDGE], inner, outer, sine, weights)


@kernel
def _most(edge, inner, outer, root):
    """Bound on the sum of an edge's four terms, of weights of 1 at most."""
    total, n = 0.0, edge[WEDGE]
    for m in range(4):
        turned = (math.pi if m % 2 == 0 else -math.pi) + inner + (outer if m > 1 else -outer)
        d = turned - 2.0 * math.pi * n * np.rint(turned / (2.0 * math.pi * n))
        sine = abs(math.sin(0.5 * d))
        cot = sine / abs(math.tan(0.5 * d / n)) if d != 0.0 else n
        total += cot * min(math.sqrt(math.pi) * root, 1.0 / sine if sine > 0.0 else math.inf)
    return total


@kernel
def _unfolded(edge, other, w0, u, v, view, image):
    """Turning points (t, t') of the shortest path past two edges, by unfolding at one, then the other, and Newton.

    w0, u, v : from the start of the first edge, as the mirrors show it, to that of the second, and their directions
    view, image : (angle, distance, coordinate) of the ends about the edges
    """
    rho, z, sigma, y, c = view[1], view[2], image[1], image[2], dot(u, v)
    t, t2, step, step2, last = 0.5 * edge[LENGTH], 0.5 * other[LENGTH], 0.0, 0.0, math.inf
    for n in range(_ROUNDS):
        w = moved(moved(w0, v, t2), u, -t)
        r, s, b = math.sqrt(rho * rho + (t - z) ** 2), math.sqrt(sigma * sigma + (t2 - y) ** 2), math.sqrt(dot(w, w))
        one, two = -dot(w, u) / b, dot(w, v) / b
        if n < _FIRST or last < 0.0:
            # The point on the other edge about this one: distance and coordinate, then where the line between turns.
            t = z + (t - b * one - z) * rho / (rho + b * math.sqrt(max(1.0 - one * one, 0.0)))
            w = moved(moved(w0, v, t2), u, -t)
            b, along_two = math.sqrt(dot(w, w)), dot(w, v)
            t2 = y + (t2 - along_two - y) * sigma / (sigma + math.sqrt(max(b * b - along_two * along_two, 0.0)))
            last = math.inf
            continue
        if r + s + b > last:  # Newton's step led too far: back, and by unfolding
            t, t2, last = t + step, t2 + step2, -1.0
            continue
        last = (r + s + b) * (1.0 + 1e-13)
        g, h = (t - z) / r + one, (t2 - y) / s + two
        first, second = (rho / r) ** 2 / r + (1.0 - one * one) / b, (sigma / s) ** 2 / s + (1.0 - two * two) / b
        mixed = -(c + one * two) / b
        below = max(first * second - mixed * mixed, 1e-14 * first * second)
        step, step2 = (second * g - mixed * h) / below, (first * h - mixed * g) / below
        t, t2 = t - step, t2 - step2
        if abs(step) + abs(step2) <= _STILL * (r + s + b) + 4e-16 * (abs(t) + abs(t2)):
            return t, t2
    return -math.inf, -math.inf  # where the edges' lines cross, there is no path


@inlined
def _between(graph, b):
    """Vector from the start of a leg's first edge, as mirrors show it, to that of its second; directions of both."""
    one, two, a = graph.edges[graph.legs[b, 0]], graph.edges[graph.legs[b, 1]], graph.images[graph.legs[b, 2]]
    x, y, z, _ = _step(_image(a, along(one, 0.0), 1.0), along(two, 0.0))
    u, v = _image(a, one[ALONG : ALONG + 3], 0.0), two[ALONG : ALONG + 3]
    return (x, y, z), u, (v[0], v[1], v[2])


@kernel
def _leg_angles(graph, b, t, t2):
    """Vector of the leg between two edges at its end, its length, and its angle about either; -1 not in the air."""
    one, two, a = graph.edges[graph.legs[b, 0]], graph.edges[graph.legs[b, 1]], graph.images[graph.legs[b, 2]]
    p, q = along(one, t), along(two, t2)
    x, y, z, s = _step(_image(a, p, 1.0), q)
    # Mirrors are their own transposes inverted: back by the transpose.
    d = (dot(a[:, 0], (x, y, z)), dot(a[:, 1], (x, y, z)), dot(a[:, 2], (x, y, z)))
    phi, _, _ = _polar(one, moved(p, d, 1.0))
    psi, _, _ = _polar(two, (q[0] - x, q[1] - y, q[2] - z))
    return s, in_the_air(one, phi, _ALONG), in_the_air(two, psi, _ALONG)


@returning
def _tries(views, point, graph, rules):
    """Paths past edges that may be: int64[N, 3], leg (-1 - edge for one edge) and views; bounds and turning points."""
    edges, turns, k = graph.edges, graph.turns, rules.k
    tries, numbers, count = np.empty((64, 3), np.int64), np.empty((64, 3)), 0
    for n in range(edges.shape[0] + graph.legs.shape[0] if rules.edges > 0 else 0):
        b = n - edges.shape[0]
        e, f = (n, n) if b < 0 else (graph.legs[b, 0], graph.legs[b, 1])
        if views.first[e] == views.first[e + 1] or point.first[f] == point.first[f + 1]:
            continue
        one, two, middle = edges[e], edges[f], 0 if b < 0 else turns[graph.legs[b, 2], 0]
        w0, u, v = _between(graph, max(b, 0)) if b >= 0 else ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        for i in range(views.first[e], views.first[e + 1]):
            for j in range(point.first[f], point.first[f + 1]):
                if turns[views.turn[i, 0], 0] + middle + turns[point.turn[j, 0], 0] > rules.mirrors:
                    continue
                view, image = views.polar[i], point.polar[j]
                if b < 0:
                    t = t2 = view[2] + (image[2] - view[2]) * view[1] / (view[1] + image[1])
                else:
                    t, t2 = _unfolded(one, two, w0, u, v, view, image)
                if _part_within(t, one[LENGTH]) == 0.0 or _part_within(t2, two[LENGTH]) == 0.0:
                    continue
                if not (view[3] <= t <= view[4] and image[3] <= t2 <= image[4]):
                    continue
                r, s, phi, psi = math.sqrt(view[1] ** 2 + (t - view[2]) ** 2), 0.0, image[0], view[0]
                z = math.sqrt(image[1] ** 2 + (t2 - image[2]) ** 2)
                if b >= 0:
                    s, phi, psi = _leg_angles(graph, b, t, t2)
                    if k * s < 1.0 or phi < 0.0 or psi < 0.0:
                        continue
                whole, sine, other = r + s + z, view[1] / r, image[1] / z
                bound = _most(one, phi, view[0], math.sqrt(2.0 * k * r * (s + z) / whole) * sine) / (one[WEDGE] * sine)
                if b < 0:
                    bound /= math.sqrt(8.0 * math.pi * k * r * z * whole)
                else:
                    bound *= _most(two, psi, image[0], math.sqrt(2.0 * k * z * (r + s) / whole) * other)
                    bound /= 4.0 * math.pi * k * two[WEDGE] * other * math.sqrt(r * s * z * min(r + s, s + z))
                tries, numbers = grown(tries, count), grown(numbers, count)
                tries[count, 0], tries[count, 1], tries[count, 2] = b if b >= 0 else -1 - e, i, j
                numbers[count, 0], numbers[count, 1], numbers[count, 2] = bound, t, t2
                count += 1
    return tries[:count], numbers[:count]


@kernel
def _record(way, count, ends, length, pair, values, met):
    """Write a path's row; return its power."""
    for p in range(2):
        amplitude = pair[p, p] * way.through[p]
        for i in range(count):
            amplitude *= way.coefficients[i, p] if way.met[i] >= 0 else 1.0
        values[2 * p], values[2 * p + 1] = amplitude.real, amplitude.imag
    way.at[0], way.at[count + 1] = ends[0], ends[1]
    x, y, z, r = _step(way.at[count], way.at[count + 1])
    values[TOTAL], values[ARRIVAL], values[ARRIVAL + 1], values[ARRIVAL + 2] = length, x / r, y / r, z / r
    for i in range(MET + 2):
        for c in range(3):
            values[STATIONS + 3 * i + c] = way.at[i, c]
    met[:] = 0
    for i in range(count):
        met[i] = way.names[i] if way.met[i] >= 0 else -way.met[i]
        for p in range(2):
            part = way.coefficients[i, p]
            values[SURFACES + 4 * i + 2 * p], values[SURFACES + 4 * i + 2 * p + 1] = part.real, part.imag
    for p in range(4):
        part = pair[p // 2, p % 2]
        values[PAIR + 2 * p], values[PAIR + 2 * p + 1] = part.real, part.imag
    return values[0] ** 2 + values[1] ** 2 + values[2] ** 2 + values[3] ** 2


@returning
def paths_between(views, point, graph, tree, rules, values, met):
    """Find all paths from the point of some `Views` to that of others.

    values, met : float64[room, VALUES], int32[room, MET], where rows are written

    Return the number of paths, how many pass an edge within 1 / k of an end, and both lists, longer where they had no
    room.
    """
    edges, sides, turns, k = graph.edges, graph.sides, graph.turns, rules.k
    way = Way(
        np.zeros(MET, np.int64), np.zeros(MET, np.int32), np.zeros((MET + 2, 3)), np.zeros((MET + 2, 3)),
        np.zeros((MET, 2), np.complex128), np.zeros(2, np.complex128),
    )  # fmt: skip
    weights, others = np.zeros((2, 3), np.complex128), np.zeros((2, 3), np.complex128)
    pair = np.zeros((2, 2), np.complex128)
    count, near, power = 0, 0, 0.0
    start = (views.seen[0], views.seen[1], views.seen[2])
    end = (point.seen[0], point.seen[1], point.seen[2])
    ends = (start, end)
    nowhere, zero = (NO, NO, NO), np.int64(0)
    shares = np.full(turns.shape[0], -1.0)  # of waves that end at an edge within rounding of the point
    tries, numbers = _tries(views, point, graph, rules)
    order = np.argsort(-numbers[:, 0])
    rest = 2.0 * (numbers[:, 0] ** 2).sum()
    if _leg_clear(start, end, zero, zero, nowhere + nowhere, -1.0, way, graph, tree):
        _, _, _, r = _step(start, end)
        power = 2.0 / (r * r)
    ways, raised, bodies = np.empty((WAYS, WAY)), np.empty((2, 3)), graph.bodies
    for b in range(bodies.starts.shape[0] - 1):
        for i in range(turns.shape[0]):
            for j in range(turns.shape[0]):
                room = rules.mirrors - turns[i, 0] - turns[j, 0]
                if room < 0 or (room == 0 and rules.edges == 0):
                    continue
                a, c = _image(graph.images[i], views.point, 1.0), _image(graph.images[j], point.point, 1.0)
                for w in range(ways_by(a, c, bodies, b, k, True, rules.edges > 0, ways)):
                    low, creeps = _put(way, 0, turns, i, False), ways[w, KIND] == 2.0
                    mid = low + 1 if creeps else low
                    high = _put(way, mid + 1, turns, j, True)
                    way.through[:] = 1.0
                    for node in range(low, mid + 1):
                        at, place = 3 * (node - low), bodies.places[int(ways[w, SIDE + node - low])]
                        way.met[node], way.names[node] = graph.plane[place], -1 - CURVED - graph.mesh[place]
                        te, tm = field_coefficients(graph.materials, graph.row[place], ways[w, COSINE])
                        soft = complex(ways[w, FIELD], ways[w, FIELD + 1])
                        hard = complex(ways[w, FIELD + 2], ways[w, FIELD + 3])
                        way.coefficients[node, 0] = (
                            0.5 * ((1.0 - te) * soft + (1.0 + te) * hard) if node == low else 1.0
                        )
                        way.coefficients[node, 1] = (
                            0.5 * ((1.0 - tm) * soft + (1.0 + tm) * hard) if node == low else 1.0
                        )
                        p = (ways[w, TOUCH + at], ways[w, TOUCH + at + 1], ways[w, TOUCH + at + 2])
                        way.at[node + 1] = p
                        out = (ways[w, OUTWARD + at], ways[w, OUTWARD + at + 1], ways[w, OUTWARD + at + 2])
                        raised[node - low] = moved(p, out, graph.raised)
                    p, q = (
                        (raised[0, 0], raised[0, 1], raised[0, 2]),
                        (raised[mid - low, 0], raised[mid - low, 1], raised[mid - low, 2]),
                    )
                    if not _leg_clear(start, p, zero, low, nowhere + nowhere, -1.0, way, graph, tree):
                        continue
                    if not _leg_clear(q, end, mid + 1, high, nowhere + nowhere, -1.0, way, graph, tree):
                        continue
                    pair[0, 1] = pair[1, 0] = 0.0
                    pair[0, 0] = pair[1, 1] = 1.0
                    values, met = grown(values, count), grown(met, count)
                    power += _record(way, high, ends, ways[w, REACH], pair, values[count], met[count])
                    count += 1
    for attempt in range(tries.shape[0] + turns.shape[0]):
        n = attempt - tries.shape[0]
        if n < 0 and rest > rules.share * power:
            n = order[attempt]
            b, i, j = tries[n, 0], tries[n, 1], tries[n, 2]
            bound, t, t2 = numbers[n, 0], numbers[n, 1], numbers[n, 2]
            rest -= 2.0 * bound * bound
            e, f = (-1 - b, -1 - b) if b < 0 else (graph.legs[b, 0], graph.legs[b, 1])
            one, two, view, image = edges[e], edges[f], views.polar[i], point.polar[j]
            way.through[:] = 1.0
            low = _put(way, 0, turns, views.turn[i, 0], False)
            mid = low if b < 0 else _put(way, low + 1, turns, graph.legs[b, 2], False)
            way.met[low], way.met[mid] = -1 - e, -1 - f
            high = _put(way, mid + 1, turns, point.turn[j, 0], True)
            p, q, at_one, at_two = along(one, t), along(two, t2), _planes_of(sides, e), _planes_of(sides, f)
            if not _leg_clear(start, p, zero, low, nowhere + at_one, -1.0, way, graph, tree):
                continue
            if not _leg_clear(q, end, mid + 1, high, at_two + nowhere, -1.0, way, graph, tree):
                continue
            way.at[low + 1], way.at[mid + 1] = p, q
            r, z = math.sqrt(view[1] ** 2 + (t - view[2]) ** 2), math.sqrt(image[1] ** 2 + (t2 - image[2]) ** 2)
            near += k * min(r, z) < 1.0
            part = _part_within(t, one[LENGTH]) * (_part_within(t2, two[LENGTH]) if b >= 0 else 1.0)
            if b < 0:
                bend = _bend(graph, e, image[0], view[0], view[1] / r, weights)
                root = math.sqrt(k * r * z / (r + z)) * bend.sine
                below, above = bend.angle - bend.outer, bend.angle + bend.outer
                terms = (
                    boundary_term(bend.n, below, 1.0, root) + boundary_term(bend.n, below, -1.0, root),
                    boundary_term(bend.n, above, -1.0, root), boundary_term(bend.n, above, 1.0, root),
                )  # fmt: skip
                spread = -part * cmath.exp(1j * (k * (r + z) + 0.25 * math.pi))
                spread /= bend.n * bend.sine * math.sqrt(8.0 * math.pi * k * r * z * (r + z))
                pair[0, 1] = pair[1, 0] = 0.0
                for c in range(2):
                    pair[c, c] = weights[c, 0] * terms[0] + weights[c, 1] * terms[1] + weights[c, 2] * terms[2]
                pair *= spread
                values, met = grown(values, count), grown(met, count)
                power += _record(way, high, ends, r + z, pair, values[count], met[count])
                count += 1
                there = geometric_weights(bend.n, bend.angle, bend.outer)
                past = (abs(below) - math.pi, above - math.pi, above - (2.0 * bend.n - 1.0) * math.pi)
                for wave in range(3):
                    if abs(past[wave]) <= _ROUNDING:
                        m = low
                        if wave > 0:
                            way.met[m] = sides[e, wave - 1]
                            m += 1
                        m = _put(way, m, turns, point.turn[j, 0], True)
                        for g in range(turns.shape[0]):
                            same = turns[g, 0] == m
                            for c in range(m):
                                same = same and turns[g, 1 + c] == way.met[c]
                            shares[g] = there[wave] if same else shares[g]
                continue
            s, phi, psi = _leg_angles(graph, b, t, t2)
            passed = (way.through[0], way.through[1])
            on_one, on_two = _level(one, phi) != 0.0, _level(two, psi) != 0.0
            for side in range(4):
                # Along a sheet there is light on both its sides; along any face half of it is what the face reflects.
                sheet, last = on_one and one[WEDGE] == 2.0, on_two and two[WEDGE] == 2.0
                if (side > 1 and not sheet) or (side % 2 == 1 and not last):
                    continue
                phi, psi = 2.0 * math.pi * (side // 2) if sheet else phi, 2.0 * math.pi * (side % 2) if last else psi
                up, upper, across, other = _level(one, phi), _level(two, psi), _grows(one, phi), _grows(two, psi)
                p_up, q_up = moved(p, across, up * graph.raised), moved(q, other, upper * graph.raised)
                cosine = dot(_image(graph.images[graph.legs[b, 2]], across, 0.0), other)
                way.through[0], way.through[1] = passed
                if on_one and on_two and not cosine * up * upper > 0.5:
                    continue
                around = at_one + at_two
                clear = _leg_clear(p_up, q_up, low + 1, mid, around, -1.0, way, graph, tree)
                for aside in range(6 if mid > low + 1 and not clear else 0):
                    # A mirror met at its very border: beside it, so that rounding does not decide, nor the direction.
                    if not clear:
                        way.through[0], way.through[1] = passed
                        shift = 0.01 * graph.raised * (1.0 if aside < 3 else -1.0)
                        beside = (shift * (aside % 3 == 0), shift * (aside % 3 == 1), shift * (aside % 3 == 2))
                        one_up, two_up = moved(p_up, beside, 1.0), moved(q_up, beside, 1.0)
                        clear = _leg_clear(one_up, two_up, low + 1, mid, around, -1.0, way, graph, tree)
                if not clear:
                    continue
                first = _bend(graph, e, phi, view[0], view[1] / r, weights)
                second = _bend(graph, f, psi, image[0], image[1] / z, others)
                double_diffraction(first, second, r, s, z, cosine, k, pair)
                within = 1.0 / (cosine * cosine / (r + s) + (1.0 - cosine * cosine) / s)
                spread = part * math.sqrt(within / (r * s * (r + s) * z * (within + z)))
                pair *= (0.5 if on_one or on_two else 1.0) * spread * cmath.exp(1j * k * (r + s + z))
                values, met = grown(values, count), grown(met, count)
                power += _record(way, high, ends, r + s + z, pair, values[count], met[count])
                count += 1
        elif n >= 0:
            # By mirrors alone.
            way.through[:] = 1.0
            high = _put(way, 0, turns, n, False)
            clear = _leg_clear(start, end, zero, high, nowhere + nowhere, shares[n], way, graph, tree)
            part = shares[n] if shares[n] >= 0.0 else (1.0 if clear else 0.0)
            _, _, _, r = _step(_image(graph.images[n], views.point, 1.0), point.point)
            if part == 0.0 or r == 0.0:
                continue
            pair[0, 0] = pair[1, 1] = part * cmath.exp(1j * k * r) / r
            pair[0, 1] = pair[1, 0] = 0.0
            values, met = grown(values, count), grown(met, count)
            _record(way, high, ends, r, pair, values[count], met[count])
            count += 1
    return count, near, values, met


@returning
def paths_to(source, source_seen, point, point_seen, graph, tree, rules):
    """Return the paths from a source to a point: float64[N, VALUES], int32[N, MET], and how many are near an edge."""
    views, others = views_of(source, source_seen, graph, tree), views_of(point, point_seen, graph, tree)
    values, met = np.empty((16, VALUES)), np.empty((16, MET), np.int32)
    count, near, values, met = paths_between(views, others, graph, tree, rules, values, met)
    return values[:count], met[:count], near


@inlined
def _sinc(x):
    return math.sin(x) / x if abs(x) > 1e-4 else 1.0 - x * x / 6.0


@returning
def fields_at(source, source_seen, points, seen, cells, normals, graph, tree, rules, fields, powers):
    """Fill fields complex128[P, 2] and powers float64[P, 2], soft and hard; return how many points are near an edge.

    cells   : float64[P + 2, 3], middles of squares, then their two half sides as vectors
    normals : float64[P, 3], of surfaces, whose powers are those of each path times |cos|; 0 for none

    Powers are means of |u|^2 over the squares. Within its square each path is a plane wave, of the direction and
    amplitude that it has at the point: of two paths the fringes are averaged in closed form.
    """
    views, near, k = views_of(source, source_seen, graph, tree), 0, rules.k
    values, met = np.empty((64, VALUES)), np.empty((64, MET), np.int32)
    u, v = k * cells[points.shape[0]], k * cells[points.shape[0] + 1]
    whole = u.any()
    for n in range(points.shape[0]):
        others = views_of(points[n], seen[n], graph, tree)
        count, close, values, met = paths_between(views, others, graph, tree, rules, values, met)
        near += close > 0
        fields[n] = powers[n] = 0.0
        x, y, z, _ = _step(points[n], cells[n])
        for i in range(count):
            d = values[i, ARRIVAL : ARRIVAL + 3]
            at_x, at_y, phase = dot(d, u), dot(d, v), k * dot(d, (x, y, z))
            facing = abs(dot(d, normals[n])) if normals[n].any() else 1.0
            for p in range(2):
                fields[n, p] += complex(values[i, 2 * p], values[i, 2 * p + 1])
                powers[n, p] += facing * (values[i, 2 * p] ** 2 + values[i, 2 * p + 1] ** 2)
            for j in range(i if whole else 0):
                c = values[j, ARRIVAL : ARRIVAL + 3]
                share = 2.0 * _sinc(at_x - dot(c, u)) * _sinc(at_y - dot(c, v))
                turn = share * cmath.exp(1j * (phase - k * dot(c, (x, y, z))))
                for p in range(0, 4, 2):
                    product = complex(values[i, p], values[i, p + 1]) * complex(values[j, p], -values[j, p + 1])
                    powers[n, p // 2] += (product * turn).real
    return near
