"""The generalised memory effect of slabs and screens."""

import numpy as np
import pytest
from zscore import assert_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.paths.joint_correlation import forward_correlation

K = 2 * np.pi
CONCENTRATION = (K * 4.0) ** 2 / 2  # of lobes as screens of correlation length 4 have
SLAB = sg.Slab(thickness=400.0, mean_free_path=80.0, scatterer=sg.VonMisesFisher(concentration=CONCENTRATION))
TILT = 13.1 / (K * 400.0)
SHIFTS = np.array([0.0, 0.25, 0.5, 0.75]) * 400.0 * TILT


@pytest.fixture(scope="module")
def walked():
    return sg.joint_correlation(SLAB, wavelength=1.0, tilts=[0.0, TILT], shifts=SHIFTS, paths=40_000, seed=1)


def test_a_forward_slab_by_paths_as_measured_elsewhere(walked):
    """Independent paths .653 .820 .891 .832, errors of the last digit; waves in slices .649 .817 .890 .830."""
    error = np.hypot(walked.standard_error[1], 0.002)
    assert_z(walked.magnitude[1], [0.653, 0.820, 0.891, 0.832], error)
    assert_z(walked.magnitude[1], [0.649, 0.817, 0.890, 0.830], np.hypot(error, 0.002))


def test_the_comparison_has_power(walked):
    moved = sg.joint_correlation(SLAB, wavelength=1.0, tilts=[1.1 * TILT], shifts=SHIFTS, paths=40_000, seed=1)
    with pytest.raises(AssertionError, match="z ="):
        assert_z(moved.magnitude[0], walked.magnitude[1], np.hypot(moved.standard_error[0], 0.002))


def test_the_closed_form_and_the_optimum_plane(walked):
    expected = forward_correlation(SLAB, 1.0, TILT, SHIFTS)
    np.testing.assert_allclose(expected, [0.636, 0.821, 0.893, 0.821], atol=1e-3)
    # The ballistic light and large angles, which the closed form counts as Gaussian, are worth some .02.
    np.testing.assert_allclose(walked.magnitude[1], expected, atol=0.025)
    assert walked.plane == pytest.approx(200.0, rel=0.05)
    assert walked.magnitude[1].argmax() == 2
    np.testing.assert_allclose(walked.magnitude[0, 0], 1.0)


def test_screens_have_it_in_closed_form():
    screen = sg.PhaseScreen(rms_phase=4.0, correlation_length=20.0)
    pair = sg.ScreenStack(screens=(screen, screen), gaps=(800.0,))
    found = sg.joint_correlation(pair, wavelength=1.0, tilts=[0.00391], shifts=[0.0, 0.00391 * 400.0])
    np.testing.assert_allclose(found.magnitude[0, 0], 0.680, atol=1.5e-3)
    assert found.plane == pytest.approx(400.0)
    assert found.magnitude[0, 1] > found.magnitude[0, 0]
    assert not found.standard_error.any()


def test_a_result_is_a_function_of_its_seed_and_a_bad_argument_is_named():
    few = {"wavelength": 1.0, "tilts": [TILT], "shifts": [0.0], "paths": 640}
    one, again, other = (sg.joint_correlation(SLAB, **few, seed=seed).magnitude for seed in (1, 1, 2))
    assert one == again != other
    with pytest.raises(sg.RuleError, match="paths"):
        sg.joint_correlation(SLAB, wavelength=1.0, tilts=[TILT], shifts=[0.0], paths=3)


def test_paths_that_do_not_cross_an_absorbing_slab_are_refused():
    """Optical depth 40, albedo 0.5: a correlation of 1.004 +- 0.016 of whatever came through was handed out."""
    medium = sg.Slab(thickness=1000.0, mean_free_path=25.0, albedo=0.5, scatterer=sg.Isotropic())
    with pytest.raises(RuleError, match="joint_correlation paths must be enough that light crosses"):
        sg.joint_correlation(medium, wavelength=0.5, tilts=[1e-4], shifts=[0.0])
