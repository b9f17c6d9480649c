"""Bright pixels of an object: where they are, and their autocorrelation."""

from specklegen.kernels import kernel


@kernel
def fill_extent(light, out):
    """Fill ``out`` int64[5] with the first row and column that are lit, those after the last, and how many pixels are.

    Of light real[h, w]; the first pixel where none is lit.
    """
    height, width = light.shape
    top, left, bottom, right, count = height, width, 0, 0, 0
    for y in range(height):
        for x in range(width):
            if light[y, x] != 0:
                top, left, bottom, right = min(top, y), min(left, x), y + 1, max(right, x + 1)
                count += 1
    if count == 0:
        top, left, bottom, right = 0, 0, 1, 1
    out[0], out[1], out[2], out[3], out[4] = top, left, bottom, right, count


@kernel
def fill_pairs(light, out):
    """Fill ``out`` float64[h, 2 w - 1] with sums of products of pixels of ``light`` float64[h, w].

    Of pixels so many rows apart, 0 or more, and so many columns less w - 1.
    """
    height, width = light.shape
    out[:] = 0.0
    for y in range(height):
        for x in range(width):
            own = light[y, x]
            if own != 0:
                first = width - 1 - x
                for below in range(y, height):
                    row, target = light[below], out[below - y]
                    for n in range(width):
                        target[first + n] += own * row[n]
