"""Mean currents and the march that they drive, piece by piece against literal sums."""

import numpy as np
import pytest
from refusals import assert_refused

from specklegen.fdtd import (
    Moments,
    Pulse,
    RandomLayer,
    illuminate,
    in_phase,
    monte_carlo_mean,
    out_of_phase,
    phase_variance,
    sample_moments,
    single_delay,
    single_realization,
    transfer_matrix,
)
from specklegen.fdtd.currents import mean_polarisation, radiated
from specklegen.fdtd.mean_currents import mean_currents

REFERENCE_K0 = 2 * np.pi / 0.6
quiet = pytest.mark.filterwarnings("ignore:.*order not valid", "ignore:.*white from cell to cell")


def rel(a, b):
    return np.linalg.norm(a - b) / np.linalg.norm(b)


def test_phase_variance_closed_form():
    for lc in (0.05, 0.5, 3.0):
        layer = RandomLayer(correlation_length=lc)
        x = layer.length / lc
        closed = 2 * REFERENCE_K0**2 * 0.03**2 * lc**2 * (x + np.expm1(-x))
        # the grid sums what the closed form integrates: (dx/L_c)^2/12 apart
        assert phase_variance(layer, REFERENCE_K0) == pytest.approx(closed, rel=5e-4)
    for lc, quarter in ((0.02, 0.0029), (0.5, 0.0617), (3, 0.1634), (1000, 0.2220)):
        assert phase_variance(RandomLayer(correlation_length=lc), REFERENCE_K0) / 4 == pytest.approx(quarter, rel=0.02)


def test_stationary_sums_are_the_full_sums():
    layer = RandomLayer(correlation_length=0.02, n_points=150)
    stationary = layer.moments()
    lag = np.abs(np.subtract.outer(np.arange(150), np.arange(150)))
    full = Moments(stationary.mean, stationary.second[lag])
    theta = np.array([0.01, 0.05, 0.4])
    assert np.allclose(in_phase(full), in_phase(stationary), rtol=1e-13)
    assert rel(out_of_phase(full, theta), out_of_phase(stationary, theta)) < 1e-13
    literal = np.array(
        [
            [sum(full.second[m, k] * np.exp(-2j * th * (k - m)) for k in range(m + 1, 150)) for m in range(150)]
            for th in theta
        ]
    )
    assert rel(out_of_phase(stationary, theta), literal) < 1e-13


def test_sample_of_one_is_the_born_series_of_that_medium():
    layer = RandomLayer(correlation_length=0.05, n_points=200)
    kappa = layer.sample(1, 2)
    theta = np.array([0.02, 0.05])
    for f, th in enumerate(theta):
        g, m = -1j * np.tan(th / 2), np.arange(200)
        incident = np.exp(-1j * th * m)
        propagate = g * np.exp(-1j * th * np.abs(m[:, None] - m))
        first = propagate @ (kappa[0] * incident)
        second = propagate @ (kappa[0] * first)
        back, forward = radiated(mean_polarisation(sample_moments(kappa), theta, 2), theta)
        assert back[f] == pytest.approx(first[0] + second[0], rel=1e-12)
        assert forward[f] * incident[-1] == pytest.approx(first[-1] + second[-1], rel=1e-12)


def test_second_order_leaves_a_third():
    """What two orders leave out is of third order: eightfold for twice the fluctuation."""
    theta = np.array([0.03])
    medium = RandomLayer(correlation_length=0.02, n_points=100).sample(1, 0)
    left = []
    for kappa in (0.05 * medium, 0.1 * medium):
        exact = np.array(transfer_matrix(kappa[0], theta))
        left.append(exact - [[0], [1]] - radiated(mean_polarisation(sample_moments(kappa), theta, 2), theta))
    assert np.abs(np.divide(left[1], left[0])).ravel() == pytest.approx([8, 8], rel=0.03)


def test_out_of_phase_current_is_the_direct_sum_over_delays():
    """[Tan13] Eqs. 28-29 in time, O(N^2), at S = 1 where every delay is a whole number of steps (N = 200)."""
    layer = RandomLayer(correlation_length=0.02, n_points=200)
    incidence = illuminate(layer, Pulse(duration=0.3), courant=1.0)
    moments, n = layer.moments(), 200
    g = -1j * np.tan(incidence.theta / 2)
    drive = incidence.series(g * (1 - np.exp(-1j * incidence.omega)))
    padded = np.concatenate([np.zeros(2 * n), drive])
    at = lambda delay: padded[2 * n - delay : padded.size - delay]  # noqa: E731
    a = in_phase(moments)
    direct = np.stack(
        [
            a[m] * at(m) + sum((moments.second[k - m] * at(m + 2 * (k - m)) for k in range(m + 1, n)), 0 * drive)
            for m in range(0, n, 20)
            if m + 2 * (n - m) <= 2 * n
        ]
    )
    second = mean_polarisation(moments, incidence.theta, 2) - mean_polarisation(moments, incidence.theta, 1)
    currents = mean_currents(second, incidence).T[::20]
    # the record starts at -1e-8 of its peak, not at 0: a delay that reaches before it reads zeros there
    assert rel(currents, direct) < 1e-7


@quiet
@pytest.mark.parametrize("modulated", [True, False])
def test_march_with_mean_currents_is_its_closed_form(modulated):
    layer, pulse = RandomLayer(correlation_length=0.02), Pulse(modulated=modulated)
    closed = single_realization(layer, method="frequency", pulse=pulse)
    marched = single_realization(layer, pulse=pulse)
    assert rel(marched.back, closed.back) < 1e-3  # Mur ends; measured 2.2e-4
    assert rel(marched.forward, closed.forward) < 3e-5
    opened = single_realization(layer, pulse=pulse, margin=6000)
    assert rel(opened.back, closed.back) < 1e-6
    assert rel(opened.forward, closed.forward) < 1e-6
    assert np.array_equal(marched.incident, closed.incident)


@quiet
def test_sample_and_stationary_covariance_meet_for_many_media():
    """Forward; the back mean of 4000 media is noise at this L_c (standard error 0.7 of it)."""
    layer = RandomLayer(correlation_length=0.02)
    exact = single_realization(layer, method="frequency")
    sample = single_realization(layer, method="frequency", covariance="sample", kappa=layer.sample(4000, 0))
    error = np.linalg.norm(monte_carlo_mean(layer, 4000).forward_error)
    assert np.linalg.norm(sample.forward - exact.forward) < 4 * error


def test_no_fluctuation_gives_exactly_nothing():
    field = single_realization(RandomLayer(correlation_length=0.5, rms_index=0))
    assert not field.back.any()
    assert not field.forward.any()
    assert field.validity is not None
    assert field.validity["forward"]
    assert field.validity["back"]


def test_single_delay_finds_a_delay_and_measures_its_error():
    omega = np.linspace(0.02, 0.03, 20)
    delay, amplitude = np.array([3.3, 40.0, 700.25]), np.array([1.0, -2.0, 0.5])
    p = amplitude * np.exp(-1j * omega[:, None] * delay)
    fit = single_delay(p, omega, np.ones(20), longest=1000)
    assert fit.delay == pytest.approx(delay, abs=0.02)
    assert fit.amplitude == pytest.approx(amplitude, rel=1e-6)
    assert rel(fit.out_of_phase(omega), p) < 1e-3
    assert_refused(lambda: single_delay(p, omega, np.zeros(20), longest=1000), "weight must be non-negative")


def test_single_delay_works_for_short_correlation_only():
    """Its error grows with L_c: below .02 at L_c = .02 um, above .09 at .5 um (median over the cells)."""
    medians, field_errors = [], []
    for lc in (0.02, 0.1, 0.5, 3.0):
        layer = RandomLayer(correlation_length=lc)
        incidence = illuminate(layer)
        p = out_of_phase(layer.moments(), incidence.theta)
        power = np.abs(incidence.spectrum) ** 2
        fit = single_delay(p, incidence.omega, power, 2 * 1500 / incidence.courant)
        medians.append(np.median(fit.error[:-1]))
        back, _ = radiated(mean_polarisation(layer.moments(), incidence.theta, 2), incidence.theta)
        replaced = mean_polarisation(layer.moments(), incidence.theta, 2, fit.out_of_phase(incidence.omega))
        field_errors.append(rel(np.sqrt(power) * radiated(replaced, incidence.theta)[0], np.sqrt(power) * back))
        assert fit.error[-1] == 0  # nothing lies beyond the last cell
    assert medians == sorted(medians)
    assert medians[0] < 0.02
    assert medians[2] > 0.09
    assert field_errors[0] < 0.06
    assert field_errors[2] > 0.15


@quiet
def test_single_delay_march():
    layer = RandomLayer(correlation_length=0.02)
    full, single = (single_realization(layer, delays=d) for d in ("all", "single"))
    assert 1e-3 < rel(single.back, full.back) < 0.03
    assert rel(single.forward, full.forward) < 0.01


@quiet
def test_bad_choices_are_refused():
    layer = RandomLayer(correlation_length=0.02, n_points=200)
    for fields, message in (
        ({"order": 3}, "order must be 1 or 2"),
        ({"method": "guess"}, "method must be one of"),
        ({"covariance": "guess"}, "covariance must be one of"),
        ({"covariance": "sample"}, "kappa must be given for a sample covariance"),
        ({"kappa": np.zeros((2, 200))}, "kappa must be absent"),
        ({"covariance": "sample", "kappa": np.zeros((2, 5))}, "kappa must be of shape"),
        ({"delays": "guess"}, "delays must be one of"),
        ({"courant": 1.1}, "courant must be"),
    ):
        with pytest.raises(ValueError, match=message):
            single_realization(layer, **fields)
