"""Draws of wavevectors from the diffraction pattern of an opening, |Psi(xi)|^2, by rejection.

N waves never add to more than |sum Psi_l|^2 <= N sum |Psi_l|^2 (Cauchy), so a draw from sum |Psi_l|^2 is kept with the
probability |sum Psi_l|^2 / (N sum |Psi_l|^2) [Steinberg] Eqs. 22-25.

*Slits*: Psi_l = w_l sinc(xi w_l/2) e^{-i xi c_l + i phase_l}; a slit is drawn by its width, then xi from sinc^2 under
min(1, 1/x^2).

*Polygons*: edge terms |Psi_e|^2 = |e|^2 q^2/(p^2 + q^2)^2 sinc^2(p|e|/2), p along and q across the edge, have no
finite integral at xi = 0. Inside a disc |xi| < c the bound is A^2 instead. Outside, the integral over q of
q^2/(p^2 + q^2)^2 is 2G(p) with alpha = asin(min(1, |p|/c)),

    G = (alpha/2 + sin(2 alpha)/4) / |p| <= 1/c

so p is drawn from sinc^2(p|e|/2), kept with c G(p), and q = |p| / tan(phi), phi in [0, alpha] of density cos^2(phi).
(The complement of the angle theta of the derivation: nothing cancels at small p.)

Draw n of a stream has the address (key; sample 0, path n, dimension = a running counter), so draws do not depend on
each other or on their order.
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.rng import uniforms
from specklegen.wavetracing.kernels.apertures import polygon_transform, sinc

_TRIES = 1024
"""Tries for each wave of the sum; then the draw counts as failed."""


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


@kernel
def draw_polygon(key0, key1, first, edges, area, radius, cumulative, longest, xi, counts):
    """Fill ``xi`` float64[n, 2] with draws ``first``, ``first`` + 1, ...; NaN where every try failed.

    edges      : float64[N, 4]    midpoint and vector of each edge, about any point
    radius     : float            c, the disc of the bound A^2
    cumulative : float64[N + 1]   running sum of N E_e over the edges, then with pi c^2 A^2 for the disc
    longest, counts               as in `draw_slits`
    """
    k0, k1 = np.uint64(key0), np.uint64(key1)
    sides = edges.shape[0]
    for n in range(xi.shape[0]):
        path, counter, tries = np.uint64(first + n), np.uint64(0), 0
        xi[n, 0] = xi[n, 1] = math.nan
        while tries < _TRIES * sides:
            u, keep, v, w = uniforms(k0, k1, np.uint64(0), path, counter)
            counter += np.uint64(1)
            chosen = pick(cumulative, u)
            tries += 1
            if chosen == sides:
                r, turn = radius * math.sqrt(v), 2.0 * math.pi * w
                x, y = r * math.cos(turn), r * math.sin(turn)
                bound = area * area
            else:
                ex, ey = edges[chosen, 2], edges[chosen, 3]
                length = math.sqrt(ex * ex + ey * ey)
                p, alpha = 0.0, 0.0
                while True:
                    s, counter = draw_sinc(k0, k1, path, counter)
                    p = 2.0 * s / length
                    share = min(1.0, abs(p) / radius)
                    alpha = math.asin(share)
                    a, b, c, d = uniforms(k0, k1, np.uint64(0), path, counter)
                    counter += np.uint64(1)
                    if a * abs(p) < radius * (0.5 * alpha + 0.25 * math.sin(2.0 * alpha)):
                        break
                phi = alpha * b
                cosine = math.cos(phi)
                while c > cosine * cosine:
                    _, b, c, d = uniforms(k0, k1, np.uint64(0), path, counter)
                    counter += np.uint64(1)
                    phi = alpha * b
                    cosine = math.cos(phi)
                q = abs(p) * cosine / math.sin(phi)
                q = q if d < 0.5 else -q
                x, y = (p * ex + q * ey) / length, (p * ey - q * ex) / length
                bound = 0.0
                square = x * x + y * y
                for e in range(sides):
                    across = x * edges[e, 3] - y * edges[e, 2]
                    term = across / square * sinc(0.5 * (x * edges[e, 2] + y * edges[e, 3]))
                    bound += term * term
                bound *= sides
            value = polygon_transform(edges, area, x, y)
            if keep * bound < value.real * value.real + value.imag * value.imag:
                if _kept(xi, n, x, y, longest, counts):
                    break
        counts[0] += tries
        if xi[n, 0] != xi[n, 0]:
            counts[2] += 1


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
