"""The cylindrical focus against multiple-precision optics, quadrature of the rays, and printed tables."""

import math
from collections.abc import Sequence
from typing import Literal

import mpmath as mp
import numpy as np
import pytest
from scipy.special import hankel1e
from scipy.stats import t as student

from specklegen.coherence import (
    coherent_modes,
    gaussian_schell_model,
    intensity_from_modes,
    propagate_csd,
    sample_fields,
    spectral_degree_of_coherence,
    spectral_density,
)
from specklegen.greens import (
    AxialDetector,
    CylindricalFocus,
    GreensMatrix,
    TransverseDetector,
    flux_weighted_csd,
)

FALSE_ALARM = 1e-6  # chance that a right build fails a test, shared by its comparisons
SIGMAS = [2, 1, 0.6, 0.4, 0.2, 0.1]
K = 2 * np.pi
AXIS = np.linspace(-15, 15, 201)
PIXELS = [110, 120, 130, 140, 160, 180, 200]
DISTANCES = [110, 120, 140, 160, 180, 200]  # of AXIS: z = 1.5, 3, 6, 9, 12, 15

# sigma_g / a: S(x)/S(0) and Re mu(0, x) at PIXELS, half width at half maximum, x of the first
# |mu| < 0.5; the same along the axis, with |mu| (design document, A5: an independent program)
TRANSVERSE = {
    2: (
        [0.8586, 0.5296, 0.2133, 0.0474, 0.0445, 0.0194, 0.0109],
        [0.9935, 0.9685, 0.8934, 0.5573, -0.9827, -0.8226, 0.8853],
        0.5183,
        1.020,
    ),
    0.6: (
        [0.9367, 0.7701, 0.5575, 0.3589, 0.1204, 0.0480, 0.0265],
        [0.9611, 0.8424, 0.6389, 0.3478, -0.3757, -0.4920, 0.3066],
        0.8140,
        0.896,
    ),
    0.2: (
        [0.9904, 0.9620, 0.9167, 0.8570, 0.7080, 0.5442, 0.3911],
        [0.9342, 0.7513, 0.4921, 0.2131, -0.1834, -0.1834, 0.0604],
        2.1274,
        0.746,
    ),
}
AXIAL = {
    2: (
        [0.9129, 0.7015, 0.2419, 0.0871, 0.1247, 0.1087],
        [0.9999, 0.9996, 0.9974, 0.9955, 0.9994, 0.9993],
        4.196,
    ),
    0.6: (
        [0.9342, 0.7739, 0.3952, 0.2030, 0.1723, 0.1477],
        [0.9932, 0.9721, 0.8814, 0.8305, 0.9347, 0.9369],
        5.086,
    ),
    0.2: (
        [0.9782, 0.9276, 0.7707, 0.5965, 0.4531, 0.3532],
        [0.9722, 0.8934, 0.6422, 0.4670, 0.5314, 0.5740],
        10.91,
    ),
}


def focus(half_aperture=100.0, n_source=51, n_pixels=201, half_width=2.5):
    """The f/1 focus of the paper; a = 100 wavelengths unless said."""
    return CylindricalFocus(
        half_aperture=half_aperture,
        focal_length=2 * half_aperture,
        wavelength=1,
        n_source=n_source,
        detector=TransverseDetector(half_width=half_width, n_pixels=n_pixels),
    )


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
    assert crossing(system.detector.z, S, 0.5) == pytest.approx(
        half_width, abs=5.1e-3 if sigma == 0.2 else 6e-4
    )


# Independent routes, for every coherence length


def debye_csd(x, sigma, nodes=200):
    """Infinite f: every source point sends a plane wave of sine t / sqrt(4 + t^2), t = x' / a.

    Continuous source, Gauss-Legendre; the flux through the plane weighs a pair by its mean cosine.
    """
    t, weight = np.polynomial.legendre.leggauss(nodes)
    s0 = np.hypot(2, t)
    field = np.exp(-1j * K * np.outer(x, t / s0)) * weight * 2 / s0**1.5
    pairs = np.exp(-(((t[:, None] - t) / sigma) ** 2) / 2) * (1 / s0[:, None] + 1 / s0)
    return field @ pairs @ field.conj().T


@pytest.mark.parametrize("sigma", SIGMAS)
@pytest.mark.parametrize(
    ("half_aperture", "n_source", "S_error", "mu_error"),
    [
        (
            15803.0,
            801,
            5e-7,
            5e-5,
        ),  # a = 1 cm at 632.8 nm; measured 4.4e-7 and 4.3e-5, O(lambda / a) and 801 points
        (15803.0, 51, 1.2e-4, 5e-4),  # the 51 points of the paper: 1.1e-4, 4.5e-4
        (100.0, 51, 1.5e-4, None),  # mu has the curvature of a wave front of radius f, which Debye has not
    ],
)
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
                    exact = exact_greens(
                        detector.x[i], detector.z[i], system.source_x[j], system.focal_length, derivative
                    )
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


# rms error of S(x)/S(0) from n independent realizations, times sqrt(n) (design document, A3)
@pytest.mark.parametrize(
    ("sigma", "law"), [(2, 0.088), (1, 0.194), (0.6, 0.350), (0.4, 0.53), (0.2, 0.89), (0.1, 1.13)]
)
def test_mean_over_realizations(sigma, law):
    """The error law, to first order, and 64 batches of Karhunen-Loeve fields against it."""
    system = focus()
    G, W0 = system.physical_optics(), source(system, sigma)
    S, mu = profile(propagate_csd(G, W0))
    theory = math.sqrt(np.sum(S**2 * 2 * (1 - np.abs(mu) ** 2)) / 200)
    assert theory == pytest.approx(law, abs=5.1e-4 if law < 0.4 else 5.1e-3)  # as printed
    squared, n = [], 2000
    for seed in range(64):
        found = np.mean(np.abs(sample_fields(W0, n, seed=seed) @ G.T) ** 2, axis=0)
        squared.append(np.sum((found / found[100] - S) ** 2) * n / 200)
    assert abs(t_values(np.array(squared), theory**2)) < student.isf(FALSE_ALARM / 2, 63)


# Monte Carlo. Its exact mean and variance by Gauss-Legendre quadrature over pixel and element


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


SYSTEMS: dict[str, tuple[CylindricalFocus, Literal["uniform", "stratified"]]] = {
    "stratified": (focus(n_pixels=41), "stratified"),
    "uniform": (focus(n_pixels=41), "uniform"),
    "axial": (axial_focus(np.linspace(-15, 15, 41)), "stratified"),
}
RAYS, SEEDS = 4 * 41 * 51, 64  # 4 rays an entry


@pytest.fixture(scope="module", params=SYSTEMS)
def many_runs(request):
    system, sampling = SYSTEMS[request.param]
    runs = [system.monte_carlo(RAYS, sampling, seed=seed, calibrated=False) for seed in range(SEEDS)]
    return (
        system,
        sampling,
        np.array([run.value for run in runs]),
        np.array([run.standard_error for run in runs]),
    )


def t_values(samples, expected):
    return (samples.mean(0) - expected) * math.sqrt(len(samples)) / samples.std(0, ddof=1)


def amplitudes(values, mean):
    """Estimates of 1 and 0: size and phase of each run along the exact mean."""
    shares = np.einsum("nij,ij->n", values, mean.conj()) / np.sum(np.abs(mean) ** 2)
    return np.column_stack([shares.real, shares.imag])


def test_monte_carlo_is_unbiased(many_runs):
    system, sampling, values, _ = many_runs
    mean, _ = quadrature(system, sampling)
    assert np.abs(t_values(amplitudes(values, mean), [1, 0])).max() < student.isf(FALSE_ALARM / 4, SEEDS - 1)
    # entry by entry
    for part in (values.real - mean.real, values.imag - mean.imag):
        spread = part.std(0, ddof=1)
        t = np.abs(part.mean(0)) * math.sqrt(SEEDS) / np.where(spread > 0, spread, np.inf)
        assert t.max() < student.isf(FALSE_ALARM / (4 * t.size), SEEDS - 1)


def test_the_test_of_bias_has_power():
    """Edges of the pixels half a per cent off, and a focal length 0.2 % off, must be caught."""
    system, sampling = SYSTEMS["stratified"]
    mean, _ = quadrature(system, sampling)
    limit = student.isf(FALSE_ALARM / 4, SEEDS - 1)
    for wrong in (
        focus(n_pixels=41, half_width=2.5 * 1.005),
        system.replace(focal_length=200.4),
    ):
        values = np.array([wrong.monte_carlo(RAYS, seed=s, calibrated=False).value for s in range(SEEDS)])
        assert np.abs(t_values(amplitudes(values, mean), [1, 0])).max() > limit


def test_variance_and_standard_error(many_runs):
    """Scatter between seeds, and the mean of standard_error^2, against the exact variance."""
    system, sampling, values, errors = many_runs
    mean, variance = quadrature(system, sampling)
    rays_a_mean = RAYS / (system.n_source * (1 if sampling == "uniform" else mean.shape[0]))
    scatter = np.sum(np.abs(values - mean) ** 2, axis=(1, 2)) * rays_a_mean / variance.sum()
    # An entry that no ray reached says inf; its sample variance is 0, and counts as such in the mean.
    claimed = (
        np.sum(np.where(np.isfinite(errors), errors, 0) ** 2, axis=(1, 2)) * rays_a_mean / variance.sum()
    )
    limit = student.isf(FALSE_ALARM / 4, SEEDS - 1)
    assert abs(t_values(scatter, 1)) < limit
    assert abs(t_values(claimed, 1)) < limit
    assert abs(t_values(claimed, 1.1)) > limit
    np.testing.assert_array_equal(np.isinf(errors), values == 0)


@pytest.mark.parametrize(
    ("sampling", "law", "tolerance"), [("uniform", 101.0, 1.5), ("stratified", 4.83, 0.2)]
)
def test_error_law(sampling, law, tolerance):
    """||G - E[G]|| / ||E[G]|| = law / sqrt(rays) for 201 pixels and 51 elements."""
    system = focus()
    mean, variance = quadrature(system, sampling)
    strata = 51 if sampling == "uniform" else 51 * 201
    exact = math.sqrt(strata * variance.sum() / np.sum(np.abs(mean) ** 2))
    assert exact == pytest.approx(law, abs=tolerance / 4)
    if sampling == "uniform":
        assert exact == pytest.approx(math.sqrt(200 * 51), rel=2e-3)  # (equal pixels of angle)
    squared, n = [], 51 * 201 * 2
    for seed in range(32):
        error = system.monte_carlo(n, sampling, seed=seed, calibrated=False).value - mean
        squared.append(n * np.sum(np.abs(error) ** 2) / np.sum(np.abs(mean) ** 2))
    assert math.sqrt(np.mean(squared)) == pytest.approx(law, abs=tolerance)
    assert abs(t_values(np.array(squared), exact**2)) < student.isf(FALSE_ALARM / 2, 31)


@pytest.mark.parametrize("system", [focus(), axial_focus(n_source=201)], ids=["transverse", "axial"])
def test_calibrated_expectation_is_physical_optics(system):
    """Amplitude and phase, to the averaging over pixel and element."""
    mean, _ = quadrature(system, "stratified")
    ratio = calibration(system) * mean / system.physical_optics(measurement=True)
    assert np.abs(ratio - 1).max() < 4e-3
    assert abs(ratio.mean() - 1) < 1.5e-3


def test_calibrated_run_is_the_calibrated_mean():
    system = axial_focus(z=(-3.0, 0.0, 4.0))
    bare = system.monte_carlo(10_000, seed=5, calibrated=False)
    full = system.monte_carlo(10_000, seed=5)
    np.testing.assert_allclose(full.value, calibration(system) * bare.value, rtol=1e-14)
    np.testing.assert_allclose(
        full.standard_error, np.abs(calibration(system)) * bare.standard_error, rtol=1e-14
    )


@pytest.mark.parametrize(("sigma", "raw_error"), [(0.4, 0.0164), (0.1, 0.0534)])
def test_without_calibration_the_axial_profile_is_wrong(sigma, raw_error):
    """By Z / f. With 201 elements; 51 average the phase at 15 wavelengths, which costs 7e-3 at 0.1."""
    system = axial_focus(n_source=201)
    mean, _ = quadrature(system, "stratified")
    exact, _ = profile(measured_csd(system, sigma))
    raw, _ = profile(propagate_csd(mean, source(system, sigma)))
    calibrated, _ = profile(propagate_csd(calibration(system) * mean, source(system, sigma)))
    assert np.abs(raw - exact).max() == pytest.approx(raw_error, abs=1e-4)
    assert np.abs(calibrated - exact).max() < 9e-4


@pytest.mark.parametrize(
    ("sigma", "averaging"),
    [(2, 1.1e-4), (1, 1.1e-4), (0.6, 2.3e-4), (0.4, 6e-4), (0.2, 2.5e-3), (0.1, 5.1e-3)],
)
def test_profile_from_stratified_rays(sigma, averaging):
    """Averaging over pixel and element (just above the measured), and 1e6 rays about that mean."""
    system = focus()
    exact, mu_exact = profile(measured_csd(system, sigma))
    mean, mu_mean = profile(propagate_csd(quadrature(system, "stratified")[0], source(system, sigma)))
    assert np.abs(mean - exact).max() < averaging
    squared = []
    for seed in range(4):
        S, mu = profile(propagate_csd(system.monte_carlo(10**5, seed=seed).value, source(system, sigma)))
        squared.append(np.mean((S - mean) ** 2))
        assert np.abs(mu - mu_mean)[exact > 0.05].max() < 0.03
    assert math.sqrt(np.mean(squared)) < 1e-3


def test_residual_of_uniform_rays():
    """c_r = rms error of S(x)/S(0) times sqrt(rays): 20.4 to first order, not the 30.1 of the paper."""
    system = focus()
    exact, _ = profile(propagate_csd(quadrature(system, "uniform")[0], source(system, 0.6)))
    squared = []
    for seed in range(16):
        value = system.monte_carlo(2 * 10**5, "uniform", seed=seed).value
        S, _ = profile(propagate_csd(value, source(system, 0.6)))
        squared.append(2 * 10**5 * np.sum((S - exact) ** 2) / 200)
    assert 15 < math.sqrt(np.mean(squared)) < 28


@pytest.mark.slow
def test_a_hundred_million_uniform_rays():
    """The law still holds, and S and mu come as near to physical optics as the document says."""
    system, n = focus(), 10_251 * 10**4
    mean, _ = quadrature(system, "uniform")
    G = system.monte_carlo(n, "uniform", seed=0, calibrated=False).value
    assert np.linalg.norm(G - mean) / np.linalg.norm(mean) * math.sqrt(n) == pytest.approx(101, abs=3)
    for sigma in SIGMAS:
        S, mu = profile(propagate_csd(G, source(system, sigma)))
        exact, mu_exact = profile(measured_csd(system, sigma))
        assert np.abs(S - exact).max() < 0.012
        assert np.abs(mu - mu_exact).max() < 0.06


# Purity


@pytest.mark.parametrize("sampling", ["uniform", "stratified"])
def test_same_seed_same_bits_for_any_number_of_threads(sampling):
    system = focus(n_pixels=11, n_source=7)
    one = system.monte_carlo(1000, sampling, seed=3, threads=1)
    two = system.monte_carlo(1000, sampling, seed=3, threads=4)
    np.testing.assert_array_equal(one.value, two.value)
    np.testing.assert_array_equal(one.standard_error, two.standard_error)
    assert not np.array_equal(one.value, system.monte_carlo(1000, sampling, seed=4).value)


def test_focus_survives_json():
    for system in (focus(), axial_focus(z=(0.0, 1.0))):
        assert CylindricalFocus.from_json(system.canonical_json()) == system


# Extreme cases


def test_full_coherence():
    system = focus()
    W = propagate_csd(system.physical_optics(), source(system, math.inf))
    S, mu = profile(W)
    np.testing.assert_allclose(np.abs(mu), 1, atol=1e-12)
    assert S[200] == pytest.approx(0.01187, abs=6e-6)
    assert np.linalg.matrix_rank(W, tol=1e-10 * np.trace(W).real) == 1


def test_no_coherence():
    system = focus()
    with pytest.warns(UserWarning, match="depends on their number"):
        W0 = source(system, 0.0)
    S, mu = profile(propagate_csd(system.physical_optics(), W0))
    assert S[200] == pytest.approx(0.99985, abs=6e-6)
    x = system.detector.x
    assert x[100 + np.argmax(np.abs(mu[100:]) < 0.5)] == pytest.approx(0.697, abs=6e-4)


def test_one_source_element_is_a_point_for_optics_and_a_lens_for_rays():
    system = focus(n_source=1)
    S, mu = profile(propagate_csd(system.physical_optics(), np.ones((1, 1))))
    assert S[200] == pytest.approx(0.99977, abs=6e-6)
    np.testing.assert_allclose(np.abs(mu), 1, atol=1e-12)
    mean, _ = quadrature(system, "stratified", nodes=60)
    assert abs(mean[200, 0] / mean[100, 0]) == pytest.approx(0.103, abs=6e-4)
    traced = system.monte_carlo(2 * 10**6, seed=1, calibrated=False)
    t = np.abs(traced.value - mean)[:, 0] / traced.standard_error[:, 0]
    assert t.max() < 6  # circular or less: exp(-18) for each of 201, together 3e-6
    assert abs(traced.value[200, 0] / traced.value[100, 0]) == pytest.approx(0.103, abs=0.02)


def test_no_ray_is_lost_at_an_edge():
    """Uniform launch: the squared moduli of all pixels add to the range of angles squared, ray by ray."""
    from specklegen.kernels.rays import uniform_rays

    lower, upper = np.array([-1.0, 0.0]), np.array([0.0, 1.0])
    total, square = np.zeros(2, complex), np.zeros(2)
    uniform_rays(np.uint64(1), np.uint64(2), 0, 0.0, 0.0, 10_000, lower, upper, 5.0, K, total, square)
    span = 2 * math.atan(1 / 5)
    assert square.sum() == pytest.approx(10_000 * span**2, rel=1e-12)


def test_rays_stay_between_their_limits():
    """Also at the ends of the range of angles, where the tangent rounds past them."""
    from specklegen.kernels.rays import landing

    for xs in np.random.default_rng(0).uniform(-50, 50, 200):
        for unit, end in ((0.0, 0.7), (2.0**-33, 0.7), (1 - 2.0**-33, 0.8), (1.0, 0.8)):
            x, _ = landing(xs, 0.7, 0.8, 9.0, unit)
            assert 0.7 <= x <= 0.8
            assert x == pytest.approx(end, abs=1e-10)


def test_a_ray_on_the_last_edge_falls_in_the_last_pixel():
    """A detector so narrow that rounding puts rays on its edges keeps every one."""
    tiny = focus(n_source=301, n_pixels=3, half_width=1e-13)
    traced = tiny.monte_carlo(301 * 100, "uniform", seed=0, calibrated=False)
    span = 2e-13 * 200 / (200**2 + tiny.source_x**2)
    np.testing.assert_allclose(np.abs(traced.value.sum(axis=0)), span, rtol=1e-3)  # source elements are wide


def test_fewer_rays_than_entries_warn_and_stay_finite():
    system = focus()
    for sampling in ("uniform", "stratified"):
        with pytest.warns(UserWarning, match="1000 rays for 10251 pairs"):
            traced = system.monte_carlo(1000, sampling, seed=0)
        assert np.isfinite(traced.value).all()
        assert not np.isnan(traced.standard_error).any()
        assert np.isinf(traced.standard_error[traced.value == 0]).all()
        mu = spectral_degree_of_coherence(propagate_csd(traced.value, source(system, 0.6)))
        assert np.isfinite(mu).all()
        assert np.abs(mu).max() <= 1


def test_every_ray_is_traced():
    """One ray for two elements goes to the first of them; the error of a single ray is unknown."""
    with pytest.warns(UserWarning, match="1 rays for 2 pairs"):
        one = focus(n_source=2, n_pixels=1).monte_carlo(1, "uniform", seed=0)
    assert one.value[0, 0] != 0
    assert one.value[0, 1] == 0
    assert np.isinf(one.standard_error).all()


def test_dark_pixels_have_no_coherence():
    with pytest.warns(UserWarning, match="pairs"):
        value = focus().monte_carlo(60, "uniform", seed=0).value
    W = propagate_csd(value, np.ones((51, 51)))
    dark = spectral_density(W) == 0
    assert dark.any()
    mu = spectral_degree_of_coherence(W)
    assert np.isfinite(mu).all()
    np.testing.assert_array_equal(mu[dark], 0)


def test_even_number_of_pixels_is_normalised_on_the_axis():
    system = focus(n_pixels=200)
    axis = system.on_axis()
    assert axis.detector.x.tolist() == [0.0]
    assert axis.detector.pixel_width == pytest.approx(system.detector.pixel_width)
    G = np.vstack([axis.physical_optics(measurement=True), system.physical_optics(measurement=True)])
    S, mu = profile(propagate_csd(G, source(system, 0.6)), centre=0)
    odd, mu_odd = profile(propagate_csd(focus().physical_optics(measurement=True), source(system, 0.6)))
    x, x_odd = system.detector.x, focus().detector.x
    np.testing.assert_allclose(S[1:], np.interp(x, x_odd, odd), atol=3e-4)  # curvature times pixel^2 / 8
    assert S[1:].max() < 1


@pytest.mark.parametrize("half_width", [1e4, 1e12])
def test_detector_much_wider_than_its_distance(half_width):
    """The range of angles tends to pi; tan near pi/2 neither overflows nor loses rays."""
    system = focus(n_source=2, n_pixels=3, half_width=half_width)
    aimed = system.monte_carlo(6000, "stratified", seed=0, calibrated=False)
    assert np.isfinite(aimed.value).all()
    assert np.isfinite(aimed.standard_error).all()
    spread = system.monte_carlo(6000, "uniform", seed=0, calibrated=False)
    assert np.isfinite(spread.value).all()
    wide = 2 * math.atan(half_width / 3 / 200)  # nearly every ray lands in the middle pixel
    assert wide > 0.96 * math.pi
    for G in (aimed, spread):
        assert (np.abs(G.value[1]) <= math.pi).all()
        assert (np.abs(G.value[[0, 2]]) < 0.03 * math.pi).all()


def test_angles_near_a_right_angle_are_sampled_uniformly():
    from specklegen.kernels.rays import landing

    for xs in (-3.0, 0.0, 7.0):
        for unit in np.linspace(0.001, 0.999, 25):
            x, span = landing(xs, -1e6, 1e6, 2.0, unit)
            low, high = math.atan((-1e6 - xs) / 2), math.atan((1e6 - xs) / 2)
            assert span == pytest.approx(high - low, rel=1e-14)
            assert math.atan((x - xs) / 2) == pytest.approx(low + unit * (high - low), abs=1e-9)


def test_phase_keeps_its_digits_at_large_distances():
    """a = 15803 wavelengths, against 40 digits. (In float32 the distance alone is lost: 4e-3 waves.)"""
    from specklegen.kernels.rays import path_difference

    for x, xs, z in ((2.4, 15000.0, 0.0), (0.3, -7000.0, 12.5)):
        with mp.workdps(40):
            f = mp.mpf(31606)
            exact = mp.sqrt((f + z) ** 2 + (mp.mpf(x) - xs) ** 2) - mp.sqrt(f**2 + mp.mpf(xs) ** 2)
        assert path_difference(x, xs, 31606.0, z) == pytest.approx(float(exact), rel=1e-14)
    assert np.spacing(np.float32(34986.0)) > 3e-3


def test_physical_optics_survives_a_large_argument():
    assert np.isfinite(hankel1e(1, 2 * np.pi * 1e9))
    assert np.isfinite(focus(1e8, 3, 3).physical_optics()).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: axial_focus(z=(-200.0, 1.0)),
            "detector.z must be greater than -focal_length = -200; got -200.0.",
        ),
        (
            lambda: AxialDetector(z=np.zeros(0), pixel_width=1),
            "AxialDetector.z must be a list of at least one distance",
        ),
        (
            lambda: AxialDetector(z=np.array(0.0), pixel_width=1),
            "AxialDetector.z must be a list of at least one distance",
        ),
        (lambda: TransverseDetector(half_width=0, n_pixels=3), "half_width must be greater than 0.0; got 0."),
        (lambda: TransverseDetector(half_width=1, n_pixels=0), "n_pixels must be at least 1; got 0."),
        (lambda: focus(n_source=0), "CylindricalFocus.n_source must be at least 1; got 0."),
        (lambda: focus(half_aperture=-1.0), "CylindricalFocus.half_aperture must be greater than 0"),
        (lambda: focus().replace(wavelength=math.nan), "CylindricalFocus.wavelength must be"),
        (lambda: focus().monte_carlo(0, seed=0), "n_rays must be at least 1; got 0."),
        (lambda: focus().monte_carlo(10, "sobol", seed=0), "sampling must be 'stratified' or 'uniform'"),  # type: ignore[arg-type]
        (lambda: axial_focus().monte_carlo(10**5, "uniform", seed=0), "'stratified' for an AxialDetector"),
        (lambda: focus().physical_optics(True, True), "measurement must be False with derivative=True"),
    ],
)
def test_bad_input_is_refused_in_the_house_format(call, message):
    with pytest.raises(ValueError, match="must be .*; got ") as error:
        call()
    assert message in str(error.value)


def test_greens_matrix_is_a_value():
    matrix = GreensMatrix(np.eye(2), np.zeros((2, 2)))
    with pytest.raises(AttributeError):
        matrix.value = np.ones((2, 2))  # type: ignore[misc]
