"""Random phases of connections, and the direct sum of fields behind a slab.

    u(t, v) = sum_m sqrt(W_m) z_m A_t(m) B_v(m)                                  [Bar19] Eqs. 13, 38

A_t and B_v are the endpoint factors of :mod:`specklegen.kernels.endpoints`; where many views look at a slab of
Henyey-Greenstein particles, B_v is found and summed here in one pass. Single scattering couples both ends in s(i . v),
which is the same for all connections: the caller multiplies it on (``single`` = 1).
"""

import math

import numpy as np

from specklegen.kernels import ROOM, inlined, kernel
from specklegen.kernels.arithmetic import exponential, fma
from specklegen.kernels.phase_functions import amplitude
from specklegen.kernels.rng import uniforms
from specklegen.kernels.slab_steps import Leg
from specklegen.kernels.trigonometry import TAU, sincos_turns
from specklegen.kernels.walk import EXIT, EXIT_DIRECTION

TOGETHER = 4  # connections whose ends are added to the sums of a tilt in one pass


@kernel
def random_phases(key0, key1, sample, orders, paths, out):
    """Fill ``out`` complex128[M] with e^(2 pi i zeta), zeta addressed by (path, order)."""
    for m in range(out.shape[0]):
        u, _, _, _ = uniforms(
            np.uint64(key0), np.uint64(key1), np.uint64(sample), np.uint64(paths[m]), np.uint64(orders[m])
        )
        sine, cosine = sincos_turns(u)
        out[m] = complex(cosine, sine)


@inlined
def gather(records, first, count, column, width, out, start):
    """Copy ``width`` columns of some records to ``out``, one behind the other, ROOM values each."""
    for m in range(count):
        for c in range(width):
            out[start + c * ROOM + m] = records[first + m, column + c]


@kernel
def grid_points(records, pitch, slope_x, slope_y, offset, y, x, out):
    """Exits as a transform onto a grid of views needs them, projected along the grid's mode 0.

    pitch : grid pitch over the wavelength, turns per unit length
    slope_x, slope_y : lateral step per depth of mode 0
    offset : float64[3]   (mode 0 - v_ref) / wavelength
    y, x : float32/float64[M]   filled with 2 pi times the turns a step of the grid, within half a turn
    out : complex128[M]   filled with the phasor of mode 0
    """
    for m in range(records.shape[0]):
        ex, ey, ez = records[m, EXIT], records[m, EXIT + 1], records[m, EXIT + 2]
        tx, ty = (ex - slope_x * ez) * pitch, (ey - slope_y * ez) * pitch
        x[m] = TAU * (tx - np.rint(tx))
        y[m] = TAU * (ty - np.rint(ty))
        sine, cosine = sincos_turns(ex * offset[0] + ey * offset[1] + ez * offset[2])
        out[m] = complex(cosine, -sine)


@inlined
def way_out(vz, thickness, sigma_t):
    """(z of the face that vz leads to, d log|B| per length of depth from there); grazing light leaves nothing."""
    if vz == 0.0:
        return thickness, -math.inf
    return thickness if vz > 0.0 else 0.0, -0.5 * sigma_t / vz


@inlined
def sensor_end(single, g, leg, vx, vy, vz, ax, ay, az, face, decay):
    """B_v of one connection, real and imaginary part: attenuation, scattering into v, phase."""
    modulus = exponential((face - leg.z) * decay)
    if not single:
        modulus *= amplitude(g, fma(leg.wx, vx, fma(leg.wy, vy, leg.wz * vz)))
    sine, cosine = sincos_turns(fma(ax, leg.x, fma(ay, leg.y, az * leg.z)))
    return modulus * cosine, -modulus * sine


@kernel
def direct_sum(records, single, g, sigma_t, thickness, ends, directions, offsets, out):
    """Add sum_m ends[t, m] B_v(m) to ``out`` complex128[V, T], in the order of the connections.

    The inner loops run over ROOM views at a time, side by side; each tilt has a row of sums of its own, for a loop
    whose index might be negative, as the compiler would fear of one long array, is no vector loop.

    ends : complex128[M, T]      factor sqrt(W) A, connection by connection
    directions, offsets : float64[V, 3]   views v, and (v - v_ref) / wavelength in turns per unit length
    """
    tilts = ends.shape[1]
    views = np.empty(8 * ROOM)
    end = np.empty(2 * TOGETHER * ROOM)
    rows = end.reshape(TOGETHER, 2 * ROOM)
    sums = np.empty((tilts, 2 * ROOM))
    whole = records.shape[0] - records.shape[0] % TOGETHER
    for first in range(0, directions.shape[0], ROOM):
        count = min(ROOM, directions.shape[0] - first)
        gather(directions, first, count, 0, 3, views, 0)
        gather(offsets, first, count, 0, 3, views, 3 * ROOM)
        for v in range(count):
            views[6 * ROOM + v], views[7 * ROOM + v] = way_out(views[2 * ROOM + v], thickness, sigma_t)
        sums[:] = 0.0
        for m in range(0, whole, TOGETHER):
            for k in range(TOGETHER):
                ends_of_views(records[m + k], single, g, views, rows[k], count)
            for t in range(tilts):
                add_four(ends[m, t], ends[m + 1, t], ends[m + 2, t], ends[m + 3, t], end, sums[t], count)
        for m in range(whole, records.shape[0]):
            ends_of_views(records[m], single, g, views, rows[0], count)
            for t in range(tilts):
                add_one(ends[m, t], end, sums[t], count)
        for v in range(count):
            for t in range(tilts):
                out[first + v, t] += complex(sums[t, v], sums[t, ROOM + v])


@inlined
def ends_of_views(record, single, g, views, out, count):
    """Fill ``out`` with B_v of one connection at the views of :func:`direct_sum`, real parts before imaginary ones."""
    x, y, z = record[EXIT], record[EXIT + 1], record[EXIT + 2]
    wx, wy, wz = record[EXIT_DIRECTION], record[EXIT_DIRECTION + 1], record[EXIT_DIRECTION + 2]
    leg = Leg(x, y, z, wx, wy, wz)
    for v in range(count):
        out[v], out[ROOM + v] = sensor_end(
            single, g, leg, views[v], views[ROOM + v], views[2 * ROOM + v],
            views[3 * ROOM + v], views[4 * ROOM + v], views[5 * ROOM + v], views[6 * ROOM + v], views[7 * ROOM + v],
        )  # fmt: skip


@inlined
def add_one(z, end, sums, count):
    """Add z times every end to the sums."""
    for v in range(count):
        a, b = end[v], end[ROOM + v]
        sums[v] = fma(z.real, a, fma(-z.imag, b, sums[v]))
        sums[ROOM + v] = fma(z.real, b, fma(z.imag, a, sums[ROOM + v]))


@inlined
def add_four(z0, z1, z2, z3, end, sums, count):
    """Add the products of four connections in their order: the bits of four calls of :func:`add_one`, in one pass."""
    for v in range(count):
        x, y = sums[v], sums[ROOM + v]
        a, b = end[v], end[ROOM + v]
        x, y = fma(z0.real, a, fma(-z0.imag, b, x)), fma(z0.real, b, fma(z0.imag, a, y))
        a, b = end[2 * ROOM + v], end[3 * ROOM + v]
        x, y = fma(z1.real, a, fma(-z1.imag, b, x)), fma(z1.real, b, fma(z1.imag, a, y))
        a, b = end[4 * ROOM + v], end[5 * ROOM + v]
        x, y = fma(z2.real, a, fma(-z2.imag, b, x)), fma(z2.real, b, fma(z2.imag, a, y))
        a, b = end[6 * ROOM + v], end[7 * ROOM + v]
        x, y = fma(z3.real, a, fma(-z3.imag, b, x)), fma(z3.real, b, fma(z3.imag, a, y))
        sums[v], sums[ROOM + v] = x, y
