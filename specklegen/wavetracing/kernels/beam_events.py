"""Interactions of a beam: diffraction in a region, and diffuse scattering."""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.wavetracing.kernels import beam_state as beam
from specklegen.wavetracing.kernels.beam_state import axes_about, leave_region
from specklegen.wavetracing.kernels.cone_bvh import collect_all, unpacked
from specklegen.wavetracing.kernels.cones import CONE, triangle_in_cone
from specklegen.wavetracing.kernels.edge_geometry import dot
from specklegen.wavetracing.kernels.masked_beams import cover, draw_raster, fitted, shares
from specklegen.wavetracing.kernels.patterns import draw_polygon
from specklegen.wavetracing.kernels.regions import holds, project, recentre

_ONE = np.uint64(1)
_NOTHING, _EVERYTHING = np.uint64(0), np.uint64(2**64 - 1)
_AGAIN = 1024  # evanescent draws in a row
_STEEPEST = 20.0  # one over the cosine to a plane's normal at which the beam's own field is taken across the beam
_STEEP = 4.0  # rho / Sigma above which the curved phase would be undersampled
_NULL, _UNIFORM, _GAUSSIAN, _TRIES, _EVANESCENT, _TRIANGLES, _LOCAL = 3, 4, 5, 6, 7, 8, 11  # rows of the statistics


class Light(NamedTuple):
    """Wavenumber k, and ``81 / 4k^2``, the least product a b tan_a tan_b of a beam."""

    k: float
    least: float


class Event(NamedTuple):
    """Event: at an opening (or a facet), in the plane of a facet (-1: across the beam), in uniform light or not.

    ``opening`` is that of uniform light, -1: the facet itself; what lies between ``low`` and ``high`` stands in the way
    of the beam's own field, but for the facet ``beyond``, and so do all of the first ``marks`` sheets marked.
    """

    open: bool
    plane: int
    uniform: bool
    opening: int
    low: float
    high: float
    beyond: int
    marks: int


class Room(NamedTuple):
    """Workspace of a walk.

    Attributes
    ----------
    state : float64[STATE]
        The beam.
    wide : float64[CONE]
        A cylinder that holds the beam twice.
    marked, memory : int64[KEPT]
        Sheets that an event is about, and those that the beam has passed.
    flat : float64[edges, 4]
        Borders in their plane.
    fine, mask : uint64[FINE, WORDS], float64[GRID, GRID]
        What is open about a beam, `specklegen.wavetracing.kernels.masked_beams`.
    other : float64[STATE]
        A beam sent to a receiver.
    pending, touched : float64[cells, 2], int64[cells + 1]
        What the beam has brought to cells of receivers, w and w / |cos|; the number of such cells, and which.
    """

    state: np.ndarray
    wide: np.ndarray
    marked: np.ndarray
    memory: np.ndarray
    flat: np.ndarray
    fine: np.ndarray
    mask: np.ndarray
    other: np.ndarray
    pending: np.ndarray
    touched: np.ndarray


@inlined
def send(state, z, least, dx, dy, dz):
    """Send a beam off from a point of a surface."""
    leave_region(state, z, least, dx, dy, dz)
    state[beam.CX], state[beam.CY], state[beam.CZ] = state[beam.PX], state[beam.PY], state[beam.PZ]
    state[beam.DX], state[beam.DY], state[beam.DZ] = dx, dy, dz


@kernel
def scatter_diffusely(key0, key1, path, counter, state, z, least, nx, ny, nz):
    """Send the beam off over the hemisphere about a normal, density cos(theta) / pi; return the counter."""
    u, v, _, _ = uniforms(key0, key1, np.uint64(0), path, counter)
    x, y, w, a, b, c = axes_about(nx, ny, nz)
    r, h = math.sqrt(u), math.sqrt(1.0 - u)
    sine, cosine = sincos_turns(v)
    dx = r * (cosine * x + sine * a) + h * nx
    dy = r * (cosine * y + sine * b) + h * ny
    dz = r * (cosine * w + sine * c) + h * nz
    send(state, z, least, dx, dy, dz)
    return counter + _ONE


@inlined
def _turned(one, two, angle):
    """Unit vectors in the plane of two, turned."""
    c, s = math.cos(angle), math.sin(angle)
    return (
        (c * one[0] + s * two[0], c * one[1] + s * two[1], c * one[2] + s * two[2]),
        (c * two[0] - s * one[0], c * two[1] - s * one[1], c * two[2] - s * one[2]),
    )


@kernel
def footprint(state, half, normal, point):
    """Section of a beam with a plane: (middle, two axes, half-widths along them), of the plane's own ellipse.

    half   : half-width of the beam across, along x of its frame
    normal : of the plane, not across the beam;  point : of the plane
    """
    m = (state[beam.MX], state[beam.MY], state[beam.MZ])
    x = (state[beam.XX], state[beam.XY], state[beam.XZ])
    y = (state[beam.YX], state[beam.YY], state[beam.YZ])  # times e, as the half-width along it is over e
    a, b, c, d, f, g = axes_about(normal[0], normal[1], normal[2])
    s, t = (a, b, c), (d, f, g)
    # |(x.r, e y.r)|^2 / half^2 of r in the plane, and its principal axes.
    xs, xt, ys, yt = dot(x, s), dot(x, t), dot(y, s), dot(y, t)
    first, mixed, last = xs * xs + ys * ys, xs * xt + ys * yt, xt * xt + yt * yt
    one, two = _turned(s, t, 0.5 * math.atan2(2.0 * mixed, first - last))
    long = half / math.sqrt(dot(x, one) ** 2 + dot(y, one) ** 2)
    short = half / math.sqrt(dot(x, two) ** 2 + dot(y, two) ** 2)
    start = (state[beam.CX], state[beam.CY], state[beam.CZ])
    depth = (dot(point, normal) - dot(start, normal)) / dot(m, normal)
    middle = (start[0] + depth * m[0], start[1] + depth * m[1], start[2] + depth * m[2])
    return middle, one, two, long, short


@kernel
def paint(state, half, z, event, normal, print_, tree, facets, room):
    """Fill the room's mask with what is open in a beam's footprint, or with the event's sheet, seen along the mean.

    Return whether there is any, the number of triangles about it, and the window of the mask: its middle from the
    beam's, and its halves.
    """
    wide, fine, corners, open_event, marked = room.wide, room.fine, tree.corners, event.open, room.marked
    o, one, two, long, short = print_
    for c in range(CONE):
        wide[c] = state[beam.CONE_AT + c]
    wide[12], wide[13] = half, 0.0
    near, far = z - _STEEPEST * half, z + _STEEPEST * half
    if event.low < near:
        near = event.low
    if event.high > far:
        far = event.high
    places, found = collect_all(wide, near, far, tree, np.empty(256, np.int64))
    count = 0
    for n in range(found):
        place = places[n]
        if not holds(marked, event.marks, facets.sheet[facets.facet[place]]):
            if facets.facet[place] == event.beyond:
                continue
            low, _ = triangle_in_cone(unpacked(wide), event.low, event.high, corners, place)
            if low == math.inf:
                continue
        places[count] = place
        count += 1
    m = (state[beam.MX], state[beam.MY], state[beam.MZ])
    # r less what of it lies along the mean, until it is in the plane.
    p, q = dot(m, one) / dot(m, normal), dot(m, two) / dot(m, normal)
    u = (one[0] - p * normal[0], one[1] - p * normal[1], one[2] - p * normal[2])
    v = (two[0] - q * normal[0], two[1] - q * normal[1], two[2] - q * normal[2])
    flat = np.empty(6)
    x = y = 0.0
    for finer in range(2):
        fine[:, :] = _EVERYTHING if open_event else _NOTHING
        for n in range(count):
            place = places[n]
            for c in range(3):
                r = corners[place, 3 * c] - o[0], corners[place, 3 * c + 1] - o[1], corners[place, 3 * c + 2] - o[2]
                flat[2 * c], flat[2 * c + 1] = dot(r, u) - x, dot(r, v) - y
            cover(fine, 0 if open_event else 1, long, short, flat[0], flat[1], flat[2], flat[3], flat[4], flat[5])
        if finer == 0:
            right, up, across, along = fitted(fine)
            if across >= 1.0 and along >= 1.0:
                break
            x, y, long, short = right * long, up * short, across * long, along * short
    return shares(fine, room.mask), found, (x, y, long, short)


@kernel
def outline(event, facets, openings, flat):
    """Borders of the event's opening, or of its facet, in their plane: (edges in ``flat``, area, length, two axes)."""
    f = event.plane
    a, b, c, d, e, g = axes_about(facets.normals[f, 0], facets.normals[f, 1], facets.normals[f, 2])
    one, two = (a, b, c), (d, e, g)
    edges, double, length = 0, 0.0, 0.0
    if event.opening < 0:
        origin = facets.rim_ends[facets.rims[f]]
        edges, double, length = project(
            facets.rim_ends, facets.rims[f], facets.rims[f + 1], 0, origin, one, two, flat
        )
    else:
        origin = facets.loop_ends[facets.loops[facets.holes[f]]]
        for n in range(openings.starts[event.opening], openings.starts[event.opening + 1]):
            h = openings.members[n]
            edges, more, rim = project(
                facets.loop_ends, facets.loops[h], facets.loops[h + 1], edges, origin, one, two, flat
            )
            double += more
            length += rim
    recentre(flat, edges)
    return edges, 0.5 * abs(double), length, one, two


@inlined
def _leave(one, two, normal, u, v, side):
    """Direction of the parts u, v in a plane and the rest along its normal, on one side; and whether there is one."""
    rest = 1.0 - u * u - v * v
    if not rest > 0.0:
        return 0.0, 0.0, 0.0, False
    w = math.copysign(math.sqrt(rest), side)
    return (
        u * one[0] + v * two[0] + w * normal[0],
        u * one[1] + v * two[1] + w * normal[1],
        u * one[2] + v * two[2] + w * normal[2],
        True,
    )


@kernel
def diffract(key, path, counter, state, z, event, light, tree, facets, openings, room, statistics):
    """Add a wavevector of an opening's pattern to the beam, at depth z; return (counter, whether one was found).

    What a plane screen keeps is the wavevector's part in its plane, k d - (k d.n) n: the pattern is added there, so
    that it is right at any angle. Uniform light: added to the ray's, whose spread is that of the ensemble. Gaussian
    light: the pattern is that of the beam's own field, and is added to the mean's; where the field's phase is too
    curved for the grid (LOCAL_CHIRP), the pattern is that of |u|, and is added to the mean's local direction at the
    ray.
    """
    key0, key1 = key
    d = (state[beam.DX], state[beam.DY], state[beam.DZ])
    m = (state[beam.MX], state[beam.MY], state[beam.MZ])
    normal, point = m, (state[beam.PX], state[beam.PY], state[beam.PZ])
    if event.plane >= 0:
        n = facets.normals[event.plane]
        if event.uniform or abs(n[0] * m[0] + n[1] * m[1] + n[2] * m[2]) > 1.0 / _STEEPEST:
            normal = (n[0], n[1], n[2])
    side = dot(d, normal)
    through = dot(d, facets.normals[event.plane]) if event.plane >= 0 else 0.0
    edges, area, sizes, chirps, window = 0, 0.0, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
    if event.uniform:
        edges, area, _, one, two = outline(event, facets, openings, room.flat)
        if not area > 0.0:
            return counter, False
        statistics[_UNIFORM] += 1
        mean = d
    else:
        statistics[_GAUSSIAN] += 1
        grown = z * state[beam.SLOPE]
        half = 2.0 * math.sqrt(state[beam.WIDTH] ** 2 + grown * grown)
        print_ = footprint(state, half, normal, point)
        _, one, two, long, short = print_
        sizes = (long, short)
        x = (state[beam.XX], state[beam.XY], state[beam.XZ])
        e = state[beam.STRETCH]
        y = (state[beam.YX] / e, state[beam.YY] / e, state[beam.YZ] / e)
        sigma = 2.0 * (state[beam.WIDTH] / 3.0) ** 2
        steep = grown / state[beam.WIDTH]  # rho / Sigma = z / (k Sigma), tan = 9 / (2 k a) at the diffraction limit
        chirp = steep / (sigma * (1.0 + steep * steep))
        mean = m
        if steep > _STEEP:
            statistics[_LOCAL] += 1
            r = (point[0] - state[beam.CX], point[1] - state[beam.CY], point[2] - state[beam.CZ])
            u, v = chirp * dot(x, r) / light.k, chirp * dot(y, r) / light.k
            mean = (m[0] + u * x[0] + v * y[0], m[1] + u * x[1] + v * y[1], m[2] + u * x[2] + v * y[2])
        else:
            chirps = (
                chirp * (dot(x, one) ** 2 + dot(y, one) ** 2), chirp * (dot(x, two) ** 2 + dot(y, two) ** 2),
            )  # fmt: skip
        some, count, window = paint(state, half, z, event, normal, print_, tree, facets, room)
        statistics[_TRIANGLES] += count
        if not some:
            # Seen along the mean nothing is open, though the ray, a little aslant, did pass: it goes on unbent.
            statistics[_NULL] += 1
            leave_region(state, z, light.least, m[0], m[1], m[2])
            return counter, True
    for _ in range(_AGAIN):
        if event.uniform:
            x_, y_, counter, tries, good = draw_polygon(key0, key1, path, counter, room.flat[:edges], area)
            statistics[_TRIES] += tries
        else:
            x_, y_, counter, good = draw_raster(key0, key1, path, counter, room.mask, window, sizes, chirps)
        if not good:
            return counter, False
        u, v = x_ / light.k, y_ / light.k
        dx, dy, dz, there = _leave(one, two, normal, dot(mean, one) + u, dot(mean, two) + v, side)
        # Along a surface the pattern is taken across the beam: what goes to its other side is drawn again.
        if there and (event.plane < 0 or dot((dx, dy, dz), facets.normals[event.plane]) * through > 0.0):
            mx, my, mz = dx, dy, dz
            if event.uniform:
                mx, my, mz, there = _leave(one, two, normal, dot(m, one) + u, dot(m, two) + v, side)
                if not there:
                    mx, my, mz = dx, dy, dz
            leave_region(state, z, light.least, mx, my, mz)
            state[beam.DX], state[beam.DY], state[beam.DZ] = dx, dy, dz
            return counter, True
        statistics[_EVANESCENT] += 1
    return counter, False
