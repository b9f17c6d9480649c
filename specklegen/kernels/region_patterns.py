"""Diffraction inside a beam's region: one wavevector from the pattern of what is open there.

*Uniform light*, `draw_polygon`: the pattern |Psi|^2 of straight edges, by rejection under A^2 inside the disc |xi| < c
and N sum_e |Psi_e|^2 outside [S. Steinberg, M. Pharr, *Wave Tracing*, Eqs. 22-25, and
`specklegen.kernels.patterns`]. Openings here are seen from ever new directions, so no masses are computed: edge e is
proposed under the larger envelope |e|^2 sinc^2(p|e|/2) 2/c, of mass 4 pi |e| / c, and a proposal that G(p) < 1/c turns
down starts over from the choice of the component. The draws are as exact; the tries are more, and cheap.

*Gaussian light*, `draw_raster`: the beam's own field on GRID x GRID cells over four half-widths, times the open
share of each (of 4 x 4 points in it), transformed on twice as many; a cell of wavevectors is drawn by its power, first
its x and then its y, and a place in it evenly. Beyond the grid's last wavevector Q the pattern is that of its rims
alone: a rim of normal n carries |u|^2 / (pi q^2) a length and dq along n, so the share |u|^2 / (pi Q) a length of rim
is drawn there, q = Q / uniform. What this costs: structure below 1/16 of the half-width is smoothed, variances grow by
2 % of those of the beam, and corners send no more than their rims.
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.apertures import polygon_transform, sinc
from specklegen.kernels.patterns import draw_sinc
from specklegen.kernels.rng import uniforms

TRIES = 1024
"""Tries for each edge; then the draw fails."""
GRID = 64
FINE = 4 * GRID
_PADDED = 2 * GRID
_ONES, _TOP, _BYTE = np.uint32(0x01010101), np.uint32(24), np.uint32(255)
_DISC = 3.0  # c sqrt(A): the best value lies between 2.3 and 3.5 for compact openings
_ONE = np.uint64(1)


@kernel
def draw_polygon(key0, key1, path, counter, edges, area):
    """One xi of an opening's pattern: (x, y, counter behind the draws, tries, found or not).

    edges : float64[N, 4]   midpoint and vector of each edge, all loops in one sense
    area  : float           of the opening, positive
    """
    count = edges.shape[0]
    c = _DISC / math.sqrt(area)
    total = 0.0
    for e in range(count):
        total += math.sqrt(edges[e, 2] * edges[e, 2] + edges[e, 3] * edges[e, 3])
    disc = math.pi * c * c * area * area
    rims = count * 4.0 * math.pi * total / c
    tries = 0
    while tries < TRIES * count:
        u, keep, v, w = uniforms(key0, key1, np.uint64(0), path, counter)
        counter += _ONE
        u *= disc + rims
        tries += 1
        if u < disc:
            r, turn = c * math.sqrt(v), 2.0 * math.pi * w
            x, y = r * math.cos(turn), r * math.sin(turn)
            bound = area * area
        else:
            target, chosen = (u - disc) / rims * total, 0
            length = math.sqrt(edges[0, 2] * edges[0, 2] + edges[0, 3] * edges[0, 3])
            while target > length and chosen < count - 1:
                target -= length
                chosen += 1
                length = math.sqrt(edges[chosen, 2] * edges[chosen, 2] + edges[chosen, 3] * edges[chosen, 3])
            if length == 0.0:
                continue
            s, counter = draw_sinc(key0, key1, path, counter)
            p = 2.0 * s / length
            alpha = math.asin(min(1.0, abs(p) / c))
            a, b, t, sign = uniforms(key0, key1, np.uint64(0), path, counter)
            counter += _ONE
            if a * abs(p) >= c * (0.5 * alpha + 0.25 * math.sin(2.0 * alpha)):
                continue
            phi = alpha * b
            cosine = math.cos(phi)
            while t > cosine * cosine:
                _, b, t, sign = uniforms(key0, key1, np.uint64(0), path, counter)
                counter += _ONE
                phi = alpha * b
                cosine = math.cos(phi)
            q = abs(p) * cosine / math.sin(phi)
            q = q if sign < 0.5 else -q
            ex, ey = edges[chosen, 2] / length, edges[chosen, 3] / length
            x, y = p * ex + q * ey, p * ey - q * ex
            bound, square = 0.0, x * x + y * y
            for e in range(count):
                across = x * edges[e, 3] - y * edges[e, 2]
                term = across / square * sinc(0.5 * (x * edges[e, 2] + y * edges[e, 3]))
                bound += term * term
            bound *= count
        value = polygon_transform(edges, area, x, y)
        if keep * bound < value.real * value.real + value.imag * value.imag:
            return x, y, counter, tries, True
    return 0.0, 0.0, counter, tries, False


@kernel
def draw_polygons(key0, key1, first, edges, area, xi):
    """Fill ``xi`` float64[n, 2] with draws of the paths ``first``, ...; NaN where one fails. Return the tries."""
    tries = 0
    for n in range(xi.shape[0]):
        path = np.uint64(first + n)
        x, y, _, count, found = draw_polygon(np.uint64(key0), np.uint64(key1), path, np.uint64(0), edges, area)
        xi[n, 0], xi[n, 1] = (x, y) if found else (math.nan, math.nan)
        tries += count
    return tries


@kernel
def fourier(values, twiddles):
    """Transform complex128[n], n a power of two, in place: sum_j values_j e^{-2 pi i j m / n}.

    twiddles : complex128[n / 2]   e^{-2 pi i m / n}
    """
    n = values.shape[0]
    j = 0
    for i in range(1, n):
        bit = n >> 1
        while j & bit:
            j ^= bit
            bit >>= 1
        j |= bit
        if i < j:
            values[i], values[j] = values[j], values[i]
    size = 2
    while size <= n:
        half, step = size >> 1, n // size
        for start in range(0, n, size):
            for m in range(half):
                even, odd = values[start + m], values[start + m + half] * twiddles[m * step]
                values[start + m], values[start + m + half] = even + odd, even - odd
        size <<= 1


@kernel
def cover(fine, value, half_x, half_y, x0, y0, x1, y1, x2, y2):
    """Set the cells of ``fine`` uint8[FINE, FINE], over |x| < half_x, |y| < half_y, whose middles a triangle holds."""
    pitch_x, pitch_y = 2.0 * half_x / FINE, 2.0 * half_y / FINE
    # Limited before they become integers, which cannot hold everything that a triangle may reach.
    low = int(min(max(math.ceil((min(y0, y1, y2) + half_y) / pitch_y - 0.5), 0.0), FINE * 1.0))
    high = int(max(min(math.floor((max(y0, y1, y2) + half_y) / pitch_y - 0.5), FINE - 1.0), -1.0))
    for row in range(low, high + 1):
        y = (row + 0.5) * pitch_y - half_y
        left, right = math.inf, -math.inf
        for side in range(3):
            if side == 0:
                ax, ay, bx, by = x0, y0, x1, y1
            elif side == 1:
                ax, ay, bx, by = x1, y1, x2, y2
            else:
                ax, ay, bx, by = x2, y2, x0, y0
            if (ay - y) * (by - y) <= 0.0 and ay != by:
                x = ax + (y - ay) / (by - ay) * (bx - ax)
                left, right = min(left, x), max(right, x)
        first = int(min(max(math.ceil((left + half_x) / pitch_x - 0.5), 0.0), FINE * 1.0))
        last = int(max(min(math.floor((right + half_x) / pitch_x - 0.5), FINE - 1.0), -1.0))
        for column in range(first, last + 1):
            fine[row, column] = value


@kernel
def shares(fine, mask):
    """Fill ``mask`` float64[GRID, GRID] with the share of each cell that is set in ``fine``."""
    # Four neighbours at a time: sums of four bytes that are 0 or 1 do not carry into the next byte.
    words = fine.view(np.uint32)
    for row in range(GRID):
        for column in range(GRID):
            four = words[4 * row, column] + words[4 * row + 1, column]
            four += words[4 * row + 2, column] + words[4 * row + 3, column]
            mask[row, column] = (((four * _ONES) >> _TOP) & _BYTE) * 0.0625


@inlined
def _rim(mask, half_x, half_y, row, column):
    """Power beyond the grid of the rim in a cell, over that of a cell of intensity 1, and its normal."""
    left, right = mask[row, max(column - 1, 0)], mask[row, min(column + 1, GRID - 1)]
    low, high = mask[max(row - 1, 0), column], mask[min(row + 1, GRID - 1), column]
    if left == right and low == high:
        return 0.0, 0.0, 0.0, 1.0
    pitch_x, pitch_y = 2.0 * half_x / GRID, 2.0 * half_y / GRID
    nx, ny = 0.5 * (right - left) / pitch_x, 0.5 * (high - low) / pitch_y
    steep = math.sqrt(nx * nx + ny * ny)
    nx, ny = nx / steep, ny / steep
    last = math.pi / max(abs(nx) * pitch_x, abs(ny) * pitch_y)
    x, y = (column + 0.5) * pitch_x - half_x, (row + 0.5) * pitch_y - half_y
    intensity = math.exp(-18.0 * ((x / half_x) ** 2 + (y / half_y) ** 2))
    return intensity * steep / (math.pi * last), nx, ny, last


@kernel
def _rim_power(mask, half_x, half_y):
    total = 0.0
    for row in range(GRID):
        for column in range(GRID):
            total += _rim(mask, half_x, half_y, row, column)[0]
    return total


@kernel
def _beyond(mask, half_x, half_y, target, v, w):
    """Wavevector beyond the grid, across the rim in the cell at which the running power passes ``target``."""
    x = y = 0.0
    for row in range(GRID):
        for column in range(GRID):
            power, nx, ny, last = _rim(mask, half_x, half_y, row, column)
            if power > 0.0:
                q = last / v if w < 0.5 else -last / v
                x, y = q * nx, q * ny
                target -= power
                if target <= 0.0:
                    return x, y
    return x, y


@inlined
def _drawn(weights, u):
    """Place of ``weights`` at which their running sum passes the share u of the whole; of a positive weight."""
    target, found = u * weights.sum(), 0
    for n in range(weights.shape[0]):
        if weights[n] > 0.0:
            found = n
            target -= weights[n]
            if target <= 0.0:
                break
    return found


@kernel
def draw_raster(key0, key1, path, counter, mask, half_x, half_y, chirp, padded, power, twiddles, line):
    """One xi of the pattern of a Gaussian beam through a mask: (x, y, counter, found or not).

    mask           : float64[GRID, GRID]    share of each cell that is open
    half_x, half_y : float                  half sizes of the grid, six standard deviations of the beam's intensity
    chirp          : float                  of the field exp(i chirp (x^2 + y^2) / 2)
    padded         : complex128[GRID, 2 GRID];  power : float64[2 GRID];  twiddles : complex128[GRID]
    line           : complex128[2 GRID]
    """
    pitch_x, pitch_y = 2.0 * half_x / GRID, 2.0 * half_y / GRID
    across, along = np.empty(GRID, np.complex128), np.empty(GRID, np.complex128)
    for n in range(GRID):
        # Intensity exp(-x^2 / 2 s^2), s = half / 6; amplitude its root.
        place = (n + 0.5) * (2.0 / GRID) - 1.0
        size = math.exp(-9.0 * place * place)
        x, y = 0.5 * chirp * (place * half_x) ** 2, 0.5 * chirp * (place * half_y) ** 2
        across[n] = size * complex(math.cos(x), math.sin(x))
        along[n] = size * complex(math.cos(y), math.sin(y))
    power[:] = 0.0
    for row in range(GRID):
        lit = False
        for column in range(GRID):
            lit = lit or mask[row, column] > 0.0
        if not lit:
            padded[row] = 0.0
        else:
            for column in range(GRID):
                padded[row, column] = mask[row, column] * along[row] * across[column]
            padded[row, GRID:] = 0.0
            fourier(padded[row], twiddles)
            for column in range(_PADDED):
                value = padded[row, column]
                power[column] += value.real * value.real + value.imag * value.imag
    total = power.sum()
    u, v, w, t = uniforms(key0, key1, np.uint64(0), path, counter)
    counter += _ONE
    if not total > 0.0:
        return 0.0, 0.0, counter, False
    # Parseval along rows: the spectra's power is that of their cells, times the length of a transform.
    rims, inner = _rim_power(mask, half_x, half_y), total / _PADDED
    if u * (rims + inner) >= inner:
        x, y = _beyond(mask, half_x, half_y, u * (rims + inner) - inner, v, w)
        return x, y, counter, True
    # The power at each x component is known before any transform along y: one column is transformed, that drawn.
    column = _drawn(power, u * (rims + inner) / inner)
    line[:] = 0.0
    for row in range(GRID):
        line[row] = padded[row, column]
    fourier(line, twiddles)
    for row in range(_PADDED):
        power[row] = line[row].real * line[row].real + line[row].imag * line[row].imag
    row = _drawn(power, t)
    m = column if column < GRID else column - _PADDED
    n = row if row < GRID else row - _PADDED
    x = (m + v - 0.5) * 2.0 * math.pi / (_PADDED * pitch_x)
    y = (n + w - 0.5) * 2.0 * math.pi / (_PADDED * pitch_y)
    return x, y, counter, True
