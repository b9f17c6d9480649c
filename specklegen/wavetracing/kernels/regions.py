"""Record of a beam's way: holes that its ray goes through, and outer edges within its cone.

A *hole* is a loop of edges in a plane facet. The ray that goes through it meets the hole once, where it crosses the
plane, at any angle and any distance from its source. Holes nearer to each other than the light is coherent are one
opening, by which every beam is diffracted alike.

Any other edge between what is lit and what is not is an *outer* edge. It is passed where the ray crosses the plane of
the lit facet beside it; where the ray runs along that plane, or meets something before it, where the ray is nearest to
the edge. Sheets (all facets of one plane) that were passed are not passed again until the beam meets a surface.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.wavetracing.kernels import beam_state as beam
from specklegen.wavetracing.kernels.beam_state import CONE_AT
from specklegen.wavetracing.kernels.cones import CONE, edge_interval
from specklegen.wavetracing.kernels.edge_geometry import LENGTH, WEDGE, along, turn
from specklegen.wavetracing.kernels.ray_bvh import NO, nearest

KEPT = 32
"""Sheets that a beam remembers."""
_GRAZING = 0.1  # |cos| to a plane's normal below which a ray runs along the plane
_ON_FACE = 1e-9  # radians from a face within which a point lies on it
_FAR = 1e300


class Facets(NamedTuple):
    """Plane facets of a scene, their borders and holes, by place in the leaves of the hierarchy (3 sides each).

    Attributes
    ----------
    facet : int32[n]
        Facet of each triangle.
    beside : bool[n, 3]
        Whether a side borders a hole.
    normals, whole, sheet, breadth : float64[F, 3], bool[F], int32[F], float64[F]
        Normal of each facet, whether its whole border is edges, its plane's number, and its mean width, inf for too
        many edges.
    rims, rim_ends, rim_edges : int64[F + 1], float64[*, 6], int8[*]
        Where a facet's border begins, in the ends of borders; of each whether it is no edge (0), one of two faces (1),
        or one of the facet alone (2).
    holes : int64[F + 1]
        Where a facet's holes begin.
    loops, loop_ends : int64[H + 1], float64[*, 6]
        Where a hole's border begins, in the ends of holes' borders.
    thin : bool[H]
        Whether nothing but the facet itself meets a hole's border.
    material : int32[n]
        Row of the materials of each place.
    """

    facet: np.ndarray
    beside: np.ndarray
    normals: np.ndarray
    whole: np.ndarray
    sheet: np.ndarray
    breadth: np.ndarray
    rims: np.ndarray
    rim_ends: np.ndarray
    rim_edges: np.ndarray
    holes: np.ndarray
    loops: np.ndarray
    loop_ends: np.ndarray
    thin: np.ndarray
    material: np.ndarray


class Openings(NamedTuple):
    """Holes that light sees as one.

    Attributes
    ----------
    of : int32[H]
        Opening of each hole.
    starts, members : int64[C + 1], int64[H]
        Where an opening's holes begin, among holes sorted by opening.
    even : bool[C]
        Whether light in it is taken for even: all of it is lit, or beams are as wide as its largest hole.
    balls : float64[H, 4]
        A sphere about each hole, middle and radius.
    screens : int64[S]
        Facets that have holes.
    outer, bare : int64[*], bool[E]
        Edges that border no hole; of each edge, whether it does not.
    """

    of: np.ndarray
    starts: np.ndarray
    members: np.ndarray
    even: np.ndarray
    balls: np.ndarray
    screens: np.ndarray
    outer: np.ndarray
    bare: np.ndarray


@inlined
def touched(cone, near, far, x0, y0, z0, x1, y1, z1):
    """Return whether a segment comes into the cone between two depths: by its interval of depths."""
    from_x, from_y, from_z = x0 - cone[0], y0 - cone[1], z0 - cone[2]
    to_x, to_y, to_z = x1 - cone[0], y1 - cone[1], z1 - cone[2]
    ax = cone[3] * from_x + cone[4] * from_y + cone[5] * from_z
    ay = cone[6] * from_x + cone[7] * from_y + cone[8] * from_z
    az = cone[9] * from_x + cone[10] * from_y + cone[11] * from_z
    bx = cone[3] * to_x + cone[4] * to_y + cone[5] * to_z
    by = cone[6] * to_x + cone[7] * to_y + cone[8] * to_z
    bz = cone[9] * to_x + cone[10] * to_y + cone[11] * to_z
    a, t = cone[12], cone[13]
    low, high = edge_interval(
        t, ax, ay, az, a + t * az, math.sqrt(ax * ax + ay * ay), bx, by, bz, a + t * bz, math.sqrt(bx * bx + by * by)
    )
    return low <= far and high >= near


@inlined
def holds(members, count, value):
    """Return whether a value is among the first ``count``."""
    for n in range(count):
        if members[n] == value:
            return True
    return False


@inlined
def _around(ends, first, last, x, y, z, nx, ny, nz):
    """Return whether a point of their plane lies within the loop of edges [first, last), by crossings of a line."""
    ax, ay, az = abs(nx), abs(ny), abs(nz)
    u, v = (0, 1) if az >= ax and az >= ay else ((2, 0) if ay >= ax else (1, 2))
    at_u = x if u == 0 else (y if u == 1 else z)
    at_v = x if v == 0 else (y if v == 1 else z)
    inside = False
    for n in range(first, last):
        v0, v1 = ends[n, v], ends[n, 3 + v]
        if (v0 <= at_v) != (v1 <= at_v):
            u0, u1 = ends[n, u], ends[n, 3 + u]
            if u0 + (at_v - v0) * (u1 - u0) / (v1 - v0) > at_u:
                inside = not inside
    return inside


@inlined
def _hole_at(f, x, y, z, facets, openings):
    """The hole of a facet that a point of its plane lies in; -1 for none."""
    normals, balls = facets.normals, openings.balls
    for h in range(facets.holes[f], facets.holes[f + 1]):
        u, v, w = x - balls[h, 0], y - balls[h, 1], z - balls[h, 2]
        if u * u + v * v + w * w <= balls[h, 3] * balls[h, 3] and _around(
            facets.loop_ends, facets.loops[h], facets.loops[h + 1], x, y, z,
            normals[f, 0], normals[f, 1], normals[f, 2],
        ):  # fmt: skip
            return h
    return -1


@kernel
def pass_hole(state, hit, skip, facets, openings):
    """The first hole that a beam's ray goes through before ``hit``: (distance, facet, hole), -1 for none.

    The far side of a hole through a thick wall is none: its near side has diffracted the light.
    """
    px, py, pz = state[beam.PX], state[beam.PY], state[beam.PZ]
    dx, dy, dz = state[beam.DX], state[beam.DY], state[beam.DZ]
    screens, normals = openings.screens, facets.normals
    best, which, hole = hit, -1, -1
    for s in range(screens.shape[0]):
        f = screens[s]
        nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
        rate = dx * nx + dy * ny + dz * nz
        if f == skip or rate == 0.0:
            continue
        at = facets.loop_ends[facets.loops[facets.holes[f]]]
        t = ((at[0] - px) * nx + (at[1] - py) * ny + (at[2] - pz) * nz) / rate
        if not 0.0 < t < best:
            continue
        h = _hole_at(f, px + t * dx, py + t * dy, pz + t * dz, facets, openings)
        if h >= 0 and (rate < 0.0 or facets.thin[h]):
            best, which, hole = t, f, h
    return best, which, hole


@kernel
def hole_in(state, f, facets, openings):
    """Distance of a beam's ray from the plane of a facet, and in which of its holes it goes through; -1 for none."""
    n = facets.normals[f]
    at = facets.rim_ends[facets.rims[f]]
    px, py, pz = state[beam.PX], state[beam.PY], state[beam.PZ]
    dx, dy, dz = state[beam.DX], state[beam.DY], state[beam.DZ]
    t = ((at[0] - px) * n[0] + (at[1] - py) * n[1] + (at[2] - pz) * n[2]) / (dx * n[0] + dy * n[1] + dz * n[2])
    return t, _hole_at(f, px + t * dx, py + t * dy, pz + t * dz, facets, openings)


@inlined
def _nearest_point(edge, x, y, z, dx, dy, dz):
    """Place along an edge nearest to a ray; for a direction of length 0, nearest to its point."""
    ed = edge[3] * dx + edge[4] * dy + edge[5] * dz
    ux, uy, uz = x - edge[0], y - edge[1], z - edge[2]
    ud, ue = ux * dx + uy * dy + uz * dz, ux * edge[3] + uy * edge[4] + uz * edge[5]
    square = 1.0 - ed * ed
    return min(max((ue - ud * ed) / square if square > 1e-24 else ue, 0.0), edge[LENGTH])


@inlined
def beside(state, x, y, z, qx, qy, qz):
    """Return whether a beam meets a point q together with a point of its ray: by its width there, seen along it."""
    mx, my, mz = state[beam.MX], state[beam.MY], state[beam.MZ]
    depth = (x - state[beam.CX]) * mx + (y - state[beam.CY]) * my + (z - state[beam.CZ]) * mz
    width = 2.0 * (state[beam.WIDTH] + abs(depth) * state[beam.SLOPE])
    x, y, z = x - qx, y - qy, z - qz
    deep = x * mx + y * my + z * mz
    return x * x + y * y + z * z - deep * deep <= width * width and abs(deep) <= width / _GRAZING


@inlined
def _step_past(state, hit, ahead, e, table, facets, memory, kept):
    """Passage of a beam's ray by an edge: (distance, facet whose plane it crosses there or -1); inf for not at all."""
    normals, edges = facets.normals, table.edges
    f, g = table.facets[e, 0], table.facets[e, 1]
    one, two = facets.sheet[f], facets.sheet[g]
    if one == ahead or two == ahead or holds(memory, kept, one) or holds(memory, kept, two):
        return math.inf, -1
    mx, my, mz = state[beam.MX], state[beam.MY], state[beam.MZ]
    lit = mx * normals[f, 0] + my * normals[f, 1] + mz * normals[f, 2] < 0.0
    if f != g and lit == (mx * normals[g, 0] + my * normals[g, 1] + mz * normals[g, 2] < 0.0):
        return math.inf, -1
    edge = edges[e]
    x1, y1, z1 = along(edge, edge[LENGTH])
    cone = state[CONE_AT : CONE_AT + CONE]
    if not touched(cone, -_FAR, _FAR, edge[0], edge[1], edge[2], x1, y1, z1):
        return math.inf, -1
    px, py, pz = state[beam.PX], state[beam.PY], state[beam.PZ]
    dx, dy, dz = state[beam.DX], state[beam.DY], state[beam.DZ]
    owner = f if f == g or lit else g
    nx, ny, nz = normals[owner, 0], normals[owner, 1], normals[owner, 2]
    rate = dx * nx + dy * ny + dz * nz
    for attempt in range(2):
        if attempt == 0:
            if not abs(rate) > _GRAZING:
                continue
            t = ((edge[0] - px) * nx + (edge[1] - py) * ny + (edge[2] - pz) * nz) / rate
        else:
            owner = -1
            x, y, z = along(edge, _nearest_point(edge, px, py, pz, dx, dy, dz))
            t = (x - px) * dx + (y - py) * dy + (z - pz) * dz
        if not 0.0 < t < hit:
            continue
        x, y, z = px + t * dx, py + t * dy, pz + t * dz
        qx, qy, qz = along(edge, _nearest_point(edge, x, y, z, 0.0, 0.0, 0.0))
        # Beside the ray, not somewhere else on the same plane; and in the air, not seen from within a hollow solid.
        if not beside(state, x, y, z, qx, qy, qz):
            continue
        phi = turn(edge, x - qx, y - qy, z - qz)
        if edge[WEDGE] == 2.0 or _ON_FACE < phi < edge[WEDGE] * math.pi - _ON_FACE:
            return t, int(owner)
    return math.inf, -1


@kernel
def pass_edge(state, hit, ahead, candidates, count, table, facets, tree, memory, kept, marked):
    """The first outer edge that a beam's ray passes before ``hit``, and sees: (distance, edge, facet of the plane).

    ahead      : the sheet that the ray hits next, which it does not pass; -1 for none
    candidates : int64[*], numbers of edges, ``count`` of them
    memory     : int64[KEPT], sheets that were passed, ``kept`` of them
    marked     : int64[KEPT], out: sheets of the edges that are passed together, within a beam's width behind the first

    Return also the number of sheets marked, and the depth of the edge; -1 for no edge.
    """
    px, py, pz = state[beam.PX], state[beam.PY], state[beam.PZ]
    dx, dy, dz = state[beam.DX], state[beam.DY], state[beam.DZ]
    mx, my, mz = state[beam.MX], state[beam.MY], state[beam.MZ]
    cx, cy, cz = state[beam.CX], state[beam.CY], state[beam.CZ]
    last = 0.0
    while True:
        best, chosen, plane = hit, -1, -1
        for c in range(count):
            t, owner = _step_past(state, hit, ahead, candidates[c], table, facets, memory, kept)
            if last < t < best:
                best, chosen, plane = t, candidates[c], owner
        if chosen < 0:
            return hit, -1, -1, 0, 0.0
        x, y, z = px + best * dx, py + best * dy, pz + best * dz
        qx, qy, qz = along(table.edges[chosen], _nearest_point(table.edges[chosen], x, y, z, 0.0, 0.0, 0.0))
        _, place, _ = nearest(
            x, y, z, qx - x, qy - y, qz - z, 0.0, 1.0 - 1e-7, (np.int64(plane), NO), facets.facet, tree
        )
        if place < 0:
            break
        last = best  # hidden behind something
    depth = (qx - cx) * mx + (qy - cy) * my + (qz - cz) * mz
    end = depth + 2.0 * (state[beam.WIDTH] + abs(depth) * state[beam.SLOPE])
    marks = 0
    for c in range(count):
        e = candidates[c]
        if e != chosen:
            t, _ = _step_past(state, hit, ahead, e, table, facets, memory, kept)
            if t == math.inf:
                continue
            x, y, z = px + t * dx, py + t * dy, pz + t * dz
            x, y, z = along(table.edges[e], _nearest_point(table.edges[e], x, y, z, 0.0, 0.0, 0.0))
            if not depth <= (x - cx) * mx + (y - cy) * my + (z - cz) * mz <= end:
                continue
        for side in range(2):
            sheet = facets.sheet[table.facets[e, side]]
            if marks < KEPT and not holds(marked, marks, sheet):
                marked[marks] = sheet
                marks += 1
    return best, chosen, plane, marks, depth


@kernel
def borders(state, step, f, facets):
    """True if an edge of a facet's border lies in a beam's cone, beside where its ray hits the facet, ``step`` ahead.

    From inside a solid its corners are no edges.
    """
    cone = state[CONE_AT : CONE_AT + CONE]
    n = facets.normals[f]
    x, y, z = state[beam.PX] + step * state[beam.DX], state[beam.PY] + step * state[beam.DY], state[beam.PZ]
    z += step * state[beam.DZ]
    least = 1 if state[beam.DX] * n[0] + state[beam.DY] * n[1] + state[beam.DZ] * n[2] < 0.0 else 2
    for m in range(facets.rims[f], facets.rims[f + 1]):
        ends = facets.rim_ends[m]
        if facets.rim_edges[m] < least or not touched(
            cone, -_FAR, _FAR, ends[0], ends[1], ends[2], ends[3], ends[4], ends[5]
        ):
            continue
        ux, uy, uz = ends[3] - ends[0], ends[4] - ends[1], ends[5] - ends[2]
        vx, vy, vz = x - ends[0], y - ends[1], z - ends[2]
        square = ux * ux + uy * uy + uz * uz
        at = min(max((vx * ux + vy * uy + vz * uz) / square, 0.0), 1.0) if square > 0.0 else 0.0
        if beside(state, x, y, z, ends[0] + at * ux, ends[1] + at * uy, ends[2] + at * uz):
            return True
    return False


@inlined
def project(ends, first, last, count, origin, one, two, flat):
    """Write edges [first, last) of ``ends`` float64[*, 6], in a plane, behind ``count`` in ``flat``.

    flat : float64[room, 4], midpoint and vector; origin, one, two : a point of the plane, two unit vectors in it

    Return their number in ``flat`` now, twice the area that they add, and their length.
    """
    double = length = 0.0
    for n in range(first, last):
        ax, ay, az = ends[n, 0] - origin[0], ends[n, 1] - origin[1], ends[n, 2] - origin[2]
        bx, by, bz = ends[n, 3] - origin[0], ends[n, 4] - origin[1], ends[n, 5] - origin[2]
        ux, uy = one[0] * ax + one[1] * ay + one[2] * az, two[0] * ax + two[1] * ay + two[2] * az
        vx, vy = one[0] * bx + one[1] * by + one[2] * bz, two[0] * bx + two[1] * by + two[2] * bz
        flat[count, 0], flat[count, 1] = 0.5 * (ux + vx), 0.5 * (uy + vy)
        flat[count, 2], flat[count, 3] = vx - ux, vy - uy
        double += ux * vy - uy * vx
        length += math.sqrt((vx - ux) * (vx - ux) + (vy - uy) * (vy - uy))
        count += 1
    return count, double, length


@kernel
def recentre(flat, count):
    """Move ``count`` edges to about the middle of their midpoints, so that phases stay small."""
    x = y = 0.0
    for n in range(count):
        x += flat[n, 0]
        y += flat[n, 1]
    for n in range(count):
        flat[n, 0] -= x / count
        flat[n, 1] -= y / count
