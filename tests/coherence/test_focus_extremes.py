"""The cylindrical focus in extreme cases, and what it refuses."""

import math

import mpmath as mp
import numpy as np
import pytest
from focus_of_rays import K, axial_focus, focus, profile, quadrature, source

from specklegen.coherence.cross_spectral_density import propagate_csd, spectral_degree_of_coherence
from specklegen.coherence.cylindrical_focus import AxialDetector, TransverseDetector


def test_full_coherence():
    system = focus()
    W = propagate_csd(system.physical_optics(), source(system, math.inf))
    S, mu = profile(W)
    np.testing.assert_allclose(np.abs(mu), 1, atol=1e-12)
    assert S[200] == pytest.approx(0.01187, abs=6e-6)
    assert np.linalg.matrix_rank(W, tol=1e-10 * np.trace(W).real) == 1


def test_wavelengths_whose_phases_have_no_digits_are_refused():
    with pytest.raises(ValueError,
                       match=r"CylindricalFocus\.wavelength must be at least 1e-11 of the longest distance"):
        focus().replace(wavelength=1e-300)


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
    from specklegen.kernels.rays import Element, uniform_rays

    lower, upper = np.array([-1.0, 0.0]), np.array([0.0, 1.0])
    total, square = np.zeros(2, complex), np.zeros(2)
    uniform_rays(np.uint64(1), np.uint64(2), Element(0, 0.0, 0.0), 10_000, lower, upper, 5.0, K, total, square)
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


@pytest.mark.parametrize(("call", "message"), [
    (lambda: axial_focus(z=(-200.0, 1.0)), "detector.z must be greater than -focal_length = -200; got -200.0."),
    (lambda: AxialDetector(z=np.zeros(0), pixel_width=1), "AxialDetector.z must be a list of at least one distance"),
    (lambda: TransverseDetector(half_width=0, n_pixels=3), "half_width must be greater than 0.0; got 0."),
    (lambda: focus(n_source=0), "CylindricalFocus.n_source must be at least 1; got 0."),
    (lambda: focus().monte_carlo(0, seed=0), "n_rays must be at least 1 and at most 4611686018427387904; got 0."),
    (lambda: focus().monte_carlo(10, "sobol", seed=0), 'one of "stratified", "uniform"'),  # type: ignore[arg-type]
    (lambda: axial_focus().monte_carlo(10**5, "uniform", seed=0), "'stratified' for an AxialDetector"),
    (lambda: focus().physical_optics(True, True), "measurement must be False with derivative=True"),
])  # fmt: skip
def test_bad_input_is_refused_in_the_house_format(call, message):
    with pytest.raises(ValueError, match="must be .*; got ") as error:
        call()
    assert message in str(error.value)
