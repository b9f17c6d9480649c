"""Windows over cells of the exit plane: their powers, the lags between their cells, and white fields under them."""

import math

import numpy as np

from specklegen.kernels import kernel
from specklegen.kernels.rng import fill_normals
from specklegen.kernels.trigonometry import sincos_turns


@kernel
def fill_window_powers(width, count, size, gaussian, out):
    """Fill ``out`` float64[M, n] with b^2 over ``count`` cells of one axis, of sum 1; 0 beyond them.

    Of square windows cells that an edge cuts count by their share inside, of Gaussian ones by their centre.

    width, size : float64[M]
        Of the window, and between cells.
    count : int64[M]
    """
    for medium in range(len(width)):
        side, apart, cells, row = width[medium], size[medium], count[medium], out[medium]
        row[:] = 0.0
        total = 0.0
        for n in range(cells):
            position = (n - 0.5 * (cells - 1)) * apart
            if gaussian:
                row[n] = math.exp(-8.0 * (position / side) * (position / side))
            else:
                upper = min(position + 0.5 * apart, 0.5 * side)
                row[n] = max(upper - max(position - 0.5 * apart, -0.5 * side), 0.0)
            total += row[n]
        for n in range(cells):
            row[n] /= total


@kernel
def fill_lag_transforms(power, size, wavevector, pixel, out):
    """Fill ``out`` float64[M, d] with the sums over lags s of A(s) a(s)^2 cos(kappa s), kappa of d differences.

    A is the autocorrelation of ``power`` float64[M, n] over cells, a the transform of a pixel's area.

    size, wavevector, pixel : float64[M]
        Between cells; between object pixels; side of a camera pixel over the wavelength.
    """
    most = power.shape[1]
    pairs, waves = np.empty(most), np.empty(most)
    for medium in range(len(power)):
        row, apart = power[medium], size[medium]
        cells = most
        while cells > 1 and row[cells - 1] == 0.0:
            cells -= 1
        for lag in range(cells):
            total = 0.0
            for n in range(cells - lag):
                total += row[n] * row[n + lag]
            angle = math.pi * (pixel[medium] * (lag * apart))
            area = math.sin(angle) / angle if angle != 0.0 else 1.0
            pairs[lag] = (total if lag == 0 else 2.0 * total) * (area * area)  # lags of either sign
        turn = wavevector[medium] * apart / (2.0 * math.pi)
        for difference in range(out.shape[1]):
            step = difference * turn
            for lag in range(cells):
                _, waves[lag] = sincos_turns(step * lag)
            total = 0.0
            for lag in range(cells):
                total += waves[lag] * pairs[lag]
            out[medium, difference] = total


@kernel
def fill_fields(keys, sample, still, window, out):
    """Fill the first cells of ``out`` real[F, R, y, x, 2] with white fields under a window, frame after frame.

    keys   : int64[F, 2]
        Of the noise of every frame.
    sample : int
    still  : float
        Correlation of one frame with the next.
    window : real[y, x]
        Amplitude over the cells; the fields lie on as many of ``out``.
    """
    frames, rank = out.shape[:2]
    height, width = window.shape
    real = window.dtype.type
    root, share, rest = real(math.sqrt(0.5)), real(still), real(math.sqrt(1.0 - still * still))
    drawn = np.empty((rank * height * width, 2), window.dtype)
    for frame in range(frames):
        fill_normals(keys[frame, 0], keys[frame, 1], sample, drawn)
        for r in range(rank):
            for y in range(height):
                first, row = (r * height + y) * width, out[frame, r, y]
                for x in range(width):
                    amplitude = window[y, x] * root
                    row[x, 0], row[x, 1] = drawn[first + x, 0] * amplitude, drawn[first + x, 1] * amplitude
                if frame > 0:
                    before = out[frame - 1, r, y]
                    for x in range(width):
                        row[x, 0] = rest * row[x, 0] + share * before[x, 0]
                        row[x, 1] = rest * row[x, 1] + share * before[x, 1]
