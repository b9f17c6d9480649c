"""Random walks through any volume, and the connections of their vertices to the sensor.

One call traces the paths ``first`` ... ``first + count - 1``; random numbers are addressed by (key, sample,
path, dimension) as in :mod:`specklegen.kernels.walk`, whose record is written here too, together with the
particle types at both ends (physics.md 2, corrections 3 and 6).

A path serves both ways: walked backwards it is as good a path from x_B to x_1. With ``bidirectional`` its weight is the
balance heuristic over both,

    W = sigma_s(x1) prod albedo / [ p(x1, w1) + p(x_B, -w_(B-1)) sigma_t(x1) / sigma_t(x_B) ],

which evaluators must then use in both directions: added as amplitudes (coherent backscattering) or as
intensities (without it). Since p may start at sensor points as well, this is also what tames the near field.
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.phase_table import choose_type, power, sample
from specklegen.kernels.rng import uniforms
from specklegen.kernels.sources import sample_start, start_densities, turn
from specklegen.kernels.volume import EXTRA, exit_distance, free_flight, inside, optical_depth, voxel
from specklegen.kernels.walk import write_record

FAR, NEAR = 0, 1
_ONE = np.uint64(1)
_EVENTS = np.uint64(16)  # first random dimension of the walk; those below draw the start
_FLOOR = 0.1  # of isotropic scattering: no connection is judged by a zero of the amplitude at a probe


@inlined
def end_geometry(bounds, cells, extinction, near_field, px, py, pz, x, y, z):
    """Towards one view (direction or point): unit vector, decay 1/r^((d-1)/2), optical depth."""
    if not near_field:
        far = exit_distance(bounds, x, y, z, px, py, pz)
        depth = optical_depth(bounds, cells, extinction, x, y, z, px, py, pz, 0.0, far)
        return px, py, pz, 1.0, depth
    dx, dy, dz = px - x, py - y, pz - z
    r = math.sqrt(dx * dx + dy * dy + dz * dz)
    if r == 0.0:
        return 0.0, 0.0, 1.0, 0.0, 0.0  # a point on a vertex: measure zero, left out
    dx, dy, dz = dx / r, dy / r, dz / r
    reach = min(r, exit_distance(bounds, x, y, z, dx, dy, dz))
    depth = optical_depth(bounds, cells, extinction, x, y, z, dx, dy, dz, 0.0, reach)
    return dx, dy, dz, (1.0 / math.sqrt(r) if cells[EXTRA, 0] == 2 else 1.0 / r), depth


@inlined
def _probe_power(volume, table, kinds, points, x, y, z, wx, wy, wz, kind, scatters, enough):
    """Largest |end|^2 over a few probes, by which connections are thinned; where not above ``enough``, any below it."""
    bounds, cells, extinction = volume.bounds, volume.cells, volume.extinction
    even = _FLOOR / (2.0 * math.pi if cells[EXTRA, 0] == 2 else 4.0 * math.pi)
    best = 0.0
    for n in range(kinds.shape[0]):
        near = kinds[n] == NEAR
        px, py, pz = points[n, 0], points[n, 1], points[n, 2]
        s2 = 1.0
        if scatters and not near:
            s2 = max(power(table, kind, wx * px + wy * py + wz * pz), even)
        if not near and s2 <= max(best, enough):
            continue  # what is lost on the way out only lowers it
        dx, dy, dz, decay, depth = end_geometry(bounds, cells, extinction, near, px, py, pz, x, y, z)
        if scatters and near:
            s2 = max(power(table, kind, wx * dx + wy * dy + wz * dz), even)
        best = max(best, decay * decay * math.exp(-depth) * s2)
    return best


@inlined
def _below(limit, factor):
    """The largest value that stays below ``limit`` when multiplied by ``factor`` >= 0, with room for rounding."""
    return limit / factor * (1.0 - 1e-9) if factor > 0.0 else math.inf


@kernel
def trace_volume(
    key0, key1, sample_index, first, count, volume, table, sources, bidirectional, light_kinds, lights, view_kinds,
    views, threshold, max_order, records, orders, paths, types,
):  # fmt: skip
    """Trace paths and write their connections in path order.

    volume, table, sources : Volume, PhaseTable, Sources
    bidirectional : whether weights are those of the path and its reverse together
    light_kinds, lights, view_kinds, views : int64[n], float64[n, 3]   probes for thinning: FAR directions (of lights
                               reversed, as seen from the medium) or NEAR points
    threshold : contribution from which a connection is always kept; 0 keeps all
    max_order : vertices after which a path is ended
    records, orders, paths, types : float64[cap, RECORD], int32[cap], int64[cap], int32[cap, 2]   output

    Returns (connections found, scattering events, paths ended by max_order, sum of their W); connections
    beyond the capacity are counted but not written.
    """
    bounds, cells, extinction = volume.bounds, volume.cells, volume.extinction
    albedos, materials, majorants = volume.albedo, volume.material, volume.majorant
    source_kinds, source_rows = sources.kinds, sources.rows
    capacity = records.shape[0]
    found = 0
    events = 0
    unfinished = 0
    unfinished_weight = 0.0
    sample64 = np.uint64(sample_index)
    k0 = np.uint64(key0)
    k1 = np.uint64(key1)
    for p in range(first, first + count):
        path = np.uint64(p)
        started, x1, y1, z1, ox, oy, oz = sample_start(
            bounds, cells, extinction, source_kinds, source_rows, k0, k1, sample64, path
        )
        if not started:
            continue
        here = voxel(bounds, cells, x1, y1, z1)
        extinction1 = extinction[here]
        scattering = albedos[here] * extinction1
        if scattering == 0.0:
            continue
        vertex_density, joint_density = start_densities(
            bounds, cells, extinction, source_kinds, source_rows, x1, y1, z1, ox, oy, oz
        )
        a, b, _, _ = uniforms(k0, k1, sample64, path, np.uint64(3))
        type1 = choose_type(table, materials[here], a)
        events += 1
        weight = scattering / vertex_density
        w = threshold
        if threshold > 0.0:
            w = weight * _probe_power(volume, table, light_kinds, lights, x1, y1, z1, 0.0, 0.0, 0.0, type1, False, 0.0)
            w *= _probe_power(volume, table, view_kinds, views, x1, y1, z1, 0.0, 0.0, 0.0, type1, False, 0.0)
            # s(i . v) is the same for all and not known here: judged as isotropic.
            w /= 2.0 * math.pi if cells[EXTRA, 0] == 2 else 4.0 * math.pi
        if w >= threshold or b * threshold < w:
            if found < capacity:
                kept = weight * (1.0 if w >= threshold else threshold / w)
                write_record(records[found], x1, y1, z1, 0.0, 0.0, 0.0, x1, y1, z1, 0.0, 0.0, 0.0, kept, 0.0)
                orders[found] = 1
                paths[found] = p
                types[found, 0] = type1
                types[found, 1] = type1
            found += 1

        light_forward = view_backward = 1.0
        if threshold > 0.0:
            light_forward = _probe_power(
                volume, table, light_kinds, lights, x1, y1, z1, -ox, -oy, -oz, type1, True, 0.0
            )  # fmt: skip
            view_backward = _probe_power(volume, table, view_kinds, views, x1, y1, z1, -ox, -oy, -oz, type1, True, 0.0)
        x, y, z = x1, y1, z1
        wx, wy, wz = ox, oy, oz
        length = 0.0
        order = 1
        dimension = _EVENTS
        while True:
            flight, dimension = free_flight(
                bounds, cells, extinction, majorants, x, y, z, wx, wy, wz, k0, k1, sample64, path, dimension
            )
            if flight == math.inf:
                break
            x, y, z = x + wx * flight, y + wy * flight, z + wz * flight
            if not inside(bounds, x, y, z):
                break
            length += flight
            if order == max_order:
                unfinished += 1
                unfinished_weight += scattering / joint_density
                break
            order += 1
            events += 1
            here = voxel(bounds, cells, x, y, z)
            a, b, c, d = uniforms(k0, k1, sample64, path, dimension)
            e, f, g, _ = uniforms(k0, k1, sample64, path, dimension + _ONE)
            dimension += _ONE + _ONE
            if e >= albedos[here]:
                break
            material = materials[here]
            type_end = choose_type(table, material, f)
            weight = scattering / joint_density
            w = best = threshold
            if threshold > 0.0:
                lost = a * threshold  # a contribution that is dropped
                best = light_forward * _probe_power(
                    volume, table, view_kinds, views, x, y, z, wx, wy, wz, type_end, True,
                    _below(lost, light_forward * weight),
                )  # fmt: skip
                if bidirectional:
                    back = _probe_power(
                        volume, table, light_kinds, lights, x, y, z, wx, wy, wz, type_end, True,
                        _below(lost, view_backward * weight),
                    )  # fmt: skip
                    best = max(best, view_backward * back)
                w = best * weight
            # The reversed path can only lower the weight: what is dropped without it needs no second density.
            if bidirectional and (w >= threshold or a * threshold < w):
                _, backward = start_densities(
                    bounds, cells, extinction, source_kinds, source_rows, x, y, z, -wx, -wy, -wz
                )
                weight = scattering / (joint_density + backward * extinction1 / extinction[here])
                if threshold > 0.0:
                    w = best * weight
            if w >= threshold or a * threshold < w:
                if found < capacity:
                    kept = weight * (1.0 if w >= threshold else threshold / w)
                    write_record(records[found], x1, y1, z1, ox, oy, oz, x, y, z, wx, wy, wz, kept, length)
                    orders[found] = order
                    paths[found] = p
                    types[found, 0] = type1
                    types[found, 1] = type_end
                found += 1
            one_minus_cos = sample(table, choose_type(table, material, g), b, d)
            wx, wy, wz = turn(cells[EXTRA, 0], wx, wy, wz, one_minus_cos, c)
    return found, events, unfinished, unfinished_weight
