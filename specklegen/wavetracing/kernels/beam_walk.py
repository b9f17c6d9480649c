"""Beams through a scene: from the source to the surfaces, the openings and the receivers.

One call walks the beams ``first`` ... ``first + count - 1``. Beam n draws at the address (key; sample 0, path n, a
running counter), so blocks and threads change nothing. Each beam carries one ray of its Wigner ensemble; the cone about
the mean is the envelope of that ensemble. Where the cone meets triangles, [d, d + 2a) is a region: there the ray hits a
facet (matter event) or passes (open event), and a wavevector of the pattern of that facet, or of what is open, is
added.
So every beam ends exactly once, and power closes in integers.

Modes: WAVE as above. BALLISTIC: the mean ray alone decides; where it hits, a point of the beam's cross-section decides
between matter and opening, where it does not, nothing happens. RAY: plain rays.

Source: S. Steinberg, M. Pharr, *Wave Tracing*, sections on traversal and on Fraunhofer diffraction.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.rng import normal_pair, uniforms
from specklegen.wavetracing.kernels import beam_state as beam
from specklegen.wavetracing.kernels.beam_events import Event, Light, Region, Room, diffract, scatter_diffusely
from specklegen.wavetracing.kernels.beam_sources import emit
from specklegen.wavetracing.kernels.beam_state import hold_ray, leave_region, mirror
from specklegen.wavetracing.kernels.cone_bvh import collect_all, first_region
from specklegen.wavetracing.kernels.cones import CONE
from specklegen.wavetracing.kernels.masked_beams import FINE, GRID, WORDS
from specklegen.wavetracing.kernels.ray_bvh import nearest
from specklegen.wavetracing.kernels.receivers import crossing
from specklegen.wavetracing.kernels.regions import FOUND, census
from specklegen.wavetracing.kernels.surfaces import ABSORBED, REFLECTED, SCATTERED, TRANSMITTED, outcome

WAVE, BALLISTIC, RAY = 0, 1, 2
# Ends of beams.
RECEIVED, ABSORBED_END, ESCAPED, STOPPED, FAILED, ENDS = 0, 1, 2, 3, 4, 5
# Statistics.
(
    SURFACE_EVENTS, OPEN_EVENTS, MATTER_EVENTS, NULL_EVENTS, RESTARTS, PLAIN_RAYS, UNIFORM, GAUSSIAN, TRIES, EVANESCENT,
    REGION_TRIANGLES, REGIONS, CROSSINGS, LOCAL_CHIRP, STATISTICS,
) = range(15)  # fmt: skip
_FIRST, _GROWTH, _LONGEST, _RESTARTS = 2.0, 4.0, 65536.0, 16  # the ballistic length, in wavelengths
_NULLS = 4096
_ONE = np.uint64(1)


class Rules(NamedTuple):
    """How beams are walked: the mode, 0 (auto), 1 (uniform) or 2 (gaussian) light in regions, events of a beam."""

    mode: int
    amplitude: int
    max_events: int


class Tally(NamedTuple):
    """What a walk adds to.

    Attributes
    ----------
    counts, fluence, squares : int64[cells], float64[cells], float64[cells]
        Crossings of receivers, sum of 1 / |cos| and of its square.
    ends, statistics, areas : int64[ENDS], int64[STATISTICS], float64[1]
        The ledger; what happened; the areas of regions.
    """

    counts: np.ndarray
    fluence: np.ndarray
    squares: np.ndarray
    ends: np.ndarray
    statistics: np.ndarray
    areas: np.ndarray


@inlined
def depth_of(state):
    """Depth of the ray's point along the beam's mean."""
    x, y, z = state[beam.PX] - state[beam.CX], state[beam.PY] - state[beam.CY], state[beam.PZ] - state[beam.CZ]
    return x * state[beam.MX] + y * state[beam.MY] + z * state[beam.MZ]


@inlined
def ray_hit(state, skip, facet, tree):
    """Distance and place of what the ray of a beam meets first; (inf, -1) for nothing."""
    hit, place, _ = nearest(
        state[beam.PX], state[beam.PY], state[beam.PZ], state[beam.DX], state[beam.DY], state[beam.DZ], 0.0, math.inf,
        skip, facet, tree,
    )  # fmt: skip
    return hit, place


@inlined
def cross_planes(state, reach, receivers, tally):
    """Count the crossings of receivers on the next ``reach`` of a ray; return how many."""
    planes = receivers.planes
    found = 0
    for r in range(planes.shape[0]):
        cell, _, steep = crossing(
            state[beam.PX], state[beam.PY], state[beam.PZ], state[beam.DX], state[beam.DY], state[beam.DZ], reach,
            planes, r,
        )  # fmt: skip
        if cell >= 0:
            cell += receivers.first_cell[r]
            tally.counts[cell] += 1
            tally.fluence[cell] += steep
            tally.squares[cell] += steep * steep
            found += 1
    return found


@kernel
def find_region(packed, wavelength, z_ray, hit, near, fresh, tree, places, spans, statistics):
    """Next region on a beam's way: (depth, its end, number of triangles, their places, spans, whether a plain ray).

    Depth inf: no region before the cone has left the scene. ``near``: depth from which to search; behind an interaction
    (``fresh``) the first stretch is the ray's alone, and grows while the cone touches at once.
    """
    length, tries = _FIRST * wavelength, 0
    while True:
        start = max(near, z_ray + length) if fresh else near
        if fresh and hit <= length:
            return math.inf, math.inf, 0, places, spans, True
        depth, far, region = first_region(packed, start, not fresh, tree, places, spans)
        if region > places.shape[0]:
            places, spans = np.empty(region, np.int64), np.empty((region, 2))
            continue
        if not fresh or depth == math.inf or depth > start:
            return depth, far, region, places, spans, False
        tries += 1
        statistics[RESTARTS] += 1
        if tries > _RESTARTS:
            statistics[PLAIN_RAYS] += 1
            return math.inf, math.inf, 0, places, spans, True
        length = min(_GROWTH * length, _LONGEST * wavelength)


@kernel
def look_around(state, depth, far, own, places, region, corners, facets, room, statistics, areas):
    """Take the census of a region of ``region`` triangles; return the number of its holes."""
    packed = state[beam.CONE_AT : beam.CONE_AT + CONE]
    ray = (state[beam.PX], state[beam.PY], state[beam.PZ], state[beam.DX], state[beam.DY], state[beam.DZ])
    statistics[REGIONS] += 1
    statistics[REGION_TRIANGLES] += region
    areas[0] += math.pi * (state[beam.WIDTH] + depth * state[beam.SLOPE]) ** 2 / state[beam.STRETCH]
    return census(packed, depth, far, ray, own, places, region, corners, facets, room.seen, room.touched, room.found)


@kernel
def cross_section_point(key0, key1, path, counter, state, depth, z_hit):
    """A point of a beam's cross-section at ``depth``, of its own deviation at ``z_hit``; one pair of normals."""
    u, v, _, _ = uniforms(key0, key1, np.uint64(0), path, counter)
    gx, gy = normal_pair(u, v)
    s = math.sqrt(state[beam.WIDTH] ** 2 + (z_hit * state[beam.SPREAD]) ** 2) / 3.0
    gx, gy = gx * s, gy * s / (state[beam.STRETCH] * state[beam.STRETCH])
    return (
        state[beam.CX] + depth * state[beam.MX] + gx * state[beam.XX] + gy * state[beam.YX],
        state[beam.CY] + depth * state[beam.MY] + gx * state[beam.XX + 1] + gy * state[beam.YX + 1],
        state[beam.CZ] + depth * state[beam.MZ] + gx * state[beam.XX + 2] + gy * state[beam.YX + 2],
    )


@kernel
def seen_aside(state, step, qx, qy, qz, skip, normals, facet, tree):
    """Whether nothing stands between a ray, ``step`` ahead of its point, and a point q beside it.

    skip : facet that the ray has just left, or -1. Its point lies there to rounding, which no query of the segment can
           judge: what is behind the plane of that facet is taken for hidden.
    """
    px, py, pz = state[beam.PX], state[beam.PY], state[beam.PZ]
    if skip >= 0:
        nx, ny, nz = normals[skip, 0], normals[skip, 1], normals[skip, 2]
        ahead = state[beam.DX] * nx + state[beam.DY] * ny + state[beam.DZ] * nz
        if not ((qx - px) * nx + (qy - py) * ny + (qz - pz) * nz) * ahead > 0.0:
            return False
    px, py, pz = px + step * state[beam.DX], py + step * state[beam.DY], pz + step * state[beam.DZ]
    _, place, _ = nearest(px, py, pz, qx - px, qy - py, qz - pz, 0.0, 1.0, skip, facet, tree)
    return place < 0


@kernel
def step_to_opening(state, which, amplitude, found, normals, rims, rim_ends, hit, nearest_step, farthest_step):
    """Way along the ray to an open event: the plane of the openings ``which``, or beside the nearest edge."""
    step = math.inf
    if which >= 0 and amplitude != 2:
        nx, ny, nz = normals[which, 0], normals[which, 1], normals[which, 2]
        at = rim_ends[rims[which]]
        step = ((at[0] - state[beam.PX]) * nx + (at[1] - state[beam.PY]) * ny + (at[2] - state[beam.PZ]) * nz) / (
            state[beam.DX] * nx + state[beam.DY] * ny + state[beam.DZ] * nz
        )
    if not (step > 0.0 and step < hit and step < math.inf):
        step = (
            (found[2] - state[beam.PX]) * state[beam.DX]
            + (found[3] - state[beam.PY]) * state[beam.DY]
            + (found[4] - state[beam.PZ]) * state[beam.DZ]
        )
        # Within the region: a ray that is turned on a surface, ahead or behind, may come to lie beyond it.
        step = min(max(step, nearest_step), farthest_step)
        step = min(max(step, 0.0), hit)
    return step


@kernel
def walk_beams(key, first, count, rules, source, wavelength, tree, facets, materials, receivers, tally):
    """Walk beams; fill what receivers and the ledger count.

    key : two words;  rules, tally : Rules, Tally;  source : float64[SOURCE]
    tree, facets, receivers : Tree, Facets, Receivers of `specklegen.wavetracing.kernels`
    materials : float64[M, 4], see `specklegen.wavetracing.kernels.surfaces`
    """
    k0, k1 = np.uint64(key[0]), np.uint64(key[1])
    mode, amplitude, max_events = rules.mode, rules.amplitude, rules.max_events
    facet, normals, whole, rims, rim_ends = facets.facet, facets.normals, facets.whole, facets.rims, facets.rim_ends
    holes, loops, material, corners = facets.holes, facets.loops, facets.material, tree.corners
    ends, statistics, areas = tally.ends, tally.statistics, tally.areas
    k = 2.0 * math.pi / wavelength
    least = 81.0 / (4.0 * k * k)
    most_edges = max(1, facets.loop_ends.shape[0])  # of all holes, or of one facet
    for f in range(rims.shape[0] - 1):
        most_edges = max(most_edges, rims[f + 1] - rims[f])
    state, found = np.empty(beam.STATE), np.empty(FOUND)
    packed = state[beam.CONE_AT : beam.CONE_AT + CONE]
    hole_count = loops.shape[0] - 1
    seen, touched = np.zeros(hole_count, np.int32), np.empty(hole_count, np.int32)
    places, spans = np.empty(256, np.int64), np.empty((256, 2))
    fine, mask = np.empty((FINE, WORDS), np.uint64), np.empty((GRID, GRID))
    room = Room(np.empty(CONE), seen, touched, found, np.empty((most_edges, 4)), fine, mask)
    light = Light(k, least)

    for n in range(count):
        path = np.uint64(first + n)
        counter = emit(k0, k1, path, source, mode, k, state)
        events, skip, end, crossed = 0, -1, -1, False
        while end < 0:
            hold_ray(state)
            hit, place = ray_hit(state, skip, facet, tree)
            # Depths along the axis of the ray's start, and what a step of the ray adds.
            z_ray = depth_of(state)
            rate = state[beam.DX] * state[beam.MX] + state[beam.DY] * state[beam.MY] + state[beam.DZ] * state[beam.MZ]
            z_hit = z_ray + hit * rate if place >= 0 else math.inf
            depth, far, open_event, hole_number, region = math.inf, math.inf, False, 0, 0
            own = facet[place] if place >= 0 else -1
            if mode == WAVE and rate > 0.0:
                near, fresh, nulls = z_ray, True, 0
                while True:
                    depth, far, region, places, spans, plain = find_region(
                        packed, wavelength, z_ray, hit, near, fresh, tree, places, spans, statistics
                    )
                    if plain or depth == math.inf or z_hit < depth:
                        depth = math.inf
                        break
                    near_own = own if z_hit <= far else -1
                    hole_number = look_around(
                        state, depth, far, near_own, places, region, corners, facets, room, statistics, areas
                    )
                    open_event = z_hit > far and found[0] > 0.0
                    if z_hit <= far or open_event:
                        break
                    statistics[NULL_EVENTS] += 1
                    nulls += 1
                    near, fresh = far, False
                    if nulls > _NULLS:
                        statistics[PLAIN_RAYS] += 1
                        depth = math.inf
                        break
            elif mode == BALLISTIC and place >= 0:
                a = state[beam.WIDTH] + z_hit * state[beam.SLOPE]
                depth, far = max(z_hit - a, z_ray), z_hit + a
                places, region = collect_all(packed, depth, far, tree, places)
                hole_number = look_around(
                    state, depth, far, own, places, region, corners, facets, room, statistics, areas
                )
                if found[0] > 0.0:
                    # A ray along the mean through a point of the cross-section: does it pass? A point beyond a wall
                    # beside the ray is no opening, though nothing stands behind it.
                    qx, qy, qz = cross_section_point(k0, k1, path, counter, state, depth, z_hit)
                    counter += _ONE
                    _, other, _ = nearest(
                        qx, qy, qz, state[beam.MX], state[beam.MY], state[beam.MZ], 0.0, far - depth, -1,
                        facet, tree,
                    )  # fmt: skip
                    if other < 0 and seen_aside(state, depth - z_ray, qx, qy, qz, skip, normals, facet, tree):
                        open_event = True
                        passed = cross_planes(state, depth - z_ray, receivers, tally)
                        statistics[CROSSINGS] += passed
                        crossed = crossed or passed > 0
                        state[beam.PX], state[beam.PY], state[beam.PZ] = qx, qy, qz
                        z_ray, hit = depth, far - depth
            if not open_event and place < 0:
                passed = cross_planes(state, math.inf, receivers, tally)
                statistics[CROSSINGS] += passed
                end = RECEIVED if crossed or passed > 0 else ESCAPED
                break
            if events >= max_events:
                end = STOPPED
                break
            events += 1

            # Where along the ray it happens: at the facet, in the plane of the openings, or beside the nearest edge.
            forced = amplitude == 1
            which, step = own, hit
            if open_event:
                statistics[OPEN_EVENTS] += 1
                which = int(found[1])
                if forced and which < 0:
                    for m in range(region):
                        f = facet[places[m]]
                        if holes[f + 1] > holes[f]:
                            which = f
                            break
                wave = mode == WAVE
                step = step_to_opening(
                    state, which, amplitude, found, normals, rims, rim_ends, hit,
                    (depth - z_ray) / rate if wave else -math.inf, (far - z_ray) / rate if wave else math.inf,
                )  # fmt: skip
            passed = cross_planes(state, step, receivers, tally)
            statistics[CROSSINGS] += passed
            crossed = crossed or passed > 0
            state[beam.PX] += step * state[beam.DX]
            state[beam.PY] += step * state[beam.DY]
            state[beam.PZ] += step * state[beam.DZ]
            z = z_ray + step * (rate if mode == WAVE else 1.0)

            fate = TRANSMITTED
            nx = ny = nz = 0.0
            if not open_event:
                statistics[SURFACE_EVENTS if depth == math.inf else MATTER_EVENTS] += 1
                nx, ny, nz = normals[own, 0], normals[own, 1], normals[own, 2]
                cosine = min(1.0, abs(state[beam.DX] * nx + state[beam.DY] * ny + state[beam.DZ] * nz))
                u, _, _, _ = uniforms(k0, k1, np.uint64(0), path, counter)
                counter += _ONE
                fate = outcome(materials, material[place], cosine, u)
                skip = own
                if fate == ABSORBED:
                    end = ABSORBED_END
                    break
                if fate == SCATTERED:
                    counter = scatter_diffusely(k0, k1, path, counter, state, z, least, nx, ny, nz)
                    continue
            else:
                skip = -1
            bordered = mode != RAY and depth < math.inf and (open_event or found[5] != 0.0)
            if bordered:
                if open_event:
                    uniform = which >= 0 and amplitude != 2
                    whole_border = uniform
                else:
                    whole_border = (found[5] > 0.0 and whole[own]) or forced
                    uniform = whole_border and amplitude != 2
                around, event = Region(depth, far, hole_number), Event(open_event, uniform, forced, which)
                counter, good = diffract(
                    (k0, k1), path, counter, state, z, around, event, light, tree, facets, room, statistics
                )
                if not good:
                    end = FAILED
                    break
            else:
                leave_region(state, z, least, state[beam.MX], state[beam.MY], state[beam.MZ])
            if fate == REFLECTED:
                mirror(state, state[beam.PX], state[beam.PY], state[beam.PZ], nx, ny, nz)
        ends[end] += 1
