"""Interactions of a beam: diffraction in a region, and diffuse scattering."""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import kernel
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.wavetracing.kernels import beam_state as beam
from specklegen.wavetracing.kernels.beam_state import axes_about, kicked, leave_region, mean_kicked
from specklegen.wavetracing.kernels.cone_bvh import collect_all
from specklegen.wavetracing.kernels.cones import CONE
from specklegen.wavetracing.kernels.masked_beams import cover, draw_raster, shares
from specklegen.wavetracing.kernels.region_patterns import draw_polygon
from specklegen.wavetracing.kernels.regions import project, recentre

_ONE = np.uint64(1)
_NOTHING, _EVERYTHING = np.uint64(0), np.uint64(2**64 - 1)
_AGAIN = 1024  # evanescent draws in a row
_STEEP = 4.0  # rho / Sigma above which the curved phase would be undersampled
_NULL, _UNIFORM, _GAUSSIAN, _TRIES, _EVANESCENT, _LOCAL = 3, 6, 7, 8, 9, 13  # rows of the statistics


class Light(NamedTuple):
    """Wavenumber k, and 81 / 4k^2, the least product a b tan_a tan_b of a beam."""

    k: float
    least: float


class Region(NamedTuple):
    """Depths between which a cone meets triangles, and the number of the holes in them."""

    depth: float
    far: float
    holes: int


class Event(NamedTuple):
    """What happens in a region: at an opening or a facet, in uniform light or not, as a whole, of which facet."""

    open: bool
    uniform: bool
    forced: bool
    which: int


class Room(NamedTuple):
    """Workspace of a walk.

    Attributes
    ----------
    wide : float64[CONE]
        A cone twice as wide as the beam.
    seen, touched, found : int32[H], int32[H], float64[FOUND]
        Of `specklegen.wavetracing.kernels.regions.census`.
    flat : float64[edges, 4]
        Borders, seen along a beam.
    fine, mask : uint64[FINE, WORDS], float64[GRID, GRID]
        What is open about a beam, `specklegen.wavetracing.kernels.masked_beams`.
    """

    wide: np.ndarray
    seen: np.ndarray
    touched: np.ndarray
    found: np.ndarray
    flat: np.ndarray
    fine: np.ndarray
    mask: np.ndarray


@kernel
def scatter_diffusely(key0, key1, path, counter, state, z, least, nx, ny, nz):
    """Send the beam off over the hemisphere of the lit side, density cos(theta) / pi; return the counter."""
    u, v, _, _ = uniforms(key0, key1, np.uint64(0), path, counter)
    if state[beam.DX] * nx + state[beam.DY] * ny + state[beam.DZ] * nz > 0.0:
        nx, ny, nz = -nx, -ny, -nz
    x, y, w, a, b, c = axes_about(nx, ny, nz)
    r, h = math.sqrt(u), math.sqrt(1.0 - u)
    sine, cosine = sincos_turns(v)
    dx = r * (cosine * x + sine * a) + h * nx
    dy = r * (cosine * y + sine * b) + h * ny
    dz = r * (cosine * w + sine * c) + h * nz
    leave_region(state, z, least, dx, dy, dz)
    state[beam.CX], state[beam.CY], state[beam.CZ] = state[beam.PX], state[beam.PY], state[beam.PZ]
    state[beam.DX], state[beam.DY], state[beam.DZ] = dx, dy, dz
    return counter + _ONE


@kernel
def paint(state, region, event, half_x, half_y, tree, facet, room):
    """Fill the room's mask with what is open about the beam's axis, or with the event's facet, seen along the mean.

    Return whether there is any.
    """
    wide, fine, corners, open_event = room.wide, room.fine, tree.corners, event.open
    for c in range(CONE):
        wide[c] = state[beam.CONE_AT + c]
    # Twice the envelope: the field at its rim is a tenth of that on the axis, at twice the rim a ten-thousandth.
    wide[12] *= 2.0
    wide[13] *= 2.0
    places, count = collect_all(wide, region.depth, region.far, tree, np.empty(256, np.int64))
    fine[:, :] = _EVERYTHING if open_event else _NOTHING
    flat = np.empty(6)
    e = state[beam.STRETCH]
    for n in range(count):
        place = places[n]
        if not open_event and facet[place] != event.which:
            continue
        for v in range(3):
            x = corners[place, 3 * v] - state[beam.CX]
            y = corners[place, 3 * v + 1] - state[beam.CY]
            w = corners[place, 3 * v + 2] - state[beam.CZ]
            flat[2 * v] = state[beam.XX] * x + state[beam.XY] * y + state[beam.XZ] * w
            flat[2 * v + 1] = (state[beam.YX] * x + state[beam.YY] * y + state[beam.YZ] * w) / e
        cover(fine, 0 if open_event else 1, half_x, half_y, flat[0], flat[1], flat[2], flat[3], flat[4], flat[5])
    return shares(fine, room.mask)


@kernel
def diffract(key, path, counter, state, z, region, event, light, tree, facets, room, statistics):
    """Add a wavevector of the region's pattern to the beam, at depth z; return (counter, whether one was found).

    Uniform light: added to the ray's, whose spread is that of the ensemble. Gaussian light: the pattern is that of the
    beam's own field, and is added to the mean; where the field's phase is too curved for the grid (LOCAL_CHIRP), the
    pattern is that of |u|, and is added to the mean's local direction at the ray.
    """
    key0, key1 = key
    open_event, uniform, which, least = event.open, event.uniform, event.which, light.least
    rims, rim_ends, loops, loop_ends = facets.rims, facets.rim_ends, facets.loops, facets.loop_ends
    flat = room.flat
    e = state[beam.STRETCH]
    edges, area = 0, 0.0
    half_x = half_y = chirp = local_x = local_y = 0.0
    if uniform:
        cone = state[beam.CONE_AT : beam.CONE_AT + CONE]
        if not open_event:
            edges, area = project(rim_ends, rims[which], rims[which + 1], 0, cone, e, flat)
        elif event.forced:
            start, stop = loops[facets.holes[which]], loops[facets.holes[which + 1]]
            edges, area = project(loop_ends, start, stop, 0, cone, e, flat)
        else:
            for h in range(region.holes):
                start, stop = loops[room.touched[h]], loops[room.touched[h] + 1]
                edges, more = project(loop_ends, start, stop, edges, cone, e, flat)
                area += more
        area = 0.5 * abs(area)
        if not area > 0.0:
            return counter, False
        recentre(flat, edges)
        statistics[_UNIFORM] += 1
    else:
        statistics[_GAUSSIAN] += 1
        grown = z * state[beam.SPREAD]
        half_x = 2.0 * math.sqrt(state[beam.WIDTH] ** 2 + grown * grown)
        half_y = half_x / e
        sigma = 2.0 * (state[beam.WIDTH] / 3.0) ** 2
        steep = grown / state[beam.WIDTH]  # rho / Sigma = z / (k Sigma), tan = 9 / (2 k a) at the diffraction limit
        chirp = steep / (sigma * (1.0 + steep * steep))
        if steep > _STEEP:
            statistics[_LOCAL] += 1
            x = state[beam.PX] - state[beam.CX]
            y = state[beam.PY] - state[beam.CY]
            w = state[beam.PZ] - state[beam.CZ]
            local_x = chirp * (state[beam.XX] * x + state[beam.XY] * y + state[beam.XZ] * w)
            local_y = chirp * (state[beam.YX] * x + state[beam.YY] * y + state[beam.YZ] * w) / e
            chirp = 0.0
        if not paint(state, region, event, half_x, half_y, tree, facets.facet, room):
            # Seen along the mean nothing is open, though the ray, a little aslant, did pass: it goes on unbent.
            statistics[_NULL] += 1
            leave_region(state, z, least, state[beam.MX], state[beam.MY], state[beam.MZ])
            return counter, True
    nx = ny = nz = 0.0
    if uniform or not open_event:
        nx, ny, nz = facets.normals[which, 0], facets.normals[which, 1], facets.normals[which, 2]
    side = state[beam.DX] * nx + state[beam.DY] * ny + state[beam.DZ] * nz
    for _ in range(_AGAIN):
        if uniform:
            x, y, counter, tries, good = draw_polygon(key0, key1, path, counter, flat[:edges], area)
            statistics[_TRIES] += tries
        else:
            x, y, counter, good = draw_raster(key0, key1, path, counter, room.mask, half_x, half_y, chirp)
        if not good:
            return counter, False
        fx, fy = (x + local_x) / light.k, (y + local_y) / light.k
        mx, my, mz, forward = mean_kicked(state, fx, fy)
        dx, dy, dz, there = mx, my, mz, forward
        if uniform:
            dx, dy, dz, there = kicked(state, fx, fy)
            if not forward:
                mx, my, mz = dx, dy, dz
        # A direction that would leave on the other side of the screen than it should is no light either.
        if there and (side == 0.0 or (dx * nx + dy * ny + dz * nz) * side > 0.0):
            leave_region(state, z, least, mx, my, mz)
            state[beam.DX], state[beam.DY], state[beam.DZ] = dx, dy, dz
            return counter, True
        statistics[_EVANESCENT] += 1
    return counter, False
