"""Diffusing-wave spectroscopy: its own figures, its limits, and how far it is from radiative transfer."""

from functools import cache

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose
from refusals import assert_refused
from scipy.linalg import solve_banded
from scipy.optimize import brentq
from zscore import assert_z

from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.theory.diffusing_wave import inferred_depths, reflected_field, transmitted_field
from specklegen.theory.speckle_contrast import contrast_squared, diffusing_contrast_squared


@cache
def light(depth, g, motion, view=1.0, nodes=48):
    return adding_doubling(depth, albedo=1.0, g=g, motion=motion, view=view, nodes=nodes)


def test_printed_figures():
    x = np.array([0.002, 0.005, 0.01, 0.02, 0.05, 0.1])
    assert_allclose(transmitted_field(x, 10.0), [0.7896, 0.5746, 0.3620, 0.1682, 0.0304, 0.0039], atol=6e-5)


def test_the_slab_is_the_formula_with_more_digits():
    def literal(x, depths, h):
        with mpmath.workdps(60):
            x, depths, h = mpmath.mpf(x), mpmath.mpf(depths), mpmath.mpf(h)
            a = mpmath.sqrt(6 * x)
            above = mpmath.sinh(a) + h * a * mpmath.cosh(a)
            below = (1 + h**2 * a**2) * mpmath.sinh(depths * a) + 2 * h * a * mpmath.cosh(depths * a)
            return float((depths + 2 * h) / (1 + h) * above / below)

    for depths, h in ((1.0, 0.0), (10.0, 2 / 3), (1e3, 2.5)):
        for x in (1e-30, 1e-9, 1e-4, 0.3, 4.0):
            found = transmitted_field(x, depths, extrapolation=h)
            assert float(found) == pytest.approx(literal(x, depths, h), rel=1e-13), (depths, h, x)
    assert_allclose(transmitted_field([0.0, 1e300], 10.0), [1.0, 0.0])


def faces(x, depths, h, cells):
    """phi at both faces, phi'' - a^2 phi = -delta(z - 1) with phi = h phi' outwards, by finite differences."""
    width = depths / cells
    bands = np.zeros((3, cells + 1))
    bands[0, 1:] = bands[2, :-1] = -1 / width
    bands[1] = 2 / width + 6 * x * width
    bands[1, [0, -1]] = 1 / width + 3 * x * width + 1 / h
    source = np.zeros(cells + 1)
    source[round(1 / width)] = 1.0
    return solve_banded((1, 1), bands, source)[[0, -1]]


@pytest.mark.parametrize("h", [0.3, 2 / 3])
def test_both_formulas_are_the_diffusion_equation(h):
    """Light that leaves is phi over h; the half space is a slab of 40 transport lengths where a > 1/2."""
    for x in (1e-4, 0.01, 0.2):
        rest, moved = faces(0.0, 8.0, h, 8000), faces(x, 8.0, h, 8000)
        assert moved[1] / rest[1] == pytest.approx(float(transmitted_field(x, 8.0, extrapolation=h)), rel=1e-5)
    a = np.sqrt(6 * 0.1)
    deep = faces(0.1, 40.0, h, 40_000)[0]
    assert deep / h * (1 + h * a) == pytest.approx(np.exp(-a), rel=1e-5)  # at rest all comes back, phi = h
    assert float(reflected_field(0.1, extrapolation=h)) == pytest.approx(deep / h, rel=1e-5)


def test_reflected_light_is_near_its_exponential():
    """The form that contrast imaging uses, of gamma 5/3, is this one's straight line at x = 0."""
    x = 1e-8
    assert float(np.log(reflected_field(x)) / -np.sqrt(6 * x)) == pytest.approx(5 / 3, rel=1e-3)
    for exposure in (0.001, 0.01):
        assert contrast_squared(reflected_field, exposure) == pytest.approx(
            float(diffusing_contrast_squared(exposure, 1.0)), rel=0.03
        )


@pytest.mark.parametrize(("depth", "g", "ratio"),
                         [(5.0, 0.0, 0.921), (10.0, 0.0, 0.969), (20.0, 0.0, 0.993), (100.0, 0.9, 1.011)])  # fmt: skip
def test_what_is_inferred_of_a_slab(depth, g, ratio):
    """Lambda of this theory over the true one, read off at g1 = 1/2: within 5 % from Lambda = 10 on."""
    rest = light(depth, g, 0.0).transmitted
    x = brentq(lambda x: light(depth, g, x).transmitted / rest - 0.5, 1e-5, 0.2, xtol=1e-9)
    # Paths printed them: standard errors of .0015 of g1 move x by .3 %, and Lambda by .25 %.
    found = inferred_depths(0.5, x) / (depth * (1 - g))
    assert_z(found, ratio, 0.0025)
    assert abs(found - 1) < (0.05 if depth * (1 - g) >= 10 else 0.08)


def multiple(x, depth=60.0):
    """Multiple scattering alone, sent back 5 degrees off the axis."""
    cosine = np.cos(np.deg2rad(5))
    rate = 1 + 1 / cosine
    single = -np.expm1(-depth * rate) / rate / (4 * np.pi * cosine) * np.exp(-2 * x * (1 + cosine))
    return light(depth, 0.0, x, cosine).reflected - single


def falls_to_one_over_e(depth):
    return brentq(lambda x: (multiple(x, depth) / multiple(0.0, depth)) ** 2 - np.exp(-1), 1e-3, 0.1)


def test_light_sent_back():
    """g1 .870 .606 .200 of multiple scattering, and 25 times sooner than single scattering at a right angle. Rosenbluh,
    Hoshen, Freund, Phys. Rev. Lett. 58, 2754 (1987) measured 25. Printed figures are of an optical depth of 60; that is
    no half space yet, where it is 29 times: paths deeper than that are few, but the first to decay."""
    x = np.array([0.001, 0.01, 0.1])
    assert_z([multiple(each) / multiple(0.0) for each in x], [0.870, 0.606, 0.200], 0.0015)
    assert 0.25 / falls_to_one_over_e(60.0) == pytest.approx(25.1, abs=0.1)  # e^(-4x) = 1/e at x = .25
    assert 0.25 / falls_to_one_over_e(4000.0) == pytest.approx(29.1, abs=0.1)
    # What diffusion says is too high: it begins a transport length deep, and knows no reflection of few scatterings.
    deep = np.array([multiple(each, 4000.0) / multiple(0.0, 4000.0) for each in x])
    assert_allclose(reflected_field(x) - deep, [0.038, 0.089, 0.113], atol=2e-3)


@pytest.mark.parametrize(("ask", "words"), [
    (lambda: transmitted_field(-1.0, 10.0), "transmitted_field x must be finite and at least 0"),
    (lambda: reflected_field([0.1j]), "reflected_field x must be an array of real numbers"),
    (lambda: transmitted_field(0.1, 0.0), "transport_depths must be finite and above 0"),
    (lambda: inferred_depths(1.0, 0.1), "field must be between 0 and 1"),
    (lambda: inferred_depths(0.5, 0.0), "x must be finite and above 0"),
    (lambda: inferred_depths(0.9, 1e3), "field must be that of a slab of 1 to 1e"),
])  # fmt: skip
def test_bad_input_is_named(ask, words):
    assert_refused(ask, words)
