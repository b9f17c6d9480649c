"""The two pixel-by-pixel steps of hybrid input-output, each in one pass where array arithmetic makes four.

Fienup, Applied Optics 21, 2758 (1982): the modulus is put right, then the image where it breaks the rules.
"""

import numpy as np

from specklegen.kernels import kernel


@kernel
def replace_modulus(spectra, moduli):
    """Scale every number of ``spectra`` to the modulus wanted, its phase kept; 0 stays 0.

    spectra : float32[N, K, 2]   real and imaginary parts, changed in place
    moduli  : float32[J, K]      each for N / J consecutive spectra
    """
    count = spectra.shape[0]
    for n in range(count):
        spectrum, modulus = spectra[n], moduli[n * moduli.shape[0] // count]
        for k in range(spectrum.shape[0]):
            real, imaginary = spectrum[k, 0], spectrum[k, 1]
            power = real * real + imaginary * imaginary
            scale = modulus[k] / np.sqrt(power) if power > np.float32(0) else np.float32(0)
            spectrum[k, 0], spectrum[k, 1] = real * scale, imaginary * scale


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
