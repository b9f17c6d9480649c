"""Physical optics of the cylindrical focus against multiple precision, Debye's integral and printed tables."""

import mpmath as mp
import numpy as np
import pytest
from focus_of_rays import DISTANCES, PIXELS, SIGMAS, K, axial_focus, crossing, focus, measured_csd, profile, source

from specklegen.coherence.cross_spectral_density import (
    coherent_modes,
    intensity_from_modes,
    propagate_csd,
    spectral_density,
)
from specklegen.coherence.cylindrical_focus import AxialDetector, TransverseDetector, flux_weighted_csd

# sigma_g / a: S(x)/S(0) and Re mu(0, x) at PIXELS, half width at half maximum, x of the first
# |mu| < 0.5; the same along the axis, with |mu| (frozen, by an independent program)
TRANSVERSE = {
    2: ([0.8586, 0.5296, 0.2133, 0.0474, 0.0445, 0.0194, 0.0109],
        [0.9935, 0.9685, 0.8934, 0.5573, -0.9827, -0.8226, 0.8853], 0.5183, 1.020),
    0.6: ([0.9367, 0.7701, 0.5575, 0.3589, 0.1204, 0.0480, 0.0265],
          [0.9611, 0.8424, 0.6389, 0.3478, -0.3757, -0.4920, 0.3066], 0.8140, 0.896),
    0.2: ([0.9904, 0.9620, 0.9167, 0.8570, 0.7080, 0.5442, 0.3911],
          [0.9342, 0.7513, 0.4921, 0.2131, -0.1834, -0.1834, 0.0604], 2.1274, 0.746),
}  # fmt: skip
AXIAL = {
    2: ([0.9129, 0.7015, 0.2419, 0.0871, 0.1247, 0.1087], [0.9999, 0.9996, 0.9974, 0.9955, 0.9994, 0.9993], 4.196),
    0.6: ([0.9342, 0.7739, 0.3952, 0.2030, 0.1723, 0.1477], [0.9932, 0.9721, 0.8814, 0.8305, 0.9347, 0.9369], 5.086),
    0.2: ([0.9782, 0.9276, 0.7707, 0.5965, 0.4531, 0.3532], [0.9722, 0.8934, 0.6422, 0.4670, 0.5314, 0.5740], 10.91),
}


# The printed tables
@pytest.mark.parametrize("sigma", TRANSVERSE)
def test_transverse_table(sigma):
    system = focus()
    S_table, mu_table, half_width, first_below = TRANSVERSE[sigma]
    S, mu = profile(measured_csd(system, sigma))
    np.testing.assert_allclose(S[PIXELS], S_table, atol=6e-5)  # printed to 1e-4
    np.testing.assert_allclose(np.real(mu)[PIXELS], mu_table, atol=6e-5)
    x = system.detector.x
    assert crossing(x, S, 0.5) == pytest.approx(half_width, abs=6e-5)
    assert x[100 + np.argmax(np.abs(mu[100:]) < 0.5)] == pytest.approx(first_below, abs=6e-4)


@pytest.mark.parametrize("sigma", AXIAL)
def test_axial_table(sigma):
    system = axial_focus()
    S_table, mu_table, half_width = AXIAL[sigma]
    S, mu = profile(measured_csd(system, sigma))
    np.testing.assert_allclose(S[DISTANCES], S_table, atol=6e-5)
    np.testing.assert_allclose(np.abs(mu)[DISTANCES], mu_table, atol=6e-5)
    assert crossing(system.detector.z, S, 0.5) == pytest.approx(half_width, abs=5.1e-3 if sigma == 0.2 else 6e-4)


# Independent routes, for every coherence length
def debye_csd(x, sigma, nodes=200):
    """Infinite f: every source point sends a plane wave of sine t / sqrt(4 + t^2), t = x' / a. Continuous source,
    Gauss-Legendre; the flux through the plane weighs a pair by its mean cosine."""
    t, weight = np.polynomial.legendre.leggauss(nodes)
    s0 = np.hypot(2, t)
    field = np.exp(-1j * K * np.outer(x, t / s0)) * weight * 2 / s0**1.5
    pairs = np.exp(-(((t[:, None] - t) / sigma) ** 2) / 2) * (1 / s0[:, None] + 1 / s0)
    return field @ pairs @ field.conj().T


@pytest.mark.parametrize("sigma", SIGMAS)
@pytest.mark.parametrize(("half_aperture", "n_source", "S_error", "mu_error"), [
    (15803.0, 801, 5e-7, 5e-5),  # a = 1 cm at 632.8 nm; measured 4.4e-7 and 4.3e-5, O(lambda / a) and 801 points
    (15803.0, 51, 1.2e-4, 5e-4),  # the 51 points of the paper: 1.1e-4, 4.5e-4
    (100.0, 51, 1.5e-4, None),  # mu has the curvature of a wave front of radius f, which Debye has not
])  # fmt: skip
def test_transverse_debye_limit(sigma, half_aperture, n_source, S_error, mu_error):
    system = focus(half_aperture, n_source)
    S, mu = profile(measured_csd(system, sigma))
    S_debye, mu_debye = profile(debye_csd(system.detector.x, sigma))
    np.testing.assert_allclose(S, S_debye, rtol=0, atol=S_error)
    if mu_error:  # where S vanishes mu is not robust: weigh by the amplitude
        np.testing.assert_allclose(np.abs(mu - mu_debye) * np.sqrt(S), 0, atol=mu_error)


def exact_greens(x, z, xs, f, derivative=False):
    """-2 d/dZ of the free Green's function (i/4) H0(ks), times e^{-ik s0}: Rayleigh-Sommerfeld, 30 digits."""
    with mp.workdps(30):
        k, xs = 2 * mp.pi, mp.mpf(xs)

        def free(Z):
            return mp.mpc(0, 0.25) * mp.hankel1(0, k * mp.sqrt(Z**2 + (mp.mpf(x) - xs) ** 2))

        Z, h = mp.mpf(f) + mp.mpf(z), mp.mpf("1e-6")
        if derivative:
            value = -2 * (free(Z + h) - 2 * free(Z) + free(Z - h)) / h**2
        else:
            value = -2 * (free(Z + h) - free(Z - h)) / (2 * h)
        return complex(value * mp.exp(-1j * k * mp.sqrt(mp.mpf(f) ** 2 + xs**2)))


@pytest.mark.parametrize("half_aperture", [2.0, 100.0, 15803.0])
def test_greens_function_and_derivative_against_multiple_precision(half_aperture):
    """Cancellation-free phase: at 3e4 wavelengths float64 still has 1e-12."""
    z = [0.0] if half_aperture > 1e3 else [-1.5, 0.7]
    detectors = TransverseDetector(half_width=2.5, n_pixels=4), AxialDetector(z=np.array(z), pixel_width=1.0)
    for detector in detectors:
        system = focus(half_aperture, 5).replace(detector=detector)
        for derivative in (False, True):
            G = system.physical_optics(derivative=derivative)
            for i in (0, len(detector.x) - 1):
                for j in (0, 3):
                    exact = exact_greens(detector.x[i], detector.z[i], system.source_x[j], system.focal_length,
                                         derivative)  # fmt: skip
                    # central differences: (k h)^2 / 6 = 7e-12
                    assert G[i, j] == pytest.approx(exact, rel=2e-11)


@pytest.fixture(scope="module")
def axial_oracle():
    """Exact G and dG/dZ on a continuous source (Gauss-Legendre) at the focus and the tabulated distances."""
    t, weight = np.polynomial.legendre.leggauss(36)
    z = (0.0, 1.5, 3.0, 6.0, 9.0, 12.0, 15.0)
    both = [
        np.array([[exact_greens(0, d, 100 * p, 200, derivative) for p in t] for d in z]) * weight
        for derivative in (False, True)
    ]
    return t, z, *both


@pytest.mark.parametrize("sigma", SIGMAS)
@pytest.mark.parametrize(
    ("n_source", "error"),
    [(801, 7e-6), (51, 1.6e-3)],  # measured in mu: 6.2e-6 and 1.53e-3, falling as n_source^-2
)
def test_axial_profile_against_multiple_precision(sigma, n_source, error, axial_oracle):
    t, z, G, dG = axial_oracle
    W0 = np.exp(-(((t[:, None] - t) / sigma) ** 2) / 2)
    S_exact, mu_exact = profile(flux_weighted_csd(G, dG, W0, K), centre=0)
    S, mu = profile(measured_csd(axial_focus(z, n_source), sigma), centre=0)
    np.testing.assert_allclose(S, S_exact, rtol=0, atol=error)
    np.testing.assert_allclose(mu, mu_exact, rtol=0, atol=error)


# The measurement function
@pytest.mark.parametrize("sigma", SIGMAS)
def test_flux_weight_is_nearly_the_square_root_of_cosines(sigma):
    system = focus()
    S, mu = profile(measured_csd(system, sigma))
    S_root, mu_root = profile(propagate_csd(system.physical_optics(measurement=True), source(system, sigma)))
    np.testing.assert_allclose(S_root, S, atol=1.3e-4)  # measured 1.23e-4 at sigma_g / a = 2
    np.testing.assert_allclose(mu_root, mu, atol=2.1e-3)
    bare, mu_bare = profile(propagate_csd(system.physical_optics(), source(system, sigma)))
    assert 0.0012 < np.abs(bare - S).max() < 0.0057  # what leaving it out would change
    assert 0.02 < np.abs(mu_bare - mu).max() < 0.0725


def test_flux_weighted_csd_is_the_flux():
    """Its diagonal is Im(U* dU/dZ) / k, and it is Hermitian."""
    system = focus(n_source=1)
    G, dG = system.physical_optics(), system.physical_optics(derivative=True)
    W = flux_weighted_csd(G, dG, np.ones((1, 1)), K)
    np.testing.assert_allclose(spectral_density(W), np.imag(G.conj() * dG)[:, 0] / K, rtol=1e-14)
    np.testing.assert_array_equal(W, W.conj().T)


# What a propagated cross-spectral density must be
@pytest.mark.parametrize("sigma", SIGMAS)
def test_propagated_csd_is_hermitian_positive_and_of_limited_rank(sigma):
    system = focus()
    W = propagate_csd(system.physical_optics(), source(system, sigma))
    trace = np.trace(W).real
    assert np.abs(W - W.conj().T).max() <= 1e-12 * np.abs(W).max()
    eigenvalues = np.linalg.eigvalsh(W)
    assert eigenvalues[0] >= -1e-12 * trace
    assert np.sum(eigenvalues > 1e-12 * trace) <= 51
    S = spectral_density(W)
    assert np.abs(W / np.sqrt(np.outer(S, S))).max() <= 1 + 1e-12


@pytest.mark.parametrize("sigma", SIGMAS)
def test_modes_reproduce_the_focus(sigma):
    system = focus()
    G, W0 = system.physical_optics(measurement=True), source(system, sigma)
    S = spectral_density(propagate_csd(G, W0))
    eigenvalues, modes = coherent_modes(W0, energy=1)
    np.testing.assert_allclose(intensity_from_modes(G, modes, eigenvalues), S, rtol=0, atol=1e-14 * S.max())
