"""Pairs of modes: products of modes over an object, of fields, and of their spectra with transforms of the object.

What is added up stays in the first-level cache, a row of the grid at a time.
"""

import numpy as np

from specklegen.kernels import kernel


@kernel
def fill_mode_maps(modes, light, out):
    """Fill ``out`` real[h, T, R(R+1)/2, w] with O phi_r phi_q, twice for r < q.

    modes : real[T, R, h * w]
    light : real[h, w]
    """
    tilts, rank, _ = modes.shape
    height, width = light.shape
    for y in range(height):
        for tilt in range(tilts):
            pair = 0
            for r in range(rank):
                for q in range(r, rank):
                    one = modes[tilt, r, y * width : (y + 1) * width]
                    other = modes[tilt, q, y * width : (y + 1) * width]
                    row = out[y, tilt, pair]
                    twice = light.dtype.type(1 if q == r else 2)
                    for x in range(width):
                        row[x] = twice * (one[x] * other[x] * light[y, x])
                    pair += 1


@kernel
def fill_pair_products(views, out):
    """Fill ``out`` float32[R(R+1)/2, y, x] with Re u_r u_q* for r <= q, added up over draws.

    views : float32[draws, R, y, x, 2]
        Fields, real and imaginary parts.
    """
    draws, rank, height, width, _ = views.shape
    out[:] = 0.0
    real, imaginary = np.empty((rank, width), views.dtype), np.empty((rank, width), views.dtype)
    for y in range(height):
        for draw in range(draws):
            for r in range(rank):
                for x in range(width):
                    real[r, x] = views[draw, r, y, x, 0]
                    imaginary[r, x] = views[draw, r, y, x, 1]
            pair = 0
            for r in range(rank):
                for q in range(r, rank):
                    for x in range(width):
                        out[pair, y, x] += real[r, x] * real[q, x] + imaginary[r, x] * imaginary[q, x]
                    pair += 1


@kernel
def fill_halves(maps, rows, columns, halves, down, across):
    """Fold maps about their middle (row, column), and fill the cosines and sines that transform what is left of them.

    maps    : real[h, k, w]
    rows    : complex[n, h]
        Waves of the maps' rows at the lags, evenly spaced.
    columns : complex[w, m]
    halves  : real[2, 2, Y, k, X]
        Parts that are even and odd along x, and along y, by the distance from the middle: ``Y = h // 2 + 1`` rows
        and ``X = w // 2 + 1`` columns.
    down    : real[2, n / 2, Y]
        Cosines and sines of rows.
    across  : real[2, X, m]
    """
    height, count, width = maps.shape
    middle, centre = height // 2, width // 2
    zero = maps.dtype.type(0)
    for y in range(middle + 1):
        below = middle + y < height
        for k in range(count):
            up = maps[middle - y, k]
            other = maps[middle + y, k] if below else up
            one = maps.dtype.type(1) if below and y > 0 else zero
            for x in range(centre + 1):
                left, lower = up[centre - x], one * other[centre - x]
                right = up[centre + x] if 0 < x < width - centre else zero
                last = one * other[centre + x] if 0 < x < width - centre else zero
                halves[0, 0, y, k, x] = (left + right) + (lower + last)
                halves[1, 0, y, k, x] = (right - left) + (last - lower)
                halves[0, 1, y, k, x] = (lower + last) - (left + right)
                halves[1, 1, y, k, x] = (last - lower) - (right - left)
    for n in range(down.shape[1]):
        for y in range(middle + 1):
            wave = rows[n, y] * rows[n, 0].conjugate()
            down[0, n, y], down[1, n, y] = wave.real, wave.imag
    for x in range(centre + 1):
        for m in range(across.shape[2]):
            wave = columns[x, m] * columns[0, m].conjugate()
            across[0, x, m], across[1, x, m] = wave.real, wave.imag


@kernel
def fill_lag_sums(turned, spectra, first, out):
    """Fill some rows of ``out`` complex[T or F, n, m] with the sum over pairs of two factors, and their mirror images.

    turned  : real[2, rows, 2, T, pairs, m]
        Of lags ``first`` and on along y, sums over cosines and sines along y, then x. C c - S s + i (S c + C s) is the
        factor at each, C c + S s + i (C s - S c) that at its negative.
    spectra : complex[F, pairs, n, m]; one of T and F is 1
    """
    _, rows, _, tilts, pairs, width = turned.shape
    frames, count = len(spectra), out.shape[1]
    for picture in range(len(out)):
        tilt, frame = min(picture, tilts - 1), min(picture, frames - 1)
        for row in range(rows):
            y = first + row
            back = (count - y) % count
            one, other = out[picture, y], out[picture, back]
            one[:] = 0.0
            other[:] = 0.0
            for pair in range(pairs):
                cc, cs = turned[0, row, 0, tilt, pair], turned[0, row, 1, tilt, pair]
                sc, ss = turned[1, row, 0, tilt, pair], turned[1, row, 1, tilt, pair]
                spectrum = spectra[frame, pair, back]
                if y != 0:  # which is its own negative
                    for m in range(width):
                        other[m] += complex(cc[m] + ss[m], cs[m] - sc[m]) * spectrum[m]
                spectrum = spectra[frame, pair, y]
                for m in range(width):
                    one[m] += complex(cc[m] - ss[m], cs[m] + sc[m]) * spectrum[m]


@kernel
def turn(down, across, out):
    """Multiply ``out`` complex[P, n, m] by waves complex[n], complex[m] along either axis."""
    for picture in range(len(out)):
        for y in range(len(down)):
            row = out[picture, y]
            for m in range(len(across)):
                row[m] *= down[y] * across[m]
