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


@kernel
def fill_powers(fields, out):
    """Fill ``out`` float[k, n] with |u|^2, added up over draws, of fields complex[draws, k, n]."""
    draws, count, points = fields.shape
    for node in range(count):
        row = out[node]
        for draw in range(draws):
            values = fields[draw, node]
            if draw == 0:
                for n in range(points):
                    row[n] = values[n].real * values[n].real + values[n].imag * values[n].imag
            else:
                for n in range(points):
                    row[n] += values[n].real * values[n].real + values[n].imag * values[n].imag


_BLOCK = 1024
"""Numbers of a row that are worked on at once: they stay in the first-level cache."""


@kernel
def fill_tilt_powers(roots, views, out):
    """Fill ``out`` real[T, n] with |sum_r roots[t, r] u_r|^2, added up over draws: of few modes in one pass.

    roots : real[T, R]
    views : real[draws, R, 2 n]
        Fields u_r, real and imaginary parts in turn.
    """
    total = np.empty(_BLOCK, views.dtype)
    out[:] = 0.0
    for first in range(0, views.shape[2], _BLOCK):
        some = min(_BLOCK, views.shape[2] - first)
        for tilt in range(len(roots)):
            row = out[tilt, first // 2 : (first + some) // 2]
            for draw in range(len(views)):
                total[:some] = 0.0
                for r in range(roots.shape[1]):
                    factor, own = roots[tilt, r], views[draw, r, first : first + some]
                    for n in range(some):
                        total[n] += factor * own[n]
                for n in range(some // 2):
                    row[n] += total[2 * n] * total[2 * n] + total[2 * n + 1] * total[2 * n + 1]


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
