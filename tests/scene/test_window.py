"""Every closed form of a window against quadrature over its amplitude."""

import numpy as np
import pytest

from specklegen.scene.window import PROFILES, Window

WIDTH = 3.0
FINE = 1200
NODES = (np.arange(FINE) + 0.5) / FINE - 0.5
SPAN = {"square": WIDTH, "disc": WIDTH, "gaussian": 4 * WIDTH}
"""Side of the square of nodes: where b = exp(-16) or 0 outside."""
EDGE = {"square": 2e-6, "disc": 1e-3, "gaussian": 1e-6}
"""Relative error of the midpoint rule: 1/24 of (pi f step)^2 for the square, what the edge of the disc cuts, and
the tail of the Gaussian, e^-16 times its length."""


def sampled(profile, power):
    """Nodes float64[n] along one axis, and b^power times their area float64[n, n]."""
    x = NODES * SPAN[profile]
    return x, Window(profile, WIDTH).amplitude(x, x[:, None]) ** power * (SPAN[profile] / FINE) ** 2


@pytest.mark.parametrize("profile", PROFILES)
def test_area_is_that_of_the_intensity(profile):
    _, power = sampled(profile, 2)
    assert Window(profile, WIDTH).area == pytest.approx(power.sum(), rel=EDGE[profile])


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize(("fx", "fy"), [(0.0, 0.0), (0.2, 0.0), (0.3, -0.4)])
def test_transforms_in_space(profile, fx, fy):
    window = Window(profile, WIDTH)
    for power, found in ((1, window.transform), (2, lambda x, y: window.coherence(x, y) * window.area)):
        x, weight = sampled(profile, power)
        expected = np.exp(2j * np.pi * fy * x) @ weight @ np.exp(2j * np.pi * fx * x)
        assert found(np.array(fx), np.array(fy)) == pytest.approx(expected, abs=EDGE[profile] * weight.sum())


@pytest.mark.parametrize("profile", PROFILES)
def test_transform_in_flatland(profile):
    x = NODES * SPAN[profile]
    amplitude = Window(profile, WIDTH).amplitude(x)
    for f in (0.0, 0.3, 1.1):
        expected = (amplitude * np.cos(2 * np.pi * f * x)).sum() * SPAN[profile] / FINE
        # Midpoint rule at f = 1.1: (pi f step)^2 / 6 = 1.2e-5.
        assert Window(profile, WIDTH).transform(np.array(f)) == pytest.approx(expected, abs=2e-5 * WIDTH)


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize(("row", "column"), [(0, 0), (0, 150), (260, 90)])
def test_overlap_is_the_autocorrelation_of_the_intensity(profile, row, column):
    _, power = sampled(profile, 2)
    expected = (power[row:, column:] * power[: FINE - row, : FINE - column]).sum() / np.square(power).sum()
    step = SPAN[profile] / FINE
    found = Window(profile, WIDTH).overlap(np.array(column * step), np.array(row * step))
    assert found == pytest.approx(expected, abs=2 * EDGE[profile])


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("decay", [8.0, 12.5])
def test_support_holds_what_is_brighter(profile, decay):
    window = Window(profile, WIDTH)
    half = window.support(decay) / 2
    inside, outside = window.amplitude(np.array([half * (1 - 1e-9), half * (1 + 1e-9)])) ** 2
    assert inside >= np.exp(-decay) > outside
    assert window.sharp == (inside == 1)


def test_cells_share_the_power():
    """Of a square, each cell its share; of a Gaussian, b^2 at the centre."""
    centres, size = np.array([-1.5, -0.5, 0.5, 1.5]), 1.0
    np.testing.assert_allclose(Window("square", WIDTH).cell_power(centres, size), [0.5, 1, 1, 0.5])
    gaussian = Window("gaussian", WIDTH)
    np.testing.assert_allclose(gaussian.cell_power(centres, size), gaussian.amplitude(centres) ** 2)
    assert [Window(profile, WIDTH).separable for profile in PROFILES] == [True, False, True]
