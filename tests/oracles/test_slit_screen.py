"""Slits in a perfect screen: against frozen figures, a second law of power, convergence and two limits."""

import numpy as np
import pytest

from specklegen.oracles.slit_screen import slit_screen

X = np.array([0.0, 4.0, 8.0, 20.0])
POINTS = np.stack([X, np.full(4, 50.0)], axis=1)
FIGURES = {  # |u|^2 behind 10 wavelengths at Z = 50, from an independent implementation, printed to 8 digits
    "hard": [1.54946444, 0.26516034, 0.123316, 0.01058395], "soft": [1.63800895, 0.23241488, 0.1210614, 0.00994154],
}  # fmt: skip
TRANSMITTED = {  # width in wavelengths: hard, soft; printed to 5 digits
    10: (1.00001, 0.99792), 1: (1.00331, 0.95310), 0.2: (1.05570, 0.11144),
}  # fmt: skip


def half_space(degree=400):
    t, weight = np.polynomial.legendre.leggauss(degree)
    return np.pi / 2 * t, np.pi / 2 * weight


@pytest.mark.parametrize("boundary", ["hard", "soft"])
def test_ten_wavelengths(boundary):
    found = np.square(np.abs(slit_screen([(-5, 5)], boundary=boundary).field(POINTS)))
    assert np.abs(found - FIGURES[boundary]).max() < 6e-9  # half of the last printed digit


@pytest.mark.parametrize("width", TRANSMITTED)
def test_transmitted_power(width):
    found = [slit_screen([(-width / 2, width / 2)], boundary=b).transmitted for b in ("hard", "soft")]
    assert np.abs(np.subtract(found, TRANSMITTED[width])).max() < 6e-6  # half of the last printed digit


@pytest.mark.parametrize("aslant", [0.0, 0.9])
@pytest.mark.parametrize("boundary", ["hard", "soft"])
def test_power_through_the_slits_is_that_of_the_far_field(boundary, aslant):
    """Two unequal slits: what passes, by the unknowns in the slits, and what arrives, by another integral."""
    slits = [(-5.0, -1.0), (1.0, 4.0)]
    solved = slit_screen(slits, boundary=boundary, angle=aslant)
    angles, weights = half_space()
    arrived = np.square(np.abs(solved.far_field(angles))) @ weights / (7 * np.cos(aslant))
    assert arrived == pytest.approx(solved.transmitted, abs=1e-12)  # measured 3e-14
    finer = slit_screen(slits, boundary=boundary, nodes=32, angle=aslant)
    assert np.abs(solved.field(POINTS) - finer.field(POINTS)).max() < 1e-12  # measured 5e-15
    coarse = slit_screen(slits, boundary=boundary, nodes=2.2, angle=aslant)  # 24 nodes a slit: the check above can fail
    assert np.abs(coarse.field(POINTS) - finer.field(POINTS)).max() > 1e-8


@pytest.mark.parametrize("boundary", ["hard", "soft"])
def test_far_field_is_the_limit_of_the_field(boundary):
    solved, far, angle = slit_screen([(-1, 1)], boundary=boundary), 1e5, np.array([0.3, -0.8])
    at = far * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    limit = solved.field(at) * np.sqrt(far) * np.exp(-2j * np.pi * far)
    assert np.abs(limit - solved.far_field(angle)).max() < 5e-5  # next order: k h^2 / (2 r) = 3e-5 of it


def test_wide_slit_is_two_half_planes():
    """Near one edge of 50 wavelengths the field is that of a half plane, but for the wave of the other edge. That wave
    is 1/sqrt(2 pi k 50) = .023 for each way of a soft edge, and of order (k 50)^(-3/2) = 2e-4 for a hard one, whose
    wave along the screen cancels at normal incidence."""
    from references.wedge_series import half_plane

    width, at = 50.0, np.array([[0.7, 2.0], [-1.0, 1.5]])
    for boundary, tolerance in (("hard", 1e-3), ("soft", 0.046)):
        found = slit_screen([(0.0, width)], boundary=boundary, nodes=5).field(at)
        # 0-face: the lit side of the metal x < 0; from there over the slit (x > 0) to the dark side.
        phi = np.pi + np.arctan2(at[:, 1], at[:, 0])
        expected = half_plane(2 * np.pi - phi, 1.5 * np.pi, np.hypot(*at.T), 2 * np.pi, boundary)
        assert np.abs(found - expected).max() < tolerance  # measured 6.5e-4, .029
