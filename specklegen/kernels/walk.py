"""Random walks through a plane slab, and the thinned connections of their vertices to the sensor.

One call traces the paths ``first`` ... ``first + count - 1``. Every random number is addressed by
(key, sample, path, dimension), so the call may be split over blocks and threads at will.

A path (physics.md 2): the first vertex lies exponentially deep along the reference direction behind a point of the
illuminated face, the first direction comes from the medium's phase function about the reference direction, then free
flights and scatterings as in radiative transfer, many paths in lock step (`specklegen.kernels.lanes`), or drawn towards
the far face where few would reach it (`specklegen.kernels.stretching`). At every vertex the contribution w of the
connection to the sensor is found, and the connection is kept with probability min(1, w / threshold); its amplitude
weight grows by the inverse probability.

A record is one kept connection, a row of float64[RECORD]:
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.arithmetic import minus_log1m
from specklegen.kernels.lanes import (
    ADDRESS,
    AMOUNT,
    AZIMUTH,
    CANDIDATE,
    COIN,
    DENSITY,
    FLIGHT,
    FLOWN,
    KEEP,
    LANES,
    ORDER,
    OX,
    OY,
    OZ,
    PATH,
    POLAR,
    POWER,
    SHAPE,
    STATE,
    WX,
    WY,
    WZ,
    X1,
    Y1,
    Z1,
    X,
    Y,
    Z,
    adopt,
    draw,
    draw_coin,
    drop_ended,
    fly,
    mark_candidates,
    scatter,
    scatter_by_table,
    sort_by_path,
)
from specklegen.kernels.lobes import judged_phase_function, phase_function
from specklegen.kernels.phase_functions import henyey_greenstein, sample_henyey_greenstein
from specklegen.kernels.rng import uniforms
from specklegen.kernels.stretching import fly_stretched, steer
from specklegen.kernels.trigonometry import sincos_turns

ENTRY = 0  # x1, first vertex
ENTRY_DIRECTION = 3  # omega_1, unit vector leaving x1 (zero for single scattering)
EXIT = 6  # x_B, last vertex
EXIT_DIRECTION = 9  # omega_(B-1), unit vector arriving at x_B (zero for single scattering)
WEIGHT = 12  # W over the probability of keeping
LENGTH = 13  # sum of the free flights from x1 to x_B
RECORD = 14

# UNLIMITED is a plane wave on an infinite slab: all entry points are alike, so the walk starts at the
# origin and every quantity is per unit area.
SQUARE, DISC, GAUSSIAN, UNLIMITED = 0, 1, 2, 3

_ONE = np.uint64(1)
_ASIDE = np.uint64(0x80000000)  # dimensions of what not every walk draws lie apart


@inlined
def sample_footprint(footprint, extent, u, v):
    """Draw a point of the illuminated face and return it with the inverse of its density (an area).

    ``extent``: half side of the square, radius of the disc, or standard deviation of the Gaussian density.
    """
    if footprint == SQUARE:
        return extent * (2.0 * u - 1.0), extent * (2.0 * v - 1.0), 4.0 * extent * extent
    if footprint == UNLIMITED:
        return 0.0, 0.0, 1.0
    sine, cosine = sincos_turns(v)
    if footprint == DISC:
        radius = extent * math.sqrt(u)
        return radius * cosine, radius * sine, math.pi * extent * extent
    r2 = -2.0 * math.log(u)
    radius = extent * math.sqrt(r2)
    return radius * cosine, radius * sine, 2.0 * math.pi * extent * extent * math.exp(0.5 * r2)


@inlined
def footprint_density(footprint, extent, x, y):
    """Density per area with which :func:`sample_footprint` draws the point (x, y)."""
    if footprint == SQUARE:
        return 1.0 / (4.0 * extent * extent) if abs(x) <= extent and abs(y) <= extent else 0.0
    if footprint == UNLIMITED:
        return 1.0
    r2 = x * x + y * y
    if footprint == DISC:
        return 1.0 / (math.pi * extent * extent) if r2 <= extent * extent else 0.0
    s2 = extent * extent
    return math.exp(-0.5 * r2 / s2) / (2.0 * math.pi * s2)


@inlined
def profile(footprint, radius, x, y):
    """Amplitude profile b at a point of the entrance face, 1 at its peak.

    ``radius``: half side, radius, or the 1/e^2 intensity radius.
    """
    if footprint == SQUARE:
        return 1.0 if abs(x) <= radius and abs(y) <= radius else 0.0
    if footprint == UNLIMITED:
        return 1.0
    r2 = x * x + y * y
    if footprint == DISC:
        return 1.0 if r2 <= radius * radius else 0.0
    return math.exp(-r2 / (radius * radius))


@inlined
def write_record(row, x1, y1, z1, ox, oy, oz, x, y, z, wx, wy, wz, weight, length):
    """Fill one record: entrance and direction leaving it, direction arriving and exit, weight, path length."""
    row[ENTRY], row[ENTRY + 1], row[ENTRY + 2] = x1, y1, z1
    row[ENTRY_DIRECTION], row[ENTRY_DIRECTION + 1], row[ENTRY_DIRECTION + 2] = ox, oy, oz
    row[EXIT], row[EXIT + 1], row[EXIT + 2] = x, y, z
    row[EXIT_DIRECTION], row[EXIT_DIRECTION + 1], row[EXIT_DIRECTION + 2] = wx, wy, wz
    row[WEIGHT] = weight
    row[LENGTH] = length


@inlined
def forward_contribution(power, g, rows, places, z, wx, wy, wz, probes):
    """Largest contribution over the views of a vertex that light of ``power`` reaches."""
    best = 0.0
    for n in range(probes.shape[0]):
        t = probes[n, 3] + probes[n, 4] * z
        if t < 700.0:
            cos = wx * probes[n, 0] + wy * probes[n, 1] + wz * probes[n, 2]
            best = max(best, power * judged_phase_function(g, rows, places, cos) * math.exp(-t))
    return best


@inlined
def start(
    key0, key1, sample, first, count, thickness, sigma_t, albedo, rate, ix, iy, iz,
    footprint, extent, radius, state, address,
):  # fmt: skip
    """Put the first vertices of paths ``first`` ... into the lanes, light arriving along the reference direction."""
    spared = 1.0 - rate * iz
    chance = -math.expm1(-sigma_t * spared * thickness / iz)  # to collide at all
    for i in range(count):
        address[PATH + i], address[ORDER + i] = np.uint64(first + i), np.uint64(0)
    draw(key0, key1, sample, np.uint64(0), address, state, count)
    for i in range(count):
        # Two words a coordinate: 32 bits alone would put wide beams on a lattice.
        u = state[KEEP + i] + (state[POLAR + i] - 0.5) * 2.0**-32
        v = state[AZIMUTH + i] + (state[FLIGHT + i] - 0.5) * 2.0**-32
        fx, fy, area = sample_footprint(footprint, extent, u, v)
        # Points that only other tilts light are judged as if this one did, else they would never be kept.
        beam = profile(footprint, radius, fx, fy) if footprint == GAUSSIAN else 1.0
        state[X1 + i], state[Y1 + i] = fx, fy
        state[AMOUNT + i], state[POWER + i] = albedo * area * iz * chance / spared, beam * beam / iz
    draw(key0, key1, sample, _ONE, address, state, count)
    for i in range(count):
        collided = state[KEEP + i] * chance
        depth = minus_log1m(collided) / (sigma_t * spared)
        state[X1 + i] += depth * ix
        state[Y1 + i] += depth * iy
        state[Z1 + i] = min(depth * iz, thickness)
        # sigma_s / p1, where p1 = (1/area) sigma_t e^(-sigma_t depth) / chance / iz per volume; sigma_t is spared both.
        state[AMOUNT + i] /= 1.0 - collided
        state[POWER + i] *= 1.0 - collided
        state[X + i], state[Y + i], state[Z + i] = state[X1 + i], state[Y1 + i], state[Z1 + i]
        state[WX + i], state[WY + i], state[WZ + i] = ix, iy, iz
        state[KEEP + i] = state[FLIGHT + i]
        state[FLOWN + i] = state[COIN + i] = 0.0
        address[ORDER + i] = _ONE
    if rate > 0.0:
        for i in range(count):
            state[POWER + i] *= math.exp(-rate * sigma_t * state[Z + i])


@inlined
def leave(
    key0, key1, sample, g, rows, places, aim_rows, guide, mean_free_path, rate, most, aimed, importance,
    state, address, count,
):  # fmt: skip
    """Send the paths of :func:`start` off, their first directions drawn from the lobe that they aim with."""
    if rate > 0.0:
        for i in range(count):
            state[OX + i], state[OY + i], state[OZ + i] = state[WX + i], state[WY + i], state[WZ + i]
        steer(key0, key1, sample, _ASIDE, g, aim_rows, guide, rate, most, importance, state, address, count)
        for i in range(count):
            cos = state[OX + i] * state[WX + i] + state[OY + i] * state[WY + i] + state[OZ + i] * state[WZ + i]
            state[POLAR + i] = state[SHAPE + i] * (0.5 / math.pi) / aimed
            state[POWER + i] *= judged_phase_function(g, rows, places, cos)
    elif aim_rows.shape[0] == 0:
        scatter(g, state, count)
        for i in range(count):
            state[POLAR + i] = henyey_greenstein(g, 1.0 - sample_henyey_greenstein(g, state[POLAR + i]))
            state[POWER + i] *= state[POLAR + i]
    else:
        for i in range(count):
            state[OX + i], state[OY + i], state[OZ + i] = state[WX + i], state[WY + i], state[WZ + i]
        scatter_by_table(aim_rows, guide, state, count)
        for i in range(count):
            cos = state[OX + i] * state[WX + i] + state[OY + i] * state[WY + i] + state[OZ + i] * state[WZ + i]
            state[POLAR + i] = state[SHAPE + i] * (0.5 / math.pi)
            state[POWER + i] *= judged_phase_function(g, rows, places, cos)
    for i in range(count):
        density = state[POLAR + i]
        state[OX + i], state[OY + i], state[OZ + i] = state[WX + i], state[WY + i], state[WZ + i]
        state[DENSITY + i] = density / state[AMOUNT + i]  # p1 p_omega / sigma_s
        state[AMOUNT + i] /= density
    draw(key0, key1, sample, _ONE, address, state, count)
    if rate > 0.0:
        fly_stretched(mean_free_path, rate, state, count)
    else:
        fly(mean_free_path, state, count)


@inlined
def survivor_weight(weight, w, threshold, u):
    """``weight`` over the probability min(1, w / threshold) that a connection of contribution w survives; else 0."""
    if w <= 0.0 or (w < threshold and u * threshold >= w):
        return 0.0
    return weight if w >= threshold else weight * threshold / w


@inlined
def weigh_both_ways(
    state, i, sigma_t, albedo, chance, g, rows, places, aim_rows, aim_places, ix, iy, iz,
    footprint, extent, radius, probes,
):  # fmt: skip
    """W of the path in lane i drawn either way (balance heuristic), and its largest contribution of both directions."""
    x, y, z, wx, wy, wz = state[X + i], state[Y + i], state[Z + i], state[WX + i], state[WY + i], state[WZ + i]
    depth = z / iz
    fx, fy = x - depth * ix, y - depth * iy
    back = -(wx * ix + wy * iy + wz * iz)
    passed = math.exp(-sigma_t * depth) / iz
    # p1 p_omega / sigma_s of the path walked backwards: the balance heuristic adds both densities.
    density = footprint_density(footprint, extent, fx, fy) * passed / (albedo * chance)
    weight = 1.0 / (state[DENSITY + i] + density * phase_function(g, aim_rows, aim_places, back))
    beam = profile(footprint, radius, fx, fy)
    power = weight * beam * beam * passed * judged_phase_function(g, rows, places, back)
    ox, oy, oz, z1 = state[OX + i], state[OY + i], state[OZ + i], state[Z1 + i]
    forward = forward_contribution(weight * state[POWER + i], g, rows, places, z, wx, wy, wz, probes)
    reversed_ = forward_contribution(power, g, rows, places, z1, -ox, -oy, -oz, probes)
    return weight, max(forward, reversed_)


@kernel
def trace_slab(
    key0, key1, sample, first, count, thickness, sigma_t, albedo, lobe, aim, stretch, ix, iy, iz,
    footprint, extent, radius, probes, reverse, threshold, max_order, records, orders, paths, ranks,
):  # fmt: skip
    """Trace paths and write the kept connections.

    thickness, sigma_t, albedo : the slab (length, 1/length, -)
    lobe, aim : Lobe           its phase function, and the lobe of first directions about (ix, iy, iz), iz > 0; either
                               both are closed, of one g, or both are tables
    stretch : Stretch          how paths are drawn towards the far face; of a rate above 0 not with ``reverse``
    footprint, extent, radius : kind of beam, size of the sampled footprint and of the profile
    probes : float64[n, 5]     views at which the contribution is judged, and the optical depth to the outside
                               along each as (at z = 0, per length of z)
    reverse : 1 to weigh each path together with its reversal (balance heuristic), else 0
    threshold : contribution from which a connection is always kept; 0 keeps all
    max_order : vertices after which a path is ended
    records, orders, paths : float64[cap, RECORD], int32[cap], int64[cap]   output, as the walk finds them
    ranks : int64[cap]         output: where the first, second, ... connection in path order was written

    Returns (connections found, scattering events, paths ended by max_order, sum of their W); connections
    beyond the capacity are counted but not written: call again with more room.
    """
    g, rows, guide, places = lobe.g, lobe.rows, lobe.guide, lobe.places
    aim_rows, aim_guide, aim_places = aim.rows, aim.guide, aim.places
    rate, survival, most, aimed, importance = stretch.rate, stretch.survival, stretch.most, stretch.aimed, stretch.rows
    capacity = records.shape[0]
    found = events = unfinished = 0
    unfinished_weight = 0.0
    chance = -math.expm1(-sigma_t * thickness / iz)
    mean_free_path = 1.0 / sigma_t
    k0, k1, sample64 = np.uint64(key0), np.uint64(key1), np.uint64(sample)
    last_order = np.uint64(max_order)
    state, address = np.empty(STATE), np.empty(ADDRESS, np.uint64)
    fresh, fresh_address = np.empty(STATE), np.empty(ADDRESS, np.uint64)
    flying = waiting = started = 0
    while True:
        flying, cut, cut_weight = drop_ended(state, address, flying, thickness, survival, last_order)
        unfinished += cut
        unfinished_weight += cut_weight
        while flying < LANES and (waiting > 0 or started < count):
            if waiting > 0:
                waiting -= 1
                adopt(state, address, flying, fresh, fresh_address, waiting)
                flying += 1
                continue
            waiting = min(LANES, count - started)
            start(
                k0, k1, sample64, first + started, waiting, thickness, sigma_t, albedo, rate, ix, iy, iz,
                footprint, extent, radius, fresh, fresh_address,
            )  # fmt: skip
            started += waiting
            events += waiting
            mark_candidates(g, rows, places, threshold, probes, fresh, waiting)
            for i in range(waiting):
                if fresh[CANDIDATE + i] == 0.0:
                    continue
                # Single scattering is its own reverse and is never doubled.
                x, y, z, weight = fresh[X + i], fresh[Y + i], fresh[Z + i], fresh[AMOUNT + i]
                w = forward_contribution(weight * fresh[POWER + i], g, rows, places, z, ix, iy, iz, probes)
                kept = survivor_weight(weight, w, threshold, fresh[KEEP + i])
                if kept > 0.0:
                    if found < capacity:
                        write_record(records[found], x, y, z, 0.0, 0.0, 0.0, x, y, z, 0.0, 0.0, 0.0, kept, 0.0)
                        orders[found], paths[found] = 1, fresh_address[PATH + i]
                    found += 1
            leave(
                k0, k1, sample64, g, rows, places, aim_rows, aim_guide, mean_free_path, rate, most, aimed, importance,
                fresh, fresh_address, waiting,
            )  # fmt: skip
            waiting, cut, cut_weight = drop_ended(fresh, fresh_address, waiting, thickness, survival, last_order)
            unfinished += cut
            unfinished_weight += cut_weight
        if flying == 0:
            break

        for i in range(flying):
            address[ORDER + i] += _ONE
        events += flying
        draw(k0, k1, sample64, _ONE, address, state, flying)
        if survival < 1.0:
            # Absorption as a coin: the weight stays, the work goes.
            draw_coin(k0, k1, sample64, _ASIDE, address, state, flying)
        mark_candidates(g, rows, places, 0.0 if reverse else threshold, probes, state, flying)
        for i in range(flying):
            if state[CANDIDATE + i] == 0.0 or state[COIN + i] >= survival:
                continue
            x, y, z = state[X + i], state[Y + i], state[Z + i]
            wx, wy, wz = state[WX + i], state[WY + i], state[WZ + i]
            if reverse:
                weight, w = weigh_both_ways(
                    state, i, sigma_t, albedo, chance, g, rows, places, aim_rows, aim_places,
                    ix, iy, iz, footprint, extent, radius, probes,
                )  # fmt: skip
            else:
                weight = state[AMOUNT + i]
                w = forward_contribution(weight * state[POWER + i], g, rows, places, z, wx, wy, wz, probes)
            kept = survivor_weight(weight, w, threshold, state[KEEP + i])
            if kept > 0.0:
                if found < capacity:
                    write_record(
                        records[found], state[X1 + i], state[Y1 + i], state[Z1 + i],
                        state[OX + i], state[OY + i], state[OZ + i], x, y, z, wx, wy, wz, kept, state[FLOWN + i],
                    )  # fmt: skip
                    orders[found], paths[found] = address[ORDER + i], address[PATH + i]
                found += 1
        if rate > 0.0:
            steer(k0, k1, sample64, _ASIDE, g, rows, guide, rate, most, importance, state, address, flying)
            fly_stretched(mean_free_path, rate, state, flying)
            continue
        if rows.shape[0] == 0:
            scatter(g, state, flying)
        else:
            scatter_by_table(rows, guide, state, flying)
        fly(mean_free_path, state, flying)
    sort_by_path(paths, first, count, min(found, capacity), ranks)
    return found, events, unfinished, unfinished_weight


@kernel
def draw_types(key0, key1, sample, orders, paths, cumulative, out):
    """Fill ``out`` int32[M, 2] with the types of the first and of the last particle of every connection.

    cumulative : float64[n]    running sum of the shares, the last 1
    """
    for m in range(out.shape[0]):
        address = np.uint64(key0), np.uint64(key1), np.uint64(sample), np.uint64(paths[m])
        first = uniforms(*address, np.uint64(0))[0]
        last = first if orders[m] == 1 else uniforms(*address, np.uint64(orders[m]))[0]
        for side, u in enumerate((first, last)):
            t = 0
            while t < cumulative.shape[0] - 1 and cumulative[t] <= u:
                t += 1
            out[m, side] = t
