"""Moments, propagation and envelopes of beams (W1, W2)."""

import numpy as np
import pytest

from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.wavetracing import Cone, GaussianBeam
from specklegen.wavetracing.kernels import beam_state

K = 2 * np.pi
SIGMA = np.array([[40.0, 11.0], [11.0, 25.0]])
BEAM = GaussianBeam(np.zeros(3), np.array([0, 0, 1.0]), SIGMA, 1.0)


def test_moments_are_those_of_a_sheared_wigner_function():
    """The Wigner function is exp(-x S^-1 x - q S q) at the waist; free space shears it by x <- x + rho q."""
    inverse = np.linalg.inv(SIGMA)
    for rho in (0.0, 3.0, 200.0):
        beam = BEAM.replace(rho=rho)
        back = np.block([[np.eye(2), -rho * np.eye(2)], [np.zeros((2, 2)), np.eye(2)]])
        quadratic = back.T @ np.block([[inverse, np.zeros((2, 2))], [np.zeros((2, 2)), SIGMA]]) @ back
        expected = np.linalg.inv(quadratic) / 2
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        assert np.abs((beam.covariance - expected) / scale).max() < 1e-11
        assert np.abs(beam.covariance[:2, :2] - beam.var_position).max() == 0
        assert np.abs(beam.covariance[2:, 2:] - beam.var_wavevector).max() == 0


def test_phase_space_volume():
    """The determinant of all moments is 1/16 at any distance; cancellation leaves (rho / Sigma)^4 roundings."""
    assert np.linalg.det(BEAM.covariance) * 16 == pytest.approx(1, abs=1e-13)
    far = BEAM.propagated(300.0)
    assert far.rho == pytest.approx(300 / K, rel=1e-15)
    assert np.linalg.det(far.covariance) * 16 == pytest.approx(1, abs=1e-13)  # measured 3e-16
    products = [np.linalg.det(b.var_position @ b.var_wavevector) ** 0.5 for b in (BEAM, far)]
    assert products[0] == pytest.approx(0.25, rel=1e-13)
    assert products[1] > 0.25


def _grid(n=256, width=120.0):
    x = (np.arange(n) - n // 2) * (width / n)
    return x, width / n


def test_field_is_normalised_and_solves_the_paraxial_equation():
    """Field at 300 wavelengths against the angular spectrum of the field at the waist with a parabolic dispersion."""
    x, pitch = _grid()
    frame = BEAM.frame
    plane = x[None, :, None] * frame[0] + x[:, None, None] * frame[1]
    start = BEAM.field(plane)
    assert (np.abs(start) ** 2).sum() * pitch**2 == pytest.approx(1, abs=1e-12)
    q = 2 * np.pi * np.fft.fftfreq(len(x), pitch)
    z = 30.0
    drift = np.exp(1j * K * z - 0.5j * z / K * (q[None, :] ** 2 + q[:, None] ** 2))
    expected = np.fft.ifft2(np.fft.fft2(start) * drift)
    found = BEAM.field(plane + z * frame[2])
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()
    tilted = GaussianBeam(np.zeros(3), np.array([0, 0, 1.0]), SIGMA * 1.01, 1.0).field(plane + z * frame[2])
    assert np.abs(tilted - expected).max() > 1e-3 * np.abs(expected).max()  # power of the comparison


def test_variance_of_the_field():
    x, pitch = _grid()
    beam = BEAM.propagated(40.0)
    plane = x[None, :, None] * BEAM.frame[0] + x[:, None, None] * BEAM.frame[1] + beam.origin
    power = np.abs(beam.field(plane)) ** 2
    assert np.abs(np.abs(BEAM.field(plane)) ** 2 - power).max() < 1e-14
    mean = power.sum() * pitch**2
    axes = (x[None, :], x[:, None])
    variance = [[(power * u * v).sum() * pitch**2 / mean for v in axes] for u in axes]
    assert np.abs(variance - beam.var_position).max() < 1e-10


def test_cone_of_a_beam():
    """a tan(alpha) = 9 / 2k on both axes, the axes those of Sigma."""
    cone = BEAM.cone
    large, small = np.linalg.eigvalsh(SIGMA)[::-1]
    assert cone.a == pytest.approx(3 * np.sqrt(large / 2), rel=1e-14)
    assert cone.b == pytest.approx(3 * np.sqrt(small / 2), rel=1e-14)
    assert cone.a * cone.tan_a == pytest.approx(4.5 / K, rel=1e-12)
    assert cone.b * cone.tan_b == pytest.approx(4.5 / K, rel=1e-12)
    assert np.abs(cone.frame @ cone.frame.T - np.eye(3)).max() < 1e-14
    across = cone.frame[0] @ BEAM.frame[:2].T
    assert across @ SIGMA @ across == pytest.approx(large, rel=1e-13)


@pytest.mark.parametrize("rho", [0.0, 7.0])
def test_cone_holds_three_deviations_and_not_much_more(rho):
    """Half-width over 3 standard deviations of a round beam lies in [1, sqrt 2] and is sqrt 2 at z tan(alpha) = a."""
    beam = GaussianBeam(np.zeros(3), np.array([0, 0, 1.0]), 30 * np.eye(2), 1.0, rho=rho)
    z = np.concatenate([np.geomspace(1e-3, 1e7, 400), [30 * K - rho * K]])
    z = z[z > 0]
    width = beam.cone.a + z * beam.cone.tan_a
    deviation = np.sqrt((30 + (rho + z / K) ** 2 / 30) / 2)
    ratio = width / (3 * deviation)
    assert ratio.min() >= 1 - 1e-12
    assert ratio.max() == pytest.approx(np.sqrt(2), abs=1e-12)


def test_least_etendue_after_many_interactions():
    """Two thousand random regions and directions: a b tan_a tan_b never falls below 81 / 4k^2."""
    rng = np.random.default_rng(0)
    cone = BEAM.cone
    least, floor = np.inf, 81 / (4 * K**2)
    d = np.array([0, 0, 1.0])
    for _ in range(2000):
        region = cone.region(rng.uniform(0, 3), half_depth=rng.uniform(0.05, 1) * cone.a)
        d = rng.normal(size=3)
        d /= np.linalg.norm(d)
        product = cone.tan_a * cone.tan_b
        cone = cone.after(region, d)
        assert cone.tan_a * cone.tan_b == pytest.approx(product, rel=1e-12)
        assert cone.tan_a / cone.tan_b == pytest.approx(cone.a / cone.b, rel=1e-9)
        least = min(least, cone.a * cone.b * cone.tan_a * cone.tan_b)
    assert least >= floor * (1 - 1e-12)


def test_beams_of_a_trace_interact_as_cones_do():
    """The kernel's state through a thousand regions against `Cone.after`: place, cross-section, tangents, to 1e-12.

    Both are restarted from the kernel's state, so that roundings do not add up.
    """
    rng, state = np.random.default_rng(2), np.zeros(beam_state.STATE)
    least, cone = 81 / (4 * K**2), Cone(np.zeros(3), np.eye(3), 4.0, 2.0, 0.2, 0.1, 81 / (4 * K**2))
    for _ in range(1000):
        state[beam_state.CONE_AT : beam_state.CONE_AT + 14] = cone.packed()
        state[beam_state.STRETCH], state[beam_state.PRODUCT] = cone.ratio, cone.tan_a * cone.tan_b
        depth, d = rng.uniform(0, 3), rng.normal(size=3)
        d /= np.linalg.norm(d)
        expected = cone.after(cone.region(depth), d)
        beam_state.leave_region(state, depth, least, *d)
        frame = state[beam_state.XX : beam_state.XX + 9].reshape(3, 3) / [[1], [state[beam_state.STRETCH]], [1]]
        a, b = state[beam_state.WIDTH], state[beam_state.WIDTH] / state[beam_state.STRETCH]
        slope = state[beam_state.SLOPE]
        found = Cone(state[beam_state.CX : beam_state.CX + 3].copy(), frame, a, b, slope, slope / (a / b), least)
        ellipses = [c.frame[:2].T @ np.diag([c.a**2, c.b**2]) @ c.frame[:2] for c in (found, expected)]
        assert np.abs(ellipses[0] - ellipses[1]).max() < 1e-12 * expected.a**2
        assert np.abs(found.origin - expected.origin).max() < 1e-12 * expected.a
        assert (found.tan_a, found.tan_b) == pytest.approx((expected.tan_a, expected.tan_b), rel=1e-11)
        assert found.a * found.b * found.tan_a * found.tan_b >= least * (1 - 1e-12)
        # Small again, so that the least product is met: a thousand regions would only grow.
        cone = Cone(np.zeros(3), frame, *np.sort(rng.uniform(0.5, 5, 2))[::-1], 0.05, 0.05 * rng.uniform(0.2, 1), least)


def test_silhouette_of_a_region():
    """Seen along each axis an ellipsoid shows its other two semi-axes, and obliquely what projecting points shows."""
    cone = Cone(np.zeros(3), np.eye(3), 4.0, 2.0, 0.2, 0.1)
    region = cone.region(0.0, half_depth=3.0)
    for direction, axes in (([0, 0, 1], (4, 2)), ([1, 0, 0], (3, 2)), ([0, 1, 0], (4, 3))):
        seen = cone.after(region, np.array(direction, float))
        assert (seen.a, seen.b) == pytest.approx(axes, rel=1e-12)
    rng = np.random.default_rng(1)
    points = rng.normal(size=(200_000, 3))
    points = points / np.linalg.norm(points, axis=1)[:, None] * [4, 2, 3]
    d = np.array([0.6, 0.0, 0.8])
    seen = cone.after(region, d)
    x, y = seen.frame[:2] @ points.T
    assert np.abs(x).max() == pytest.approx(seen.a, rel=1e-4)  # the largest of 2e5 points on an ellipsoid
    assert np.abs(y).max() == pytest.approx(seen.b, rel=1e-4)


def test_contains():
    cone = Cone(np.array([1.0, 0, 0]), np.eye(3), 2.0, 0.5, 0.2, 0.05)
    inside = cone.contains([[1, 0.74, 5], [1, 0.76, 5], [3.9, 0, 5], [4.1, 0, 5], [1, 0, -9.9], [1, 0, -10.1]])
    assert inside.tolist() == [True, False, True, False, True, False]


def test_refused_and_doubted():
    with pytest.raises(RuleError, match="positive definite"):
        BEAM.replace(sigma=np.array([[1.0, 2.0], [2.0, 1.0]]))
    with pytest.raises(RuleError, match="symmetric"):
        BEAM.replace(sigma=np.array([[1.0, 0.5], [0.0, 1.0]]))
    with pytest.raises(RuleError, match="unit vector"):
        BEAM.replace(direction=np.array([0, 0, 2.0]))
    with pytest.raises(RuleError, match="wavelength"):
        BEAM.replace(wavelength=0.0)
    with pytest.raises(RuleError, match="rho"):
        BEAM.replace(rho=-1.0)
    with pytest.raises(RuleError, match="orthonormal"):
        Cone(np.zeros(3), np.ones((3, 3)), 1, 1, 0.1, 0.1)
    with pytest.raises(RuleError, match="exactly where"):
        Cone(np.zeros(3), np.eye(3), 1, 0, 0.1, 0.1)
    with pytest.warns(DoubtWarning, match="paraxial"):
        BEAM.replace(sigma=0.5 * np.eye(2))
