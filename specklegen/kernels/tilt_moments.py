"""Moments of noise within cells: their spectrum along the tilts, and the light that each tilt sends through them."""

import numpy as np

from specklegen.kernels import kernel


@kernel
def fill_spectrum(roots, ranks, white, start, out):
    """Fill ``out`` complex[n, Q, some] with roots times noise from cell ``start`` on; 0 where a frequency has no rank.

    roots : complex[n, Q, most]
    ranks : int64[n]
        Columns that each uses.
    white : complex[rank, cells]
        Of all frequencies, one after the other.
    """
    cells = out.shape[2]
    real = np.empty((roots.shape[2], cells), roots.real.dtype)
    imaginary = np.empty_like(real)
    sum_real, sum_imaginary = np.empty(cells, real.dtype), np.empty(cells, real.dtype)
    first = 0
    for n in range(len(ranks)):
        for r in range(ranks[n]):
            for cell in range(cells):
                noise = white[first + r, start + cell]
                real[r, cell], imaginary[r, cell] = noise.real, noise.imag
        for q in range(out.shape[1]):
            sum_real[:], sum_imaginary[:] = 0.0, 0.0
            for r in range(ranks[n]):
                a, b = roots[n, q, r].real, roots[n, q, r].imag
                for cell in range(cells):
                    sum_real[cell] += a * real[r, cell] - b * imaginary[r, cell]
                    sum_imaginary[cell] += a * imaginary[r, cell] + b * real[r, cell]
            for cell in range(cells):
                out[n, q, cell] = complex(sum_real[cell], sum_imaginary[cell])
        first += ranks[n]


@kernel
def fill_lit(noise, down, across, window, out):
    """Fill ``out`` complex[T, Qy, y, Qx, x] with moments under the window, turned to the beam of each tilt.

    noise        : complex[T, Qy, Qx, y, x]
    down, across : complex[T, y], complex[T, x]
        Phases of each tilt.
    window       : complex[y, x]
    """
    tilts, along_y, along_x, height, width = noise.shape
    wave = np.empty(width, noise.dtype)
    for t in range(tilts):
        for y in range(height):
            for x in range(width):
                wave[x] = down[t, y] * across[t, x] * window[y, x]
            for p in range(along_y):
                for q in range(along_x):
                    for x in range(width):
                        out[t, p, y, q, x] = noise[t, p, q, y, x] * wave[x]
