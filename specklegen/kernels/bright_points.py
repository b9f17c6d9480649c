"""Bright points of an object one by one: fields turned to the beam of each, and the power of what is seen of them."""

from specklegen.kernels import kernel


@kernel
def fill_turned(field, down, across, out):
    """Fill the first rows and columns of ``out`` complex[n, m] with a field times e^(ik i . s) of a beam i.

    field  : float[y, x, 2]
        Real and imaginary parts.
    down, across : complex[y], complex[x]
        Factors of the wave along either axis.
    """
    for y in range(len(down)):
        for x in range(len(across)):
            wave = down[y] * across[x]
            real, imaginary = field[y, x, 0], field[y, x, 1]
            out[y, x] = complex(real * wave.real - imaginary * wave.imag, real * wave.imag + imaginary * wave.real)


@kernel
def add_power(brightness, views, total):
    """Add a brightness times |view|^2 to ``total`` float[n, m], of views complex[n, m]."""
    for y in range(len(total)):
        for x in range(total.shape[1]):
            view = views[y, x]
            total[y, x] += brightness * (view.real * view.real + view.imag * view.imag)
