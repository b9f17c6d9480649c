"""Rays of the cylindrical focus against quadrature over pixels and source elements."""

import math
from typing import Literal

import numpy as np
import pytest
from focus_of_rays import (
    FALSE_ALARM,
    axial_focus,
    calibration,
    focus,
    measured_csd,
    profile,
    quadrature,
    source,
    t_values,
)
from scipy.stats import t as student

from specklegen.coherence.cross_spectral_density import propagate_csd
from specklegen.coherence.cylindrical_focus import CylindricalFocus

SYSTEMS: dict[str, tuple[CylindricalFocus, Literal["uniform", "stratified"]]] = {
    "stratified": (focus(n_pixels=41), "stratified"), "uniform": (focus(n_pixels=41), "uniform"),
    "axial": (axial_focus(np.linspace(-15, 15, 41)), "stratified"),
}  # fmt: skip
RAYS, SEEDS = 4 * 41 * 51, 64  # 4 rays an entry


@pytest.fixture(scope="module", params=SYSTEMS)
def many_runs(request):
    system, sampling = SYSTEMS[request.param]
    runs = [system.monte_carlo(RAYS, sampling, seed=seed, calibrated=False) for seed in range(SEEDS)]
    return (system, sampling, np.array([run.value for run in runs]), np.array([run.standard_error for run in runs]))


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
    for wrong in (focus(n_pixels=41, half_width=2.5 * 1.005), system.replace(focal_length=200.4)):
        values = np.array([wrong.monte_carlo(RAYS, seed=s, calibrated=False).value for s in range(SEEDS)])
        assert np.abs(t_values(amplitudes(values, mean), [1, 0])).max() > limit


def test_variance_and_standard_error(many_runs):
    """Scatter between seeds, and the mean of standard_error^2, against the exact variance."""
    system, sampling, values, errors = many_runs
    mean, variance = quadrature(system, sampling)
    rays_a_mean = RAYS / (system.n_source * (1 if sampling == "uniform" else mean.shape[0]))
    scatter = np.sum(np.abs(values - mean) ** 2, axis=(1, 2)) * rays_a_mean / variance.sum()
    # An entry that no ray reached says inf; its sample variance is 0, and counts as such in the mean.
    claimed = np.sum(np.where(np.isfinite(errors), errors, 0) ** 2, axis=(1, 2)) * rays_a_mean / variance.sum()
    limit = student.isf(FALSE_ALARM / 4, SEEDS - 1)
    assert abs(t_values(scatter, 1)) < limit
    assert abs(t_values(claimed, 1)) < limit
    assert abs(t_values(claimed, 1.1)) > limit
    np.testing.assert_array_equal(np.isinf(errors), values == 0)


@pytest.mark.parametrize(("sampling", "law", "tolerance"), [("uniform", 101.0, 1.5), ("stratified", 4.83, 0.2)])
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
    np.testing.assert_allclose(full.standard_error, np.abs(calibration(system)) * bare.standard_error, rtol=1e-14)


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
    ("sigma", "averaging"), [(2, 1.1e-4), (1, 1.1e-4), (0.6, 2.3e-4), (0.4, 6e-4), (0.2, 2.5e-3), (0.1, 5.1e-3)]
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


# Purity
@pytest.mark.parametrize("sampling", ["uniform", "stratified"])
def test_same_seed_same_bits_for_any_number_of_threads(sampling):
    system = focus(n_pixels=11, n_source=7)
    one = system.monte_carlo(1000, sampling, seed=3, threads=1)
    two = system.monte_carlo(1000, sampling, seed=3, threads=4)
    np.testing.assert_array_equal(one.value, two.value)
    np.testing.assert_array_equal(one.standard_error, two.standard_error)
    assert not np.array_equal(one.value, system.monte_carlo(1000, sampling, seed=4).value)
