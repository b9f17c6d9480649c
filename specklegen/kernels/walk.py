"""Random walks through a plane slab, and the thinned connections of their vertices to the sensor.

One call traces the paths ``first`` ... ``first + count - 1``. Every random number is addressed by
(key, sample, path, dimension), so the call may be split over blocks and threads at will.

A path (physics.md 2): the first vertex lies exponentially deep along the reference direction behind a point of the
illuminated face, the first direction comes from the medium's phase function about the reference direction; then come
free flights and scatterings as in radiative transfer, many paths in lock step (`specklegen.kernels.lanes`), or drawn
towards the far face where few would reach it (`specklegen.kernels.stretching`). At every vertex the contribution w of
the connection to the sensor is found, and the connection is kept with probability min(1, w / threshold); its amplitude
weight grows by the inverse probability.

A record is one kept connection, a row of float64[RECORD], one number longer where the momentum transfer is asked for:
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.jones import scatter_polarised, unpolarised, write_matrix
from specklegen.kernels.lanes import (
    ADDRESS,
    AMOUNT,
    ASIDE,
    CANDIDATE,
    COIN,
    DOPPLER,
    FLOWN,
    FLYING,
    KEEP,
    LANES,
    ORDER,
    OX,
    OY,
    OZ,
    PATH,
    POWER,
    STATE,
    TURNED,
    WAITING,
    WX,
    WY,
    WZ,
    X1,
    Y1,
    Z1,
    X,
    Y,
    Z,
    add_doppler,
    add_turns,
    adopt,
    draw,
    draw_coin,
    drop_ended,
    fly,
    hand_on,
    mark_candidates,
    scatter,
    scatter_by_fisher,
    scatter_by_table,
    sort_by_path,
)
from specklegen.kernels.reflections import (
    Mirror,
    mirror_of,
    reflect,
    reflect_first,
    reflect_polarised,
    turn_over,
    unfolded,
)
from specklegen.kernels.rng import uniforms
from specklegen.kernels.slab_steps import (
    Address,
    Layer,
    Leg,
    contribution,
    leave,
    start,
    survivor_weight,
    weigh_both_ways,
)
from specklegen.kernels.stretching import Pull, fly_stretched, steer

ENTRY = 0  # x1, first vertex
ENTRY_DIRECTION = 3  # omega_1, unit vector leaving x1 (zero for single scattering)
EXIT = 6  # x_B, last vertex
EXIT_DIRECTION = 9  # omega_(B-1), unit vector arriving at x_B (zero for single scattering)
WEIGHT = 12  # W over the probability of keeping
LENGTH = 13  # sum of the free flights from x1 to x_B
RECORD = 14
TRANSFER = 14  # sum of 1 - cos theta over x2 ... x_(B-1), each times the mobility there: a column only where asked for
FLOW = 15  # sum of (omega_(b-1) - omega_b) . V(x_b) over the same: one more, only where particles flow

_ONE = np.uint64(1)


class Rules(NamedTuple):
    """Which connections are kept, and how long paths are.

    Attributes
    ----------
    reverse : int
        1 to weigh each path together with its reversal (balance heuristic), else 0.
    threshold : float
        Contribution from which a connection is always kept; 0 keeps all.
    max_order : int
        Vertices after which a path is ended.
    """

    reverse: int
    threshold: float
    max_order: int


class Found(NamedTuple):
    """Output of a walk, in the order in which it is computed.

    Attributes
    ----------
    records, orders, paths : float64[cap, RECORD, TRANSFER + 1 or FLOW + 1], int32[cap], int64[cap]
    bounces : int8[cap, 2]
        Reflections of the first and of the last leg; left as it is without faces.
    ranks : int64[cap]
        Where the first, second, ... connection in path order was written.
    """

    records: np.ndarray
    orders: np.ndarray
    paths: np.ndarray
    bounces: np.ndarray
    ranks: np.ndarray


@inlined
def write_record(row, entry, last, weight, length, turned, doppler):
    """Fill one record: entrance and direction leaving it, exit and direction arriving there, weight, path length.

    And the sums of 1 - cos theta and of the Doppler shifts between, where the row has room for them.
    """
    row[ENTRY], row[ENTRY + 1], row[ENTRY + 2] = entry.x, entry.y, entry.z
    row[ENTRY_DIRECTION], row[ENTRY_DIRECTION + 1], row[ENTRY_DIRECTION + 2] = entry.wx, entry.wy, entry.wz
    row[EXIT], row[EXIT + 1], row[EXIT + 2] = last.x, last.y, last.z
    row[EXIT_DIRECTION], row[EXIT_DIRECTION + 1], row[EXIT_DIRECTION + 2] = last.wx, last.wy, last.wz
    row[WEIGHT] = weight
    row[LENGTH] = length
    if row.shape[0] > TRANSFER:
        row[TRANSFER] = turned
    if row.shape[0] > FLOW:
        row[FLOW] = doppler


@kernel
def trace_slab(where, share, slab, lobe, aim, stretch, faces, light, probes, rules, found, jones):
    """Trace paths and write the kept connections.

    where, slab, light, rules, found : Address, FlowingLayer, Light (z > 0), Rules, Found
    share : (first path, number of paths)
    ``lobe, aim : Lobe``       the phase function, and that of first directions about the light; either both are
                               closed, of one g, or both are tables
    stretch : Stretch          how paths are drawn towards the far face; of a rate above 0 not with ``reverse``, and not
                               between faces
    faces : Faces or None      what reflects; None leaves all that belongs to it out of the compiled walk
    probes : float64[n, 5]     views at which the contribution is judged, and the optical depth to the outside
                               along each as (at z = 0, per length of z); with faces the views as they look at a vertex
                               after no reflection, then after one, ..., and depths hold -ln of what faces leave
    jones : Jones or None      of polarised light, not stretched, its matrices between frames of directions as paths are
                               walked, not as they are unfolded; None leaves it out likewise

    Returns (connections found, scattering events, paths ended by max_order, sum of their W); connections
    beyond the capacity are counted but not written: call again with more room.
    """
    first, count = share
    thickness, sigma_t, flow = slab.thickness, slab.sigma_t, slab.flow
    layer = Layer(thickness, sigma_t, slab.albedo)
    g, rows, guide, places = lobe.g, lobe.rows, lobe.guide, lobe.places
    aim_rows, aim_guide, aim_places = aim.rows, aim.guide, aim.places
    survival, importance = stretch.survival, stretch.rows
    pull = Pull(stretch.rate, stretch.most, stretch.aimed)
    reverse, threshold = rules.reverse, rules.threshold
    records, orders, paths, bounces = found.records, found.orders, found.paths, found.bounces
    capacity, transfers, flows = records.shape[0], records.shape[1] > TRANSFER, records.shape[1] > FLOW
    kept_count = events = unfinished = 0
    unfinished_weight = 0.0
    chance = -math.expm1(-sigma_t * thickness / light.z)
    mean_free_path = 1.0 / sigma_t
    where = Address(np.uint64(where.key0), np.uint64(where.key1), np.uint64(where.sample))
    last_order = np.uint64(rules.max_order)
    state, address = np.empty(STATE), np.empty(ADDRESS, np.uint64)
    fresh, fresh_address = np.empty(STATE), np.empty(ADDRESS, np.uint64)
    images, up = 0, False
    mirror = Mirror(0, probes.shape[0], 0.0, 1.0, chance)
    if faces is not None:
        images, up = faces.images, faces.up == 1
        mirror = mirror_of(faces, layer, light, probes.shape[0])
    views = mirror.views
    flying = waiting = started = 0
    while True:
        flying, cut, cut_weight = drop_ended(
            state, address, flying, thickness, survival, last_order, jones, FLYING
        )  # fmt: skip
        unfinished += cut
        unfinished_weight += cut_weight
        while flying < LANES and (waiting > 0 or started < count):
            if waiting > 0:
                waiting -= 1
                adopt(state, address, flying, fresh, fresh_address, waiting)
                if jones is not None:
                    hand_on(jones.carried, FLYING, flying, WAITING, waiting)
                flying += 1
                continue
            waiting = min(LANES, count - started)
            start(where, first + started, waiting, layer, pull.rate, light, fresh, fresh_address)
            if jones is not None:
                unpolarised(jones.carried, waiting)
            if faces is not None:
                reflect_first(where, layer, light, mirror, fresh, fresh_address, waiting)
            started += waiting
            events += waiting
            mark_candidates(g, rows, places, threshold, probes, fresh, waiting)
            for i in range(waiting):
                if fresh[CANDIDATE + i] == 0.0:
                    continue
                # Single scattering is its own reverse and is never doubled.
                x, y, z, weight = fresh[X + i], fresh[Y + i], fresh[Z + i], fresh[AMOUNT + i]
                leg = Leg(x, y, z, light.x, light.y, fresh[WZ + i])
                for m in range(images + 1):
                    power = weight * fresh[POWER + i]
                    w = contribution(power, g, rows, places, leg, probes, m * views, (m + 1) * views)
                    kept = survivor_weight(weight, w, threshold, fresh[KEEP + i])
                    if kept > 0.0:
                        if kept_count < capacity:
                            entry = Leg(x, y, fresh[Z1 + i], 0.0, 0.0, 0.0)
                            last = Leg(x, y, unfolded(z, thickness, m, up), 0.0, 0.0, 0.0)
                            write_record(records[kept_count], entry, last, kept, 0.0, 0.0, 0.0)
                            orders[kept_count], paths[kept_count] = 1, fresh_address[PATH + i]
                            if faces is not None:
                                bounces[kept_count, 0], bounces[kept_count, 1] = int(fresh[Z1 + i] / thickness), m
                        kept_count += 1
            leave(
                where, g, rows, places, aim_rows, aim_guide, mean_free_path, pull, importance, fresh, fresh_address,
                waiting,
            )  # fmt: skip
            if faces is not None:
                turn_over(thickness, fresh, waiting)
                if jones is not None:
                    reflect_polarised(where, thickness, faces, jones.carried[WAITING], fresh, fresh_address, waiting)
                else:
                    reflect(where, thickness, faces, fresh, fresh_address, waiting)
            waiting, cut, cut_weight = drop_ended(
                fresh, fresh_address, waiting, thickness, survival, last_order, jones, WAITING
            )  # fmt: skip
            unfinished += cut
            unfinished_weight += cut_weight
        if flying == 0:
            break

        for i in range(flying):
            address[ORDER + i] += _ONE
        events += flying
        draw(where.key0, where.key1, where.sample, _ONE, address, state, flying)
        if survival < 1.0:
            # Absorption as a coin: the weight stays, the work goes.
            draw_coin(where.key0, where.key1, where.sample, ASIDE, address, state, flying)
        mark_candidates(g, rows, places, 0.0 if reverse else threshold, probes, state, flying)
        for i in range(flying):
            if state[CANDIDATE + i] == 0.0 or state[COIN + i] >= survival:
                continue
            x, y, z = state[X + i], state[Y + i], state[Z + i]
            wx, wy, wz = state[WX + i], state[WY + i], state[WZ + i]
            for m in range(images + 1):
                if reverse:
                    weight, w = weigh_both_ways(
                        state, i, m, layer, light, mirror, g, rows, places, aim_rows, aim_places, probes
                    )
                else:
                    weight = state[AMOUNT + i]
                    power, leg = weight * state[POWER + i], Leg(x, y, z, wx, wy, wz)
                    w = contribution(power, g, rows, places, leg, probes, m * views, (m + 1) * views)
                kept = survivor_weight(weight, w, threshold, state[KEEP + i])
                if kept > 0.0:
                    if kept_count < capacity:
                        entry = Leg(
                            state[X1 + i], state[Y1 + i], state[Z1 + i], state[OX + i], state[OY + i], state[OZ + i]
                        )
                        last = Leg(x, y, unfolded(z, thickness, m, up), wx, wy, -wz if m % 2 else wz)
                        write_record(records[kept_count], entry, last, kept, state[FLOWN + i], state[TURNED + i],
                                     state[DOPPLER + i])  # fmt: skip
                        orders[kept_count], paths[kept_count] = address[ORDER + i], address[PATH + i]
                        if jones is not None:
                            write_matrix(jones.carried, i, jones.found[kept_count])
                        if faces is not None:
                            bounces[kept_count, 0], bounces[kept_count, 1] = int(state[Z1 + i] / thickness), m
                    kept_count += 1
        if flows:
            add_doppler(flow, 1.0, state, flying)
        if pull.rate > 0.0:
            steer(where, g, rows, guide, pull, importance, state, address, flying)
            if transfers:
                add_turns(state, flying)
            if flows:
                add_doppler(flow, -1.0, state, flying)
            fly_stretched(mean_free_path, pull.rate, state, flying)
            continue
        if jones is not None:
            scatter_polarised(
                where, g, rows, guide, places, jones.matrices, jones.carried[FLYING], jones.step, state, address, flying
            )  # fmt: skip
        elif rows.shape[0] == 0:
            scatter(g, state, flying)
        elif g > 1.0:
            scatter_by_fisher(g, state, flying)
        else:
            scatter_by_table(rows, guide, state, flying)
        if transfers:
            add_turns(state, flying)
        if flows:
            add_doppler(flow, -1.0, state, flying)
        fly(mean_free_path, state, flying)
        if faces is not None:
            if jones is not None:
                reflect_polarised(where, thickness, faces, jones.carried[FLYING], state, address, flying)
            else:
                reflect(where, thickness, faces, state, address, flying)
    sort_by_path(paths, first, count, min(kept_count, capacity), found.ranks)
    return kept_count, events, unfinished, unfinished_weight


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
