"""The cylindrical focus that the tests of Green's functions share, and its exact rays by quadrature."""

import math
from collections.abc import Sequence

import numpy as np

from specklegen.coherence.cross_spectral_density import (
    gaussian_schell_model,
    spectral_degree_of_coherence,
    spectral_density,
)
from specklegen.coherence.cylindrical_focus import (
    AxialDetector,
    CylindricalFocus,
    TransverseDetector,
    flux_weighted_csd,
)

FALSE_ALARM = 1e-6  # chance that a right build fails a test, shared by its comparisons
SIGMAS = [2, 1, 0.6, 0.4, 0.2, 0.1]
K = 2 * np.pi
AXIS = np.linspace(-15, 15, 201)
PIXELS = [110, 120, 130, 140, 160, 180, 200]
DISTANCES = [110, 120, 140, 160, 180, 200]  # of AXIS: z = 1.5, 3, 6, 9, 12, 15


def focus(half_aperture=100.0, n_source=51, n_pixels=201, half_width=2.5):
    """The f/1 focus of the paper; a = 100 wavelengths unless said."""
    return CylindricalFocus(half_aperture=half_aperture, focal_length=2 * half_aperture, wavelength=1,
                            n_source=n_source,
                            detector=TransverseDetector(half_width=half_width, n_pixels=n_pixels))  # fmt: skip


def axial_focus(z: Sequence[float] | np.ndarray = AXIS, n_source=51):
    return focus(n_source=n_source).replace(detector=AxialDetector(z=np.array(z), pixel_width=5 / 201))


def source(system, sigma):
    return gaussian_schell_model(system.source_x / system.half_aperture, sigma)


def measured_csd(system, sigma):
    """The cross-spectral density through the measurement function."""
    G, dG = system.physical_optics(), system.physical_optics(derivative=True)
    return flux_weighted_csd(G, dG, source(system, sigma), system.wavenumber)


def profile(W, centre=100):
    S = spectral_density(W)
    return S / S[centre], spectral_degree_of_coherence(W, reference=centre)


def crossing(x, y, level):
    """First x > 0 where y falls through level, by linear interpolation from the centre on."""
    i = 101 + int(np.argmax(y[101:] < level))
    return x[i - 1] + (y[i - 1] - level) / (y[i - 1] - y[i]) * (x[i] - x[i - 1])


def quadrature(system, sampling, nodes=6):
    """Exact mean and variance of what one ray adds (range of angles times phasor), for each entry."""
    u, weight = np.polynomial.legendre.leggauss(nodes)
    u, weight = (u + 1) / 2, weight / 2
    w, d = system.detector.pixel_width, system.source_width
    f, detector = system.focal_length, system.detector
    Z = (f + detector.z)[:, None, None, None]
    low = (detector.x - w / 2)[:, None, None, None]
    xs = (system.source_x - d / 2)[None, :, None, None] + d * u[:, None]
    x = low + w * u
    s = np.sqrt(Z**2 + (x - xs) ** 2)
    angle = np.arctan((low + w - xs) / Z) - np.arctan((low - xs) / Z)
    L = w * detector.x.size / 2
    aimed = angle if sampling == "stratified" else np.arctan((L - xs) / Z) - np.arctan((-L - xs) / Z)
    integrand = np.exp(1j * system.wavenumber * (s - np.sqrt(f**2 + xs**2))) * Z / s**2 * w
    mean = np.einsum("a,b,ijab->ij", weight, weight, integrand)
    square = np.einsum("a,ijab->ij", weight, aimed * angle)
    return mean, square - np.abs(mean) ** 2


def calibration(system):
    return (
        np.exp(-0.25j * np.pi)
        * np.sqrt(system.focal_length + system.detector.z[:, None])
        / (system.detector.pixel_width)
    )


def t_values(samples, expected):
    return (samples.mean(0) - expected) * math.sqrt(len(samples)) / samples.std(0, ddof=1)
