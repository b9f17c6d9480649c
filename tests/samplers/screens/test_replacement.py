"""Screens in the place of a slab, against the slab's own memory effect."""

import numpy as np
import pytest
from refusals import assert_refused
from scipy.integrate import trapezoid
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.theory.phase_screens import lobes


def slab(scatterer, depth=8.0, **fields):
    return sg.Slab(thickness=400.0, mean_free_path=400.0 / depth, scatterer=scatterer, **fields)


LOBE = sg.VonMisesFisher(300.0)


@pytest.fixture(scope="module")
def narrow():
    return sg.stack_like(slab(LOBE), wavelength=1.0, paths=20_000)


def test_a_slab_of_gaussian_lobes_is_replaced_within_a_few_hundredths(narrow):
    """Forward, L / l* = .03: multi-slice and paths agree within .013 there, and what is left is paraxial."""
    assert [narrow.of_slab[0], narrow.of_stack[0]] == pytest.approx([1, 1], abs=1e-12)
    assert narrow.of_slab[-1] < 0.5
    assert narrow.error < 0.03 + 5 * narrow.standard_error.max()
    assert narrow.radiance == pytest.approx(1, abs=0.15)
    assert narrow.transmittance_error < 3e-4
    power = expected_power(narrow.stack)
    assert_z([narrow.transmittance], [power], [narrow.transmittance_error], degrees=19_999, slack=1e-4)


def expected_power(stack):
    """What leaves the stack: the integral of its lobe and the unscattered light."""
    sines = np.linspace(0, 1, 20001)
    lobe = lobes(stack, 1.0).density(sines)
    return trapezoid(2 * np.pi * sines * lobe, sines) + np.exp(-stack.optical_depth(1.0))


def test_what_a_slab_holds_back_is_stated_against_adding_and_doubling():
    """Of an index-matched slab that also absorbs: its stack has all of the light, and the ratio is in the report."""
    medium = slab(sg.HenyeyGreenstein(0.95), depth=2.0, albedo=0.95)
    made = sg.stack_like(medium, wavelength=1.0, paths=20_000)
    exact = adding_doubling(2.0, albedo=0.95, g=0.95).transmittance
    assert made.transmittance_error < 0.003
    assert_z([made.transmittance], [exact], [made.transmittance_error], degrees=19_999)
    assert 0.95 < expected_power(made.stack) < 1  # at rms angles of a third a little lies beyond right angles
    refute_z([made.transmittance], [exact + 0.02], [made.transmittance_error], degrees=19_999)


def test_what_is_said_of_the_slab_is_what_memory_effect_says(narrow):
    curve = sg.memory_effect(slab(LOBE), wavelength=1.0, tilts=np.arcsin(narrow.tilts), paths=20_000, seed=5)
    error = np.hypot(curve.standard_error, narrow.standard_error)[1:]
    assert_z(narrow.of_slab[1:], curve.intensity[1:], error, degrees=60)


def test_the_walk_has_both_variances_of_the_slab(narrow):
    """Over all views OD theta^2 L^2 / 3, at a fixed view a quarter of it, whatever the number of screens."""
    from specklegen.theory.phase_screens import spread

    for stack in (narrow.stack, sg.stack_like(slab(LOBE), wavelength=1.0, screens=3, paths=2000).stack):
        over_all, fixed, pivot = spread(stack, 1.0)
        angle = 1 - LOBE.mean_cosine()  # 2 (1 - cos) = two axes
        assert over_all == pytest.approx(8 * angle * 400.0**2 / 3, rel=1e-9)
        assert fixed == pytest.approx(8 * angle * 400.0**2 / 12, rel=1e-9)
        assert pivot == pytest.approx(200.0, rel=1e-9)


@pytest.mark.parametrize(("medium", "says"), [
    (slab(sg.HenyeyGreenstein(0.5)), "wavelength|rms angle"),
    (slab(LOBE, faces=sg.Faces(inside=1.33)), "screens do not reflect"),
])  # fmt: skip
def test_what_no_screens_can_replace_is_refused(medium, says):
    assert_refused(lambda: sg.stack_like(medium, wavelength=1.0, paths=1000), says)
