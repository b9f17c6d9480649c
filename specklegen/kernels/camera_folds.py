"""Spectra folded along y before the camera's transform, and images unfolded after it.

A camera is the same on either side of its axis. So a sum over lags at all views is one over half of the lags at half of
the views:

    sum_s S(s) e^(-ivs) = sum_s>=0 [S(s) + S(-s)] cos vs - i [S(s) - S(-s)] sin vs
"""

import numpy as np

from specklegen.kernels import kernel


@kernel
def fill_folded(spectrum, turn_y, turn_x, out):
    """Fill ``out`` real[2, n / 2, P, 2, m] with S(s) + S(-s), and with S(s) - S(-s), its imaginary part first.

    spectrum : real[P, n, m, 2]
        S at the lags, along y in the order of an FFT; the largest is beyond the window.
    turn_y, turn_x : real[P, n, 2], real[P, m, 2]
        Phasors by which S is multiplied; of length 0 where there are none.
    """
    count, rows, width, _ = spectrum.shape
    up, down = np.empty((width, 2), out.dtype), np.empty((width, 2), out.dtype)
    for picture in range(count):
        for y in range(rows // 2):
            back = (rows - y) % rows
            # The two rows, turned where beams are tilted.
            if len(turn_x):
                x = turn_x[picture]
                for row, own in ((y, up), (back, down)):
                    one, wave = spectrum[picture, row], turn_y[picture, row]
                    for m in range(width):
                        real = wave[0] * x[m, 0] - wave[1] * x[m, 1]
                        imaginary = wave[0] * x[m, 1] + wave[1] * x[m, 0]
                        own[m, 0] = one[m, 0] * real - one[m, 1] * imaginary
                        own[m, 1] = one[m, 0] * imaginary + one[m, 1] * real
            else:
                up[:], down[:] = spectrum[picture, y], spectrum[picture, back]
            if y == 0:
                down[:] = 0.0
            even, odd = out[0, y, picture], out[1, y, picture]
            for m in range(width):
                even[0, m], even[1, m] = up[m, 0] + down[m, 0], up[m, 1] + down[m, 1]
                odd[1, m], odd[0, m] = up[m, 0] - down[m, 0], up[m, 1] - down[m, 1]


@kernel
def fill_unfolded(parts, out):
    """Fill ``out`` real[P, H, W] with the sums and differences that views of either sign along y and x see.

    parts : real[2, 2, y, P, x]
        Cosine and sine along x, of the even and the odd part along y, at the views of one quarter, ascending.
    """
    count, height, width = out.shape
    rows, columns = parts.shape[2], parts.shape[4]
    for y in range(rows):
        below, above = height - rows + y, rows - 1 - y
        for picture in range(count):
            p, q = parts[0, 0, y, picture], parts[0, 1, y, picture]
            r, t = parts[1, 0, y, picture], parts[1, 1, y, picture]
            one, other = out[picture, above], out[picture, below]
            for x in range(columns):
                one[columns - 1 - x] = (p[x] - q[x]) - (r[x] + t[x])
                other[columns - 1 - x] = (p[x] + q[x]) - (r[x] - t[x])
            right = width - columns
            for x in range(columns):
                one[right + x] = (p[x] - q[x]) + (r[x] + t[x])
            for x in range(columns):
                other[right + x] = (p[x] + q[x]) + (r[x] - t[x])
