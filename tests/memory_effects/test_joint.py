"""The generalised memory effect of slabs and screens."""

import numpy as np
import pytest
from refusals import assert_refused
from scipy.special import j0
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.core.statistics import batch_sums, jackknife
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.memory_effects.joint import forward_correlation
from specklegen.memory_effects.oblique import estimate_oblique_correlation
from specklegen.paths.analog_walk import walked as walked_light

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
    refute_z(moved.magnitude[0], walked.magnitude[1], np.hypot(moved.standard_error[0], 0.002))


def test_the_closed_form_and_the_optimum_plane(walked):
    expected = forward_correlation(SLAB, 1.0, TILT, SHIFTS)
    np.testing.assert_allclose(expected, [0.636, 0.821, 0.893, 0.821], atol=1e-3)
    # The ballistic light and large angles, which the closed form counts as Gaussian, are worth some .02.
    np.testing.assert_allclose(walked.magnitude[1], expected, atol=0.025)
    assert walked.plane == pytest.approx(200.0, rel=0.05)
    assert walked.magnitude[1].argmax() == 2
    np.testing.assert_allclose(walked.magnitude[0, 0], 1.0)


# Of programs of screens and of random walks: |K| over all views, unscattered light included, and about the axis, under
# tilts of one and two bins of a grid of that side; paths first, errors of the last digit (standard error .002 granted).
FORWARD = {("vMF", 4.0, 5, 400.0, 192): ([0.653, 0.259], [0.938, 0.792]),
           ("vMF", 4.0, 20, 400.0, 384): ([0.616, 0.185], [0.901, 0.664]),
           ("vMF", 3.0, 20, 200.0, 320): ([0.708, 0.311], [0.932, 0.757]),
           ("HG", 0.98, 10, 400.0, 320): ([0.527, 0.271], [0.970, 0.900]),
           ("HG", 0.9, 10, 60.0, 320): ([0.765, 0.511], [0.912, 0.813])}  # fmt: skip


def forward_slab(kind, width, depth, thickness):
    """Lobes of Henyey and Greenstein's g, or as wide as those of screens of a correlation length."""
    lobe = sg.HenyeyGreenstein(g=width) if kind == "HG" else sg.VonMisesFisher(concentration=(K * width) ** 2 / 2)
    return sg.Slab(thickness=thickness, mean_free_path=thickness / depth, scatterer=lobe)


@pytest.mark.parametrize("case", FORWARD, ids=str)
def test_forward_slabs_have_both_memory_effects_of_another_program(case):
    *medium, side = case
    over_all, axis = FORWARD[case]
    medium, tilts = forward_slab(*medium), np.array([1, 2]) / side
    straight = np.exp(-medium.optical_depth)
    walked = sg.joint_correlation(medium, wavelength=1.0, tilts=tilts, shifts=[0.0], paths=10_000, seed=5)
    found = walked.magnitude[:, 0] * (1 - straight) + straight
    assert_z(found, over_all, np.hypot(walked.standard_error[:, 0], 0.002), degrees=63)
    curve = sg.memory_effect(medium, wavelength=1.0, tilts=np.arcsin(tilts), paths=20_000, seed=5)
    error = 0.5 * curve.standard_error / np.sqrt(curve.intensity)
    assert_z(np.sqrt(curve.intensity), axis, np.hypot(error, 0.002), degrees=63)
    refute_z(found, axis, np.hypot(walked.standard_error[:, 0], 0.002), degrees=63)  # power: neither is the other


@pytest.mark.parametrize(("scatterer", "expected"), [
    (sg.HenyeyGreenstein(g=0.99), [0.978, 0.920, 0.751]),
    (sg.VonMisesFisher(concentration=100.0), [0.762, 0.357, 0.028]),
], ids=["HG", "vMF"])  # fmt: skip
def test_the_transport_length_alone_does_not_fix_the_memory_effect_of_forward_slabs(scatterer, expected):
    """C_I at q = 4, 8, 16, OD 20 and L / l* = .2 of either."""
    medium = sg.Slab(thickness=400.0, mean_free_path=20.0, scatterer=scatterer)
    tilts = np.arcsin(np.array([4.0, 8.0, 16.0]) / (K * 400.0))
    found = sg.memory_effect(medium, wavelength=1.0, tilts=tilts, paths=50_000, seed=4)
    assert_z(found.intensity, expected, np.hypot(found.standard_error, 0.003), degrees=63)


# The slope of the lateral way with the view, over the thickness: (optical depth, g, p, its error).
SLOPES = [(5, 0.9, 0.52, 0.01), (10, 0.9, 0.58, 0.01), (10, 0.0, 0.16, 0.01), (20, 0.0, 0.08, 0.03)]


@pytest.mark.parametrize(("depth", "g", "slope", "error"), SLOPES)
def test_the_pattern_of_a_view_moves_with_the_tilt(depth, g, slope, error):
    """p L = <R> / tan v at v_x = .2."""
    lobe = sg.HenyeyGreenstein(g=g) if g else sg.Isotropic()
    medium = sg.Slab(thickness=1.0, mean_free_path=1 / depth, scatterer=lobe)
    view = np.array([0.2, 0.0, np.sqrt(0.96)])
    walk = estimate_oblique_correlation(medium, np.array([0.0, 0.0, 1.0]), view, 100_000, 3)
    both = np.stack([walk.weights * walk.displacement[:, 0], walk.weights])
    sums = batch_sums(both, walk.owners, walk.paths).real
    found, own = jackknife(sums, lambda total: total[:1] / total[1:] * view[2] / view[0])
    assert_z(found, slope, np.hypot(own, error), degrees=63)


def test_behind_faces_one_view_has_the_curve_of_the_slab():
    """Light that leaves about the axis, as it is walked between the faces and as connections are made to it."""
    medium = sg.Slab(thickness=400.0, mean_free_path=400.0 / 3, scatterer=sg.HenyeyGreenstein(g=0.7),
                     faces=sg.Faces(inside=1.33))  # fmt: skip
    walks, ways, weights, _, _ = walked_light(medium, 150_000, 3)
    near = (np.hypot(*ways.T) < 0.15) & (weights > 0)
    tilts, distance = np.array([0.8, 1.6]) / (K * 400.0), np.hypot(*walks[near].T)
    batch = np.flatnonzero(near) * 64 // len(near)
    sums = np.array([np.bincount(batch, each, 64) for each in (*j0(K * tilts[:, None] * distance), 1.0 + 0 * distance)])
    found, error = jackknife(sums.T, lambda total: total[:-1] / total[-1])
    kernel = estimate_correlation(medium, 30_000, 4)
    curve, _, own = kernel.intensity(K * tilts)
    # A cone of .15 about the axis: the walk of its light is 2 % longer at most.
    assert_z(np.square(found), curve, np.hypot(2 * found * error, own), degrees=63, slack=0.006)
    matched = estimate_correlation(medium.replace(faces=sg.Faces()), 30_000, 4)(K * tilts)
    refute_z(np.square(found), np.square(matched), np.hypot(2 * found * error, own), degrees=63, slack=0.006)


def test_faces_that_do_not_reflect_leave_the_joint_correlation_to_the_bit():
    few = {"wavelength": 1.0, "tilts": [0.4 * TILT], "shifts": SHIFTS[:2], "paths": 640}
    plain, same, water = (
        sg.joint_correlation(SLAB.replace(faces=faces), **few).magnitude
        for faces in (sg.Faces(), sg.Faces(inside=1.4, outside=1.4), sg.Faces(inside=1.33))
    )
    assert plain.tobytes() == same.tobytes() != water.tobytes()


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
    assert_refused(lambda: sg.joint_correlation(SLAB, wavelength=1.0, tilts=[TILT], shifts=[0.0], paths=3), "paths")


def test_paths_that_do_not_cross_an_absorbing_slab_are_refused():
    """Optical depth 40, albedo 0.5: a correlation of 1.004 +- 0.016 of whatever came through was handed out."""
    medium = sg.Slab(thickness=1000.0, mean_free_path=25.0, albedo=0.5, scatterer=sg.Isotropic())
    with pytest.raises(RuleError, match="joint_correlation paths must be enough that light crosses"):
        sg.joint_correlation(medium, wavelength=0.5, tilts=[1e-4], shifts=[0.0])
