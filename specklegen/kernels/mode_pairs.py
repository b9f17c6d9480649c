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
def fill_lag_sums(turned, spectra, out):
    """Fill ``out`` complex64[T or F, n, m] with the sum over pairs of two factors.

    turned  : complex64[n, T, pairs, m]
    spectra : complex64[F, pairs, n, m]; one of T and F is 1
    """
    count, tilts, pairs, width = turned.shape
    frames = len(spectra)
    for picture in range(len(out)):
        tilt, frame = min(picture, tilts - 1), min(picture, frames - 1)
        for n in range(count):
            row = out[picture, n]
            row[:] = 0.0
            for pair in range(pairs):
                one, other = turned[n, tilt, pair], spectra[frame, pair, n]
                for m in range(width):
                    row[m] += one[m] * other[m]
