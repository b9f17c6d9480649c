"""K of a stack, gathered for speed, against the mixture of every term."""

import numpy as np
import pytest

import specklegen as sg
from specklegen.samplers.screens.correlation import GATHERED_ERROR, envelope, screen_correlation
from specklegen.scene.illumination import directions_of_sines
from specklegen.theory.phase_screens import gathered, lobes, tilt_ways

LAB = sg.ScreenStack(screens=(sg.GroundGlass(angle=0.1), sg.GroundGlass(angle=0.2)), gaps=(700.0,)).stack
WEAK = sg.ScreenStack(screens=[sg.PhaseScreen(rms_phase=n, correlation_length=10.0 * n) for n in (1.0, 2.0)],
                      gaps=(300.0,), behind=50.0)  # fmt: skip
MANY = sg.ScreenStack(screens=(sg.PhaseScreen(rms_phase=2.0, correlation_length=16.0),) * 8, gaps=(100.0,) * 7)


@pytest.mark.parametrize("stack", [LAB, WEAK, MANY])
def test_gathered_terms_are_right_as_far_as_is_stated(stack):
    kernel, terms, k = screen_correlation(stack, 0.532), lobes(stack, 0.532), 2 * np.pi / 0.532
    assert kernel.radius.size < 0.5 * len(terms.shares)
    tilts = np.geomspace(0.02, 6, 25) * kernel.half_range() / k
    exact = [abs(terms.correlation(np.zeros(2), tilt_ways(stack, np.array([tilt, 0.0])))) ** 2 for tilt in tilts]
    intensity, lost, error = kernel.intensity(k * tilts)
    np.testing.assert_allclose(np.square(kernel(k * tilts)), exact, atol=GATHERED_ERROR)
    np.testing.assert_allclose(intensity, exact, atol=GATHERED_ERROR)
    assert (error <= GATHERED_ERROR).all()
    # Gathered terms keep their second moment, so what small tilts lose is right to their fourth power.
    variance, _ = terms.spreads(tilt_ways(stack, np.array([1.0, 0.0])))
    weight = terms.densities(0.0)
    tiny = 1e-6 * tilts[0]
    expected = np.square(k * tiny) * (weight @ variance) / weight.sum()
    assert kernel.intensity(np.array([k * tiny]))[1][0] == pytest.approx(expected, rel=1e-6)


def test_terms_gathered_too_wide_would_be_caught():
    terms = lobes(LAB, 0.532)
    variance, _ = terms.spreads(tilt_ways(LAB, np.array([1.0, 0.0])))
    walks = variance > 1e-12 * variance.max()
    variance, weight = variance[walks], terms.densities(0.0)[walks]
    x = np.geomspace(0.05, 5, 25)[:, None] / np.median(variance)
    exact = np.square(np.exp(-x * variance) @ weight / weight.sum())
    for width, right in ((0.02, True), (0.3, False)):
        few, share = gathered(variance, weight, width)
        off = np.abs(np.square(np.exp(-x * few) @ share / share.sum()) - exact).max()
        assert (off <= GATHERED_ERROR) == right


@pytest.mark.parametrize("stack", [LAB, WEAK, MANY])
def test_the_lobe_over_a_grid_is_that_of_its_points(stack):
    """1e-4 of f(0): half of the square of (width / 2) times max |u^2 - u| e^-u = .309."""
    terms, angle = lobes(stack, 0.532), stack.rms_angle(0.532)
    x, y = np.linspace(-3, 2, 9) * angle, np.linspace(-1, 4, 7) * angle
    exact = terms.density(np.hypot(x, y[:, None])) / terms.density(0.0)
    found = terms.over_grid(x, y)
    np.testing.assert_allclose(found, exact, atol=1e-4)
    assert np.abs(found.T[:7, :7] - exact[:, :7]).max() > 1e-2  # rows are y
    both = terms.over_grid(np.stack([x, x + angle]), np.stack([y, y]))
    np.testing.assert_allclose(both[0], found, rtol=1e-12)


@pytest.mark.parametrize("stack", [LAB, WEAK, MANY])
def test_k_on_a_grid_is_k_of_its_distances(stack):
    """Products of functions of x and y, not asked distance by distance: of grids off the origin, and of several."""
    kernel = screen_correlation(stack, 0.532)
    half = kernel.half_range()
    x, y = half * np.array([np.linspace(-1, 2, 7), np.linspace(0.3, 4, 7)]), half * np.linspace([-3, 0], [1, 2], 5).T
    distance = np.hypot(y[:, :, None], x[:, None])
    np.testing.assert_allclose(kernel.on_grid(x, y), kernel(distance), rtol=1e-12, atol=1e-14)
    assert np.abs(kernel.on_grid(x, y[::-1]) - kernel(distance)).max() > 0.01, "rows and columns, and which is which"


@pytest.mark.parametrize("stack", [LAB, WEAK, MANY])
@pytest.mark.parametrize("far", [0.0, 1e4])
def test_spreads_are_the_variances_of_their_definition(stack, far):
    """V = sum_m e_m |a_m - c|^2, c = sum_m e_m a_m / T: also of ways that are far from 0 and close to one another."""
    terms = lobes(stack, 0.532)
    ways = far + np.random.default_rng(0).normal(size=(3, len(stack.distances), 2))
    variance, mean = terms.spreads(ways)
    for n in np.linspace(0, len(terms.shares) - 1, 20).astype(int):
        share = terms.events[n] / terms.events[n].sum()
        middle = share @ ways
        np.testing.assert_allclose(mean[:, n], middle, rtol=1e-12)
        literal = (terms.events[n][:, None] * np.square(ways - middle[:, None])).sum((1, 2))
        np.testing.assert_allclose(variance[:, n], literal, rtol=1e-9, atol=1e-10 * terms.variances[n])


def test_straight_on_a_beam_has_the_root_of_its_cosine():
    """Of the power through the face, as the mean field has it; the envelope is that of the lobe's middle."""
    beams = directions_of_sines("beams", np.array([[0.0, 0.0], [0.6, 0.0], [0.0, -0.8]]))
    found = np.abs(envelope(MANY, 0.532, beams, beams[None]).direct[:, 0])
    np.testing.assert_allclose(found.diagonal(), np.sqrt([1.0, 0.8, 0.6]), rtol=1e-6)
