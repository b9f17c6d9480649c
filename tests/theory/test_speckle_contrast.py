"""Contrast of exposures: against quadrature, matrices of pairs, radiative transfer, and simulated grains."""

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose
from refusals import assert_refused
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from zscore import assert_mean, refute_mean

from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.theory import speckle_contrast as sc
from specklegen.theory.speckle_contrast import exposure_average

DEPTH = np.array([0.0, 1e-300, 1e-12, 1e-3, 0.5, 1 - 1e-9, 1 + 1e-9, 5.0, 700.0, 1e9, 1e300])


def exact_average(y):
    """F(y) with as many digits as cancel."""
    with mpmath.workdps(700):
        y = mpmath.mpf(float(y))
        return 1.0 if y == 0 else float(2 * (mpmath.exp(-y) - 1 + y) / y**2)


def test_the_average_keeps_its_digits():
    assert_allclose(exposure_average(DEPTH), [exact_average(y) for y in DEPTH], rtol=4e-16 * 4)
    assert exposure_average(np.inf) == 0


@pytest.mark.parametrize(("exposure", "rho"), [(0.0, 1.0), (0.3, 0.0), (0.7, 0.4), (20.0, 1.0), (1e3, 0.9)])
def test_one_exponential_is_the_integral_of_its_correlation(exposure, rho):
    def power(u):
        return 2 * (1 - u) * (rho * np.exp(-u * exposure) + 1 - rho) ** 2

    end = min(1.0, 30 / max(exposure, 1.0))
    literal = sum(quad(power, *ends, epsabs=1e-14, epsrel=1e-13)[0] for ends in ((0, end), (end, 1)))
    found = sc.exponential_contrast_squared(exposure * 7.0, 7.0, dynamic_share=rho, beta=0.5)
    assert float(found) == pytest.approx(0.5 * literal, rel=1e-11)


def test_limits_of_the_exposure():
    times = np.array([1e-2, 1.0, 1e2])
    assert_allclose(sc.exponential_contrast_squared(0.0, times, beta=0.3), 0.3)
    assert_allclose(sc.exponential_contrast_squared(1.0, np.inf), 1.0)
    assert_allclose(sc.exponential_contrast_squared(1e15, times, dynamic_share=0.7), 0.09, rtol=1e-9)
    assert_allclose(sc.diffusing_contrast_squared([0.0, 1e200], 1.0), [1.0, 0.0])
    assert_allclose(sc.class_contrast_squared([0.0, 5.0], [0.3, 0.7], [0.0, 1e15]), [1.0, 0.09], rtol=1e-12)


def test_diffusing_light_is_the_integral_of_its_correlation():
    """Printed figures at gamma 5/3, and the quadrature of panels, which knows nothing of gamma functions."""
    exposures = np.array([0.001, 0.01, 0.1, 1.0])
    assert_allclose(sc.diffusing_contrast_squared(exposures, 1.0), [0.8728, 0.6576, 0.2970, 0.0546], atol=5e-5)
    for exposure in (1e-24, 1e-9, 0.3, 40.0, 1e8):
        literal = sc.contrast_squared(lambda lag: np.exp(-1.8 * np.sqrt(6 * lag / 3)), exposure)
        assert float(sc.diffusing_contrast_squared(exposure, 3.0, gamma=1.8)) == pytest.approx(literal, rel=1e-8)


def test_classes_are_the_matrix_of_their_pairs():
    rng = np.random.default_rng(3)
    y, p = np.concatenate([[0.0], rng.lognormal(2, 3, 200)]), rng.uniform(size=201)
    for exposure in (0.0, 1e-9, 1e-3, 0.7, 1e4, 1e300):
        pairs = exposure_average(2 * np.add.outer(y, y) * exposure)
        literal = p @ pairs @ p / p.sum() ** 2
        assert float(sc.class_contrast_squared(y, p, exposure)) == pytest.approx(literal, rel=1e-12), exposure
        assert sc.contrast_squared(sc.class_field(y, p), min(exposure, 1e4)) == pytest.approx(
            float(sc.class_contrast_squared(y, p, min(exposure, 1e4))), rel=1e-12
        )


@pytest.mark.parametrize("frames", [1, 2, 3, 8, 33])
def test_sub_frames_are_a_double_sum_over_their_midpoints(frames):
    instants = (np.arange(frames) + 0.5) / frames * 2.4
    literal = np.square(np.abs(np.exp((-1 + 3j) * np.abs(np.subtract.outer(instants, instants))))).mean()
    found = sc.sub_frame_contrast_squared(lambda lag: np.exp((-1 + 3j) * lag), 2.4, frames)
    assert found == pytest.approx(literal, rel=1e-14)


@pytest.mark.parametrize("tolerance", [0.3, 0.01, 1e-4])
def test_the_fewest_sub_frames(tolerance):
    field = sc.class_field([0.2, 3.0, 40.0], [0.2, 0.3, 0.5])
    whole, count = sc.contrast_squared(field, 1.0), sc.sub_frames(field, 1.0, tolerance=tolerance)
    assert sc.sub_frame_contrast_squared(field, 1.0, count) <= whole * (1 + tolerance)
    assert sc.sub_frame_contrast_squared(field, 1.0, count - 1) > whole * (1 + tolerance)


@pytest.fixture(scope="module")
def isotropic():
    """g1(x) of the slab of optical depth 10, isotropic, on the axis: radiative transfer, no path and no class."""
    roots = np.linspace(0, 1, 48) ** 2 * 2.0
    light = [adding_doubling(10.0, albedo=1.0, g=0.0, motion=r * r, nodes=32).transmitted for r in roots]
    line = CubicSpline(roots, np.log(np.array(light) / light[0]))
    return lambda x: np.exp(line(np.sqrt(np.minimum(x, 4.0))))


def test_figures_of_a_slab(isotropic):
    """K^2(T) to the .5 % that the paths of the reference pages have, its value at 1/e, and the sub-frames' excess."""
    exposures = [0.001, 0.01, 0.05, 0.2, 1.0]
    found = [sc.contrast_squared(isotropic, exposure) for exposure in exposures]
    assert_allclose(found, [0.9246, 0.5430, 0.1835, 0.0516, 0.0107], rtol=5e-3)
    last = brentq(lambda x: isotropic(x) - np.exp(-1), 1e-4, 1)
    for times, frames, percent in ((1, (4, 8, 16), (6.6, 1.7, 0.4)), (3, (4, 8, 16), (31, 8.3, 2.1)),
                                   (10, (16, 32, 64), (17, 4.5, 1.1))):  # fmt: skip
        whole = sc.contrast_squared(isotropic, times * last)
        over = [100 * (sc.sub_frame_contrast_squared(isotropic, times * last, n) / whole - 1) for n in frames]
        assert_allclose(over, percent, atol=0.1, rtol=0.015)  # printed with two digits


@pytest.mark.parametrize("rho", [1.0, 0.6, 1e-3])
def test_times_come_back_from_their_contrast(rho):
    times = np.geomspace(1e-6, 1e4, 41)
    squared = sc.exponential_contrast_squared(1.0, times, dynamic_share=rho, beta=0.4)
    back = sc.correlation_time(squared, 1.0, dynamic_share=rho, beta=0.4)
    # What the contrast's own rounding leaves: eps K^2 / |dK^2 / dln tau|.
    apart = sc.exponential_contrast_squared(1.0, times * 1.001, dynamic_share=rho, beta=0.4) - squared
    assert_allclose(back, times, rtol=1e-9 + (8e-16 * squared / apart * 1e-3).max())
    off = sc.correlation_time(squared[20] * 1.001, 1.0, dynamic_share=rho, beta=0.4)
    assert abs(off / times[20] - 1) > 1e-3  # 1e-3 of K^2 moves the time by more


def test_contrasts_that_no_time_has():
    found = sc.correlation_time([[0.0, 0.04, 0.05], [0.5, 0.6, 1.0]], 1.0, dynamic_share=0.8, beta=0.5)
    assert found[0, 0] == 0  # below the static floor, .02, nothing else can be said
    assert (found[1] == np.inf).all()
    assert 0 < found[0, 1] < found[0, 2] < np.inf
    assert_allclose(sc.correlation_time([1e-300, 5e-324], 1.0), 1e-300, rtol=1e-9)  # F = tau / T; nothing is smaller


def estimates(modes, grains, trials, seed):
    """s^2 / m^2 of intensities of mean 1 whose modes have these shares, in 64 batches; the rest does not fluctuate."""
    rng = np.random.default_rng(seed)
    intensity = sum(share * rng.standard_exponential((64, trials, grains), dtype=np.float32) for share in modes)
    intensity += 1 - np.sum(modes)
    return intensity.var(axis=-1, ddof=1, dtype=np.float64) / intensity.mean(axis=-1, dtype=np.float64) ** 2


@pytest.mark.parametrize(("count", "grains"), [(1, 5), (1, 49), (4, 20)])
def test_estimates_of_equal_modes_have_their_exact_moments(count, grains):
    found = estimates(np.full(count, 1 / count), grains, 1000, seed=count)
    law = sc.contrast_estimate(1 / count, grains)
    assert_mean(found.mean(axis=1), float(law.mean))
    spread = np.square(found - float(law.mean)).mean(axis=1)
    assert_mean(spread, float(law.standard_deviation) ** 2)
    refute_mean(spread, 1.05 * float(law.standard_deviation) ** 2)  # 5 % of the variance are seen


def test_estimates_under_motion():
    """Modes of one exponential at T = 3 tau_c, by their eigenvalues; equal modes would have a third less variance."""
    instants = (np.arange(400) + 0.5) / 400
    share = np.linalg.eigvalsh(np.exp(-3 * np.abs(np.subtract.outer(instants, instants))) / 400)
    grains, found = 500, estimates(share[share > 2e-3], 500, 64, seed=1)
    law = sc.motion_contrast_estimate(lambda lag: np.exp(-lag), 3.0, grains)
    # The next order, 10 / N of the variance; sub-frames here and there, and small modes left out, .2 % of K^2.
    assert_mean(np.square(found - found.mean()).mean(axis=1), float(law.standard_deviation) ** 2,
                slack=0.03 * float(law.standard_deviation) ** 2)  # fmt: skip
    assert_mean(found.mean(axis=1), float(law.mean), slack=0.002 * float(law.mean))
    equal = sc.contrast_estimate(float(sc.exponential_contrast_squared(3.0, 1.0)), grains)
    refute_mean(np.square(found - found.mean()).mean(axis=1), float(equal.standard_deviation) ** 2,
                slack=0.03 * float(law.standard_deviation) ** 2)  # fmt: skip


def test_both_laws_of_estimates_agree_where_modes_are_equal():
    at_rest = sc.motion_contrast_estimate(np.ones_like, 1.0, 1e6)
    exact = sc.contrast_estimate(1.0, 1e6)
    assert float(at_rest.standard_deviation) == pytest.approx(float(exact.standard_deviation), rel=2e-5)
    assert 1 - float(at_rest.mean) == pytest.approx(1 - float(exact.mean), rel=2e-5)
    assert float(exact.standard_deviation) == pytest.approx(np.sqrt(2 * 2 / 1e6), rel=2e-5)


@pytest.mark.parametrize(("ask", "words"), [
    (lambda: exposure_average(-1.0), "exposure_average y must be at least 0"),
    (lambda: sc.exponential_contrast_squared(1.0, 0.0), "correlation_time must be above 0"),
    (lambda: sc.exponential_contrast_squared(1.0, 1.0, dynamic_share=1.1), "dynamic_share must be from 0 to 1"),
    (lambda: sc.correlation_time(-0.1, 1.0), "contrast_squared must be at least 0"),
    (lambda: sc.diffusing_contrast_squared(1.0, 1.0, gamma=-1), "gamma must be above 0"),
    (lambda: sc.contrast_squared(lambda lag: lag[:2], 1.0), "field must be finite, one number"),
    (lambda: sc.class_contrast_squared([1.0], [1.0, 2.0], 1.0), "one number for each transfer"),
    (lambda: sc.class_contrast_squared([], [], 1.0), "at least one"),
    (lambda: sc.class_contrast_squared([1.0], [0.0], 1.0), "not all 0"),
    (lambda: sc.class_contrast_squared([-1.0], [1.0], 1.0), "transfer must be at least 0"),
    (lambda: sc.sub_frame_contrast_squared(np.ones_like, 1.0, 0), "frames must be at least 1"),
    (lambda: sc.sub_frames(np.ones_like, 1.0, tolerance=0.0), "tolerance must be above 0"),
    (lambda: sc.contrast_estimate(1.1, 10), "contrast_squared must be at most 1"),
    (lambda: sc.contrast_estimate(0.5, 1), "grains must be finite and at least 2"),
    (lambda: sc.motion_contrast_estimate(lambda t: np.exp(-t), 1e5, 10), "exposure must be so short"),
])  # fmt: skip
def test_bad_input_is_named(ask, words):
    assert_refused(ask, words)
