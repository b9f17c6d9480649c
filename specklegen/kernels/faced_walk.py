"""Random walks through a slab whose faces reflect, and the connections of their vertices through the faces.

As :mod:`specklegen.kernels.walk`, whose steps and addresses of random numbers it shares, with three differences:

* a flight that meets a face is reflected with the probability R of its angle and keeps its remaining length;
* the first leg may have been reflected m = 0, 1, ... times before the first collision, with probability a^m (1 - a),
  a = R e^(-OD / i_z) (all m up to the last image together are the weight);
* a vertex is connected to a view once for every number m of reflections of the last leg, by roulette one by one.

Legs that were reflected are unfolded in the records: vertex and direction are the images from which the leg is straight
(z measured along the leg's own side), so that phases, depths and lobes at the ends are those of a slab without faces.
What is left, R^(m/2) and the root of 1 - R of each light and view, is with them (:mod:`specklegen.paths.faces`).
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.fresnel import reflectance
from specklegen.kernels.lanes import (
    ADDRESS,
    AMOUNT,
    CANDIDATE,
    COIN,
    DENSITY,
    FLOWN,
    KEEP,
    LANES,
    ORDER,
    OX,
    OY,
    OZ,
    PATH,
    POWER,
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
from specklegen.kernels.rng import uniforms
from specklegen.kernels.walk import footprint_density, leave, profile, start, survivor_weight, write_record

_ONE = np.uint64(1)
_FACES = np.uint64(0x40000000)  # dimensions of reflections: above all orders, below the coins of absorption
_COINS = np.uint64(0x80000000)
_INSIDE = 1.0 - 1e-12  # of the thickness: the deepest first vertex, so that its image tells its number


@inlined
def reflect(key0, key1, sample, thickness, inside, wall, outside, state, address, count):
    """Turn back the lanes that a face reflects; those that leave stay outside."""
    for i in range(count):
        z, wz = state[Z + i], state[WZ + i]
        if z >= 0.0 and z <= thickness:
            continue
        r = reflectance(abs(wz), inside, wall, outside)
        if r >= 1.0:
            m = math.floor(z / thickness)
            z -= m * thickness
            if m % 2.0 != 0.0:
                z, wz = thickness - z, -wz
        elif r > 0.0:
            u = uniforms(key0, key1, sample, address[PATH + i], address[ORDER + i] + _FACES)[0]
            while (z < 0.0 or z > thickness) and u < r:
                z, wz = (-z if z < 0.0 else 2.0 * thickness - z), -wz
                u /= r
        state[Z + i], state[WZ + i] = z, wz


@inlined
def reflect_first(key0, key1, sample, thickness, sigma_t, ix, iy, iz, again, crossing, images, state, address, count):
    """Move the first vertices of :func:`start` behind reflections of the first leg, by their chances.

    again : R at the reference direction; crossing : 1 - R there; images : largest number of reflections
    """
    slant = thickness / iz
    share = again * math.exp(-sigma_t * slant)
    total = 1.0
    for _ in range(images):
        total = 1.0 + share * total
    for i in range(count):
        u = total * uniforms(key0, key1, sample, address[PATH + i], _FACES)[0]
        m, part = 0, 1.0
        while m < images and u >= part:
            u -= part
            part *= share
            m += 1
        z = min(state[Z1 + i], thickness * _INSIDE)
        state[AMOUNT + i] *= total / part
        state[POWER + i] *= part * crossing
        state[X1 + i] += m * slant * ix
        state[Y1 + i] += m * slant * iy
        state[Z1 + i] = m * thickness + z
        state[X + i], state[Y + i] = state[X1 + i], state[Y1 + i]
        state[Z + i] = thickness - z if m % 2 else z
        state[WZ + i] = -iz if m % 2 else iz
    return total


@inlined
def image_contribution(power, g, rows, places, z, wx, wy, wz, probes, views, m):
    """Largest contribution over the views of a vertex that light of ``power`` reaches, after m reflections."""
    best = 0.0
    for n in range(m * views, (m + 1) * views):
        t = probes[n, 3] + probes[n, 4] * z
        if t < 700.0:
            cos = wx * probes[n, 0] + wy * probes[n, 1] + wz * probes[n, 2]
            best = max(best, power * judged_phase_function(g, rows, places, cos) * math.exp(-t))
    return best


@inlined
def unfolded(z, thickness, m, up):
    """Depth of a vertex's image from which a leg of m reflections leads straight through the upper or lower face."""
    if up:
        return z - m * thickness if m % 2 == 0 else -z - (m - 1) * thickness
    return z + m * thickness if m % 2 == 0 else (m + 1) * thickness - z


@inlined
def weigh_both_ways(
    state, i, m, views, sigma_t, thickness, albedo, chance, again, crossing, g, rows, places, aim_rows, aim_places,
    ix, iy, iz, footprint, extent, radius, probes,
):  # fmt: skip
    """W of a connection of m reflections drawn either way, and its largest contribution of both directions.

    Both ends lie behind the lower face: reversed paths interfere in reflection alone.
    """
    x, y, z, wx, wy, wz = state[X + i], state[Y + i], state[Z + i], state[WX + i], state[WY + i], state[WZ + i]
    turned = -wz if m % 2 else wz
    depth = unfolded(z, thickness, m, False) / iz
    fx, fy = x - depth * ix, y - depth * iy
    back = -(wx * ix + wy * iy + turned * iz)
    passed = math.exp(-sigma_t * depth) / iz * again**m
    density = footprint_density(footprint, extent, fx, fy) * passed / (albedo * chance)
    weight = 1.0 / (state[DENSITY + i] + density * phase_function(g, aim_rows, aim_places, back))
    beam = profile(footprint, radius, fx, fy)
    power = weight * beam * beam * passed * crossing * judged_phase_function(g, rows, places, back)
    first = int(state[Z1 + i] / thickness)
    z1, oz = state[Z1 + i] - first * thickness, state[OZ + i]
    if first % 2:
        z1, oz = thickness - z1, -oz
    ox, oy = state[OX + i], state[OY + i]
    forward = image_contribution(weight * state[POWER + i], g, rows, places, z, wx, wy, wz, probes, views, m)
    reversed_ = image_contribution(power, g, rows, places, z1, -ox, -oy, -oz, probes, views, first)
    return weight, max(forward, reversed_)


@kernel
def trace_faced_slab(
    key0, key1, sample, first, count, thickness, sigma_t, albedo, inside, wall, outside, images, lobe, aim, ix, iy, iz,
    footprint, extent, radius, probes, up, reverse, threshold, max_order, records, bounces, orders, paths, ranks,
):  # fmt: skip
    """Trace paths through a slab with reflecting faces and write the kept connections.

    As :func:`specklegen.kernels.walk.trace_slab`, and besides:

    inside, wall, outside : indices of refraction
    images : largest number of reflections of the first and of the last leg
    probes : float64[(images + 1) n, 5]  the n views by which roulette judges, then as they look at a vertex after one
                               reflection, two, ...; depths to the outside hold -ln of what faces leave
    up : 1 where views are behind the upper face, else 0
    bounces : int8[cap, 2]     output, reflections of the first and of the last leg
    """
    g, rows, guide, places = lobe.g, lobe.rows, lobe.guide, lobe.places
    aim_rows, aim_guide, aim_places = aim.rows, aim.guide, aim.places
    capacity, views = records.shape[0], probes.shape[0] // (images + 1)
    found = events = unfinished = 0
    unfinished_weight = 0.0
    again = reflectance(iz, inside, wall, outside)
    crossing, total = 1.0 - again, 1.0
    chance = -math.expm1(-sigma_t * thickness / iz)
    mean_free_path = 1.0 / sigma_t
    k0, k1, sample64 = np.uint64(key0), np.uint64(key1), np.uint64(sample)
    last_order = np.uint64(max_order)
    state, address = np.empty(STATE), np.empty(ADDRESS, np.uint64)
    fresh, fresh_address = np.empty(STATE), np.empty(ADDRESS, np.uint64)
    unguided = np.ones((2, 2))  # flights are not stretched between reflecting faces
    flying = waiting = started = 0
    while True:
        flying, cut, cut_weight = drop_ended(state, address, flying, thickness, albedo, last_order)
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
                k0, k1, sample64, first + started, waiting, thickness, sigma_t, albedo, 0.0, ix, iy, iz,
                footprint, extent, radius, fresh, fresh_address,
            )  # fmt: skip
            total = reflect_first(
                k0, k1, sample64, thickness, sigma_t, ix, iy, iz, again, crossing, images, fresh, fresh_address, waiting
            )
            started += waiting
            events += waiting
            mark_candidates(g, rows, places, threshold, probes, fresh, waiting)
            for i in range(waiting):
                if fresh[CANDIDATE + i] == 0.0:
                    continue
                x, y, z, weight = fresh[X + i], fresh[Y + i], fresh[Z + i], fresh[AMOUNT + i]
                for m in range(images + 1):
                    power = weight * fresh[POWER + i]
                    w = image_contribution(power, g, rows, places, z, ix, iy, fresh[WZ + i], probes, views, m)
                    kept = survivor_weight(weight, w, threshold, fresh[KEEP + i])
                    if kept > 0.0:
                        if found < capacity:
                            write_record(
                                records[found], x, y, fresh[Z1 + i], 0.0, 0.0, 0.0,
                                x, y, unfolded(z, thickness, m, up == 1), 0.0, 0.0, 0.0, kept, 0.0,
                            )  # fmt: skip
                            orders[found], paths[found] = 1, fresh_address[PATH + i]
                            bounces[found, 0], bounces[found, 1] = int(fresh[Z1 + i] / thickness), m
                        found += 1
            leave(
                k0, k1, sample64, g, rows, places, aim_rows, aim_guide, mean_free_path, 0.0, 1.0, 1.0, unguided,
                fresh, fresh_address, waiting,
            )  # fmt: skip
            for i in range(waiting):
                if int(fresh[Z1 + i] / thickness) % 2:
                    fresh[OZ + i] = -fresh[OZ + i]
            reflect(k0, k1, sample64, thickness, inside, wall, outside, fresh, fresh_address, waiting)
            waiting, cut, cut_weight = drop_ended(fresh, fresh_address, waiting, thickness, albedo, last_order)
            unfinished += cut
            unfinished_weight += cut_weight
        if flying == 0:
            break

        for i in range(flying):
            address[ORDER + i] += _ONE
        events += flying
        draw(k0, k1, sample64, _ONE, address, state, flying)
        if albedo < 1.0:
            draw_coin(k0, k1, sample64, _COINS, address, state, flying)
        mark_candidates(g, rows, places, 0.0 if reverse else threshold, probes, state, flying)
        for i in range(flying):
            if state[CANDIDATE + i] == 0.0 or state[COIN + i] >= albedo:
                continue
            x, y, z = state[X + i], state[Y + i], state[Z + i]
            wx, wy, wz = state[WX + i], state[WY + i], state[WZ + i]
            for m in range(images + 1):
                if reverse:
                    weight, w = weigh_both_ways(
                        state, i, m, views, sigma_t, thickness, albedo, chance * total, again, crossing,
                        g, rows, places, aim_rows, aim_places, ix, iy, iz, footprint, extent, radius, probes,
                    )  # fmt: skip
                else:
                    weight = state[AMOUNT + i]
                    power = weight * state[POWER + i]
                    w = image_contribution(power, g, rows, places, z, wx, wy, wz, probes, views, m)
                kept = survivor_weight(weight, w, threshold, state[KEEP + i])
                if kept > 0.0:
                    if found < capacity:
                        write_record(
                            records[found], state[X1 + i], state[Y1 + i], state[Z1 + i],
                            state[OX + i], state[OY + i], state[OZ + i],
                            x, y, unfolded(z, thickness, m, up == 1), wx, wy, -wz if m % 2 else wz,
                            kept, state[FLOWN + i],
                        )  # fmt: skip
                        orders[found], paths[found] = address[ORDER + i], address[PATH + i]
                        bounces[found, 0], bounces[found, 1] = int(state[Z1 + i] / thickness), m
                    found += 1
        if rows.shape[0] == 0:
            scatter(g, state, flying)
        else:
            scatter_by_table(rows, guide, state, flying)
        fly(mean_free_path, state, flying)
        reflect(k0, k1, sample64, thickness, inside, wall, outside, state, address, flying)
    sort_by_path(paths, first, count, min(found, capacity), ranks)
    return found, events, unfinished, unfinished_weight
