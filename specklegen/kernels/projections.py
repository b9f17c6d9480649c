"""The two pixel-by-pixel steps of hybrid input-output, each in one pass where array arithmetic makes many.

Fienup, Applied Optics 21, 2758 (1982): the modulus is put right, then the image where it breaks the rules.
"""

import numpy as np

from specklegen.kernels import kernel

_DARK = np.float32(1e-38)  # power at which a frequency counts as dark, so that no loop has to ask


@kernel
def _replace(here, there, modulus):
    """Put right frequencies complex64[K] and the opposite ones, in place; modulus float32[K].

    Complex numbers in contiguous rows: loops over [K, 2] become no vector loops.
    """
    for k in range(here.size):
        one, other = here[k], there[k]
        a, b = one.real + other.real, one.imag - other.imag
        c, d = one.real - other.real, one.imag + other.imag
        first = modulus[k] / np.sqrt(max(a * a + b * b, _DARK))
        second = modulus[k] / np.sqrt(max(c * c + d * d, _DARK))
        a, b, c, d = a * first, b * first, c * second, d * second
        here[k], there[k] = complex(a + c, b + d), complex(a - c, d - b)


@kernel
def replace_moduli(spectra, moduli):
    """Give two real images, the real and the imaginary part of one, the modulus wanted, their phases kept.

    Z(k) + Z*(-k) and Z(k) - Z*(-k), from the transform Z of that one image, are twice the transform of the first,
    and of the second times i: each is scaled to the modulus, and Z'(k) is their sum. 0 stays 0.

    spectra : complex64[N, n, n]      changed in place; n even
    moduli  : float32[J, n, n/2 + 1]  each for N / J consecutive spectra
    """
    side = spectra.shape[1]
    half = side // 2
    opposite = np.empty(half, spectra.dtype)
    for p in range(spectra.shape[0]):
        spectrum, modulus = spectra[p], moduli[p * moduli.shape[0] // spectra.shape[0]]
        for row in range(side):  # column 0 holds its own opposites: they are put right twice, which changes nothing
            there = spectrum[(side - row) % side]
            opposite[0] = there[0]
            for k in range(1, half):
                opposite[k] = there[side - k]
            _replace(spectrum[row, :half], opposite, modulus[row, :half])
            there[0] = opposite[0]
            for k in range(1, half):
                there[side - k] = opposite[k]
        for row in range(half + 1):
            mirrored = (side - row) % side
            opposite[0] = spectrum[mirrored, half]
            _replace(spectrum[row, half : half + 1], opposite, modulus[row, half : half + 1])
            spectrum[mirrored, half] = opposite[0]


@kernel
def feed_back(images, proposed, allowed, beta):
    """Take what is proposed where it is positive and allowed; elsewhere take ``beta`` times it off.

    images   : float32[K]   changed in place
    proposed : float32[K]
    allowed  : float32[K]   1 on the support, else 0
    beta     : float32
    """
    for k in range(images.shape[0]):
        p = proposed[k]
        kept = images[k] - beta * p
        images[k] = p if p * allowed[k] > np.float32(0) else kept
