"""Many paths in lock step: loops over lanes, which the compiler turns into vector instructions.

A path in flight occupies a lane. The lanes' state is one flat array, quantity after quantity (LANES values each),
so that constant distances tell the compiler that writing one quantity leaves the others alone. The arithmetic is
strict (`specklegen.kernels.inlined`): a path has the same bits in any lane and in any company.
"""

import math

import numpy as np

from specklegen.kernels import inlined
from specklegen.kernels.arithmetic import fma, minus_log
from specklegen.kernels.frames import deflect
from specklegen.kernels.lobes import density_of, fisher_density, judged, sample_density, sample_fisher
from specklegen.kernels.phase_functions import sample_henyey_greenstein
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns

LANES = 128  # the state of all lanes stays in the first-level cache

# Where each quantity starts in float64[STATE]. The last vertex, the direction arriving there, the way to it.
X, Y, Z, WX, WY, WZ, FLOWN = (LANES * n for n in range(7))
# The first vertex, the direction leaving it; the path's weight W, its power there, the density it was drawn with.
X1, Y1, Z1, OX, OY, OZ, AMOUNT, POWER, DENSITY = (LANES * n for n in range(7, 16))
# Sums over the vertices behind the first one, where they are asked for: of 1 - cos theta, and of (w - w') . V, w' the
# direction that leaves; the coin of absorption.
TURNED, DOPPLER, COIN = (LANES * n for n in range(16, 19))
# Uniforms of the present step, and whether its connection may be kept.
KEEP, POLAR, AZIMUTH, FLIGHT, CANDIDATE = (LANES * n for n in range(19, 24))
# 1 - cos theta of the last scattering, or what a table is looked up for, and what stands there.
DROP, SHAPE = (LANES * n for n in range(24, 26))
STATE = 26 * LANES

# uint64[ADDRESS]: number of the path, and vertices so far.
PATH, ORDER = 0, LANES
ADDRESS = 2 * LANES

# Rows of what else the lanes hold: those of paths in flight, and of paths that wait for a lane.
FLYING, WAITING = 0, 1

ASIDE = np.uint64(0x80000000)  # dimensions of what not every walk draws lie apart
_ONE = np.uint64(1)


@inlined
def draw(key0, key1, sample, dimension, address, state, count):
    """Draw the four uniforms of every lane: for the vertex ``ORDER`` at the dimension ``ORDER + dimension``."""
    for i in range(count):
        a, b, c, d = uniforms(key0, key1, sample, address[PATH + i], address[ORDER + i] + dimension)
        state[KEEP + i], state[POLAR + i], state[AZIMUTH + i], state[FLIGHT + i] = a, b, c, d


@inlined
def draw_coin(key0, key1, sample, dimension, address, state, count):
    """Draw one more uniform of every lane."""
    for i in range(count):
        state[COIN + i] = uniforms(key0, key1, sample, address[PATH + i], address[ORDER + i] + dimension)[0]


@inlined
def propose(g, least, vx, vy, vz, depth, slope, state, count):
    """Mark the lanes whose contribution along v has an upper bound above ``least`` KEEP.

    ``depth + slope z`` is the optical depth t to the outside along v. ``e^t >= 1 + t + t^2/2 + t^3/6`` bounds without
    an exponential; squared and multiplied out, the Henyey-Greenstein power then needs neither a root nor a division.
    """
    scale = (1.0 - g * g) / (4.0 * math.pi) / least  # relative to the least, whose square may underflow
    for i in range(count):
        most = state[AMOUNT + i] * state[POWER + i] * scale
        t = fma(slope, state[Z + i], depth)
        cos = fma(state[WX + i], vx, fma(state[WY + i], vy, state[WZ + i] * vz))
        base = fma(2.0 * g, 1.0 - cos, (1.0 - g) * (1.0 - g))
        bound = state[KEEP + i] * fma(t, fma(t, fma(t, 1.0 / 6.0, 0.5), 1.0), 1.0)
        exceeds = (most * most > bound * bound * (base * base * base)) & (t < 700.0)
        state[CANDIDATE + i] = max(state[CANDIDATE + i], 1.0 if exceeds else 0.0)


@inlined
def propose_by_table(g, rows, places, least, vx, vy, vz, depth, slope, state, count):
    """Propose by a phase function of rows. The lookup is no vector loop, and stands alone."""
    for i in range(count):
        cos = fma(state[WX + i], vx, fma(state[WY + i], vy, state[WZ + i] * vz))
        state[DROP + i] = max(1.0 - cos, 0.0)
    if g > 1.0:
        for i in range(count):
            state[SHAPE + i] = fisher_density(g, state[DROP + i])
    else:
        for i in range(count):
            state[SHAPE + i] = density_of(rows, places, state[DROP + i])
    for i in range(count):
        t = fma(slope, state[Z + i], depth)
        power = state[AMOUNT + i] * state[POWER + i] / least * judged(state[SHAPE + i])
        bound = state[KEEP + i] * fma(t, fma(t, fma(t, 1.0 / 6.0, 0.5), 1.0), 1.0)
        exceeds = (power > bound) & (t < 700.0)
        state[CANDIDATE + i] = max(state[CANDIDATE + i], 1.0 if exceeds else 0.0)


@inlined
def mark_candidates(g, rows, places, least, probes, state, count):
    """Mark the lanes whose connection may have a contribution above ``least`` KEEP at any of the views."""
    for i in range(count):
        state[CANDIDATE + i] = 0.0 if least > 0.0 else 1.0
    if least > 0.0:
        for n in range(probes.shape[0]):
            vx, vy, vz, depth, slope = probes[n, 0], probes[n, 1], probes[n, 2], probes[n, 3], probes[n, 4]
            if rows.shape[0] == 0:
                propose(g, least, vx, vy, vz, depth, slope, state, count)
            else:
                propose_by_table(g, rows, places, least, vx, vy, vz, depth, slope, state, count)


@inlined
def scatter(g, state, count):
    """Turn every lane's direction by a Henyey-Greenstein angle."""
    for i in range(count):
        sine, cosine = sincos_turns(state[AZIMUTH + i])
        state[DROP + i] = one_minus_cos = sample_henyey_greenstein(g, state[POLAR + i])
        x, y, z = deflect(state[WX + i], state[WY + i], state[WZ + i], one_minus_cos, cosine, sine)
        state[WX + i], state[WY + i], state[WZ + i] = x, y, z


@inlined
def scatter_by_fisher(kappa, state, count):
    """Turn every lane's direction by a von Mises-Fisher angle."""
    for i in range(count):
        sine, cosine = sincos_turns(state[AZIMUTH + i])
        state[DROP + i] = one_minus_cos = sample_fisher(kappa, state[POLAR + i])
        x, y, z = deflect(state[WX + i], state[WY + i], state[WZ + i], one_minus_cos, cosine, sine)
        state[WX + i], state[WY + i], state[WZ + i] = x, y, z


@inlined
def scatter_by_table(rows, guide, state, count):
    """Turn every lane's direction by an angle from a table; the density of its 1 - cos is left in ``SHAPE``."""
    for i in range(count):
        state[DROP + i], state[SHAPE + i] = sample_density(rows, guide, state[POLAR + i])
    for i in range(count):
        sine, cosine = sincos_turns(state[AZIMUTH + i])
        x, y, z = deflect(state[WX + i], state[WY + i], state[WZ + i], state[DROP + i], cosine, sine)
        state[WX + i], state[WY + i], state[WZ + i] = x, y, z


@inlined
def add_turns(state, count):
    """Add 1 - cos theta of the scattering that every lane has just had to what it collects."""
    for i in range(count):
        state[TURNED + i] += state[DROP + i]


@inlined
def carried(flow, cell, x, y, z, wx, wy, wz):
    """W . V(x) of the flow in a cell: V at the origin, then its gradient, row after row."""
    vx = fma(flow[cell, 3], x, fma(flow[cell, 4], y, fma(flow[cell, 5], z, flow[cell, 0])))
    vy = fma(flow[cell, 6], x, fma(flow[cell, 7], y, fma(flow[cell, 8], z, flow[cell, 1])))
    vz = fma(flow[cell, 9], x, fma(flow[cell, 10], y, fma(flow[cell, 11], z, flow[cell, 2])))
    return fma(wx, vx, fma(wy, vy, wz * vz))


@inlined
def add_doppler(flow, sign, state, count):
    """Add ``sign`` w . V of every lane's vertex and direction to what it collects, of a flow float64[1, 12]."""
    for i in range(count):
        state[DOPPLER + i] += sign * carried(
            flow, 0, state[X + i], state[Y + i], state[Z + i], state[WX + i], state[WY + i], state[WZ + i]
        )


@inlined
def fly(mean_free_path, state, count):
    """Move every lane by a free flight along its direction."""
    for i in range(count):
        flight = minus_log(state[FLIGHT + i]) * mean_free_path
        state[X + i] = fma(state[WX + i], flight, state[X + i])
        state[Y + i] = fma(state[WY + i], flight, state[Y + i])
        state[Z + i] = fma(state[WZ + i], flight, state[Z + i])
        state[FLOWN + i] += flight


@inlined
def adopt(state, address, lane, other_state, other_address, other):
    """Put the path of another lane, here or elsewhere, into ``lane``; uniforms of the step stay behind."""
    for quantity in range(0, KEEP, LANES):
        state[quantity + lane] = other_state[quantity + other]
    address[PATH + lane] = other_address[PATH + other]
    address[ORDER + lane] = other_address[ORDER + other]


@inlined
def hand_on(beside, row, lane, other_row, other):
    """Put what another lane holds beside its state, float64[2, n LANES], into ``lane``."""
    for quantity in range(0, beside.shape[1], LANES):
        beside[row, quantity + lane] = beside[other_row, quantity + other]


@inlined
def drop_ended(state, address, count, thickness, albedo, last_order, jones, row):
    """Fill the lanes of paths that left, were absorbed or are too long with the last ones.

    jones, row : matrices of polarised light (:mod:`specklegen.kernels.jones`), and which of its rows these lanes have

    Returns (lanes still in use, paths that were too long, sum of their W).
    """
    unfinished = 0
    weight = 0.0
    lane = 0
    while lane < count:
        z = state[Z + lane]
        if z > 0.0 and z < thickness and state[COIN + lane] < albedo:
            if address[ORDER + lane] < last_order:
                lane += 1
                continue
            unfinished += 1
            weight += state[AMOUNT + lane]
        count -= 1
        adopt(state, address, lane, state, address, count)
        if jones is not None:
            hand_on(jones.carried, row, lane, row, count)
    return count, unfinished, weight


@inlined
def sort_by_path(paths, first, count, connections, ranks):
    """Fill ``ranks`` with the places of ``found`` connections in path order, those of one path as they were found."""
    begin = np.zeros(count + 1, np.int64)
    for n in range(connections):
        begin[paths[n] - first + 1] += 1
    for p in range(count):
        begin[p + 1] += begin[p]
    for n in range(connections):
        p = paths[n] - first
        ranks[begin[p]] = n
        begin[p] += 1
