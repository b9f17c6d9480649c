"""Diffraction of a beam's own field by what is open in its cross-section: one wavevector of the pattern.

The field stands on GRID x GRID cells, over six deviations of the beam's intensity each way or, where less is open, over
that: the wave times the open share of each cell (of 4 x 4 points in it). At wavevectors (m + v) 2 pi / width, v drawn
once, the sum over cells is exact, and the powers of all m add to the same for any v: a draw among them is a draw from
the pattern, without any blur. No transform of the whole is needed for it. By Parseval, the power at each x component is
the sum over rows y of the power of the row's own transform; so a row is drawn by its power, an x component from the
transform of that row, and a y component from the transform of the column of that x component. A column's entries are
transforms of rows at one wavevector: sums over the few places at which the open share changes along a row, of the wave
beyond each place.

An open share is a mean over its cell: the power of an edge at angle ``theta = pi m / GRID`` comes out as
``theta^2 (1 - 2/3 sin^2 theta) / sin^2 theta`` of itself, folded frequencies included, 0.69 at worst. Shares sharpened
by `_SHARPER` of their second differences bring it to 0.92 ... 1.11.

Beyond the grid's last wavevector Q the pattern is that of its rims alone: a rim of normal n carries
``|u|^2 / (pi q^2)`` a length and dq along n, so the share ``|u|^2 / (pi Q)`` a length of rim is drawn there,
``q = Q / uniform``. What this costs: structure below 1/16 of the half-width is smoothed where more is open, and corners
send no more than their rims.
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.rng import uniforms

GRID = 64
FINE = 4 * GRID
_MIDDLE = 0.5 * FINE - 0.5
_BITS = 64  # of a word of the fine mask
WORDS = FINE // _BITS
_NONE, _ALL, _ONE = np.uint64(0), np.uint64(2**64 - 1), np.uint64(1)
_PAIRS, _FOURS, _BYTES = np.uint64(0x5555555555555555), np.uint64(0x3333333333333333), np.uint64(0x0F0F0F0F0F0F0F0F)
_2, _4 = np.uint64(2), np.uint64(4)
_BYTE = np.uint64(255)
_FROM = np.packbits(np.triu(np.ones((FINE + 1, FINE), bool)), axis=1, bitorder="little").view("<u8")
"""Words of a row whose bits are set from a column on, uint64[FINE + 1, WORDS]."""
_PLACE = (np.arange(GRID) + 0.5) * (2.0 / GRID) - 1.0
_SHARPER = 1.0 / 24.0  # (1 + 4 / 24 sin^2)^2 takes off what the mean over a cell does, to second order
_FITS = 0.75  # of a side: what is open on less gets a grid of its own
_TWIDDLES = np.exp(-2j * np.pi * np.arange(GRID // 2) / GRID)


@kernel
def fourier(values):
    """Transform complex128[GRID] in place: sum_j values_j e^{-2 pi i j m / n}."""
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
                even, odd = values[start + m], values[start + m + half] * _TWIDDLES[m * step]
                values[start + m], values[start + m + half] = even + odd, even - odd
        size <<= 1


@inlined
def _along_side(y, ax, ay, slope, least, most):
    """Return the place of a side at y: within its ends, also if it is so flat that it has no slope."""
    x = ax + (y - ay) * slope
    return (x if x <= most else most) if x >= least else least


@kernel
def cover(fine, value, half_x, half_y, x0, y0, x1, y1, x2, y2):
    """Set the bits of ``fine`` uint64[FINE, WORDS], over |x| < half_x, |y| < half_y, whose middles a triangle holds."""
    if y0 > y1:
        x0, y0, x1, y1 = x1, y1, x0, y0
    if y1 > y2:
        x1, y1, x2, y2 = x2, y2, x1, y1
    if y0 > y1:
        x0, y0, x1, y1 = x1, y1, x0, y0
    # In cells, whose middles are whole numbers; limited before they become integers, which cannot hold everything that
    # a triangle may reach.
    scale_x, scale_y = 0.5 * FINE / half_x, 0.5 * FINE / half_y
    x0, x1, x2 = x0 * scale_x + _MIDDLE, x1 * scale_x + _MIDDLE, x2 * scale_x + _MIDDLE
    y0, y1, y2 = y0 * scale_y + _MIDDLE, y1 * scale_y + _MIDDLE, y2 * scale_y + _MIDDLE
    low, high = int(math.ceil(min(max(y0, 0.0), FINE * 1.0))), int(math.floor(max(min(y2, FINE - 1.0), -1.0)))
    if y0 == y2 or max(x0, x1, x2) < 0.0 or min(x0, x1, x2) > FINE:
        return
    whole, lower, upper = (x2 - x0) / (y2 - y0), (x1 - x0) / (y1 - y0), (x2 - x1) / (y2 - y1)
    for row in range(low, high + 1):
        y = row * 1.0
        one = _along_side(y, x0, y0, whole, min(x0, x2), max(x0, x2))
        if y < y1:
            two = _along_side(y, x0, y0, lower, min(x0, x1), max(x0, x1))
        else:
            two = _along_side(y, x1, y1, upper, min(x1, x2), max(x1, x2))
        left, right = min(one, two), max(one, two)
        first = int(math.ceil(min(max(left, 0.0), FINE * 1.0)))
        stop = int(math.floor(max(min(right, FINE - 1.0), -1.0))) + 1
        # All words alike, whether or not the span reaches them: no branch, and the four are one vector.
        for word in range(WORDS):
            bits = _FROM[first, word] & ~_FROM[stop, word]
            fine[row, word] = fine[row, word] | bits if value == 1 else fine[row, word] & ~bits


@inlined
def _fours(word):
    """Number of bits set in each four of a word."""
    word = word - ((word >> _ONE) & _PAIRS)
    return (word & _FOURS) + ((word >> _2) & _FOURS)


@kernel
def shares(fine, mask):
    """Fill ``mask`` float64[GRID, GRID] with the share of each cell that is set in ``fine``; return whether any is."""
    cells, some = _BITS // 4, _NONE
    for row in range(GRID):
        for word in range(WORDS):
            a, b, c, d = fine[4 * row, word], fine[4 * row + 1, word], fine[4 * row + 2, word], fine[4 * row + 3, word]
            some |= a | b | c | d
            if a | b | c | d == _NONE or a & b & c & d == _ALL:
                mask[row, cells * word : cells * (word + 1)] = 1.0 if a else 0.0
                continue
            a, b, c, d = _fours(a), _fours(b), _fours(c), _fours(d)
            even = (a & _BYTES) + (b & _BYTES) + (c & _BYTES) + (d & _BYTES)
            odd = ((a >> _4) & _BYTES) + ((b >> _4) & _BYTES) + ((c >> _4) & _BYTES) + ((d >> _4) & _BYTES)
            for pair in range(cells // 2):
                shift = np.uint64(8 * pair)
                mask[row, cells * word + 2 * pair] = ((even >> shift) & _BYTE) * 0.0625
                mask[row, cells * word + 2 * pair + 1] = ((odd >> shift) & _BYTE) * 0.0625
    return some != _NONE


@kernel
def fitted(fine):
    """Middle and half of what is open on a side, in halves of a side: (x, y, half_x, half_y), with a margin.

    All of it, where more than `_FITS` of both sides is open, or nothing.
    """
    low, high, left, right = FINE, -1, FINE, -1
    for row in range(FINE):
        for word in range(WORDS):
            bits = fine[row, word]
            if bits == _NONE:
                continue
            low, high = min(low, row), row
            first, last = 0, _BITS - 1
            while (bits >> np.uint64(first)) & _ONE == _NONE:
                first += 1
            while (bits >> np.uint64(last)) & _ONE == _NONE:
                last -= 1
            left, right = min(left, _BITS * word + first), max(right, _BITS * word + last)
    across, along = (right - left + 3.0) / FINE, (high - low + 3.0) / FINE
    if high < 0 or (across > _FITS and along > _FITS):
        return 0.0, 0.0, 1.0, 1.0
    margin = GRID / (GRID - 2.0)  # a cell of shade on each side
    x, y = (left + right + 1.0) / FINE - 1.0, (low + high + 1.0) / FINE - 1.0
    return x, y, across * margin, along * margin


@inlined
def _rim(mask, power_x, power_y, half_x, half_y, row, column):
    """Power beyond the grid of the rim in a cell, over that of a cell of intensity 1, its normal and its least q."""
    nx = 0.5 * (mask[row, min(column + 1, GRID - 1)] - mask[row, max(column - 1, 0)]) * GRID / (2.0 * half_x)
    ny = 0.5 * (mask[min(row + 1, GRID - 1), column] - mask[max(row - 1, 0), column]) * GRID / (2.0 * half_y)
    steep = math.sqrt(nx * nx + ny * ny)
    nx, ny = nx / steep, ny / steep
    last = math.pi * GRID / (2.0 * max(abs(nx) * half_x, abs(ny) * half_y))
    return power_y[row] * power_x[column] * steep / (math.pi * last), nx, ny, last


@kernel
def _rims(mask, power_x, power_y, half_x, half_y, target, flags):
    """Running power of the rims up to where it passes ``target``: that, and the row and column of that cell.

    flags : uint8[GRID], workspace; a row of cells is looked at by eight, most of which have no rim
    """
    total, words = 0.0, flags.view(np.uint64)
    for row in range(GRID):
        low, high = max(row - 1, 0), min(row + 1, GRID - 1)
        for column in range(1, GRID - 1):
            flags[column] = (mask[row, column - 1] != mask[row, column + 1]) | (mask[low, column] != mask[high, column])
        for column in (0, GRID - 1):
            left, right = max(column - 1, 0), min(column + 1, GRID - 1)
            flags[column] = (mask[row, left] != mask[row, right]) | (mask[low, column] != mask[high, column])
        for word in range(GRID // 8):
            if words[word] == _NONE:
                continue
            for column in range(8 * word, 8 * word + 8):
                if flags[column]:
                    total += _rim(mask, power_x, power_y, half_x, half_y, row, column)[0]
                    if total >= target:
                        return total, row, column
    return total, -1, -1


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


@inlined
def _power_of(line, power):
    for m in range(GRID):
        power[m] = line[m].real * line[m].real + line[m].imag * line[m].imag


@kernel
def _sharpen(mask, sharp):
    """Fill ``sharp`` float64[GRID, GRID] with the shares less `_SHARPER` of their second differences, on both axes."""
    for row in range(GRID):
        low, high = max(row - 1, 0), min(row + 1, GRID - 1)
        for column in range(GRID):
            here = mask[row, column]
            sharp[row, column] = here + _SHARPER * (2.0 * here - mask[low, column] - mask[high, column])
        before, here = sharp[row, 0], sharp[row, 0]
        for column in range(GRID):
            after = sharp[row, min(column + 1, GRID - 1)]
            sharp[row, column] = here + _SHARPER * (2.0 * here - before - after)
            before, here = here, after


@kernel
def _steps(mask, power_x, power_y, at, by, count, row_power):
    """List where the open share changes along each row, and the power of the rows.

    at, by    : int64, float64[GRID, GRID], out: columns of the ``count`` int64[GRID] changes of a row, and the changes
    row_power : float64[GRID], out
    """
    for row in range(GRID):
        before, found, power = 0.0, 0, 0.0
        for column in range(GRID):
            here = mask[row, column]
            if here != before:
                at[row, found], by[row, found] = column, here - before
                found += 1
                before = here
            power += here * here * power_x[column]
        count[row], row_power[row] = found, power * power_y[row]


@kernel
def _wave_along(middle, half, size, chirp, turn, wave, power):
    """Fill ``wave`` complex128[GRID] with a beam's field in the cells of one axis, and ``power`` with its square.

    middle, half : of the grid, from the beam's mean; size : where its intensity is down to six deviations
    chirp        : of the phase chirp x^2 / 2;  turn : shift of the wavevectors, in steps of them
    """
    for n in range(GRID):
        x = middle + half * _PLACE[n]
        amplitude = math.exp(-9.0 * (x / size) * (x / size))
        phase = 0.5 * chirp * x * x - math.pi * turn * _PLACE[n]
        wave[n] = complex(amplitude * math.cos(phase), amplitude * math.sin(phase))
        power[n] = amplitude * amplitude


@kernel
def draw_raster(key0, key1, path, counter, mask, window, sizes, chirps):
    """One xi of the pattern of a Gaussian beam through a mask: (x, y, counter, found or not).

    mask   : float64[GRID, GRID]   share of each cell that is open
    window : (x, y, half_x, half_y) of the grid, from the beam's mean
    sizes  : six standard deviations of the beam's intensity along both axes
    chirps : of the field ``exp(i (chirp_x x^2 + chirp_y y^2) / 2)``
    """
    middle_x, middle_y, half_x, half_y = window
    at, by, sharp = np.empty((GRID, GRID), np.int64), np.empty((GRID, GRID)), np.empty((GRID, GRID))
    across, along, line = np.empty(GRID, np.complex128), np.empty(GRID, np.complex128), np.empty(GRID, np.complex128)
    power_x, power_y, power = np.empty(GRID), np.empty(GRID), np.empty(GRID)
    count, row_power = np.empty(GRID, np.int64), np.empty(GRID)
    u, v, w, t = uniforms(key0, key1, np.uint64(0), path, counter)
    s, _, _, _ = uniforms(key0, key1, np.uint64(0), path, counter + _ONE)
    counter += _2
    _wave_along(middle_x, half_x, sizes[0], chirps[0], v - 0.5, across, power_x)
    _wave_along(middle_y, half_y, sizes[1], chirps[1], w - 0.5, along, power_y)
    _sharpen(mask, sharp)
    _steps(sharp, power_x, power_y, at, by, count, row_power)
    inner = row_power.sum()
    if not inner > 0.0:
        return 0.0, 0.0, counter, False
    flags = np.empty(GRID, np.uint8)
    rims, _, _ = _rims(mask, power_x, power_y, half_x, half_y, math.inf, flags)
    if u * (rims + inner) >= inner:
        # Its share of the rims lies below all of them, so a cell is found.
        target = min(u * (rims + inner) - inner, rims)
        _, row, column = _rims(mask, power_x, power_y, half_x, half_y, target, flags)
        _, nx, ny, last = _rim(mask, power_x, power_y, half_x, half_y, row, column)
        q = last / v if w < 0.5 else -last / v
        return q * nx, q * ny, counter, True
    row = _drawn(row_power, u * (rims + inner) / inner)
    for column in range(GRID):
        line[column] = sharp[row, column] * across[column]
    fourier(line)
    _power_of(line, power)
    chosen = _drawn(power, t)
    # What the wave, turned by this wavevector, adds up to beyond each column.
    total = complex(0.0, 0.0)
    for column in range(GRID - 1, -1, -1):
        turn = (chosen * column) % GRID
        wave = across[column] * _TWIDDLES[turn % (GRID // 2)]
        total += wave if turn < GRID // 2 else -wave
        across[column] = total
    line[:] = 0.0
    for row in range(GRID):
        value = complex(0.0, 0.0)
        for n in range(count[row]):
            value += by[row, n] * across[at[row, n]]
        line[row] = value * along[row]
    fourier(line)
    _power_of(line, power)
    row = _drawn(power, s)
    m = chosen if chosen < GRID // 2 else chosen - GRID
    n = row if row < GRID // 2 else row - GRID
    return math.pi * (m + v - 0.5) / half_x, math.pi * (n + w - 0.5) / half_y, counter, True
