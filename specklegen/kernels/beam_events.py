"""Interactions of a beam: diffraction in a region, and diffuse scattering."""

import math

import numpy as np

from specklegen.kernels import beam_state as beam
from specklegen.kernels import kernel
from specklegen.kernels.beam_state import axes_about, kicked, leave_region, mean_kicked
from specklegen.kernels.cone_bvh import collect_all
from specklegen.kernels.cones import CONE
from specklegen.kernels.masked_beams import cover, draw_raster, shares
from specklegen.kernels.region_patterns import draw_polygon
from specklegen.kernels.regions import project, recentre
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns

_ONE = np.uint64(1)
_NOTHING, _EVERYTHING = np.uint64(0), np.uint64(2**64 - 1)
_AGAIN = 1024  # evanescent draws in a row
_STEEP = 4.0  # rho / Sigma above which the curved phase would be undersampled
_NULL, _UNIFORM, _GAUSSIAN, _TRIES, _EVANESCENT, _LOCAL = 3, 6, 7, 8, 9, 13  # rows of the statistics


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
def paint(state, wide, depth, far, open_event, which, half_x, half_y, boxes, link, corners, facet, fine, mask):
    """Fill ``mask`` with what is open about the beam's axis, or with the facet ``which``, seen along the mean.

    Return whether there is any.
    """
    for c in range(CONE):
        wide[c] = state[beam.CONE_AT + c]
    # Twice the envelope: the field at its rim is a tenth of that on the axis, at twice the rim a ten-thousandth.
    wide[12] *= 2.0
    wide[13] *= 2.0
    places, count = collect_all(wide, depth, far, boxes, link, corners, np.empty(256, np.int64))
    fine[:, :] = _EVERYTHING if open_event else _NOTHING
    flat = np.empty(6)
    e = state[beam.STRETCH]
    for n in range(count):
        place = places[n]
        if not open_event and facet[place] != which:
            continue
        for v in range(3):
            x = corners[place, 3 * v] - state[beam.CX]
            y = corners[place, 3 * v + 1] - state[beam.CY]
            w = corners[place, 3 * v + 2] - state[beam.CZ]
            flat[2 * v] = state[beam.XX] * x + state[beam.XY] * y + state[beam.XZ] * w
            flat[2 * v + 1] = (state[beam.YX] * x + state[beam.YY] * y + state[beam.YZ] * w) / e
        cover(fine, 0 if open_event else 1, half_x, half_y, flat[0], flat[1], flat[2], flat[3], flat[4], flat[5])
    return shares(fine, mask)


@kernel
def diffract(
    key0, key1, path, counter, state, wide, z, depth, far, k, least, open_event, uniform, forced, which, hole_number,
    touched, boxes, link, corners, facet, normals, rims, rim_ends, holes, loops, loop_ends, flat, fine, mask,
    statistics,
):  # fmt: skip
    """Add a wavevector of the region's pattern to the beam; return (counter, whether one was found).

    Uniform light: added to the ray's, whose spread is that of the ensemble. Gaussian light: the pattern is that of the
    beam's own field, and is added to the mean; where the field's phase is too curved for the grid (LOCAL_CHIRP), the
    pattern is that of |u|, and is added to the mean's local direction at the ray.
    """
    e = state[beam.STRETCH]
    edges, area = 0, 0.0
    half_x = half_y = chirp = local_x = local_y = 0.0
    if uniform:
        cone = state[beam.CONE_AT : beam.CONE_AT + CONE]
        if not open_event:
            edges, area = project(rim_ends, rims[which], rims[which + 1], 0, cone, e, flat)
        elif forced:
            start, stop = loops[holes[which]], loops[holes[which + 1]]
            edges, area = project(loop_ends, start, stop, 0, cone, e, flat)
        else:
            for h in range(hole_number):
                start, stop = loops[touched[h]], loops[touched[h] + 1]
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
        if not paint(
            state, wide, depth, far, open_event, which, half_x, half_y, boxes, link, corners, facet, fine, mask
        ):
            # Seen along the mean nothing is open, though the ray, a little aslant, did pass: it goes on unbent.
            statistics[_NULL] += 1
            leave_region(state, z, least, state[beam.MX], state[beam.MY], state[beam.MZ])
            return counter, True
    nx = ny = nz = 0.0
    if uniform or not open_event:
        nx, ny, nz = normals[which, 0], normals[which, 1], normals[which, 2]
    side = state[beam.DX] * nx + state[beam.DY] * ny + state[beam.DZ] * nz
    for _ in range(_AGAIN):
        if uniform:
            x, y, counter, tries, good = draw_polygon(key0, key1, path, counter, flat[:edges], area)
            statistics[_TRIES] += tries
        else:
            x, y, counter, good = draw_raster(key0, key1, path, counter, mask, half_x, half_y, chirp)
        if not good:
            return counter, False
        fx, fy = (x + local_x) / k, (y + local_y) / k
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


