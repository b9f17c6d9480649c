"""Modes of the memory effect over a lattice of beams: coefficients of K in polynomials, their factor, and its values.

The formulas are those of :mod:`specklegen.synthesis.modes`.
"""

import math

import numpy as np

from specklegen.kernels import kernel


@kernel
def fill_round_coefficients(known, rows, columns, degrees, out):
    """Fill ``out`` float64[M, N, N] with the coefficients of a K that is even along both axes.

    known : float64[M, h, w]
        K by differences (row, column), neither below 0.
    rows, columns : float64[m, m, h], float64[n, n, w]
        Correlations of two polynomials, differences of both signs together.
    degrees : int64[N, 2]
        Of each product of polynomials, along rows and columns.
    """
    side, height, width = len(rows), known.shape[1], known.shape[2]
    partial = np.empty((side, side, width))
    for medium in range(len(known)):
        # Sums over rows; products of an even and an odd polynomial have none.
        for a in range(side):
            for b in range(a, side):
                target = partial[a, b]
                target[:] = 0.0
                if (a + b) % 2 == 0:
                    for y in range(height):
                        factor, line = rows[a, b, y], known[medium, y]
                        for x in range(width):
                            target[x] += factor * line[x]
        # Sums over columns.
        for i in range(len(degrees)):
            for j in range(i + 1):
                total = 0.0
                a, b = min(degrees[i, 0], degrees[j, 0]), max(degrees[i, 0], degrees[j, 0])
                c, d = degrees[i, 1], degrees[j, 1]
                if (a + b) % 2 == 0 and (c + d) % 2 == 0:
                    line, other = partial[a, b], columns[c, d]
                    for x in range(width):
                        total += line[x] * other[x]
                out[medium, i, j] = total
                out[medium, j, i] = total


@kernel
def fill_tilt_coefficients(known, polynomials, out):
    """Fill ``out`` float64[M, N, N] with P^T K P, of K float64[M, T, T] and polynomials P float64[T, N]."""
    tilts, count = polynomials.shape
    partial = np.empty((tilts, count))
    for medium in range(len(known)):
        partial[:] = 0.0
        for t in range(tilts):
            for u in range(tilts):
                for n in range(count):
                    partial[t, n] += known[medium, t, u] * polynomials[u, n]
        out[medium] = 0.0
        for t in range(tilts):
            for m in range(count):
                for n in range(count):
                    out[medium, m, n] += polynomials[t, m] * partial[t, n]


@kernel
def fill_factors(matrices, size, jitter, tolerance, together, columns, rank, reached):
    """Fill in the kept columns of Cholesky factors first, their number, and the share that all columns reach.

    matrices : float64[M, N, N]
        Coefficients, of which the lower triangle is read.
    size : int
        Beams, the sum of K's diagonal.
    jitter, tolerance, together : float
        What is added to diagonals; share of the intensity that may be left out; ratio of the powers of two columns
        from which on they are kept together.
    columns, rank, reached : float64[M, N, N], int64[M], float64[M]
        Filled; columns beyond the rank are 0.
    """
    count = matrices.shape[1]
    factor, power, descending = np.empty((count, count)), np.empty(count), np.empty(count)
    for medium in range(len(matrices)):
        # Cholesky factor, row by row; a column that rounding leaves without a pivot is 0.
        factor[:] = 0.0
        for i in range(count):
            for j in range(i + 1):
                total = matrices[medium, i, j] + (jitter if i == j else 0.0)
                for k in range(j):
                    total -= factor[i, k] * factor[j, k]
                if i == j:
                    factor[i, i] = math.sqrt(total) if total > 0.0 else 0.0
                elif factor[j, j] > 0.0:
                    factor[i, j] = total / factor[j, j]
        # Powers of columns, and in descending order.
        whole = 0.0
        for j in range(count):
            total = 0.0
            for i in range(j, count):
                total += factor[i, j] * factor[i, j]
            power[j] = total
            whole += total
            place = j
            while place > 0 and descending[place - 1] < total:
                descending[place] = descending[place - 1]
                place -= 1
            descending[place] = total
        reached[medium] = whole / size
        # The strongest, as few as will do.
        least, kept = descending[count - 1], 0.0
        for n in range(count):
            kept += descending[n]
            following = descending[n + 1] if n + 1 < count else 0.0
            if size - kept <= tolerance * size and following <= together * descending[n]:
                least = descending[n]
                break
        columns[medium] = 0.0
        place = 0
        for j in range(count):
            if power[j] >= least:
                for i in range(j, count):
                    columns[medium, i, place] = factor[i, j]
                place += 1
        rank[medium] = place


@kernel
def fill_mode_values(basis, columns, out):
    """Fill ``out`` real[T, R, n] with modes over beams, their squares of sum 1 at each: products of basis and columns.

    basis   : float64[N, T n]
    columns : float64[N, R]
    """
    tilts, rank, pixels = out.shape
    squares = np.zeros(tilts * pixels)
    values = np.zeros((rank, tilts * pixels))
    for r in range(rank):
        mode = values[r]
        for n in range(len(basis)):
            factor = columns[n, r]
            if factor != 0.0:
                own = basis[n]
                for beam in range(len(squares)):
                    mode[beam] += factor * own[beam]
        for beam in range(len(squares)):
            squares[beam] += mode[beam] * mode[beam]
    for beam in range(len(squares)):
        squares[beam] = 1.0 / math.sqrt(squares[beam])
    for tilt in range(tilts):
        for r in range(rank):
            first = tilt * pixels
            for n in range(pixels):
                out[tilt, r, n] = values[r, first + n] * squares[first + n]
