"""What lies in a beam's region: edges that diffract, and the openings or facets that they border.

All borders run in one sense about their facet, so the transform of several is the sum of theirs.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.wavetracing.kernels.cones import edge_interval

# Columns of what `census` fills, float64[FOUND].
EDGES, HOLES_OF, NEAREST_X, NEAREST_Y, NEAREST_Z, OWN, FOUND = 0, 1, 2, 3, 4, 5, 6


class Facets(NamedTuple):
    """Plane facets of a scene, their borders and holes, by place in the leaves of the hierarchy (3 sides each).

    Attributes
    ----------
    facet : int32[n]
        Facet of each triangle.
    across : int32[n, 3]
        Place across each side; -1 none (a boundary), -2 no edge (flat).
    loop : int32[n, 3]
        Hole of the facet that each side borders; -1 for none.
    normals, whole : float64[F, 3], bool[F]
        Normal of each facet, and whether its whole border is edges.
    rims, rim_ends : int64[F + 1], float64[*, 6]
        Where a facet's border begins, in the ends of borders.
    holes : int64[F + 1]
        Where a facet's holes begin.
    loops, loop_ends : int64[H + 1], float64[*, 6]
        Where a hole's border begins, in the ends of holes' borders.
    material : int32[n]
        Row of the materials of each place.
    """

    facet: np.ndarray
    across: np.ndarray
    loop: np.ndarray
    normals: np.ndarray
    whole: np.ndarray
    rims: np.ndarray
    rim_ends: np.ndarray
    holes: np.ndarray
    loops: np.ndarray
    loop_ends: np.ndarray
    material: np.ndarray


@inlined
def lit(corners, place, dx, dy, dz):
    """Whether a triangle's front meets the direction: d . n < 0."""
    ux, uy, uz = (
        corners[place, 3] - corners[place, 0],
        corners[place, 4] - corners[place, 1],
        corners[place, 5] - corners[place, 2],
    )
    vx, vy, vz = (
        corners[place, 6] - corners[place, 0],
        corners[place, 7] - corners[place, 1],
        corners[place, 8] - corners[place, 2],
    )
    return dx * (uy * vz - uz * vy) + dy * (uz * vx - ux * vz) + dz * (ux * vy - uy * vx) < 0.0


@inlined
def _held(cone, near, far, x, y, z):
    """Whether a point lies in the cone between two depths."""
    x, y, z = x - cone[0], y - cone[1], z - cone[2]
    depth = cone[9] * x + cone[10] * y + cone[11] * z
    across = cone[3] * x + cone[4] * y + cone[5] * z
    up = cone[6] * x + cone[7] * y + cone[8] * z
    r = cone[12] + cone[13] * depth
    return near <= depth <= far and r >= 0.0 and across * across + up * up <= r * r


@inlined
def _touched(cone, near, far, x0, y0, z0, x1, y1, z1):
    """Whether a segment comes into the cone between two depths: by its interval of depths."""
    from_x, from_y, from_z = x0 - cone[0], y0 - cone[1], z0 - cone[2]
    to_x, to_y, to_z = x1 - cone[0], y1 - cone[1], z1 - cone[2]
    ax = cone[3] * from_x + cone[4] * from_y + cone[5] * from_z
    ay = cone[6] * from_x + cone[7] * from_y + cone[8] * from_z
    az = cone[9] * from_x + cone[10] * from_y + cone[11] * from_z
    bx = cone[3] * to_x + cone[4] * to_y + cone[5] * to_z
    by = cone[6] * to_x + cone[7] * to_y + cone[8] * to_z
    bz = cone[9] * to_x + cone[10] * to_y + cone[11] * to_z
    low, high = segment_interval(cone[12], cone[13], ax, ay, az, bx, by, bz)
    return low <= far and high >= near


@inlined
def segment_interval(a, t, ax, ay, az, bx, by, bz):
    """Depths of a segment in a cone, in its coordinates; see `specklegen.wavetracing.kernels.cones.edge_interval`."""
    return edge_interval(
        t, ax, ay, az, a + t * az, math.sqrt(ax * ax + ay * ay), bx, by, bz, a + t * bz, math.sqrt(bx * bx + by * by)
    )


@kernel
def census(packed, near, far, ray, own, places, count, corners, facets, seen, touched, found):
    """Look at all edges in a region.

    packed       : float64[CONE];  near, far : the region's depths
    ray          : a point and the direction, six numbers
    own          : facet that was hit, or -1
    places       : int64[count]   triangles in the region
    seen         : int32[H]       all 0 before and after;  touched : int32[H], workspace
    found        : float64[FOUND], out: EDGES, the number of silhouette edges; HOLES_OF, the facet whose holes are
                   all that they border, wholly in the region, or -1; NEAREST, the point of an edge that is nearest to
                   the ray; OWN, how many edges of the border of ``own`` the region holds, -1 if it holds only a part

    Return the number of holes, whose numbers stand in ``touched``.
    """
    px, py, pz, dx, dy, dz = ray
    facet, across, loop, loops, rims = facets.facet, facets.across, facets.loop, facets.loops, facets.rims
    holes, total, only, complete = 0, 0, -1, True
    own_inside = own_touched = 0
    best = math.inf
    for n in range(count):
        place = places[n]
        for side in range(3):
            other = across[place, side]
            if other == -2:
                continue
            mine = facet[place] == own
            silhouette = other < 0 or (lit(corners, place, dx, dy, dz) != lit(corners, other, dx, dy, dz))
            if not silhouette and not mine:
                continue
            i, j = 3 * side, 3 * ((side + 1) % 3)
            x0, y0, z0 = corners[place, i], corners[place, i + 1], corners[place, i + 2]
            x1, y1, z1 = corners[place, j], corners[place, j + 1], corners[place, j + 2]
            if not _touched(packed, near, far, x0, y0, z0, x1, y1, z1):
                continue
            inside = _held(packed, near, far, x0, y0, z0) and _held(packed, near, far, x1, y1, z1)
            if mine:
                own_touched += 1
                own_inside += 1 if inside else 0
            if not silhouette:
                continue
            total += 1
            hole = loop[place, side]
            if hole < 0 or not inside or (only >= 0 and facet[place] != only):
                complete = False
            else:
                only = facet[place]
                if seen[hole] == 0:
                    touched[holes] = hole
                    holes += 1
                seen[hole] += 1
            # Where the edge passes nearest to the ray.
            ex, ey, ez = x1 - x0, y1 - y0, z1 - z0
            ed = ex * dx + ey * dy + ez * dz
            ux, uy, uz = x0 - px, y0 - py, z0 - pz
            ud = ux * dx + uy * dy + uz * dz
            cx, cy, cz = ex - ed * dx, ey - ed * dy, ez - ed * dz
            vx, vy, vz = ux - ud * dx, uy - ud * dy, uz - ud * dz
            square = cx * cx + cy * cy + cz * cz
            s = -(vx * cx + vy * cy + vz * cz) / square if square > 0.0 else 0.5
            s = min(max(s, 0.0), 1.0)
            distance = (vx + s * cx) ** 2 + (vy + s * cy) ** 2 + (vz + s * cz) ** 2
            if distance < best:
                best = distance
                found[NEAREST_X], found[NEAREST_Y], found[NEAREST_Z] = x0 + s * ex, y0 + s * ey, z0 + s * ez
    for h in range(holes):
        if seen[touched[h]] != loops[touched[h] + 1] - loops[touched[h]]:
            complete = False
        seen[touched[h]] = 0
    found[EDGES] = total
    found[HOLES_OF] = only if complete and holes > 0 else -1
    found[OWN] = own_touched
    if own >= 0 and own_touched > 0 and own_inside != rims[own + 1] - rims[own]:
        found[OWN] = -1
    return holes


@inlined
def project(ends, first, last, count, cone, e, flat):
    """Write edges [first, last) of ``ends`` float64[*, 6], seen along the cone's axis, behind ``count`` in ``flat``.

    flat : float64[room, 4], midpoint and vector; e : the cone's stretch, which is taken out again

    Return their number in ``flat`` now, and twice the area that they add.
    """
    double = 0.0
    for n in range(first, last):
        ax, ay, az = ends[n, 0] - cone[0], ends[n, 1] - cone[1], ends[n, 2] - cone[2]
        bx, by, bz = ends[n, 3] - cone[0], ends[n, 4] - cone[1], ends[n, 5] - cone[2]
        ux = cone[3] * ax + cone[4] * ay + cone[5] * az
        uy = (cone[6] * ax + cone[7] * ay + cone[8] * az) / e
        vx = cone[3] * bx + cone[4] * by + cone[5] * bz
        vy = (cone[6] * bx + cone[7] * by + cone[8] * bz) / e
        flat[count, 0], flat[count, 1] = 0.5 * (ux + vx), 0.5 * (uy + vy)
        flat[count, 2], flat[count, 3] = vx - ux, vy - uy
        double += ux * vy - uy * vx
        count += 1
    return count, double


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
