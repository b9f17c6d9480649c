"""Soft strips: against frozen figures, the optical theorem, the slit screen and convergence."""

import numpy as np
import pytest
from references.strip_solver import strip_solver

from specklegen.oracles.slit_screen import slit_screen

SCREEN = [((-30, 0), (-9.5, 0)), ((-4.5, 0), (4.5, 0)), ((9.5, 0), (30, 0))]
REFLECTOR = ((16, 40), (22, 80))
X = np.array([-40, -14.03, 0.02, 7.51, 12.3, 25.02, 45])
POINTS = np.stack([X, np.full(7, 150.0)], axis=1)
FIGURES = [1.254901, 0.168970, 0.601606, 0.185454, 0.309625, 0.202122, 1.027828]  # independent implementation, 6 digits


def test_two_slits_and_a_reflector():
    found = strip_solver([*SCREEN, REFLECTOR])
    assert np.abs(np.square(np.abs(found.field(POINTS))) - FIGURES).max() < 6e-7  # half of the last printed digit
    finer = strip_solver([*SCREEN, REFLECTOR], nodes=10)
    assert np.abs(found.field(POINTS) - finer.field(POINTS)).max() < 1e-11  # measured 3e-14
    coarse = strip_solver([*SCREEN, REFLECTOR], nodes=2.1)
    assert np.abs(coarse.field(POINTS) - finer.field(POINTS)).max() > 1e-6  # that check can fail


def test_optical_theorem():
    """Oblique light on two strips at an angle: what all directions receive is what the forward direction lacks."""
    angle = np.linspace(0, 2 * np.pi, 1200, endpoint=False)
    around = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    for direction in ((0.0, 1.0), (0.6, 0.8)):
        solved = strip_solver([((-3, 0), (2, 1)), ((4, 2), (4.5, 6))], direction)
        scattered = np.square(np.abs(solved.far_field(around))).mean() * 2 * np.pi
        taken = -np.sqrt(8 * np.pi / (2 * np.pi)) * solved.far_field(solved.direction[None])[0].real
        assert scattered == pytest.approx(taken, rel=1e-12)  # measured 1e-14


def test_reciprocity():
    a, b = np.array([0.28, 0.96]), np.array([-0.6, 0.8])
    strips = [((-3, 0), (2, 1)), ((4, 2), (4.5, 6))]
    there = strip_solver(strips, tuple(a)).far_field(-b[None])[0]
    back = strip_solver(strips, tuple(b)).far_field(-a[None])[0]
    assert abs(there - back) < 1e-12 * abs(there) + 1e-13


def test_a_wide_screen_with_a_slit_is_the_slit_screen():
    """Two solvers of different equations: strips of 60 wavelengths leave the waves of their far edges at the axis.
    Geometry: at the angle 80 degrees they have D/sqrt(s) of .006 each; the difference falls with the width."""
    at = np.array([[0.0, 12.0], [3.0, 15.0]])
    exact = slit_screen([(-2.5, 2.5)], boundary="soft").field(at)
    for half, tolerance in ((30, 0.02), (60, 0.0075)):  # measured 6.1e-3 at 60, 1.8e-3 at 150
        wide = strip_solver([((-half, 0), (-2.5, 0)), ((2.5, 0), (half, 0))], nodes=5).field(at)
        assert np.abs(wide - exact).max() < tolerance
    assert np.abs(exact).min() > 0.25
