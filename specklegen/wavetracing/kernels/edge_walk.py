"""Beams through a scene with diffraction by UTD: rays in unit counts, and rays from edges that carry weights.

A ray of a beam does what rays do. With it goes the wave that it stands for
(`specklegen.wavetracing.kernels.edge_waves`): plane from a collimated source, spherical from a point, so that the
ensemble of rays is the partially coherent light of the beams, and a point source is coherent. Edges that the ray passes
within the beam's half-width w, and that the wave lights, may send a ray; those within 2w interfere.

An edge ray leaves Q, where the ray passes nearest, on Keller's cone, at an angle phi of a density p(phi). Rays are
spread evenly, so those that pass within w send 2 w p(phi) re / (s (re + s) sin beta) edge rays through a unit of area
at P, over the light's own density at Q; where the rectangle of a source is narrower, its chord stands for 2w. The edge
ray's weight at P is what its edge adds there (`bent_power`) over that density. A receiver takes the weight at its
crossing, the next surface or edge that at theirs; there a weight below 1 is rounded to 0 or 1 by chance. Weights are
negative where light is missing: shadows, and dark fringes.

phi is drawn from a mixture: even, and 1 / (|phi - boundary| + delta) about each shadow and reflection boundary, where
1 / delta^2 = k times the largest distance of a receiver: waves near a boundary fall like that beyond their transition,
at any distance.

Source: S. Steinberg, M. Pharr, *Wave Tracing*, section on UTD; the measure of edge rays is our own.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel, returning
from specklegen.kernels.rng import uniforms
from specklegen.wavetracing.kernels import beam_state as beam
from specklegen.wavetracing.kernels import edge_waves as bent
from specklegen.wavetracing.kernels.beam_events import Light, scatter_diffusely
from specklegen.wavetracing.kernels.beam_sources import COLLIMATED, KIND, LOWER, UPPER, emit
from specklegen.wavetracing.kernels.beam_state import axes_about, leave_region, mirror
from specklegen.wavetracing.kernels.beam_walk import ABSORBED_END, ESCAPED, FAILED, RECEIVED, STOPPED, ray_hit
from specklegen.wavetracing.kernels.beam_walk import WAVE as WAVE_MODE
from specklegen.wavetracing.kernels.cone_bvh import collect_all
from specklegen.wavetracing.kernels.cones import CONE
from specklegen.wavetracing.kernels.edge_waves import (
    along,
    bent_power,
    edge_angle,
    from_the_air,
    grown,
    lights,
    local_wave,
    radius_along,
)
from specklegen.wavetracing.kernels.receivers import crossing
from specklegen.wavetracing.kernels.surfaces import ABSORBED, REFLECTED, SCATTERED, outcome, reflectance

ROOM = 128
"""Edges that one wave may meet together; a beam that meets more fails."""
# What an edge ray carries besides its beam: its edge, where it left, 1 / density without s and re.
_OWN, _AT, _SCALE, _PENDING = 0, 1, 2, 3
_EVEN = 0.1  # share of angles drawn evenly
_ONE = np.uint64(1)
# Rows of the statistics of `specklegen.wavetracing.kernels.beam_walk`: surface events, edge rays, edges and legs that
# see them, ...
_SURFACE, _EDGE_RAYS, _NEAR, _LEGS, _CROSSINGS = 0, 1, 8, 9, 10


class Passing(NamedTuple):
    """Where a ray passes an edge that may send one.

    Attributes
    ----------
    t, depth, strip, sine : float
        Length along the edge, depth along the beam, width of the strip of rays that pass so near, sine of the angle.
    among : int
        Edges that might have been chosen.
    """

    t: float
    depth: float
    strip: float
    sine: float
    among: int


class Sent(NamedTuple):
    """Arrays filled for an edge ray: its beam, its wave, what it carries; and workspace for angles float64[3]."""

    state: np.ndarray
    wave: np.ndarray
    carried: np.ndarray
    angles: np.ndarray


class Sums(NamedTuple):
    """What a walk adds to.

    Attributes
    ----------
    power, power_squares, fluence, fluence_squares : float64[cells]
        Sums of w and w^2, of w / |cos| and its square, over the crossings of receivers.
    ends, statistics : int64[ENDS], int64[STATISTICS]
        The ledger, and what happened.
    balance : float64[2]
        Weights of edge rays where they were received at last, and absorbed.
    """

    power: np.ndarray
    power_squares: np.ndarray
    fluence: np.ndarray
    fluence_squares: np.ndarray
    ends: np.ndarray
    statistics: np.ndarray
    balance: np.ndarray


@inlined
def _follow(state):
    """Put a beam's mean on its ray."""
    state[beam.CX], state[beam.CY], state[beam.CZ] = state[beam.PX], state[beam.PY], state[beam.PZ]
    state[beam.MX], state[beam.MY], state[beam.MZ] = state[beam.DX], state[beam.DY], state[beam.DZ]
    x, y, z, u, v, w = axes_about(state[beam.DX], state[beam.DY], state[beam.DZ])
    state[beam.XX], state[beam.XY], state[beam.XZ], state[beam.YX], state[beam.YY], state[beam.YZ] = x, y, z, u, v, w


@inlined
def _begin(wave, state, radius):
    """Start a local wave on the ray of a beam: plane (inf) or from a point (0)."""
    wave[bent.WX], wave[bent.WY], wave[bent.WZ] = state[beam.PX], state[beam.PY], state[beam.PZ]
    wave[bent.WDX], wave[bent.WDY], wave[bent.WDZ] = state[beam.DX], state[beam.DY], state[beam.DZ]
    x, y, z, _, _, _ = axes_about(state[beam.DX], state[beam.DY], state[beam.DZ])
    wave[bent.WEX], wave[bent.WEY], wave[bent.WEZ] = x, y, z
    wave[bent.R1] = wave[bent.R2] = radius


@inlined
def _boundaries(edge, rows, incidence, sine, materials, out):
    """Angles of shadow and reflection boundaries in the air, in ``out`` float64[3]; their number."""
    count, n = 0, edge[bent.WEDGE]
    top = n * math.pi
    if incidence + math.pi <= top:
        out[count] = incidence + math.pi
        count += 1
    elif incidence - math.pi >= 0.0:
        out[count] = incidence - math.pi
        count += 1
    cosine = abs(math.sin(incidence)) * sine
    if incidence <= math.pi and reflectance(materials, rows[0], cosine) > 0.0:
        out[count] = math.pi - incidence
        count += 1
    last = 2.0 * top - math.pi - incidence
    cosine = abs(math.sin(top - incidence)) * sine
    if 0.0 <= last <= top and reflectance(materials, rows[1], cosine) > 0.0:
        out[count] = last
        count += 1
    return count


@inlined
def _angle(u, v, top, boundaries, count, least):
    """One angle of the mixture and its density."""
    share = (1.0 - _EVEN) / count if count > 0 else 0.0
    even = 1.0 - share * count
    if u < even or count == 0:
        phi = v * top
    else:
        which = min(int((u - even) / share), count - 1)
        at = boundaries[which]
        below, above = math.log1p(at / least), math.log1p((top - at) / least)
        place = v * (below + above)
        phi = at - least * math.expm1(below - place) if place < below else at + least * math.expm1(place - below)
        phi = min(max(phi, 0.0), top)
    density = even / top
    for m in range(count):
        at = boundaries[m]
        both = math.log1p(at / least) + math.log1p((top - at) / least)
        density += share / (both * (abs(phi - at) + least))
    return phi, density


@inlined
def pass_by(state, edge):
    """Where a ray passes an edge's line: t along it, depth, offset, stretch of the cross-section there, sine."""
    ex, ey, ez = edge[bent.ALONG], edge[bent.ALONG + 1], edge[bent.ALONG + 2]
    x, y, z = along(edge, 0.0)
    x, y, z = x - state[beam.CX], y - state[beam.CY], z - state[beam.CZ]
    mx, my, mz = state[beam.MX], state[beam.MY], state[beam.MZ]
    b = mx * ex + my * ey + mz * ez
    square = max(1.0 - b * b, 1e-24)
    depth = x * mx + y * my + z * mz
    t = (b * depth - (x * ex + y * ey + z * ez)) / square
    depth += t * b
    sine = math.sqrt(square)
    nx, ny, nz = (my * ez - mz * ey) / sine, (mz * ex - mx * ez) / sine, (mx * ey - my * ex) / sine
    offset = abs(x * nx + y * ny + z * nz)
    # y of the frame is scaled by the stretch: the half-width of the ellipse along n is a over this.
    u = nx * state[beam.XX] + ny * state[beam.XY] + nz * state[beam.XZ]
    v = nx * state[beam.YX] + ny * state[beam.YY] + nz * state[beam.YZ]
    return t, depth, offset, math.sqrt(u * u + v * v), sine


@inlined
def _side(state, edge):
    """Unit vector across a ray and an edge, along which the rays of a strip lie side by side."""
    ex, ey, ez = edge[bent.ALONG], edge[bent.ALONG + 1], edge[bent.ALONG + 2]
    dx, dy, dz = state[beam.DX], state[beam.DY], state[beam.DZ]
    nx, ny, nz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
    size = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * size, ny * size, nz * size


@inlined
def _ahead(low, high, gap, rate):
    """The part of [low, high] in which gap + x rate > 0."""
    if rate > 0.0:
        low = max(low, -gap / rate)
    elif rate < 0.0:
        high = min(high, -gap / rate)
    return low, (high if gap > 0.0 or rate != 0.0 else low)


@inlined
def _chord(source, state, edge, t, width):
    """Length of the strip of parallel rays about an edge, within ``width`` to both sides and a source's rectangle.

    Rays that begin beyond the edge's point do not count: the rectangle may stand aslant.
    """
    d, n, q = (state[beam.DX], state[beam.DY], state[beam.DZ]), _side(state, edge), along(edge, t)
    flat = 0
    for c in range(3):
        if source[UPPER + c] == source[LOWER + c]:
            flat = c
    # The point of the rectangle's plane that lights Q, and the direction in the plane that is seen as n along d.
    back, tilt = (q[flat] - source[LOWER + flat]) / d[flat], n[flat] / d[flat]
    low, high = _ahead(-width, width, back, tilt)
    for c in range(3):
        if c != flat:
            at, rate = q[c] - back * d[c], n[c] - tilt * d[c]
            one, two = source[LOWER + c] - at, source[UPPER + c] - at
            if rate != 0.0:
                one, two = one / rate, two / rate
                low, high = max(low, min(one, two)), min(high, max(one, two))
            elif one > 0.0 or two < 0.0:
                return 0.0
    return max(high - low, 0.0)


@inlined
def _strip(state, edge, t, width, skip, facets):
    """Length of the strip of parallel rays about an edge, within ``width`` to both sides and ahead of a mirror."""
    if skip < 0:
        return 2.0 * width
    n, q, normal = _side(state, edge), along(edge, t), facets.normals[skip]
    p = facets.rim_ends[facets.rims[skip]]
    rate = state[beam.DX] * normal[0] + state[beam.DY] * normal[1] + state[beam.DZ] * normal[2]
    gap = ((q[0] - p[0]) * normal[0] + (q[1] - p[1]) * normal[1] + (q[2] - p[2]) * normal[2]) / rate
    tilt = (n[0] * normal[0] + n[1] * normal[1] + n[2] * normal[2]) / rate
    low, high = _ahead(-width, width, gap, tilt)
    return max(high - low, 0.0)


@returning
def edges_about(state, skip, but, wide, places, table, tree, found):
    """Numbers of the edges within twice a beam's cone, in ``found`` int64[ROOM]; their number.

    skip, but : facet and edge that the beam comes from, which send nothing; -1 for none

    Return -1 for their number if there are more than ROOM, and the list for places, which may have grown.
    """
    for c in range(CONE):
        wide[c] = state[beam.CONE_AT + c]
    wide[12], wide[13] = 2.0 * state[beam.WIDTH], 2.0 * state[beam.SLOPE]
    edges, edge_facets = table.edges, table.facets
    places, touched = collect_all(wide, 0.0, math.inf, tree, places)
    count = 0
    for n in range(touched):
        for side in range(3):
            e = table.at[places[n], side]
            if e < 0 or e == but or (skip >= 0 and (edge_facets[e, 0] == skip or edge_facets[e, 1] == skip)):
                continue
            _, depth, offset, stretch, _ = pass_by(state, edges[e])
            if not (depth > 0.0 and offset * stretch <= 2.0 * (state[beam.WIDTH] + depth * state[beam.SLOPE])):
                continue
            if count == ROOM:
                return -1, places
            found[count] = e
            count += 1
    return count, places


@kernel
def lit_edges(state, wave, skip, source, found, count, edges, facets, tree, good, passes):
    """Pick those of the first ``count`` edges ``found`` that may send a ray: their number; the edges in ``good``.

    source : float64[SOURCE] of a collimated source that the beam comes straight from, else float64[0]
    passes : float64[ROOM, 4], out: t along the edge, depth, width of the strip of rays that may, sine of the angle
    """
    accepted, normals, facet = 0, facets.normals, facets.facet
    for m in range(count):
        edge = edges[found[m]]
        t, depth, offset, stretch, sine = pass_by(state, edge)
        if not (depth > 0.0 and 0.0 < t < edge[bent.LENGTH]):
            continue
        x, y, z = along(edge, t)
        # By the wave's path, which is the same for all rays whose nearest point is Q.
        dx, dy, dz, reach, a, b = local_wave(wave, x, y, z)
        width = (state[beam.WIDTH] + reach * state[beam.SLOPE]) / stretch
        if not (offset <= width and from_the_air(edge, dx, dy, dz)):
            continue
        if lights(wave, skip, x, y, z, normals, facet, tree):
            good[accepted] = found[m]
            passes[accepted, 0], passes[accepted, 1], passes[accepted, 3] = t, depth, sine
            if source.size > 0:
                strip = _chord(source, state, edge, t, width)
            elif a == math.inf and b == math.inf:
                strip = _strip(state, edge, t, width, skip, facets)
            else:
                # Rays of a point pass a line at most as far from it as the point is.
                _, cosine = radius_along(wave, edge, dx, dy, dz, a, b)
                strip = 2.0 * min(width, min(a, b) * math.sqrt(max(1.0 - cosine * cosine, 0.0)))
            passes[accepted, 2] = strip
            accepted += 1 if strip > 0.0 else 0
    return accepted


@kernel
def send(key, path, counter, state, wave, table, chosen, passing, light, planes, materials, sent):
    """Fill what is ``sent``, a ray from the edge ``chosen``; return the counter."""
    edge, rows = table.edges[chosen], table.rows[chosen]
    t, k = passing.t, light.k
    new_state, new_wave, carried, angles = sent
    qx, qy, qz = along(edge, t)
    dx, dy, dz, _, a, b = local_wave(wave, qx, qy, qz)
    r, cosine = radius_along(wave, edge, dx, dy, dz, a, b)
    sine_wave = math.sqrt(max(1.0 - cosine * cosine, 1e-24))
    incidence = edge_angle(edge, -dx, -dy, -dz)
    farthest = 0.0
    for n in range(planes.shape[0]):
        x, y, z = planes[n, 0] - qx, planes[n, 1] - qy, planes[n, 2] - qz
        farthest = max(farthest, math.sqrt(x * x + y * y + z * z))
    limit = min(1.0 / math.sqrt(k * farthest + 1.0), 0.1)
    count = _boundaries(edge, rows, incidence, sine_wave, materials, angles)
    u, v, _, _ = uniforms(key[0], key[1], np.uint64(0), path, counter)
    phi, density = _angle(u, v, edge[bent.WEDGE] * math.pi, angles, count, limit)
    x, y = sine_wave * math.cos(phi), sine_wave * math.sin(phi)
    dx = x * edge[bent.INWARD] + y * edge[bent.NORMAL] + cosine * edge[bent.ALONG]
    dy = x * edge[bent.INWARD + 1] + y * edge[bent.NORMAL + 1] + cosine * edge[bent.ALONG + 1]
    dz = x * edge[bent.INWARD + 2] + y * edge[bent.NORMAL + 2] + cosine * edge[bent.ALONG + 2]
    size = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx * size, dy * size, dz * size
    new_state[:] = state
    leave_region(new_state, passing.depth, light.least, dx, dy, dz)
    new_state[beam.CX], new_state[beam.CY], new_state[beam.CZ] = qx, qy, qz
    new_state[beam.PX], new_state[beam.PY], new_state[beam.PZ] = qx, qy, qz
    new_state[beam.DX], new_state[beam.DY], new_state[beam.DZ] = dx, dy, dz
    new_wave[bent.WX], new_wave[bent.WY], new_wave[bent.WZ] = qx, qy, qz
    new_wave[bent.WDX], new_wave[bent.WDY], new_wave[bent.WDZ] = dx, dy, dz
    # Along the edge the wave keeps its curvature; across, it comes from the edge.
    x, y, z = edge[bent.ALONG] - cosine * dx, edge[bent.ALONG + 1] - cosine * dy, edge[bent.ALONG + 2] - cosine * dz
    size = 1.0 / math.sqrt(x * x + y * y + z * z)
    new_wave[bent.WEX], new_wave[bent.WEY], new_wave[bent.WEZ] = x * size, y * size, z * size
    new_wave[bent.R1], new_wave[bent.R2] = r, 0.0
    carried[_OWN], carried[_AT] = chosen, t
    carried[_SCALE] = passing.among * sine_wave * sine_wave / (passing.strip * density * passing.sine)
    # A ray counts one where it passes the edge; the wave at Q, farther from where it comes from, is as much weaker.
    for at in (bent.R1, bent.R2):
        if wave[at] < math.inf:
            carried[_SCALE] *= (wave[at] + passing.depth) / (a if at == bent.R1 else b)
    return counter + _ONE


@inlined
def _whole(weight, u):
    """Weight of a ray that goes on: one below 1 in size becomes 0 or 1 in size by chance, of the same mean."""
    return weight if abs(weight) >= 1.0 else (math.copysign(1.0, weight) if u < abs(weight) else 0.0)


@kernel
def _weight(state, t, last, skip, load, near_edges, count, table, k, facets, materials, tree):
    """Weight of a ray t ahead of its point: its own, or of one fresh from an edge what `bent_power` makes of it."""
    if load[_PENDING] == 0.0:
        return load[_SCALE]
    own = int(load[_OWN])
    edge, at = table.edges[own], load[_AT]
    x, y, z = along(edge, at)
    dx, dy, dz, _, a, b = local_wave(last, x, y, z)
    r, _ = radius_along(last, edge, dx, dy, dz, a, b)
    x, y = state[beam.PX] + t * state[beam.DX], state[beam.PY] + t * state[beam.DY]
    point = (x, y, state[beam.PZ] + t * state[beam.DZ])
    added = bent_power(last, skip, own, at, near_edges, count, table, k, point, facets, materials, tree)
    return load[_SCALE] * added * t / grown(r, t)


@kernel
def walk_edges(key, first, count, max_events, source, wavelength, tree, facets, table, materials, receivers, sums):
    """Walk beams; fill what receivers and the ledger count.

    table, sums : EdgeTable of `specklegen.wavetracing.kernels.edge_waves`, Sums
    The others are those of `specklegen.wavetracing.kernels.beam_walk.walk_beams`.
    """
    k0, k1 = np.uint64(key[0]), np.uint64(key[1])
    facet, normals, edges, planes = facets.facet, facets.normals, table.edges, receivers.planes
    ends, statistics, balance = sums.ends, sums.statistics, sums.balance
    k = 2.0 * math.pi / wavelength
    least = 81.0 / (4.0 * k * k)
    room = max_events + 3
    states, waves, before = np.empty((room, beam.STATE)), np.empty((room, bent.WAVE)), np.empty((room, bent.WAVE))
    carried, events_of = np.zeros((room, _PENDING + 1)), np.zeros(room, np.int64)
    sources, skips = np.empty((room, ROOM), np.int64), np.empty((room, 2), np.int64)
    counts_of = np.empty(room, np.int64)
    found, good = np.empty(ROOM, np.int64), np.empty(ROOM, np.int64)
    passes, angles = np.empty((ROOM, 4)), np.empty(3)
    wide, places = np.empty(CONE), np.empty(256, np.int64)
    flat, light = int(source[KIND]) == COLLIMATED, Light(k, least)
    for n in range(count):
        path = np.uint64(first + n)
        counter = emit(k0, k1, path, source, WAVE_MODE, k, states[0])
        _follow(states[0])
        _begin(waves[0], states[0], math.inf if flat else 0.0)
        carried[0, :], events_of[0], skips[0, 0], skips[0, 1] = 0.0, 0, -1, -1
        carried[0, _SCALE] = 1.0
        top, end, own_beam = 1, ESCAPED, True
        while top > 0:
            top -= 1
            # What is on top may be overwritten by what this ray sends: it works on the last rows.
            state, wave, last, load, near_edges = (
                states[room - 1], waves[room - 1], before[room - 1], carried[room - 1], sources[room - 1],
            )  # fmt: skip
            state[:], wave[:], last[:], load[:] = states[top], waves[top], before[top], carried[top]
            near_edges[:] = sources[top]
            near_count, events, skip, but, came_from = counts_of[top], events_of[top], skips[top, 0], skips[top, 1], -1
            if load[_PENDING] > 0.0:
                came_from, skip = skip, -1
            crossed, share, fate_known = False, 0.0, False
            while True:
                # A ray that has just left an edge meets neither of its faces again, whatever rounding says.
                one, two = (table.facets[but, 0], table.facets[but, 1]) if but >= 0 else (skip, skip)
                hit, place = ray_hit(state, one, two, facet, tree)
                for r in range(planes.shape[0]):
                    cell, t, steep = crossing(
                        state[beam.PX], state[beam.PY], state[beam.PZ], state[beam.DX], state[beam.DY], state[beam.DZ],
                        hit, planes, r,
                    )  # fmt: skip
                    if cell < 0:
                        continue
                    weight = _weight(
                        state, t, last, came_from, load, near_edges, near_count, table, k, facets, materials, tree
                    )
                    cell += receivers.first_cell[r]
                    sums.power[cell] += weight
                    sums.power_squares[cell] += weight * weight
                    sums.fluence[cell] += weight * steep
                    sums.fluence_squares[cell] += weight * weight * steep * steep
                    statistics[_CROSSINGS] += 1
                    crossed, share = True, weight
                if events < max_events and top < room - 1:
                    near, places = edges_about(state, skip, but, wide, places, table, tree, found)
                    if near < 0:
                        end, fate_known, top = FAILED, True, 0
                        break
                    accepted = lit_edges(
                        state, wave, skip, source if flat and events == 0 else source[:0], found, near, edges, facets,
                        tree, good, passes,
                    )  # fmt: skip
                    if accepted > 0:
                        statistics[_LEGS] += 1
                        statistics[_NEAR] += near
                        u, v, _, _ = uniforms(k0, k1, np.uint64(0), path, counter)
                        counter += _ONE
                        m = min(int(u * accepted), accepted - 1)
                        edge, t = edges[good[m]], passes[m, 0]
                        qx, qy, qz = along(edge, t)
                        way = (
                            (qx - state[beam.PX]) * state[beam.DX]
                            + (qy - state[beam.PY]) * state[beam.DY]
                            + (qz - state[beam.PZ]) * state[beam.DZ]
                        )
                        way = min(max(way, 0.0), hit)
                        weight = _weight(
                            state, way, last, came_from, load, near_edges, near_count, table, k, facets, materials, tree
                        )
                        weight = _whole(weight, v)
                        if weight != 0.0:
                            statistics[_EDGE_RAYS] += 1
                            passing = Passing(t, passes[m, 1], passes[m, 2], passes[m, 3], accepted)
                            sent = Sent(states[top], waves[top], carried[top], angles)
                            counter = send(
                                (k0, k1), path, counter, state, wave, table, good[m], passing, light, planes, materials,
                                sent,
                            )  # fmt: skip
                            carried[top, _SCALE] *= weight
                            carried[top, _PENDING] = 1.0
                            before[top, :], sources[top, :], counts_of[top] = wave, found, near
                            events_of[top], skips[top, 0], skips[top, 1] = events + 1, skip, good[m]
                            top += 1
                if place < 0:
                    if own_beam:
                        end = RECEIVED if crossed else ESCAPED
                    elif crossed:
                        balance[0] += share
                    break
                if events >= max_events:
                    end = STOPPED if own_beam else end
                    break
                u, v, _, _ = uniforms(k0, k1, np.uint64(0), path, counter)
                counter += _ONE
                if load[_PENDING] > 0.0:
                    weight = _weight(
                        state, hit, last, came_from, load, near_edges, near_count, table, k, facets, materials, tree
                    )
                    load[_SCALE], load[_PENDING] = _whole(weight, v), 0.0
                    if load[_SCALE] == 0.0:
                        break
                events += 1
                statistics[_SURFACE] += 1
                skip, but = facet[place], -1
                nx, ny, nz = normals[skip, 0], normals[skip, 1], normals[skip, 2]
                cosine = min(1.0, abs(state[beam.DX] * nx + state[beam.DY] * ny + state[beam.DZ] * nz))
                fate = outcome(materials, facets.material[place], cosine, u)
                if fate == ABSORBED:
                    if own_beam:
                        end = ABSORBED_END
                    else:
                        balance[1] += load[_SCALE]
                    break
                state[beam.PX] += hit * state[beam.DX]
                state[beam.PY] += hit * state[beam.DY]
                state[beam.PZ] += hit * state[beam.DZ]
                if fate == SCATTERED:
                    counter = scatter_diffusely(k0, k1, path, counter, state, hit, least, nx, ny, nz)
                    _begin(wave, state, 0.0)
                    continue
                leave_region(state, hit, least, state[beam.MX], state[beam.MY], state[beam.MZ])
                wave[bent.WX], wave[bent.WY], wave[bent.WZ] = state[beam.PX], state[beam.PY], state[beam.PZ]
                wave[bent.R1] += hit
                wave[bent.R2] += hit
                if fate == REFLECTED:
                    mirror(state, state[beam.PX], state[beam.PY], state[beam.PZ], nx, ny, nz)
                    for at in (bent.WDX, bent.WEX):
                        twice = 2.0 * (wave[at] * nx + wave[at + 1] * ny + wave[at + 2] * nz)
                        wave[at] -= twice * nx
                        wave[at + 1] -= twice * ny
                        wave[at + 2] -= twice * nz
            own_beam = False
            if fate_known:
                break
        ends[end] += 1
