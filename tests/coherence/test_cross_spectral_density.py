"""Sources, coherent modes and sampled fields against closed forms, exact distributions and printed tables."""

import math

import numpy as np
import pytest
from refusals import assert_refused
from scipy.stats import chi2, norm
from scipy.stats import t as student

from specklegen.coherence.cross_spectral_density import (
    coherent_modes,
    effective_modes,
    gaussian_schell_model,
    intensity_from_modes,
    number_of_modes,
    propagate_csd,
    sample_fields,
    separable_coherent_modes,
    speckle_contrast,
    spectral_degree_of_coherence,
    spectral_density,
)

FALSE_ALARM = 1e-6  # chance that a right build fails a test, shared by its comparisons

# sigma_g / a: modes for 99 % of the energy, for 1 - 1e-6, effective modes, contrast (frozen)
MODES = {10: (1, 3, 1.007, 0.997), 2: (2, 4, 1.161, 0.928), 1: (3, 6, 1.571, 0.798), 0.6: (4, 8, 2.264, 0.665),
         0.4: (5, 11, 3.180, 0.561), 0.2: (10, 19, 5.98, 0.409), 0.1: (18, 34, 11.61, 0.2935),
         0.05: (34, 65, 22.9, 0.209), 0.02: (83, 159, 56.7, 0.133)}  # fmt: skip


def line(n):
    """Centres of n elements of [-1, 1]."""
    return (np.arange(n) - (n - 1) / 2) * 2 / n


def circular(rng, *shape):
    """Circular complex Gaussian numbers of unit variance."""
    return rng.normal(size=(*shape, 2)) @ np.array([1, 1j]) / math.sqrt(2)


# Gaussian Schell model
def test_schell_model_is_the_mean_of_u1_times_conjugate_u2():
    x = np.array([-0.3, 0.1, 0.2])
    amplitude = np.array([1, 2j, 3])
    W0 = gaussian_schell_model(x, 0.9, amplitude)
    assert W0[0, 1] == pytest.approx(np.exp(-(0.4**2) / (2 * 0.9**2)) * 1 * np.conj(2j), rel=1e-15)
    np.testing.assert_array_equal(W0, W0.conj().T)
    np.testing.assert_allclose(spectral_density(W0), [1, 4, 9], rtol=1e-15)


def test_infinite_coherence_length_is_one_mode():
    W0 = gaussian_schell_model(line(51), math.inf)
    np.testing.assert_array_equal(W0, 1)
    eigenvalues, modes = coherent_modes(W0)
    assert eigenvalues.size == 1
    assert eigenvalues[0] == pytest.approx(51, rel=1e-14)
    assert np.ptp(modes) < 1e-14
    assert speckle_contrast(W0) == pytest.approx(1, rel=1e-14)
    np.testing.assert_allclose(np.abs(spectral_degree_of_coherence(W0)), 1, atol=1e-12)


def test_zero_coherence_length_is_the_identity_and_warns():
    with pytest.warns(UserWarning, match="undersample"):
        W0 = gaussian_schell_model(line(51), 0.0)
    np.testing.assert_array_equal(W0, np.eye(51))
    assert effective_modes(W0) == 51


def test_undersampled_source_warns_and_a_fine_one_does_not(recwarn):
    gaussian_schell_model(line(51), 2 * 2 / 51 + 1e-9)
    gaussian_schell_model(np.zeros(1), 0.0)
    assert not recwarn.list
    with pytest.warns(UserWarning, match="depends on their number"):
        gaussian_schell_model(line(51), 0.02)


# Coherent modes
def test_modes_of_a_gaussian_source_match_the_closed_form():
    """Gaussian amplitude of width s: eigenvalues fall geometrically (Starikov and Wolf 1982)."""
    width, coherence = 1.0, 0.7
    x = np.linspace(-9, 9, 721)
    eigenvalues, modes = coherent_modes(gaussian_schell_model(x, coherence, np.exp(-(x**2) / (4 * width**2))))
    a, b = 1 / (4 * width**2), 1 / (2 * coherence**2)
    c = math.sqrt(a * a + 2 * a * b)
    exact = math.sqrt(math.pi / (a + b + c)) * (b / (a + b + c)) ** np.arange(eigenvalues.size)
    np.testing.assert_allclose(eigenvalues * (x[1] - x[0]), exact, rtol=1e-12)
    ground = (2 * c / math.pi) ** 0.25 * np.exp(-c * x**2) * math.sqrt(x[1] - x[0])
    np.testing.assert_allclose(np.abs(modes[:, 0]), ground, atol=1e-12)
    share = 1 - (b / (a + b + c)) ** eigenvalues.size
    assert share >= 0.99 > 1 - (b / (a + b + c)) ** (eigenvalues.size - 1)


def test_all_modes_restore_the_source():
    rng = np.random.default_rng(1)
    A = circular(rng, 20, 12)
    W0 = A @ A.conj().T  # rank 12 of 20: rounding makes some eigenvalues negative
    eigenvalues, modes = coherent_modes(W0, energy=1)
    assert eigenvalues.shape == (20,)
    assert np.all(np.diff(eigenvalues) <= 0)
    assert eigenvalues.min() >= 0
    np.testing.assert_allclose(modes.conj().T @ modes, np.eye(20), atol=1e-13)
    np.testing.assert_allclose((modes * eigenvalues) @ modes.conj().T, W0, atol=1e-13 * np.trace(W0).real)
    assert coherent_modes(W0, n_modes=3)[1].shape == (20, 3)


def test_small_negative_eigenvalues_are_clipped_and_larger_ones_refused():
    good = np.diag([1.0, 0.5, -1e-11])
    assert coherent_modes(good, energy=1)[0].tolist() == [1.0, 0.5, 0.0]
    assert_refused(lambda: coherent_modes(np.diag([1.0, 0.5, -1e-9])), "positive semidefinite")


@pytest.mark.parametrize("sigma", MODES)
def test_mode_table(sigma):
    most, nearly_all, effective, contrast = MODES[sigma]
    W0 = gaussian_schell_model(line(401), sigma)
    assert coherent_modes(W0)[0].size == most
    assert coherent_modes(W0, energy=1 - 1e-6)[0].size == nearly_all
    assert effective_modes(W0) == pytest.approx(effective, rel=1e-3)  # printed to 3 or 4 digits
    assert speckle_contrast(W0) == pytest.approx(contrast, abs=5.01e-4)
    assert number_of_modes(1 / sigma) in (most, most + 1)
    assert number_of_modes(1 / sigma) == math.ceil(1.64 / sigma) + 1


# Two-dimensional sources
def test_separable_modes_are_those_of_the_whole_plane():
    W0_y, W0_x = gaussian_schell_model(line(8), 0.6), gaussian_schell_model(line(11), 0.9)
    whole = np.kron(W0_y, W0_x)  # points in C order, x running fastest
    eigenvalues, modes = separable_coherent_modes(W0_y, W0_x, energy=1)
    np.testing.assert_allclose(eigenvalues, coherent_modes(whole, energy=1)[0], atol=1e-13 * 88)
    np.testing.assert_allclose((modes * eigenvalues) @ modes.T, whole, atol=1e-13)
    G = circular(np.random.default_rng(0), 30, 88)
    direct = spectral_density(propagate_csd(G, whole))
    np.testing.assert_allclose(intensity_from_modes(G, modes, eigenvalues), direct, rtol=1e-13)


@pytest.mark.parametrize("energy", [0.9, 0.99, 0.9999])
def test_separable_modes_are_the_fewest_that_hold_the_energy(energy):
    W0_y, W0_x = gaussian_schell_model(line(61), 0.2), gaussian_schell_model(line(41), 0.5)
    eigenvalues, modes = separable_coherent_modes(W0_y, W0_x, energy=energy)
    assert modes.shape == (61 * 41, eigenvalues.size)
    assert eigenvalues.sum() >= energy * 61 * 41 > eigenvalues[:-1].sum()
    np.testing.assert_allclose(modes.T @ modes, np.eye(eigenvalues.size), atol=1e-12)
    planes = modes.T.reshape(-1, 61, 41)
    np.testing.assert_allclose(np.sum(planes * (W0_y @ planes @ W0_x), axis=(1, 2)), eigenvalues, rtol=1e-9)


# Propagation
@pytest.mark.parametrize("sigma", [2, 1, 0.6, 0.4, 0.2, 0.1])
def test_all_modes_reproduce_the_direct_formula(sigma):
    W0 = gaussian_schell_model(line(51), sigma, np.exp(2j * line(51)))
    G = circular(np.random.default_rng(2), 400, 51)
    direct = np.einsum("pj,jk,pk->p", G, W0, G.conj()).real
    eigenvalues, modes = coherent_modes(W0, energy=1)
    np.testing.assert_allclose(intensity_from_modes(G, modes, eigenvalues), direct, rtol=0, atol=1e-14 * direct.max())
    np.testing.assert_allclose(spectral_density(propagate_csd(G, W0)), direct, rtol=0, atol=1e-14 * direct.max())


def test_fewer_modes_lose_the_share_that_was_asked():
    """Mean square error on an independent circular matrix: tail^2 + sum of squared tail eigenvalues."""
    W0 = gaussian_schell_model(line(401), 0.2)
    every, _ = coherent_modes(W0, energy=1)
    G = circular(np.random.default_rng(3), 4000, 401)
    exact = intensity_from_modes(G, *coherent_modes(W0, energy=1)[::-1])
    for K in (6, 10, 14):
        eigenvalues, modes = coherent_modes(W0, n_modes=K)
        lost = (exact - intensity_from_modes(G, modes, eigenvalues)) / every[K:].sum()
        spread = np.sqrt(np.sum(every[K:] ** 2)) / every[K:].sum()
        z = (lost.mean() - 1) * math.sqrt(lost.size) / spread
        assert abs(z) < norm.isf(FALSE_ALARM / 6), z
    assert np.linalg.norm(exact - intensity_from_modes(G, modes, eigenvalues)) < 0.01 * np.linalg.norm(exact)


@pytest.mark.parametrize("sigma", [2, 0.6, 0.1])
def test_contrast_behind_an_independent_matrix(sigma):
    """64 independent matrices, Student's t; and a contrast 3 % off must be caught."""
    W0 = gaussian_schell_model(line(101), sigma)
    eigenvalues, modes = coherent_modes(W0, energy=1)
    rng = np.random.default_rng(5)
    squared = []  # contrast^2 with the known mean: unbiased
    for _ in range(64):
        intensity = intensity_from_modes(circular(rng, 400, 101), modes, eigenvalues) / 101
        squared.append(np.mean((intensity - 1) ** 2))
    squared = np.array(squared)

    def z(expected):
        return (squared.mean() - expected**2) * 8 / squared.std(ddof=1)

    limit = student.isf(FALSE_ALARM / 2, 63)
    assert abs(z(speckle_contrast(W0))) < limit
    assert abs(z(speckle_contrast(W0) * 1.1)) > limit


def test_dark_points_have_no_degree_of_coherence():
    fields = np.array([[1.0, 2.0, 0.0], [1.0, -1.0, 1e-12]]).T  # the last point: rounding only
    W = fields @ fields.T
    mu = spectral_degree_of_coherence(W)
    assert np.isfinite(mu).all()
    assert np.abs(mu).max() <= 1
    np.testing.assert_array_equal(mu[2], 0)
    np.testing.assert_array_equal(mu[1], spectral_degree_of_coherence(W, reference=1))
    assert mu[0, 1] == pytest.approx(1 / math.sqrt(2 * 5), rel=1e-15)
    np.testing.assert_array_equal(spectral_degree_of_coherence(np.zeros((2, 2))), 0)


# Sampled fields
def projections(W0):
    """Vectors that see every kind of entry of W0: diagonal, real and imaginary parts, whole modes."""
    e = np.eye(len(W0))
    pairs = [(0, 1), (0, 4), (3, 9)]
    return np.array(
        [e[0], e[5], *(e[i] + e[j] for i, j in pairs), *(e[i] + 1j * e[j] for i, j in pairs), np.ones(len(W0))]
    )


def assert_covariance(fields, W0):
    """Each projection of a circular Gaussian field has an exponential intensity: chi square, exactly."""
    for v in projections(W0):
        expected = np.real(v.conj() @ W0 @ v)
        statistic = 2 * np.sum(np.abs(fields @ v.conj()) ** 2) / expected
        tail = min(chi2.sf(statistic, 2 * len(fields)), chi2.cdf(statistic, 2 * len(fields)))
        assert tail > FALSE_ALARM / (2 * len(projections(W0))), f"tail probability {tail:.2g}"


def complex_source():
    x = line(12)
    return gaussian_schell_model(x, 0.5, np.exp(-(x**2) + 2j * x))


def test_karhunen_loeve_fields_have_the_covariance():
    W0 = complex_source()
    fields = sample_fields(W0, 20_000, seed=7)
    assert fields.shape == (20_000, 12)
    assert_covariance(fields, W0)
    # circular: <U U> = 0; independent: no memory from one realization to the next
    for other in (fields, np.roll(fields, 1, axis=0).conj()):
        first, second = fields[:, 0], other[:, 3]
        z = np.mean(first * second) * math.sqrt(20_000 / np.real(W0[0, 0] * W0[3, 3]))
        assert abs(z) ** 2 < -math.log(FALSE_ALARM / 2)  # |z|^2 is exponential


@pytest.mark.parametrize("wrong", ["length", "conjugate", "power"])
def test_the_covariance_test_has_power(wrong):
    x = line(12)
    amplitude = np.exp(-(x**2) + 2j * x)
    W0 = {"length": gaussian_schell_model(x, 0.5 * 1.1, amplitude), "conjugate": complex_source().conj(),
          "power": 1.05 * complex_source()}[wrong]  # fmt: skip
    with pytest.raises(AssertionError, match="tail probability"):
        assert_covariance(sample_fields(W0, 20_000, seed=7), complex_source())


def copula_z(fields, sigma):
    """Largest z of the covariance over all pairs of points, at one turn. The Fourier transform is unitary, so that the
    mean over all pixels is the mean of e^{i (phi_1 - phi_2)} over the samples of the disc, whose exact mean is real."""
    beta = line(51) / (2 * math.pi * sigma)
    exact = np.exp(-((2 * math.pi) ** 2) * (1 - np.cos(beta[:, None] - beta)))[np.triu_indices(51, 1)]
    error = (fields.T @ fields.conj() / len(fields))[np.triu_indices(51, 1)] - exact
    n = disc_samples(math.isqrt(len(fields)) // 2)
    z_real = error.real * math.sqrt(2 * n) / (1 - exact)
    z_imaginary = error.imag * math.sqrt(2 * n) / np.sqrt(1 - exact**2)
    return max(np.abs(z_real).max(), np.abs(z_imaginary).max())


def disc_samples(diameter):
    centre = np.arange(diameter) - (diameter - 1) / 2
    return int(np.sum(np.hypot(centre, centre[:, None]) <= diameter / 2))


@pytest.mark.parametrize("sigma", [2, 0.6, 0.1])
def test_copula_fields_have_the_correlation_of_their_phases(sigma):
    fields = sample_fields(gaussian_schell_model(line(51), sigma), 256**2, "copula", seed=3)
    np.testing.assert_allclose(np.mean(np.abs(fields) ** 2, axis=0), 1, rtol=1e-12)  # Parseval
    limit = norm.isf(FALSE_ALARM / (2 * 2 * 1275))
    assert copula_z(fields, sigma) < limit
    assert copula_z(fields, sigma * 1.05) > limit


HOLED = np.array([0.0, math.nan, 1.0])


def test_modes_of_any_unit_of_power():
    """The squares of powers of 1e-200 are 0; their shares are not."""
    assert effective_modes(1e-200 * np.eye(4)) == pytest.approx(4, rel=1e-12)


@pytest.mark.parametrize(("sigma", "turns", "message"), [
    (0.6, 0.29, "at least 0.3"), (0.1, 0.9, "Use phase_turns of at least 1."), (0.05, 1.0, "span at most pi"),
])  # fmt: skip
def test_copula_refuses_phases_of_too_little_spread(sigma, turns, message):
    with pytest.raises(ValueError, match=message):
        sample_fields(gaussian_schell_model(line(101), sigma), 10, "copula", seed=0, phase_turns=turns)


def test_copula_refuses_what_is_no_schell_model():
    x = line(51)
    with pytest.raises(ValueError, match="method='kl'"):
        sample_fields(gaussian_schell_model(x, 0.6, np.exp(1j * x)), 10, "copula", seed=0)
    with pytest.raises(ValueError, match="Gaussian Schell model to 0.02"):
        sample_fields(np.exp(-np.abs(x[:, None] - x) / 2), 10, "copula", seed=0)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: gaussian_schell_model(line(3), -1.0), "coherence_length must be at least 0; got -1.0"),
    (lambda: gaussian_schell_model(np.eye(3), 1.0), "a list of at least one position"),
    (lambda: gaussian_schell_model(line(3), 9.0, np.ones(2)), "3 numbers, one for each position"),
    (lambda: coherent_modes(np.ones((2, 3))), "a square matrix"),
    (lambda: coherent_modes(np.array([[1, 1j], [1j, 1]])), "Hermitian"),
    (lambda: coherent_modes(np.eye(3), n_modes=0), "n_modes must be at least 1 and at most 3; got 0"),
    (lambda: coherent_modes(np.eye(3), energy=1.01), "greater than 0 and at most 1"),
    (lambda: separable_coherent_modes(np.eye(2), np.diag([1, -1.0])), "W0_x must be positive"),
    (lambda: number_of_modes(-1.0), "at least 0 and finite"),
    (lambda: number_of_modes(1.0, 1.0), "less than 1; got 1.0. A finite share"),
    (lambda: sample_fields(np.eye(2), 0, seed=0), "n must be at least 1; got 0"),
    (lambda: sample_fields(np.eye(2), 1, "svd", seed=0), 'one of "kl", "copula"'),  # type: ignore[arg-type]
    (lambda: gaussian_schell_model(line(3), 9.0, HOLED), "amplitude must be finite everywhere"),
    (lambda: speckle_contrast(np.zeros((2, 2))), "of a trace above 0: of some light; got 0.0"),
    (lambda: spectral_degree_of_coherence(np.diag(HOLED)), "finite everywhere"),
    (lambda: propagate_csd(np.ones((2, 4)), np.eye(3)), "a response to the 3 points of W0 along its last axis"),
    (lambda: propagate_csd(np.diag(HOLED), np.eye(3)), "propagate_csd G must be finite everywhere"),
    (lambda: intensity_from_modes(np.eye(3), np.eye(3), -line(3)), "3 powers of at least 0, one for each mode"),
    (lambda: intensity_from_modes(np.ones((2, 4)), np.eye(3), np.ones(3)), "the 3 points of modes"),
])  # fmt: skip
def test_bad_input_is_refused_in_the_house_format(call, message):
    with pytest.raises(ValueError, match="must be .*; got ") as error:
        call()
    assert message in str(error.value)
