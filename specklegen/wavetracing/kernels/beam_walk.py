"""Beams through a scene: from the source to the surfaces, the openings and the receivers.

One call walks the beams ``first`` ... ``first + count - 1``. Beam n draws at the address (key; sample 0, path n, a
running counter), so blocks and threads change nothing. Each beam carries one ray of its Wigner ensemble; the cone about
the mean is the envelope of that ensemble. The ray alone decides whether matter is hit; where it goes through a hole, or
past an edge that the cone holds, the beam is diffracted, once for each, by what is open in that plane. So every beam
ends exactly once, power closes in integers, and what passes an opening is what rays say, at any angle and distance.

Uniform light: u = 1 over all holes that the source sees as one, added to the ray. Gaussian: the beam's own field, added
to its mean. Both are exact for evenly spread centres, if all beams take the same; so each opening, and each plate, has
one rule, which asks the source and no beam.

Matt surfaces are connected with the receivers. At each scattering the beam is also sent to a point at random of each
receiver, as far as nothing stands in its way, no opening and no edge. Crossings of both kinds are weighted by the
balance heuristic, so that a near or large receiver, which is hit by chance, loses nothing. What a mirror or an opening
sends on is counted where it happens to go. The beams themselves, and the ledger, do not change.

Modes: WAVE as above. BALLISTIC: the mean ray alone decides; where it hits a facet with an edge in the cone, a point of
the beam's cross-section decides between matter and opening, where it does not, nothing happens. RAY: plain rays.

Source: S. Steinberg, M. Pharr, *Wave Tracing*, sections on traversal, on Fraunhofer diffraction and on connections;
E. Veach, L. J. Guibas, SIGGRAPH 95, 419 (1995) (balance heuristic).
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel, returning
from specklegen.kernels.rng import normal_pair, uniforms
from specklegen.wavetracing.kernels import beam_state as beam
from specklegen.wavetracing.kernels.beam_events import Event, Light, Room, diffract, scatter_diffusely, send
from specklegen.wavetracing.kernels.beam_sources import KIND, LASER, RADIUS, emit
from specklegen.wavetracing.kernels.beam_state import leave_region, mirror
from specklegen.wavetracing.kernels.cone_bvh import collect_all
from specklegen.wavetracing.kernels.cones import CONE
from specklegen.wavetracing.kernels.masked_beams import FINE, GRID, WORDS
from specklegen.wavetracing.kernels.ray_bvh import NO, nearest
from specklegen.wavetracing.kernels.receivers import balance, crossing
from specklegen.wavetracing.kernels.regions import KEPT, borders, holds, hole_in, pass_edge, pass_hole
from specklegen.wavetracing.kernels.surfaces import ABSORBED, REFLECTED, SCATTERED, TRANSMITTED, outcome

WAVE, BALLISTIC, RAY = 0, 1, 2
# Ends of beams.
RECEIVED, ABSORBED_END, ESCAPED, STOPPED, FAILED, ENDS = 0, 1, 2, 3, 4, 5
# Statistics.
(
    SURFACE_EVENTS, OPEN_EVENTS, MATTER_EVENTS, NULL_EVENTS, UNIFORM, GAUSSIAN, TRIES, EVANESCENT, REGION_TRIANGLES,
    REGIONS, CROSSINGS, LOCAL_CHIRP, STATISTICS,
) = range(13)  # fmt: skip
AUTO, UNIFORM_LIGHT, GAUSSIAN_LIGHT = 0, 1, 2
_FEW = 64  # outer edges that are asked one by one, without a search
_ONE = np.uint64(1)


class Rules(NamedTuple):
    """Settings of the walk: mode of light in regions (``0`` auto, ``1`` uniform, ``2`` gaussian), events of a beam."""

    mode: int
    amplitude: int
    max_events: int


class Tally(NamedTuple):
    """Arrays to which a walk adds.

    Attributes
    ----------
    sums : float64[cells, 4]
        Of weights w at receivers and of their squares, of w / |cos| and of its square.
    ends, statistics, areas : int64[ENDS], int64[STATISTICS], float64[1]
        The ledger; what happened; the areas of regions.
    """

    sums: np.ndarray
    ends: np.ndarray
    statistics: np.ndarray
    areas: np.ndarray


@inlined
def depth_of(state):
    """Depth of the ray's point along the beam's mean."""
    x, y, z = state[beam.PX] - state[beam.CX], state[beam.PY] - state[beam.CY], state[beam.PZ] - state[beam.CZ]
    return x * state[beam.MX] + y * state[beam.MY] + z * state[beam.MZ]


@inlined
def ray_hit(state, skip, other, facet, tree):
    """Distance and place of what the ray of a beam meets first, but for two facets; (inf, -1) for nothing."""
    hit, place, _ = nearest(
        state[beam.PX], state[beam.PY], state[beam.PZ], state[beam.DX], state[beam.DY], state[beam.DZ], 0.0, math.inf,
        (np.int64(skip), np.int64(other)), facet, tree,
    )  # fmt: skip
    return hit, place


@inlined
def bring(room, cell, weight, steep):
    """Note what a beam brings to a cell of a receiver."""
    if room.pending[cell, 0] == 0.0:
        room.touched[0] += 1
        room.touched[room.touched[0]] = cell
    room.pending[cell, 0] += weight
    room.pending[cell, 1] += weight * steep


@inlined
def settle(room, sums):
    """Add what a beam has brought to cells, and its squares."""
    for n in range(1, room.touched[0] + 1):
        cell = room.touched[n]
        for c in range(2):
            value = room.pending[cell, c]
            sums[cell, 2 * c] += value
            sums[cell, 2 * c + 1] += value * value
            room.pending[cell, c] = 0.0
    room.touched[0] = 0


@inlined
def cross_planes(state, reach, density, receivers, room):
    """Count the crossings of receivers on the next ``reach`` of a ray; return how many.

    density : of the ray's direction at the matt surface that it leaves; 0 if it leaves another
    """
    planes = receivers.planes
    found = 0
    for r in range(planes.shape[0]):
        cell, away, steep = crossing(
            state[beam.PX], state[beam.PY], state[beam.PZ], state[beam.DX], state[beam.DY], state[beam.DZ], reach,
            planes, r,
        )  # fmt: skip
        if cell >= 0:
            weight = balance(density, away, steep, planes, r) if density > 0.0 else 1.0
            bring(room, receivers.first_cell[r] + cell, weight, steep)
            found += 1
    return found


@kernel
def cross_section_point(key0, key1, path, counter, state, depth, z_hit):
    """A point of a beam's cross-section at ``depth``, of its own deviation at ``z_hit``; one pair of normals."""
    u, v, _, _ = uniforms(key0, key1, np.uint64(0), path, counter)
    gx, gy = normal_pair(u, v)
    s = math.sqrt(state[beam.WIDTH] ** 2 + (z_hit * state[beam.SLOPE]) ** 2) / 3.0
    gx, gy = gx * s, gy * s / (state[beam.STRETCH] * state[beam.STRETCH])
    return (
        state[beam.CX] + depth * state[beam.MX] + gx * state[beam.XX] + gy * state[beam.YX],
        state[beam.CY] + depth * state[beam.MY] + gx * state[beam.XX + 1] + gy * state[beam.YX + 1],
        state[beam.CZ] + depth * state[beam.MZ] + gx * state[beam.XX + 2] + gy * state[beam.YX + 2],
    )


@kernel
def seen_aside(state, step, qx, qy, qz, skip, normals, facet, tree):
    """Return whether nothing stands between a ray, ``step`` ahead of its point, and a point q beside it.

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
    _, place, _ = nearest(px, py, pz, qx - px, qy - py, qz - pz, 0.0, 1.0, (np.int64(skip), NO), facet, tree)
    return place < 0


@returning
def edges_near(state, near, far, table, openings, tree, candidates, places):
    """Outer edges that a beam may meet between two depths, in ``candidates`` int64[E]: their number, and the places.

    places : int64[room], workspace, which may have grown
    """
    outer = openings.outer
    if outer.shape[0] <= _FEW:
        for n in range(outer.shape[0]):
            candidates[n] = outer[n]
        return outer.shape[0], places
    places, found = collect_all(state[beam.CONE_AT : beam.CONE_AT + CONE], near, far, tree, places)
    count = 0
    for n in range(found):
        for side in range(3):
            e = table.at[places[n], side]
            if e >= 0 and openings.bare[e] and not holds(candidates, count, e):
                candidates[count] = e
                count += 1
    return count, places


@returning
def opening_ahead(state, hit, own, skip, kept, facets, openings, table, tree, room, candidates, places):
    """The hole or edge that a beam comes to before ``hit`` on facet ``own``; see :func:`pass_hole`, :func:`pass_edge`.

    Return its distance, the facet in whose plane it lies, hole, edge, sheets about it and depth; and the workspace.
    """
    step, plane, hole = pass_hole(state, hit, skip, facets, openings)
    rate = state[beam.DX] * state[beam.MX] + state[beam.DY] * state[beam.MY] + state[beam.DZ] * state[beam.MZ]
    if not (rate > 0.0 and openings.outer.shape[0] > 0):
        return step, plane, hole, -1, 0, math.inf, places
    z_ray = depth_of(state)
    number, places = edges_near(
        state, z_ray - state[beam.WIDTH], z_ray + step * rate, table, openings, tree, candidates, places
    )
    step, edge, other, marks, low = pass_edge(
        state, step, facets.sheet[own] if own >= 0 else -1, candidates, number, table, facets, tree, room.memory, kept,
        room.marked
    )  # fmt: skip
    if edge < 0:
        return step, plane, hole, -1, 0, math.inf, places
    return step, other, -1, edge, marks, low, places


@kernel
def connect(draw, state, z, least, normal, left, scene, receivers, room, candidates):
    """Send a beam from a matt surface to a point of each receiver, and note what it brings there.

    draw   : two words of the key, path, counter;  normal : of the surface, on the lit side
    left   : mode, facet that is left, sheets that the beam remembers
    scene  : tree, facets, openings, edge table
    """
    tree, facets, openings, table = scene
    mode, skip, kept = left
    planes, other = receivers.planes, room.other
    places = np.empty(256, np.int64)
    for r in range(planes.shape[0]):
        u, v, _, _ = uniforms(draw[0], draw[1], np.uint64(1 + r), draw[2], draw[3])
        x, y = (u - 0.5) * planes[r, 12] * planes[r, 14], (v - 0.5) * planes[r, 12] * planes[r, 13]
        dx = planes[r, 0] + x * planes[r, 3] + y * planes[r, 6] - state[beam.PX]
        dy = planes[r, 1] + x * planes[r, 4] + y * planes[r, 7] - state[beam.PY]
        dz = planes[r, 2] + x * planes[r, 5] + y * planes[r, 8] - state[beam.PZ]
        away = math.sqrt(dx * dx + dy * dy + dz * dz)
        along = abs(dx * planes[r, 9] + dy * planes[r, 10] + dz * planes[r, 11])
        cosine = dx * normal[0] + dy * normal[1] + dz * normal[2]
        if not (along > 0.0 and cosine > 0.0):
            continue
        other[:] = state
        send(other, z, least, dx / away, dy / away, dz / away)
        step, place = ray_hit(other, skip, -1, facets.facet, tree)
        if mode == WAVE and step >= away:
            own = int(facets.facet[place]) if place >= 0 else -1
            step, _, _, _, _, _, places = opening_ahead(
                other, step, own, skip, kept, facets, openings, table, tree, room, candidates, places
            )
        if step >= away:
            cell = int(v * planes[r, 13]) * int(planes[r, 14]) + int(u * planes[r, 14])
            steep = away / along
            weight = balance(cosine / away / math.pi, away, steep, planes, r)
            bring(room, receivers.first_cell[r] + cell, weight, steep)


@inlined
def leaving_rate(state, normals, f):
    """Cosine of a beam's ray to a facet's normal; 0 without facet."""
    if f < 0:
        return 0.0
    return state[beam.DX] * normals[f, 0] + state[beam.DY] * normals[f, 1] + state[beam.DZ] * normals[f, 2]


@inlined
def remember(memory, kept, sheet):
    """Add a sheet to those that were passed, in place of the oldest where there is no room; their number."""
    if kept < KEPT:
        memory[kept] = sheet
        return kept + 1
    for n in range(KEPT - 1):
        memory[n] = memory[n + 1]
    memory[KEPT - 1] = sheet
    return KEPT


@kernel
def walk_beams(
    key, share, rules, source, wavelength, tree, facets, openings, table, materials, receivers, tally
):  # fmt: skip
    """Walk beams; fill what receivers and the ledger count.

    key : two words;  share : (first beam, number of beams);  rules, tally : Rules, Tally;  source : float64[SOURCE]
    tree, facets, openings, table, receivers : Tree, Facets, Openings, EdgeTable, Receivers of
    `specklegen.wavetracing.kernels`
    materials : float64[M, 4], see `specklegen.wavetracing.kernels.surfaces`
    """
    most_edges = max(1, facets.loop_ends.shape[0])  # of all holes, or of one facet
    for f in range(facets.rims.shape[0] - 1):
        most_edges = max(most_edges, facets.rims[f + 1] - facets.rims[f])
    marked, memory = np.empty(KEPT, np.int64), np.empty(KEPT, np.int64)
    fine, mask = np.empty((FINE, WORDS), np.uint64), np.empty((GRID, GRID))
    cells = tally.sums.shape[0]
    room = Room(
        np.empty(beam.STATE), np.empty(CONE), marked, memory, np.empty((most_edges, 4)), fine, mask,
        np.empty(beam.STATE), np.zeros((cells, 2)), np.zeros(cells + 1, np.int64),
    )  # fmt: skip
    run = np.uint64(key[0]), np.uint64(key[1]), share[0], share[1]
    _walk(run, rules, source, wavelength, tree, facets, openings, table, materials, receivers, tally, room)


@kernel
def _walk(run, rules, source, wavelength, tree, facets, openings, table, materials, receivers, tally, room):
    """Walk beams in a workspace, which is borrowed.

    run : two words of the key, first beam, number of beams;  room : Room;  the others as of :func:`walk_beams`
    """
    k0, k1, first, count = run
    mode, amplitude, max_events = rules.mode, rules.amplitude, rules.max_events
    facet, normals, sheet = facets.facet, facets.normals, facets.sheet
    ends, statistics, areas = tally.ends, tally.statistics, tally.areas
    k = 2.0 * math.pi / wavelength
    least = 81.0 / (4.0 * k * k)
    candidates, places = np.empty(max(1, table.edges.shape[0]), np.int64), np.empty(256, np.int64)
    state, marked, memory = room.state, room.marked, room.memory
    light = Light(k, least)

    for n in range(count):
        path = np.uint64(first + n)
        counter = emit(k0, k1, path, source, mode, k, state)
        events, skip, kept, end, crossed, density = 0, -1, 0, -1, False, 0.0
        while end < 0:
            hit, place = ray_hit(state, skip, -1, facet, tree)
            # Depths along the axis of the ray's start, and what a step of the ray adds.
            z_ray = depth_of(state)
            rate = state[beam.DX] * state[beam.MX] + state[beam.DY] * state[beam.MY] + state[beam.DZ] * state[beam.MZ]
            own = int(facet[place]) if place >= 0 else -1
            # An opening: how far, the facet in whose plane, the hole, sheets about it, depths about it.
            step, plane, hole, edge, marks, low, high = hit, -1, -1, -1, 0, math.inf, -math.inf
            if mode == WAVE:
                step, plane, hole, edge, marks, low, places = opening_ahead(
                    state, hit, own, skip, kept, facets, openings, table, tree, room, candidates, places
                )
                if edge >= 0:
                    high = low + 2.0 * (state[beam.WIDTH] + abs(low) * state[beam.SLOPE])
            elif mode == BALLISTIC and place >= 0 and borders(state, hit, own, facets):
                # A ray along the mean through a point of the cross-section: does it pass? A point beyond a wall beside
                # the ray is no opening, though nothing stands behind it.
                a = state[beam.WIDTH] + (z_ray + hit) * state[beam.SLOPE]
                depth, far = max(z_ray + hit - a, z_ray), z_ray + hit + a
                qx, qy, qz = cross_section_point(k0, k1, path, counter, state, depth, z_ray + hit)
                counter += _ONE
                _, other, _ = nearest(
                    qx, qy, qz, state[beam.MX], state[beam.MY], state[beam.MZ], 0.0, far - depth, (NO, NO), facet, tree,
                )  # fmt: skip
                if other < 0 and seen_aside(state, depth - z_ray, qx, qy, qz, skip, normals, facet, tree):
                    passed = cross_planes(state, depth - z_ray, 0.0, receivers, room)
                    statistics[CROSSINGS] += passed
                    crossed = crossed or passed > 0
                    state[beam.PX], state[beam.PY], state[beam.PZ] = qx, qy, qz
                    z_ray, plane = depth, own
                    step, hole = hole_in(state, own, facets, openings)
                    edge, low, high = 0, depth, far
            open_event = hole >= 0 or edge >= 0
            if not open_event and place < 0:
                passed = cross_planes(state, math.inf, density, receivers, room)
                statistics[CROSSINGS] += passed
                end = RECEIVED if crossed or passed > 0 else ESCAPED
                break
            passed = cross_planes(state, step, density, receivers, room)
            statistics[CROSSINGS] += passed
            crossed = crossed or passed > 0
            if events >= max_events:
                end = STOPPED
                break
            events, density = events + 1, 0.0
            state[beam.PX] += step * state[beam.DX]
            state[beam.PY] += step * state[beam.DY]
            state[beam.PZ] += step * state[beam.DZ]
            z = z_ray + step * (rate if mode == WAVE else 1.0)

            fate, bordered, uniform, opening = TRANSMITTED, open_event, False, -1
            nx = ny = nz = 0.0
            if open_event:
                statistics[OPEN_EVENTS] += 1
                if hole >= 0:
                    opening = int(openings.of[hole])
                    uniform = amplitude == UNIFORM_LIGHT or (amplitude == AUTO and openings.even[opening])
                    marks = 1
                    marked[0] = sheet[plane]
                elif mode == BALLISTIC:
                    marks = 1
                    marked[0] = sheet[own]
                for m in range(marks):
                    if not holds(memory, kept, marked[m]):
                        kept = remember(memory, kept, marked[m])
            else:
                nx, ny, nz = normals[own, 0], normals[own, 1], normals[own, 2]
                cosine = min(1.0, abs(state[beam.DX] * nx + state[beam.DY] * ny + state[beam.DZ] * nz))
                u, _, _, _ = uniforms(k0, k1, np.uint64(0), path, counter)
                counter += _ONE
                fate = outcome(materials, facets.material[place], cosine, u)
                bordered = mode != RAY and fate != ABSORBED and fate != SCATTERED and borders(state, 0.0, own, facets)
                statistics[MATTER_EVENTS if bordered else SURFACE_EVENTS] += 1
                skip, plane = own, own
                kept = remember(memory, kept if fate == TRANSMITTED else 0, sheet[own])
                if fate == ABSORBED:
                    end = ABSORBED_END
                    break
                if fate == SCATTERED:
                    if leaving_rate(state, normals, own) > 0.0:
                        nx, ny, nz = -nx, -ny, -nz
                    if mode != BALLISTIC:
                        connect(
                            (k0, k1, path, counter), state, z, least, (nx, ny, nz), (mode, own, kept),
                            (tree, facets, openings, table), receivers, room, candidates
                        )  # fmt: skip
                    counter = scatter_diffusely(k0, k1, path, counter, state, z, least, nx, ny, nz)
                    if mode != BALLISTIC:
                        density = abs(leaving_rate(state, normals, own)) / math.pi
                    continue
                if bordered:
                    marks = 1
                    marked[0] = sheet[own]
                    low, high = math.inf, -math.inf
                    uniform = facets.whole[own] and amplitude != GAUSSIAN_LIGHT and (
                        amplitude == UNIFORM_LIGHT
                        or (int(source[KIND]) != LASER and source[RADIUS] >= facets.breadth[own])
                    )  # fmt: skip
            if bordered:
                statistics[REGIONS] += 1
                areas[0] += math.pi * (state[beam.WIDTH] + abs(z) * state[beam.SLOPE]) ** 2 / state[beam.STRETCH]
                leaving = leaving_rate(state, normals, skip)
                event = Event(open_event, plane, uniform, opening, low, high, own, marks)
                counter, good = diffract(
                    (k0, k1), path, counter, state, z, event, light, tree, facets, openings, room, statistics
                )
                if not good:
                    end = FAILED
                    break
                if plane >= 0:
                    skip = plane
                elif skip >= 0 and leaving * leaving_rate(state, normals, skip) <= 0.0:
                    skip = -1  # it was turned back to the surface that it came from
            else:
                leave_region(state, z, least, state[beam.MX], state[beam.MY], state[beam.MZ])
            if fate == REFLECTED:
                mirror(state, state[beam.PX], state[beam.PY], state[beam.PZ], nx, ny, nz)
        settle(room, tally.sums)
        ends[end] += 1
