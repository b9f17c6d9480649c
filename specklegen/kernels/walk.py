"""Random walks through a plane slab, and the thinned connections of their vertices to the sensor.

One call traces the paths ``first`` ... ``first + count - 1``. Every random number is addressed by
(key, sample, path, dimension), so the call may be split over blocks and threads at will.

A path (physics.md 2): the first vertex lies exponentially deep along the reference direction behind a
point of the illuminated face, the first direction comes from a Henyey-Greenstein lobe about the
reference direction, then free flights and scatterings as in radiative transfer. At every vertex the
full weight w of the connection to the sensor is found, and the connection is kept with probability
min(1, w / threshold); its amplitude weight grows by the inverse probability.

A record is one kept connection, a row of float64[RECORD]:
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.geometry import deflect
from specklegen.kernels.phase_functions import henyey_greenstein, sample_henyey_greenstein
from specklegen.kernels.rng import uniforms
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
def escape_distance(z, thickness, vz):
    """Distance from depth z to the face that the direction cosine vz leads to; infinite when grazing."""
    if vz > 0.0:
        return (thickness - z) / vz
    if vz < 0.0:
        return -z / vz
    return math.inf


@inlined
def end_intensity(g, wx, wy, wz, z, thickness, sigma_t, vx, vy, vz):
    """|B_v|^2: phase function into v times power transmittance from depth z to the outside."""
    distance = escape_distance(z, thickness, vz)
    if sigma_t * distance > 700.0:
        return 0.0
    return henyey_greenstein(g, wx * vx + wy * vy + wz * vz) * math.exp(-sigma_t * distance)


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
def forward_full_weight(power, least, g, z, wx, wy, wz, probes):
    """Largest full weight over the views of a vertex that light of ``power`` reaches; 0 where it is below ``least``.

    e^t >= 1 + t + t^2/2 + t^3/6 rejects most vertices without an exponential; squared and multiplied out, the
    Henyey-Greenstein power then needs neither a root nor a division.
    """
    most = power * (1.0 - g * g) / (4.0 * math.pi)
    best = 0.0
    for n in range(probes.shape[0]):
        t = probes[n, 3] + probes[n, 4] * z
        cos = wx * probes[n, 0] + wy * probes[n, 1] + wz * probes[n, 2]
        base = (1.0 - g) * (1.0 - g) + 2.0 * g * (1.0 - cos)
        bound = least * (1.0 + t * (1.0 + t * (0.5 + t * (1.0 / 6.0))))
        if most * most > bound * bound * (base * base * base) and t < 700.0:
            best = max(best, power * henyey_greenstein(g, cos) * math.exp(-t))
    return best


@inlined
def reversed_full_weight(power, g, ox, oy, oz, z1, thickness, sigma_t, probes):
    """Largest full weight over the views of a path walked backwards, which leaves from its first vertex."""
    best = 0.0
    for n in range(probes.shape[0]):
        end = end_intensity(g, -ox, -oy, -oz, z1, thickness, sigma_t, probes[n, 0], probes[n, 1], probes[n, 2])
        best = max(best, power * end)
    return best


@kernel
def trace_slab(
    key0, key1, sample, first, count, thickness, sigma_t, albedo, g, lobe, ix, iy, iz,
    footprint, extent, radius, probes, reverse, threshold, max_order, records, orders, paths,
):  # fmt: skip
    """Trace paths and write the kept connections in path order.

    thickness, sigma_t, albedo, g : the slab (length, 1/length, -, -)
    lobe : anisotropy of the first direction's lobe about the reference direction (ix, iy, iz), iz > 0
    footprint, extent, radius : kind of beam, size of the sampled footprint and of the profile
    probes : float64[n, 5]     views at which the full weight is judged, and the optical depth to the outside
                               along each as (at z = 0, per length of z)
    reverse : 1 to weigh each path together with its reversal (balance heuristic), else 0
    threshold : full weight from which a connection is always kept; 0 keeps all
    max_order : vertices after which a path is ended
    records, orders, paths : float64[cap, RECORD], int32[cap], int64[cap]   output

    Returns (connections found, scattering events, paths ended by max_order, sum of their W); connections
    beyond the capacity are counted but not written: call again with more room.
    """
    capacity = records.shape[0]
    found = 0
    events = 0
    unfinished = 0
    unfinished_weight = 0.0
    full_depth = -math.expm1(-sigma_t * thickness / iz)  # chance to collide at all
    mean_free_path = 1.0 / sigma_t
    sample64 = np.uint64(sample)
    k0 = np.uint64(key0)
    k1 = np.uint64(key1)
    for p in range(first, first + count):
        path = np.uint64(p)
        a, b, c, d = uniforms(k0, k1, sample64, path, np.uint64(0))
        # Two words a coordinate: 32 bits alone would put wide beams on a lattice.
        fx, fy, area = sample_footprint(footprint, extent, a + (b - 0.5) * 2.0**-32, c + (d - 0.5) * 2.0**-32)
        a, b, c, d = uniforms(k0, k1, sample64, path, _ONE)
        depth = -math.log1p(-a * full_depth) / sigma_t
        z1 = min(depth * iz, thickness)
        x1 = fx + depth * ix
        y1 = fy + depth * iy
        # sigma_s / p1, where p1 = (1/area) sigma_t e^(-sigma_t depth) / full_depth / iz per volume.
        first_weight = albedo * area * iz * full_depth * math.exp(sigma_t * depth)
        # Points that only other tilts light are judged as if this one did, else they would never be kept.
        entry_beam = profile(footprint, radius, fx, fy) if footprint == GAUSSIAN else 1.0
        entry_power = entry_beam * entry_beam / iz * math.exp(-sigma_t * depth)

        # Single scattering is its own reverse and is never doubled.
        best = 0.0
        for n in range(probes.shape[0]):
            best = max(
                best,
                end_intensity(g, ix, iy, iz, z1, thickness, sigma_t, probes[n, 0], probes[n, 1], probes[n, 2]),
            )
        w = first_weight * entry_power * best
        events += 1
        if w > 0.0 and (w >= threshold or d * threshold < w):
            if found < capacity:
                kept = first_weight * (1.0 if w >= threshold else threshold / w)
                write_record(records[found], x1, y1, z1, 0.0, 0.0, 0.0, x1, y1, z1, 0.0, 0.0, 0.0, kept, 0.0)
                orders[found] = 1
                paths[found] = p
            found += 1

        sine, cosine = sincos_turns(c)
        one_minus_cos = sample_henyey_greenstein(lobe, b)
        ox, oy, oz = deflect(ix, iy, iz, one_minus_cos, cosine, sine)
        lobe_density = henyey_greenstein(lobe, 1.0 - one_minus_cos)
        forward_weight = first_weight / lobe_density
        entry_power *= henyey_greenstein(g, 1.0 - one_minus_cos)
        forward_density = lobe_density / first_weight  # p1 p_omega / sigma_s
        x, y, z = x1, y1, z1
        wx, wy, wz = ox, oy, oz
        length = 0.0
        a, b, c, d = uniforms(k0, k1, sample64, path, np.uint64(2))
        order = 1
        while True:
            flight = -math.log(d) * mean_free_path
            z += wz * flight
            if z <= 0.0 or z >= thickness:
                break
            x += wx * flight
            y += wy * flight
            length += flight
            if order == max_order:
                unfinished += 1
                unfinished_weight += forward_weight
                break
            order += 1
            events += 1
            a, b, c, d = uniforms(k0, k1, sample64, path, np.uint64(order + 1))
            if albedo < 1.0:
                # Absorption as a coin: the weight stays, the work goes. Its dimensions lie apart.
                e, _, _, _ = uniforms(k0, k1, sample64, path, np.uint64(order) + np.uint64(0x80000000))
                if e >= albedo:
                    break

            weight = forward_weight
            if reverse:
                depth_end = z / iz
                fx, fy = x - depth_end * ix, y - depth_end * iy
                back = -(wx * ix + wy * iy + wz * iz)
                passed = math.exp(-sigma_t * depth_end) / iz
                # p1 p_omega / sigma_s of the path walked backwards: the balance heuristic adds both densities.
                density = footprint_density(footprint, extent, fx, fy) * passed / (albedo * full_depth)
                weight = 1.0 / (forward_density + density * henyey_greenstein(lobe, back))
                w = forward_full_weight(weight * entry_power, 0.0, g, z, wx, wy, wz, probes)
                beam = profile(footprint, radius, fx, fy)
                power = weight * beam * beam * passed * henyey_greenstein(g, back)
                w = max(w, reversed_full_weight(power, g, ox, oy, oz, z1, thickness, sigma_t, probes))
            else:
                w = forward_full_weight(weight * entry_power, a * threshold, g, z, wx, wy, wz, probes)
            if w > 0.0 and (w >= threshold or a * threshold < w):
                if found < capacity:
                    kept = weight * (1.0 if w >= threshold else threshold / w)
                    write_record(records[found], x1, y1, z1, ox, oy, oz, x, y, z, wx, wy, wz, kept, length)
                    orders[found] = order
                    paths[found] = p
                found += 1

            sine, cosine = sincos_turns(c)
            wx, wy, wz = deflect(wx, wy, wz, sample_henyey_greenstein(g, b), cosine, sine)
    return found, events, unfinished, unfinished_weight
