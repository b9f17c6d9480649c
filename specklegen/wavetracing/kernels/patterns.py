"""Draws of wavevectors from the diffraction pattern of an opening, |Psi(xi)|^2, by rejection.

N waves never add to more than ``|sum Psi_l|^2 <= N sum |Psi_l|^2`` (Cauchy), so a draw from ``sum |Psi_l|^2`` is kept
with the probability ``|sum Psi_l|^2 / (N sum |Psi_l|^2)`` [Steinberg] Eqs. 22-25.

*Slits*: ``Psi_l = w_l sinc(xi w_l/2) e^{-i xi c_l + i phase_l}``; a slit is drawn by its width, then xi from ``sinc^2``
under ``min(1, 1/x^2)``.

*Polygons*: edge terms ``|Psi_e|^2 = |e|^2 q^2/(p^2 + q^2)^2 sinc^2(p|e|/2)``, p along and q across the edge, have no
finite integral at xi = 0. Inside a disc |xi| < c the bound is A^2 instead. Outside, the integral over q of
``q^2/(p^2 + q^2)^2`` is ``2G(p)`` with ``alpha = asin(min(1, |p|/c))``,

    G = (alpha/2 + sin(2 alpha)/4) / |p| <= 1/c

so p is drawn from ``sinc^2(p|e|/2)``, kept with ``c G(p)``, and ``q = |p| / tan(phi)``, phi in ``[0, alpha]`` of
density ``cos^2(phi)``. (The complement of the angle theta of the derivation: nothing cancels at small p.)

Draw n of a stream has the address (key; sample 0, path n, dimension = a running counter), so draws do not depend on
each other or on their order.
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.wavetracing.kernels.apertures import polygon_transform, sinc

_TRIES = 1024
"""Tries for each wave of the sum; then the draw counts as failed."""
_TURN = 0.5 / math.pi
_ONE = np.uint64(1)


@inlined
def draw_sinc(key0, key1, path, counter):
    """Return x of density sinc(x)^2 / pi, and the counter behind the draws that it took."""
    while True:
        u, v, w, _ = uniforms(key0, key1, np.uint64(0), path, counter)
        counter += np.uint64(1)
        if u < 0.5:
            x, bound = 2.0 * v - 1.0, 1.0
        else:
            x = 1.0 / v
            bound = 1.0 / (x * x)
            x = x if u < 0.75 else -x
        s = sinc(x)
        if w * bound < s * s:
            return x, counter


@inlined
def pick(cumulative, u):
    """Return the index of the interval of ``cumulative`` (rising to its last value) in which u * last lies."""
    target, low, high = u * cumulative[cumulative.size - 1], 0, cumulative.size - 1
    while low < high:
        middle = (low + high) // 2
        if cumulative[middle] <= target:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def draw_slits(key0, key1, first, widths, centres, phases, cumulative, longest, xi, counts):
    """Fill ``xi`` float64[n] with draws ``first``, ``first`` + 1, ...; NaN where every try failed.

    cumulative : float64[N]   running sum of the widths
    longest    : float        |xi| above which a draw is evanescent, and drawn again
    counts     : int64[3]     tries, evanescent draws, failures: added to
    """
    k0, k1 = np.uint64(key0), np.uint64(key1)
    slits = widths.size
    for n in range(xi.size):
        path, counter, tries = np.uint64(first + n), np.uint64(0), 0
        xi[n] = math.nan
        while tries < _TRIES * slits:
            u, keep, _, _ = uniforms(k0, k1, np.uint64(0), path, counter)
            counter += np.uint64(1)
            chosen = pick(cumulative, u)
            x, counter = draw_sinc(k0, k1, path, counter)
            x *= 2.0 / widths[chosen]
            tries += 1
            real = imag = power = 0.0
            for slit in range(slits):
                a = widths[slit] * sinc(0.5 * x * widths[slit])
                turn = phases[slit] - x * centres[slit]
                real += a * math.cos(turn)
                imag += a * math.sin(turn)
                power += a * a
            if keep * slits * power < real * real + imag * imag:
                if abs(x) > longest:
                    counts[1] += 1
                else:
                    xi[n] = x
                    break
        counts[0] += tries
        if xi[n] != xi[n]:
            counts[2] += 1


@inlined
def _kept(xi, n, x, y, longest, counts):
    """Keep a draw that is not evanescent; count one that is."""
    if x * x + y * y > longest * longest:
        counts[1] += 1
        return False
    xi[n, 0], xi[n, 1] = x, y
    return True


@inlined
def _powers(edges, x, y):
    """|sum_e Psi_e|^2 and sum_e |Psi_e|^2, both times |xi|^4, away from xi = 0, where the sum cancels."""
    real = imag = power = 0.0
    for e in range(edges.shape[0]):
        b = 0.5 * (x * edges[e, 2] + y * edges[e, 3])
        sine, _ = sincos_turns(b * _TURN)
        size = (x * edges[e, 3] - y * edges[e, 2]) * (sine / b if abs(b) > 1e-4 else 1.0 - b * b / 6.0)
        sine, cosine = sincos_turns((x * edges[e, 0] + y * edges[e, 1]) * _TURN)
        real += size * cosine
        imag += size * sine
        power += size * size
    return real * real + imag * imag, power


@inlined
def disc_radius(length, area, count):
    """Radius c of the disc, of openings of so many edges and so long a border: mean trials within a tenth of the least.

    ``0.62 length / area`` where edges are long beside ``1 / c``; where they are many and short, the least of
    ``pi c^2 A^2 + 4 pi N length / c``.
    """
    return min(0.62 * length / area, (2.0 * count * length / (area * area)) ** (1.0 / 3.0))


@kernel
def draw_polygon(key0, key1, path, counter, edges, area):
    """One xi of an opening's pattern: (x, y, counter behind the draws, trials, found or not).

    edges : float64[N, 4]   midpoint and vector of each edge, all loops in one sense
    area  : float           of the opening, positive

    Edge e is proposed under the larger envelope ``|e|^2 sinc^2(p|e|/2) 2/c``, of mass ``4 pi |e| / c``, so that no
    masses are computed; a proposal that G(p) < 1/c turns down starts over from the choice of the component, and is no
    trial.
    """
    count, length = edges.shape[0], 0.0
    for e in range(count):
        length += math.sqrt(edges[e, 2] * edges[e, 2] + edges[e, 3] * edges[e, 3])
    c = disc_radius(length, area, count)
    disc = math.pi * c * c * area * area
    rims = count * 4.0 * math.pi * length / c
    tries = 0
    for _ in range(8 * _TRIES * count):
        u, keep, v, w = uniforms(key0, key1, np.uint64(0), path, counter)
        counter += _ONE
        u *= disc + rims
        if u < disc:
            tries += 1
            r = c * math.sqrt(v)
            sine, cosine = sincos_turns(w)
            x, y = r * cosine, r * sine
            value = polygon_transform(edges, area, x, y)
            if keep * area * area < value.real * value.real + value.imag * value.imag:
                return x, y, counter, tries, True
        else:
            target, chosen = (u - disc) / rims * length, 0
            size = math.sqrt(edges[0, 2] * edges[0, 2] + edges[0, 3] * edges[0, 3])
            while target > size and chosen < count - 1:
                target -= size
                chosen += 1
                size = math.sqrt(edges[chosen, 2] * edges[chosen, 2] + edges[chosen, 3] * edges[chosen, 3])
            if size == 0.0:
                continue
            s, counter = draw_sinc(key0, key1, path, counter)
            p = 2.0 * s / size
            share = min(1.0, abs(p) / c)
            alpha = math.asin(share)
            a, b, t, sign = uniforms(key0, key1, np.uint64(0), path, counter)
            counter += _ONE
            if a * abs(p) >= c * 0.5 * (alpha + share * math.sqrt(1.0 - share * share)):
                continue
            tries += 1
            sine, cosine = sincos_turns(alpha * b * _TURN)
            while t > cosine * cosine:
                _, b, t, sign = uniforms(key0, key1, np.uint64(0), path, counter)
                counter += _ONE
                sine, cosine = sincos_turns(alpha * b * _TURN)
            q = abs(p) * cosine / sine
            q = q if sign < 0.5 else -q
            ex, ey = edges[chosen, 2] / size, edges[chosen, 3] / size
            x, y = p * ex + q * ey, p * ey - q * ex
            value, bound = _powers(edges, x, y)
            if keep * count * bound < value:
                return x, y, counter, tries, True
    return 0.0, 0.0, counter, tries, False


@kernel
def draw_polygons(key0, key1, first, edges, area, longest, xi, counts):
    """Fill ``xi`` float64[n, 2] with draws ``first``, ``first`` + 1, ... of a polygon; NaN where every try failed.

    edges, area as in `draw_polygon`, edges about any point;  longest, counts as in `draw_slits`
    """
    k0, k1 = np.uint64(key0), np.uint64(key1)
    for n in range(xi.shape[0]):
        path, counter, tries, found = np.uint64(first + n), np.uint64(0), 0, True
        xi[n, 0] = xi[n, 1] = math.nan
        while found and tries < _TRIES * edges.shape[0]:
            x, y, counter, more, found = draw_polygon(k0, k1, path, counter, edges, area)
            tries += more
            if found and _kept(xi, n, x, y, longest, counts):
                break
        counts[0] += tries
        counts[2] += xi[n, 0] != xi[n, 0]


@kernel
def draw_table(key0, key1, first, probability, alias, corners, lowest, step, longest, xi, counts):
    """Fill ``xi`` float64[n, 2] from a table of C x C cells of width ``step``, bilinearly within a cell.

    probability : float64[C * C]       that cell m stays cell m, else ``alias``[m] int64[C * C]; row y, column x
    corners     : float64[C + 1, C + 1]   density at the corners of the cells
    lowest      : float                least x, and y, of the table

    A bilinear density is a mixture of four, each rising linearly towards one corner: sqrt(v) of the way.
    """
    k0, k1 = np.uint64(key0), np.uint64(key1)
    cells, columns = probability.size, corners.shape[1] - 1
    for n in range(xi.shape[0]):
        path, counter, tries = np.uint64(first + n), np.uint64(0), 0
        xi[n, 0] = xi[n, 1] = math.nan
        while tries < _TRIES:
            u, keep, v, w = uniforms(k0, k1, np.uint64(0), path, counter)
            counter += np.uint64(1)
            tries += 1
            cell = min(int(u * cells), cells - 1)
            if keep >= probability[cell]:
                cell = alias[cell]
            row, column = cell // columns, cell % columns
            below = corners[row, column] + corners[row, column + 1]
            above = corners[row + 1, column] + corners[row + 1, column + 1]
            a, b, _, _ = uniforms(k0, k1, np.uint64(0), path, counter)
            counter += np.uint64(1)
            upper = a * (below + above) < above
            right = b * (above if upper else below) < corners[row + upper, column + 1]
            x = lowest + (column + (math.sqrt(v) if right else 1.0 - math.sqrt(v))) * step
            y = lowest + (row + (math.sqrt(w) if upper else 1.0 - math.sqrt(w))) * step
            if _kept(xi, n, x, y, longest, counts):
                break
        counts[0] += tries
        if xi[n, 0] != xi[n, 0]:
            counts[2] += 1


@kernel
def fill_alias(share, order, probability, alias):
    """Fill ``probability`` float64[M] (to stay) and ``alias`` int64[M] (to go) of Walker's method; uses ``share`` up.

    share : float64[M]   weights with the mean 1
    order : int64[M]     cells by rising share

    The largest share gives to the smallest until it is itself below 1; then it is the next to be given to.
    Source: Vose, IEEE Trans. Softw. Eng. 17, 972 (1991).
    """
    small, large, pending = 0, share.size - 1, -1
    for m in range(share.size):
        probability[m], alias[m] = 1.0, m
    while small < large or (pending >= 0 and small <= large):
        if pending >= 0:
            cell, pending = pending, -1
        else:
            cell = order[small]
            small += 1
        giver = order[large]
        if cell == giver or share[cell] >= 1.0:
            continue
        probability[cell], alias[cell] = share[cell], giver
        share[giver] -= 1.0 - share[cell]
        if share[giver] < 1.0:
            pending = giver
            large -= 1
