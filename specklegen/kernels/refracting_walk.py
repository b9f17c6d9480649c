"""Random walks through layers whose refractive indices differ, and the thinned connections of their vertices.

Paths are drawn as in :mod:`specklegen.kernels.volume_walk`, one after the other: a first vertex along one of the legs
of the reference light, a first direction about it, then flights that faces reflect and refract. Every vertex is
connected along all legs of the views that lead from its layer (:mod:`specklegen.kernels.legs`).

Densities along a leg from a layer of index n to one of n' change by (n / n')^2 beside those of a homogeneous medium:
that is what refraction makes of solid angles. It is shared out, n^2 to the vertices and the rest to the legs; so a
path walked backwards has the amplitudes of the lights and views that it then has at its ends, and nothing else:

    W = n_1^2 sigma_s(x1) prod albedo / [ p(x1, w1) + p(x_B, -w_(B-1)) sigma_t(x1) n_1^2 / (sigma_t(x_B) n_B^2) ]
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel, spliced
from specklegen.kernels.arithmetic import exponential, minus_log
from specklegen.kernels.footprints import GAUSSIAN, footprint_density, profile, sample_footprint
from specklegen.kernels.frames import deflect
from specklegen.kernels.lanes import sort_by_path
from specklegen.kernels.legs import AMOUNT, ASIDE, DECAY, SLOPE, TOWARDS, face_of
from specklegen.kernels.phase_table import choose_type, power, sample
from specklegen.kernels.refraction import fly_layers
from specklegen.kernels.rng import uniforms
from specklegen.kernels.slab_steps import Leg, survivor_weight
from specklegen.kernels.sources import lobe_density, sample_lobe
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.kernels.walk import write_record

_LEAST = 0.1 / (4.0 * math.pi)  # phase function by which roulette judges at least: a zero of it judges no connection
_ONE = np.uint64(1)
# Random dimensions: of the start those below 16; of vertex B blocks at _EVENT + B and _MORE + B; from _FACE on, of
# meetings with faces.
_EVENT, _MORE, _FACE = np.uint64(16), np.uint64(0x80000000), np.uint64(0xC0000000)


class Particles(NamedTuple):
    """Scatterers of each layer.

    Attributes
    ----------
    albedo, material : float64[n], int64[n]
    lobe : float64[n]
        Anisotropy of the first directions that are drawn there.
    square : float64[n]
        (n_k / n)^2, n the index in which directions are measured.
    """

    albedo: np.ndarray
    material: np.ndarray
    lobe: np.ndarray
    square: np.ndarray


@spliced
def _judged(table, kind, cos):
    return max(power(table, kind, cos), _LEAST)


@spliced
def _seen(table, kind, face, rows, leg, last):
    """Largest |end|^2 of a vertex over all directions of one of their legs; without direction, as its light goes on."""
    best = 0.0
    h = abs(last.z - face)
    for n in range(rows.shape[0]):
        row = rows[n, leg]
        if row[AMOUNT] == 0.0:
            continue
        cos = last.wx * row[TOWARDS] + last.wy * row[TOWARDS + 1] + last.wz * row[TOWARDS + 2]
        amount = row[AMOUNT] * row[AMOUNT] * exponential(-2.0 * row[DECAY] * h)
        best = max(best, amount * _judged(table, kind, cos))
    return best


@spliced
def _start_density(starts, beam, extinction, layer, leg, x, y, z):
    """Density of a first vertex on a leg of the reference light, per volume."""
    row, face = starts.legs.rows[0, leg], starts.legs.face[leg]
    h, depth = abs(z - face), starts.depth[layer]
    fx, fy = face_of(row, x, y, h)
    rate = 2.0 * row[DECAY]
    per_area = footprint_density(beam.footprint, beam.extent, fx, fy)
    return per_area * starts.share[leg] * rate * exponential(-rate * h) / -math.expm1(-depth)


@kernel
def trace_refracting(where, share, stack, particles, table, starts, beam, views, rules, found, types):
    """Trace paths and write their connections as the walk finds them.

    where, rules, found : Address, Rules, Found of :mod:`specklegen.kernels.walk`; ``found.bounces`` int16[cap, 2] are
                          the numbers of both legs
    share : (first path, number of paths)
    stack, particles, table : Stack, Particles, PhaseTable
    starts, beam : Starts, Light
    views : Legs of the views by which connections are judged; with ``rules.reverse`` those of the same light
    types : int32[cap, 2]      output, of the first and of the last particle

    Returns (connections found, scattering events, paths ended by max_order, sum of their W); connections beyond the
    capacity are counted but not written.
    """
    first, count = share
    reverse, threshold, last_order = rules.reverse, rules.threshold, rules.max_order
    indices, extinction, edges = stack.indices, stack.extinction, stack.edges
    walls = stack.entrance, stack.far, stack.outside
    albedo, material, lobes, square = particles.albedo, particles.material, particles.lobe, particles.square
    lit, begin = starts.legs.rows, starts.legs.first
    faces, seen, ahead = views.face, views.rows, views.first
    records, orders, paths, numbers = found.records, found.orders, found.paths, found.bounces
    capacity = records.shape[0]
    kept_count = events = unfinished = 0
    unfinished_weight = 0.0
    key = np.uint64(where.key0), np.uint64(where.key1), np.uint64(where.sample)
    k0, k1, sample64 = key
    thickness, unit = edges[edges.shape[0] - 1], math.sqrt(square[0]) / indices[0]
    for p in range(first, first + count):
        path = np.uint64(p)
        a, b, c, d = uniforms(k0, k1, sample64, path, np.uint64(0))
        # Two words a coordinate: 32 bits alone would put wide beams on a lattice.
        fx, fy, _ = sample_footprint(beam.footprint, beam.extent, a + (b - 0.5) * 2.0**-32, c + (d - 0.5) * 2.0**-32)
        u, v, turn, azimuth = uniforms(k0, k1, sample64, path, np.uint64(1))
        keep, choice, _, _ = uniforms(k0, k1, sample64, path, np.uint64(2))
        origin = 0
        while origin < starts.share.shape[0] - 1 and starts.cumulative[origin] <= u:
            origin += 1
        layer = 0
        while begin[layer + 1] <= origin:
            layer += 1
        row = lit[0, origin]
        # The light travels against TOWARDS.
        down = row[TOWARDS + 2] < 0.0
        h = -math.log1p(v * math.expm1(-starts.depth[layer])) / (2.0 * row[DECAY])
        h = min(h, edges[layer + 1] - edges[layer])
        z = starts.legs.face[origin] + (h if down else -h)
        z = min(max(z, 0.0), thickness)
        x, y = fx - row[ASIDE] - h * row[SLOPE], fy - row[ASIDE + 1] - h * row[SLOPE + 1]
        wx, wy, wz = -row[TOWARDS], -row[TOWARDS + 1], -row[TOWARDS + 2]
        vertex = _start_density(starts, beam, extinction, layer, origin, x, y, z)
        scattering = albedo[layer] * extinction[layer] * square[layer]
        if vertex == 0.0 or scattering == 0.0:
            continue
        kind = choose_type(table, material[layer], choice)
        events += 1
        # Points that only other tilts light are judged as if this one did, else they would never be kept.
        amount = profile(beam.footprint, beam.radius, fx, fy) if beam.footprint == GAUSSIAN else 1.0
        amount *= row[AMOUNT] * exponential(-row[DECAY] * h)
        light = amount * amount
        weight = scattering / vertex
        entry = Leg(x, y, z, wx, wy, wz)
        for leg in range(ahead[layer], ahead[layer + 1]):
            w = light * weight * _seen(table, kind, faces[leg], seen, leg, entry) if threshold > 0.0 else 0.0
            kept = survivor_weight(weight, w, threshold, keep) if threshold > 0.0 else weight
            if kept > 0.0:
                if kept_count < capacity:
                    still = Leg(x, y, z, 0.0, 0.0, 0.0)
                    write_record(records[kept_count], still, still, kept, 0.0, 0.0, 0.0)
                    orders[kept_count], paths[kept_count] = 1, p
                    types[kept_count, 0] = types[kept_count, 1] = kind
                    numbers[kept_count, 0], numbers[kept_count, 1] = origin, leg
                kept_count += 1
        wx, wy, wz = sample_lobe(3, lobes[layer], wx, wy, wz, turn, azimuth)
        joint = vertex * _lobe(lobes[layer], row, wx, wy, wz)
        density, amount = joint / scattering, scattering / joint
        entry, kind1, first_albedo = Leg(x, y, z, wx, wy, wz), kind, albedo[layer]
        cos = -(wx * row[TOWARDS] + wy * row[TOWARDS + 1] + wz * row[TOWARDS + 2])
        light *= _judged(table, kind, cos)
        backward = 0.0
        if reverse and threshold > 0.0:
            away = Leg(x, y, z, -wx, -wy, -wz)
            backward = _seen(table, kind, faces[origin], seen, origin, away)
        flight = uniforms(k0, k1, sample64, path, np.uint64(3))[0]
        flown, bounce, order = 0.0, _FACE, 1
        while True:
            layer, x, y, z, wx, wy, wz, way, bounce = fly_layers(
                indices, extinction, edges, walls, layer, (x, y, z, wx, wy, wz), minus_log(flight), key, path, bounce
            )  # fmt: skip
            if layer < 0:
                break
            if order >= last_order:
                unfinished += 1
                unfinished_weight += amount
                break
            order += 1
            events += 1
            flown += way
            keep, polar, azimuth, flight = uniforms(k0, k1, sample64, path, _EVENT + np.uint64(order))
            coin, choice, second, _ = uniforms(k0, k1, sample64, path, _MORE + np.uint64(order))
            if coin >= albedo[layer]:
                break
            kind = choose_type(table, material[layer], choice)
            last = Leg(x, y, z, wx, wy, wz)
            for leg in range(ahead[layer], ahead[layer + 1]):
                w, kept = 0.0, amount
                if threshold > 0.0:
                    w = light * _seen(table, kind, faces[leg], seen, leg, last)
                if reverse:
                    back = _start_density(starts, beam, extinction, layer, leg, x, y, z)
                    back *= _lobe(lobes[layer], lit[0, leg], -wx, -wy, -wz)
                    kept = 1.0 / (density + back / (first_albedo * extinction[layer] * square[layer]))
                    if threshold > 0.0:
                        w = max(w, backward * _seen(table, kind, faces[leg], lit, leg, last))
                if threshold > 0.0:
                    kept = survivor_weight(kept, w * kept, threshold, keep)
                if kept > 0.0:
                    if kept_count < capacity:
                        write_record(records[kept_count], entry, last, kept, flown * unit, 0.0, 0.0)
                        orders[kept_count], paths[kept_count] = order, p
                        types[kept_count, 0], types[kept_count, 1] = kind1, kind
                        numbers[kept_count, 0], numbers[kept_count, 1] = origin, leg
                    kept_count += 1
            # Below the albedo, the coin is a uniform again: it chooses the type that scatters.
            chosen = choose_type(table, material[layer], coin / albedo[layer])
            sine, cosine = sincos_turns(azimuth)
            wx, wy, wz = deflect(wx, wy, wz, sample(table, chosen, polar, second), cosine, sine)
    sort_by_path(paths, first, count, min(kept_count, capacity), found.ranks)
    return kept_count, events, unfinished, unfinished_weight


@inlined
def _lobe(g, row, wx, wy, wz):
    """Density of a first direction about the light of a row."""
    ex, ey, ez = wx + row[TOWARDS], wy + row[TOWARDS + 1], wz + row[TOWARDS + 2]
    return lobe_density(3, g, 0.5 * (ex * ex + ey * ey + ez * ez))
