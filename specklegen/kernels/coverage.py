"""Area of every pixel that a polygon covers, exactly.

An edge covers, to its right, a strip of each row that it crosses; the strip of a clockwise edge counts as positive,
that of its opposite as negative, and their sum is the area inside. Where contours overlap, what is covered twice
counts once.
"""

import math

from specklegen.kernels import inlined, kernel


@inlined
def _ramp(z):
    """Integral of the share of a pixel right of an edge: ``max(z, 0)^2 / 2``."""
    return 0.5 * z * z if z > 0.0 else 0.0


@kernel
def fill_coverage(edges, out):
    """Fill ``out`` float64[h, w] with the area of each pixel inside closed contours, 0 to 1.

    Parameters
    ----------
    edges : float64[n, 4]
        Ends (x, y), (x, y) of the edges of closed contours, in pixels: column c and row r are c <= x <= c + 1,
        r <= y <= r + 1. Contours inside others turn the other way. All within the frame, 0 to w and 0 to h.
    out : float64[h, w]
    """
    rows, columns = out.shape
    out[:] = 0.0
    for n in range(len(edges)):
        x0, y0, x1, y1 = edges[n, 0], edges[n, 1], edges[n, 2], edges[n, 3]
        if y0 == y1:
            continue
        slope = (x1 - x0) / (y1 - y0)
        sign = 1.0
        if y0 > y1:
            x0, y0, x1, y1, sign = x1, y1, x0, y0, -1.0
        for row in range(max(int(y0), 0), min(int(math.ceil(y1)), rows)):
            upper, lower = max(y0, float(row)), min(y1, row + 1.0)
            height = sign * (lower - upper)
            one, two = x0 + slope * (upper - y0), x0 + slope * (lower - y0)
            left, right = min(one, two), max(one, two)
            first = min(max(int(left), 0), columns - 1)
            last = min(max(int(right), 0), columns - 1)
            before = 0.0
            # The buffer holds differences along the row, so that what lies right of the edge costs nothing.
            for column in range(first, last + 1):
                if right - left > 1e-9:
                    here = (
                        _ramp(column + 1.0 - left) - _ramp(column + 1.0 - right)
                        - _ramp(column - left) + _ramp(column - right)
                    ) / (right - left)  # fmt: skip
                else:
                    here = min(max(column + 1.0 - 0.5 * (left + right), 0.0), 1.0)
                out[row, column] += height * (here - before)
                before = here
            if last + 1 < columns:
                out[row, last + 1] += height * (1.0 - before)
    for row in range(rows):
        total = 0.0
        for column in range(columns):
            total += out[row, column]
            out[row, column] = min(abs(total), 1.0)
