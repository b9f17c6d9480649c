"""Bright points of an object: fields turned to the beam of each, the power of what is seen of them, and nodes."""

import numpy as np

from specklegen.kernels import kernel


@kernel
def fill_turned(field, down, across, out):
    """Fill the first rows and columns of ``out`` complex[n, m] with a field times e^(ik i . s) of a beam i.

    field : complex[y, x]
    down, across : complex[y], complex[x]
        Factors of the wave along either axis.
    """
    for y in range(len(down)):
        row, target, wave = field[y], out[y], down[y]
        for x in range(len(across)):
            target[x] = row[x] * (wave * across[x])


@kernel
def add_power(brightness, views, total):
    """Add a brightness times |view|^2 to ``total`` float[n, m], of views complex[n, m]."""
    for y in range(len(total)):
        for x in range(total.shape[1]):
            view = views[y, x]
            total[y, x] += brightness * (view.real * view.real + view.imag * view.imag)


_BLOCK = 1024
"""Numbers of a row that are worked on at once: they stay in the first-level cache."""


@kernel
def fill_tilt_powers(roots, views, out):
    """Fill ``out`` real[T, n] with |sum_r roots[t, r] u_r|^2 of tilts or nodes, added up over draws, in one pass.

    roots : real[T, R]
    views : real[draws, R, 2 n]
        Fields u_r, real and imaginary parts in turn.
    """
    # Two rows of roots and four modes at a time: sums are read and written once for four, modes once for two.
    rows, rank = roots.shape
    fours = rank - rank % 4
    total, other = np.empty(_BLOCK, views.dtype), np.empty(_BLOCK, views.dtype)
    out[:] = 0.0
    for first in range(0, views.shape[2], _BLOCK):
        some = min(_BLOCK, views.shape[2] - first)
        for row in range(0, rows, 2):
            also = min(row + 1, rows - 1)
            for draw in range(len(views)):
                total[:some] = 0.0
                other[:some] = 0.0
                for r in range(0, fours, 4):
                    a, b, c, d = roots[row, r], roots[row, r + 1], roots[row, r + 2], roots[row, r + 3]
                    e, f, g, h = roots[also, r], roots[also, r + 1], roots[also, r + 2], roots[also, r + 3]
                    one, two = views[draw, r, first : first + some], views[draw, r + 1, first : first + some]
                    three, four = views[draw, r + 2, first : first + some], views[draw, r + 3, first : first + some]
                    for n in range(some):
                        p, q, s, t = one[n], two[n], three[n], four[n]
                        total[n] += (a * p + b * q) + (c * s + d * t)
                        other[n] += (e * p + f * q) + (g * s + h * t)
                for r in range(fours, rank):
                    a, e, one = roots[row, r], roots[also, r], views[draw, r, first : first + some]
                    for n in range(some):
                        total[n] += a * one[n]
                        other[n] += e * one[n]
                power = out[row, first // 2 : (first + some) // 2]
                for n in range(some // 2):
                    power[n] += total[2 * n] * total[2 * n] + total[2 * n + 1] * total[2 * n + 1]
                if also > row:
                    power = out[also, first // 2 : (first + some) // 2]
                    for n in range(some // 2):
                        power[n] += other[2 * n] * other[2 * n] + other[2 * n + 1] * other[2 * n + 1]


@kernel
def fill_nodes(modes, tolerance, nodes, factor):
    """Choose nodes by pivoted Cholesky of (sum_r phi_r phi_r)^2 + 1: how many; one more than fit where they do not.

    modes  : float64[R, n]
    tolerance : float
        What may be left of the diagonal.
    nodes  : int64[most]
        Filled with their numbers.
    factor : float64[most, n]
        Filled with the rows of the factor F; F^T F is the matrix but for what is left.
    """
    rank, count = modes.shape
    left = np.zeros(count)
    for r in range(rank):
        for j in range(count):
            left[j] += modes[r, j] * modes[r, j]
    for j in range(count):
        left[j] = left[j] * left[j] + 1.0
    for found in range(len(nodes) + 1):
        best = 0
        for j in range(count):
            if left[j] > left[best]:
                best = j
        if left[best] <= tolerance or found == len(nodes):
            return found if left[best] <= tolerance else found + 1
        nodes[found] = best
        row = factor[found]
        row[:] = 0.0
        for r in range(rank):
            own = modes[r, best]
            for j in range(count):
                row[j] += own * modes[r, j]
        for j in range(count):
            row[j] = row[j] * row[j] + 1.0
        for p in range(found):
            before = factor[p]
            own = before[best]
            for j in range(count):
                row[j] -= own * before[j]
        scale = 1.0 / np.sqrt(left[best])
        for j in range(count):
            row[j] *= scale
            left[j] -= row[j] * row[j]
        left[best] = 0.0
        for p in range(found):
            row[nodes[p]] = 0.0
    return len(nodes) + 1
