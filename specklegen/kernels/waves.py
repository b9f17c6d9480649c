"""Plane waves on a grid: what the discrete transforms of any pitch are made of."""

import numpy as np

from specklegen.kernels import kernel
from specklegen.kernels.trigonometry import sincos_turns


@kernel
def fill_waves(along, across, gain, out):
    """Fill ``out`` float32/float64[n, m, 2] with gain[m] e^(2 pi i along[n] across[m]), real and imaginary parts.

    along, across : float64[n], float64[m], whose products are turns
    gain          : float64[m]
    """
    count = len(across)
    sines, cosines = np.empty(count), np.empty(count)
    for n in range(len(along)):
        for m in range(count):
            sines[m], cosines[m] = sincos_turns(along[n] * across[m])
        for m in range(count):
            out[n, m, 0] = gain[m] * cosines[m]
            out[n, m, 1] = gain[m] * sines[m]
