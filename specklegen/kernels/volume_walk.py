"""Random walks through any volume, and the connections of their vertices to the sensor.

One call traces the paths ``first`` ... ``first + count - 1``; random numbers are addressed by (key, sample, path,
dimension) as in :mod:`specklegen.kernels.walk`, whose record is written here too, together with the particle types at
both ends (docs/physics.md, section 2). Paths go in lock step (`specklegen.kernels.lanes`); what is no vector loop, the
way through voxels and particles drawn by type, has loops of its own.

A path serves both ways: walked backwards it is as good a path from x_B to x_1. With ``bidirectional`` its weight is the
balance heuristic over both,

    W = sigma_s(x1) prod albedo / [ p(x1, w1) + p(x_B, -w_(B-1)) sigma_t(x1) / sigma_t(x_B) ],

which evaluators must then use in both directions: added as amplitudes (coherent backscattering) or as
intensities (without it). Since p may start at sensor points as well, this is also what tames the near field.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import folded, inlined, kernel, spliced
from specklegen.kernels.arithmetic import exponential, fma, minus_log
from specklegen.kernels.jones import (
    amplitudes_of_type,
    draw_turns,
    project,
    start_matrix,
    turn_lane,
    write_matrix,
)
from specklegen.kernels.lanes import (
    ADDRESS,
    AMOUNT,
    AZIMUTH,
    CANDIDATE,
    COIN,
    DENSITY,
    DOPPLER,
    DROP,
    FLIGHT,
    FLOWN,
    FLYING,
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
    TURNED,
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
    carried,
    draw,
    hand_on,
    scatter,
    scatter_by_fisher,
    scatter_by_table,
    sort_by_path,
)
from specklegen.kernels.lobes import density_of, fisher_density, judged, judged_phase_function, sample_density
from specklegen.kernels.phase_functions import amplitude, sample_henyey_greenstein
from specklegen.kernels.phase_table import choose_type, power, sample
from specklegen.kernels.rng import uniforms
from specklegen.kernels.slab_steps import Address, Leg, survivor_weight
from specklegen.kernels.sources import (
    KEPT,
    TURN,
    TYPE,
    WORDS,
    draw_starts,
    sample_lobe,
    sample_start,
    start_densities,
    turn,
)
from specklegen.kernels.volume import (
    EXTRA,
    corners,
    escape_distance,
    free_flight,
    inside,
    is_homogeneous,
    optical_depth,
    voxel,
)
from specklegen.kernels.walk import FLOW, TRANSFER, write_record

FAR, NEAR = 0, 1
_ISOTROPIC = 0.25 / math.pi

# Beyond the quantities of `lanes`: power of the reversed path at its end, albedo at the first vertex and here, three
# uniforms more, the distance to the surface in mean free paths.
BACKWARD, FIRST_ALBEDO, ALBEDO, CHOICE, SECOND, ACCEPT, ESCAPE = (STATE + LANES * n for n in range(7))
_STATE = STATE + 7 * LANES
# And of whole numbers: type of the first particle, blocks of uniforms that flights have used, the voxel.
FIRST_TYPE, FLIGHTS, VOXEL = (ADDRESS + LANES * n for n in range(3))
_ADDRESS = ADDRESS + 3 * LANES

# Random dimensions: of the start those below 16; of vertex B one block at _EVENT + B, and where they are needed another
# at _MORE + B and those of the flight behind it, counted from _FLIGHT on.
_EVENT, _MORE, _FLIGHT = np.uint64(16), np.uint64(0x80000000), np.uint64(0xC0000000)
_ONE = np.uint64(1)


class Probes(NamedTuple):
    """Lights and views by which connections are thinned.

    Attributes
    ----------
    light_kinds, lights, view_kinds, views : int64[n], float64[n, 3]
        FAR directions (of lights reversed, as seen from the medium) or NEAR points.
    """

    light_kinds: np.ndarray
    lights: np.ndarray
    view_kinds: np.ndarray
    views: np.ndarray


@spliced
def _judged_power(by_lobe, g, rows, places, table, kind, even, cos):
    """Phase function by which roulette judges: that of the medium, or of the particle of type ``kind``."""
    if by_lobe:
        return judged_phase_function(g, rows, places, cos)
    return max(power(table, kind, cos), 0.1 * even)  # a zero of the amplitude at a probe judges no connection


@folded
def _probe_power(medium, by_lobe, lobe, table, even, kinds, points, leg, kind, scatters, enough):
    """Largest |end|^2 over a few probes, by which connections are thinned; where not above ``enough``, any below it."""
    bounds, cells, extinction = medium
    g, rows, places = lobe
    x, y, z, wx, wy, wz = leg
    box = corners(bounds)
    best = 0.0
    for n in range(kinds.shape[0]):
        dx, dy, dz = points[n, 0], points[n, 1], points[n, 2]
        decay, reach = 1.0, math.inf
        if kinds[n] == NEAR:
            dx, dy, dz = dx - x, dy - y, dz - z
            reach = math.sqrt(dx * dx + dy * dy + dz * dz)
            if reach == 0.0:
                continue  # a point on a vertex: measure zero, left out
            dx, dy, dz = dx / reach, dy / reach, dz / reach
            decay = 1.0 / reach if cells[EXTRA, 0] == 2 else 1.0 / (reach * reach)
        if scatters:
            cos = wx * dx + wy * dy + wz * dz
            decay *= _judged_power(by_lobe, g, rows, places, table, kind, even, cos)
        if decay <= max(best, enough):
            continue  # what is lost on the way out only lowers it
        reach = min(reach, escape_distance(box, x, y, z, dx, dy, dz))
        if extinction.shape[0] == 1:
            depth = extinction[0] * reach
        else:
            depth = optical_depth(bounds, cells, extinction, x, y, z, dx, dy, dz, 0.0, reach)
        best = max(best, decay * exponential(-depth))
    return best


@folded
def _seen_at_once(by_lobe, lobe, table, even, light_kinds, lights, view_kinds, views, place, kind):
    """Largest phase function of single scattering at a place, from any probe of the lights into any of the views."""
    g, rows, places = lobe
    x, y, z = place
    best = 0.0
    for n in range(light_kinds.shape[0]):
        ix, iy, iz = lights[n, 0], lights[n, 1], lights[n, 2]
        if light_kinds[n] == NEAR:
            ix, iy, iz = ix - x, iy - y, iz - z
        for m in range(view_kinds.shape[0]):
            vx, vy, vz = views[m, 0], views[m, 1], views[m, 2]
            if view_kinds[m] == NEAR:
                vx, vy, vz = vx - x, vy - y, vz - z
            long = math.sqrt((ix * ix + iy * iy + iz * iz) * (vx * vx + vy * vy + vz * vz))
            if long > 0.0:
                cos = max(-1.0, min(1.0, -(ix * vx + iy * vy + iz * vz) / long))
                best = max(best, _judged_power(by_lobe, g, rows, places, table, kind, even, cos))
    return best


@inlined
def _below(limit, factor):
    """The largest value that stays below ``limit`` when multiplied by ``factor`` >= 0, with room for rounding."""
    return limit / factor * (1.0 - 1e-9) if factor > 0.0 else math.inf


@inlined
def _way_out(bounds, axis, direction):
    """Distance to the volume's surface along one axis: (at position 0, per length of the position)."""
    face = bounds[1, axis] if direction > 0.0 else bounds[0, axis]
    if direction == 0.0 or not math.isfinite(face):
        return math.inf, 0.0
    return face / direction, -1.0 / direction


@inlined
def propose(bounds, sigma, g, rows, places, least, kinds, points, given, state, count):
    """Mark the lanes whose contribution at any of some probes has an upper bound above ``least`` KEEP.

    ``sigma``: the least extinction in the volume; ``given``: POWER or BACKWARD, the power of the other end. Of the loss
    e^-t on the way out the bound knows ``e^t >= 1 + t + t^2/2 + t^3/6``. Lanes are never marked off.
    """
    for n in range(kinds.shape[0]):
        if kinds[n] == NEAR:
            for i in range(count):
                state[CANDIDATE + i] = 1.0
            continue
        px, py, pz = points[n, 0], points[n, 1], points[n, 2]
        ax, bx = _way_out(bounds, 0, px)
        ay, by = _way_out(bounds, 1, py)
        az, bz = _way_out(bounds, 2, pz)
        for i in range(count):
            x, y, z = fma(bx, state[X + i], ax), fma(by, state[Y + i], ay), fma(bz, state[Z + i], az)
            state[ESCAPE + i] = sigma * min(x, min(y, z))
        for i in range(count):
            cos = fma(state[WX + i], px, fma(state[WY + i], py, state[WZ + i] * pz))
            state[DROP + i] = max(1.0 - cos, 0.0)
        if rows.shape[0] == 0:
            for i in range(count):
                s = amplitude(g, 1.0 - state[DROP + i])
                state[SHAPE + i] = s * s
        elif g > 1.0:
            for i in range(count):
                state[SHAPE + i] = judged(fisher_density(g, state[DROP + i]))
        else:
            for i in range(count):
                state[SHAPE + i] = judged(density_of(rows, places, state[DROP + i]))
        for i in range(count):
            t = state[ESCAPE + i]
            most = state[AMOUNT + i] * state[given + i] * (state[SHAPE + i] * (1.0 + 1e-9)) / least
            bound = state[KEEP + i] * fma(t, fma(t, fma(t, 1.0 / 6.0, 0.5), 1.0), 1.0)
            state[CANDIDATE + i] = max(state[CANDIDATE + i], 1.0 if most > bound else 0.0)


@inlined
def drop_ended(box, state, address, count, last_order, jones):
    """Fill the lanes of paths that left, were absorbed or are too long with the last ones, and their matrices.

    Returns (lanes still in use, paths that were too long, sum of their W).
    """
    unfinished = 0
    weight = 0.0
    lane = 0
    while lane < count:
        alive = state[COIN + lane] < state[ALBEDO + lane]
        if alive and inside(box, state[X + lane], state[Y + lane], state[Z + lane]):
            if address[ORDER + lane] < last_order:
                lane += 1
                continue
            unfinished += 1
            weight += state[AMOUNT + lane]
        count -= 1
        adopt(state, address, lane, state, address, count)
        for quantity in (BACKWARD, FIRST_ALBEDO, ALBEDO):
            state[quantity + lane] = state[quantity + count]
        for quantity in (FIRST_TYPE, FLIGHTS):
            address[quantity + lane] = address[quantity + count]
        if jones is not None:
            hand_on(jones.carried, FLYING, lane, FLYING, count)
    return count, unfinished, weight


@kernel
def trace_volume(where, share, volume, table, by_lobe, lobe, sources, probes, rules, found, types, jones):
    """Trace paths and write their connections as the walk finds them.

    where, rules, found : Address, Rules, Found of :mod:`specklegen.kernels.walk`
    share : (first path, number of paths)
    volume, table, sources, probes : Volume, PhaseTable, Sources, Probes
    ``by_lobe, lobe`` : whether all the medium scatters by one phase function of three dimensions, and that function
    types : int32[cap, 2]      output, of the first and of the last particle
    jones : Jones or None      of polarised light through layers; None leaves it out of the compiled walk

    Returns (connections found, scattering events, paths ended by max_order, sum of their W); connections
    beyond the capacity are counted but not written.
    """
    first, count = share
    bidirectional, threshold = rules.reverse, rules.threshold
    light_kinds, lights, view_kinds, views = probes.light_kinds, probes.lights, probes.view_kinds, probes.views
    bounds, cells, extinction, per_length = volume.bounds, volume.cells, volume.extinction, volume.per_length
    albedos, materials, majorants = volume.albedo, volume.material, volume.majorant
    mobility, flow = volume.mobility, volume.flow
    source_kinds, source_rows, lobes = sources.kinds, sources.rows, sources.lobes
    g, rows, guide, places = lobe.g, lobe.rows, lobe.guide, lobe.places
    medium, judging = (bounds, cells, extinction), (g, rows, places)
    box, dimension = corners(bounds), cells[EXTRA, 0]
    homogeneous = is_homogeneous(cells)
    typed = table.kinds.shape[0] > 1
    more = typed or not (homogeneous and by_lobe) or albedos[0] < 1.0  # uniforms than one block a vertex
    even = 0.5 / math.pi if dimension == 2 else _ISOTROPIC
    mean_free_path = 1.0 / extinction[0]
    thinnest = extinction.min()
    near = (light_kinds == NEAR).any() or (view_kinds == NEAR).any()
    records, orders, paths = found.records, found.orders, found.paths
    capacity, transfers, flows = records.shape[0], records.shape[1] > TRANSFER, records.shape[1] > FLOW
    kept_count = events = unfinished = 0
    unfinished_weight = 0.0
    k0, k1, sample64 = np.uint64(where.key0), np.uint64(where.key1), np.uint64(where.sample)
    last_order = np.uint64(rules.max_order)
    state, address = np.zeros(_STATE), np.zeros(_ADDRESS, np.uint64)
    words = np.empty(WORDS * LANES)
    flying = started = drawn = 0
    while True:
        flying, cut, cut_weight = drop_ended(box, state, address, flying, last_order, jones)
        unfinished += cut
        unfinished_weight += cut_weight
        fresh = flying
        while flying < LANES and started < count:
            if started == drawn:
                drawn = min(started + LANES, count)
                draw_starts(k0, k1, sample64, first + started, drawn - started, words)
            n = started % LANES
            p = first + started
            started += 1
            begun, aimed, x, y, z, ox, oy, oz = sample_start(
                bounds, cells, extinction, source_kinds, source_rows, words, n
            )  # fmt: skip
            if not begun:
                continue
            here = voxel(bounds, cells, per_length, x, y, z)
            if albedos[here] * extinction[here] == 0.0:
                continue
            # Of the first direction's lobe it matters where the vertex lies.
            spread = lobes[materials[here]]
            ox, oy, oz = sample_lobe(
                dimension, spread if aimed else 0.0, ox, oy, oz, words[LANES * TURN + n], words[LANES * (TURN + 1) + n]
            )
            vertex, joint = start_densities(
                bounds, cells, extinction, (extinction[here], spread), source_kinds, source_rows, x, y, z, ox, oy, oz
            )
            if vertex == 0.0:
                continue  # so near its point that the square of the distance underflows: measure zero, left out
            scattering = albedos[here] * extinction[here]
            kind = choose_type(table, materials[here], words[LANES * TYPE + n])
            events += 1
            kept = weight = scattering / vertex
            u = words[LANES * KEPT + n]
            leg = Leg(x, y, z, 0.0, 0.0, 0.0)
            if threshold > 0.0:
                w = weight * _seen_at_once(
                    by_lobe, judging, table, even, light_kinds, lights, view_kinds, views, (x, y, z), kind
                )
                for kinds, ends in ((light_kinds, lights), (view_kinds, views)):
                    # What is lost on the way out only lowers it, but for points, which may be close.
                    if near or survivor_weight(weight, w, threshold, u) > 0.0:
                        w *= _probe_power(medium, by_lobe, judging, table, even, kinds, ends, leg, kind, False, 0.0)
                kept = survivor_weight(weight, w, threshold, u)
            if kept > 0.0:
                if kept_count < capacity:
                    write_record(records[kept_count], leg, leg, kept, 0.0, 0.0, 0.0)
                    orders[kept_count], paths[kept_count] = 1, p
                    types[kept_count, 0] = types[kept_count, 1] = kind
                kept_count += 1
            i = flying
            flying += 1
            state[X + i], state[Y + i], state[Z + i] = x, y, z
            state[X1 + i], state[Y1 + i], state[Z1 + i] = x, y, z
            state[WX + i], state[WY + i], state[WZ + i] = ox, oy, oz
            state[OX + i], state[OY + i], state[OZ + i] = ox, oy, oz
            state[FIRST_ALBEDO + i] = state[ALBEDO + i] = albedos[here]
            state[DENSITY + i], state[AMOUNT + i] = joint / scattering, scattering / joint
            state[COIN + i] = state[FLOWN + i] = state[TURNED + i] = state[DOPPLER + i] = 0.0
            state[POWER + i] = state[BACKWARD + i] = 1.0
            address[PATH + i], address[ORDER + i] = np.uint64(p), _ONE
            address[FIRST_TYPE + i], address[FLIGHTS + i], address[VOXEL + i] = kind, _FLIGHT, here
            if jones is not None:
                start_matrix(jones.carried, i)
            if threshold > 0.0:
                leg = Leg(x, y, z, -ox, -oy, -oz)
                state[POWER + i] = _probe_power(
                    medium, by_lobe, judging, table, even, light_kinds, lights, leg, kind, True, 0.0
                )
                if bidirectional:
                    state[BACKWARD + i] = _probe_power(
                        medium, by_lobe, judging, table, even, view_kinds, views, leg, kind, True, 0.0
                    )
        if flying == 0:
            break

        # Those that were in flight scatter at the vertex that they have reached; all then fly on.
        for i in range(fresh):
            address[ORDER + i] += _ONE
        events += fresh
        draw(k0, k1, sample64, _EVENT, address, state, flying)
        if more:
            for i in range(flying):
                state[COIN + i], state[CHOICE + i], state[SECOND + i], state[ACCEPT + i] = uniforms(
                    k0, k1, sample64, address[PATH + i], address[ORDER + i] + _MORE
                )
            for i in range(fresh, flying):
                state[COIN + i] = 0.0
        if not homogeneous:
            for i in range(fresh):
                here = voxel(bounds, cells, per_length, state[X + i], state[Y + i], state[Z + i])
                address[VOXEL + i], state[ALBEDO + i] = here, albedos[here]
        for i in range(fresh):
            state[CANDIDATE + i] = 0.0 if threshold > 0.0 and by_lobe else 1.0
        if threshold > 0.0 and by_lobe:
            propose(bounds, thinnest, g, rows, places, threshold, view_kinds, views, POWER, state, fresh)
            if bidirectional:
                propose(bounds, thinnest, g, rows, places, threshold, light_kinds, lights, BACKWARD, state, fresh)
        for i in range(fresh):
            if state[CANDIDATE + i] == 0.0 or state[COIN + i] >= state[ALBEDO + i]:
                continue
            x, y, z = state[X + i], state[Y + i], state[Z + i]
            wx, wy, wz = state[WX + i], state[WY + i], state[WZ + i]
            here = address[VOXEL + i]
            u = state[KEEP + i]
            kind = choose_type(table, materials[here], state[CHOICE + i]) if typed else 0
            kept = weight = state[AMOUNT + i]
            leg = Leg(x, y, z, wx, wy, wz)
            best = 0.0
            if threshold > 0.0:
                lost = u * threshold  # a contribution that is dropped
                best = state[POWER + i] * _probe_power(
                    medium, by_lobe, judging, table, even, view_kinds, views, leg, kind, True,
                    _below(lost, state[POWER + i] * weight),
                )  # fmt: skip
                if bidirectional:
                    back = _probe_power(
                        medium, by_lobe, judging, table, even, light_kinds, lights, leg, kind, True,
                        _below(lost, state[BACKWARD + i] * weight),
                    )  # fmt: skip
                    best = max(best, state[BACKWARD + i] * back)
                kept = survivor_weight(weight, best * weight, threshold, u)
            # The reversed path can only lower the weight: what is dropped without it needs no second density.
            if kept > 0.0 and bidirectional:
                sigma = extinction[here]
                _, back = start_densities(
                    bounds, cells, extinction, (sigma, lobes[materials[here]]), source_kinds, source_rows, x, y, z,
                    -wx, -wy, -wz,
                )  # fmt: skip
                kept = weight = 1.0 / (state[DENSITY + i] + back / (state[FIRST_ALBEDO + i] * sigma))
                if threshold > 0.0:
                    kept = survivor_weight(weight, best * weight, threshold, u)
            if kept > 0.0:
                if kept_count < capacity:
                    entry = Leg(
                        state[X1 + i], state[Y1 + i], state[Z1 + i], state[OX + i], state[OY + i], state[OZ + i]
                    )
                    write_record(records[kept_count], entry, leg, kept, state[FLOWN + i], state[TURNED + i],
                                 state[DOPPLER + i])  # fmt: skip
                    orders[kept_count], paths[kept_count] = address[ORDER + i], address[PATH + i]
                    types[kept_count, 0], types[kept_count, 1] = address[FIRST_TYPE + i], kind
                    if jones is not None:
                        write_matrix(jones.carried, i, jones.found[kept_count])
                kept_count += 1
        if flows:
            for i in range(fresh):
                state[DOPPLER + i] += carried(
                    flow, address[VOXEL + i], state[X + i], state[Y + i], state[Z + i], state[WX + i], state[WY + i],
                    state[WZ + i],
                )  # fmt: skip
        if jones is not None:
            draw_turns(Address(k0, k1, sample64), jones.step, address, fresh)
            if by_lobe:
                for i in range(fresh):
                    state[DROP + i] = (
                        sample_henyey_greenstein(g, state[POLAR + i]) if rows.shape[0] == 0
                        else sample_density(rows, guide, state[POLAR + i])[0]
                    )  # fmt: skip
            by_projector = jones.matrices.shape[0] == 0
            for i in range(fresh):
                chosen = 0
                if not by_lobe:
                    u = state[COIN + i] / state[ALBEDO + i]
                    chosen = choose_type(table, materials[address[VOXEL + i]], u)
                    state[DROP + i] = sample(table, chosen, state[POLAR + i], state[SECOND + i])
                if not by_projector:
                    amplitudes_of_type(jones.matrices, chosen, jones.step, state, i)
            if by_projector:
                project(jones.step, state, fresh)
            for i in range(fresh):
                turn_lane(jones.carried[FLYING], jones.step, state, i)
        elif not by_lobe:
            for i in range(fresh):
                # Below the albedo, the coin is a uniform again: it chooses the type that scatters.
                u = state[COIN + i] / state[ALBEDO + i]
                chosen = choose_type(table, materials[address[VOXEL + i]], u)
                state[DROP + i] = one_minus_cos = sample(table, chosen, state[POLAR + i], state[SECOND + i])
                state[WX + i], state[WY + i], state[WZ + i] = turn(
                    dimension, state[WX + i], state[WY + i], state[WZ + i], one_minus_cos, state[AZIMUTH + i]
                )
        elif rows.shape[0] == 0:
            scatter(g, state, fresh)
        elif g > 1.0:
            scatter_by_fisher(g, state, fresh)
        else:
            scatter_by_table(rows, guide, state, fresh)
        if transfers:
            for i in range(fresh):
                state[TURNED + i] += state[DROP + i] * mobility[address[VOXEL + i]]
        if flows:
            for i in range(fresh):
                state[DOPPLER + i] -= carried(
                    flow, address[VOXEL + i], state[X + i], state[Y + i], state[Z + i], state[WX + i], state[WY + i],
                    state[WZ + i],
                )  # fmt: skip
        if homogeneous:
            for i in range(flying):
                state[FLIGHT + i] = minus_log(state[FLIGHT + i]) * mean_free_path
        else:
            for i in range(flying):
                state[FLIGHT + i], address[FLIGHTS + i] = free_flight(
                    bounds, cells, extinction, majorants, per_length,
                    (state[X + i], state[Y + i], state[Z + i], state[WX + i], state[WY + i], state[WZ + i]),
                    state[FLIGHT + i], state[ACCEPT + i], (k0, k1, sample64), address[PATH + i], address[FLIGHTS + i],
                )  # fmt: skip
        for i in range(flying):
            flight = state[FLIGHT + i]
            state[X + i] = fma(state[WX + i], flight, state[X + i])
            state[Y + i] = fma(state[WY + i], flight, state[Y + i])
            state[Z + i] = fma(state[WZ + i], flight, state[Z + i])
            state[FLOWN + i] += flight
    sort_by_path(paths, first, count, min(kept_count, capacity), found.ranks)
    return kept_count, events, unfinished, unfinished_weight
