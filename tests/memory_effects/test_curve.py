"""The memory effect of a slab against two independent programs and closed forms."""

from functools import partial

import numpy as np
import pytest
from refusals import assert_refused
from scenes import slab as slab_of_depth
from scipy.special import j0
from scipy.stats import chi2, norm
from scipy.stats import t as student
from zscore import FALSE_ALARM, assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.core.statistics import BATCHES, jackknife
from specklegen.memory_effects.correlation import axial_tracer, estimate_correlation, lateral_distance
from specklegen.memory_effects.curve import _dark
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.endpoints import AXIS
from specklegen.theory import slab as theory

THICKNESS, WAVELENGTH = 1000.0, 0.5
DEGREES = BATCHES - 1


slab = partial(slab_of_depth, thickness=THICKNESS)


def tilts(q) -> np.ndarray:
    """Tilts at which k L sin(tilt) = q."""
    return np.arcsin(np.asarray(q) * WAVELENGTH / (2 * np.pi * THICKNESS))


def curve(medium: sg.Slab, q, paths: int, seed: int = 1, **options) -> sg.MemoryEffect:
    return sg.memory_effect(medium, wavelength=WAVELENGTH, tilts=tilts(q), paths=paths, seed=seed, **options)


# ---- The table of two independent programs --------------------------------------------------------------

Q = [0.5, 1.0, 1.491, 2.742, 4.0, 8.0]
TABLE = {  # optical depth: single share, its curve over Q, the table's standard error
    1: (0.373, [0.879, 0.678, 0.531, 0.349, 0.276, 0.201], 0.0015),
    5: (0.027, [0.908, 0.695, 0.473, 0.145, 0.048, 0.006], 0.0015),
    20: (0.0, [0.912, 0.697, 0.463, 0.105, 0.016, 0.0], 0.0025),
}
SLACK = 0.003  # beside the standard errors, granted by the table


@pytest.mark.parametrize("optical_depth", TABLE)
def test_transmission_follows_the_table(optical_depth):
    single, expected, error = TABLE[optical_depth]
    found = curve(slab(optical_depth), Q, 400_000)
    np.testing.assert_allclose(found.q, Q, rtol=1e-12)
    assert_z(found.intensity, expected, np.hypot(found.standard_error, error), degrees=DEGREES, slack=SLACK)
    assert found.single_share == pytest.approx(single, abs=0.003)
    assert not found.reverse
    # Power: tilts one tenth too large fail.
    other = curve(slab(optical_depth), np.multiply(Q, 1.1), 100_000)
    refute_z(other.intensity, expected, np.hypot(other.standard_error, error), degrees=DEGREES, slack=SLACK)


@pytest.mark.parametrize(("g", "expected"), [(0.0, 0.107), (0.8, 0.219), (0.9, 0.610)])
def test_forward_scattering_widens_the_range(g, expected):
    found = curve(slab(10, g), [2.742], 400_000)
    assert_z(found.intensity, expected, found.standard_error, degrees=DEGREES, slack=0.01)


@pytest.mark.parametrize(("albedo", "off", "on"), [(1.0, 0.580, 0.728), (0.8, 0.935, 0.985)])
def test_reflection(albedo, off, on):
    """Looking exactly back, without and with reversed paths; and 5 degrees off, where they have died out."""
    medium, back = slab(10, albedo=albedo), -AXIS
    plain = curve(medium, [2.742], 150_000, mode="reflection", view=back, reverse=False)
    assert_z(plain.intensity, off, plain.standard_error, degrees=DEGREES, slack=0.01)
    enhanced = curve(medium, [2.742], 60_000, mode="reflection", view=back, reverse=True)
    assert enhanced.reverse
    assert_z(enhanced.intensity, on, enhanced.standard_error, degrees=DEGREES, slack=0.01)
    default = curve(medium, [2.742], 150_000, 2, mode="reflection")
    assert not default.reverse
    assert_z(default.intensity, off, default.standard_error, degrees=DEGREES, slack=0.01)
    # At -i itself "auto" must take them in.
    assert curve(medium, [2.742], 64, mode="reflection", view=back).reverse


# ---- Closed forms ---------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("optical_depth", "paths"),
    [(10, 600_000), (20, 300_000), (40, 150_000)]
    + [
        pytest.param(d, n, marks=pytest.mark.slow)
        for d, n in ((10, 4_000_000), (20, 4_000_000), (40, 4_000_000), (80, 4_000_000))
    ],
)
def test_thick_slabs_follow_the_closed_form(optical_depth, paths):
    q = np.array([0.3, 0.5, 1.0, 1.491, 2.0, 2.742, 4.0, 6.0])
    found = curve(slab(optical_depth), q, paths)
    expected = theory.memory_effect_thick_slab(q, optical_depth)
    assert_z(found.intensity, expected, found.standard_error, degrees=DEGREES, slack=0.003)


def test_the_closed_form_tells_depths_apart():
    """The power of the test above: diffusion theory (Eq. 39) is refused at OD 10."""
    q = np.array([1.491, 2.742])
    found = curve(slab(10), q, 600_000)
    refute_z(found.intensity, theory.memory_effect_diffusion(q), found.standard_error, degrees=DEGREES, slack=0.003)


def test_closed_forms_have_their_figures():
    expected = [0.9207, 0.7241, 0.5000, 0.1260, 0.0215, 3e-5]
    # q = 1.491 and 2.742 are rounded there, by 0.0005 of q.
    np.testing.assert_allclose(theory.memory_effect_diffusion(Q), expected, atol=2e-4)
    assert theory.memory_effect_diffusion(0.0) == 1
    assert theory.memory_effect_diffusion(2000.0) == 0
    np.testing.assert_allclose(theory.memory_effect_diffusion([-1.0, 1e-200]), [1 / np.sinh(1) ** 2, 1.0], rtol=1e-14)
    assert theory.memory_effect_thick_slab(0.0, 10) == 1
    # Small tilts: 1 - C_I = q^2 <r^2>/2, smoothly.
    small = 1 - theory.memory_effect_thick_slab([1e-3, 2e-3], 30)
    assert small[1] / small[0] == pytest.approx(4, rel=1e-4)
    # The thick limit is Eq. 39.
    np.testing.assert_allclose(theory.memory_effect_thick_slab(Q, 1e6), theory.memory_effect_diffusion(Q), atol=1e-5)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: theory.memory_effect_thick_slab(9.0, 10), r"memory_effect_thick_slab q must be at most 0\.8 OD = 8.*9"),
    (lambda: theory.memory_effect_thick_slab(np.nan, 10), "memory_effect_thick_slab q must be"),
    (lambda: theory.memory_effect_thick_slab(1.0, -2), "optical_depth must be greater than 0; got -2"),
])  # fmt: skip
def test_closed_forms_refuse_what_they_cannot_say(call, message):
    assert_refused(call, message)


# ---- Small tilts, and the two ways to the curve --------------------------------------------------------
@pytest.mark.parametrize(("optical_depth", "g", "expected"), [(10, 0.9, 0.396), (1, 0.0, 1.16)])
def test_mean_square_distance(optical_depth, g, expected):
    kernel = estimate_correlation(slab(optical_depth, g), 1_000_000, 1)
    sums = np.stack([kernel.weights @ kernel.radius**2, kernel.weights.sum(axis=1)], 1)
    value, error = jackknife(sums, lambda total: total[0] / total[1])
    assert_z(value / THICKNESS**2, expected, error / THICKNESS**2, degrees=DEGREES, slack=0.005)


def test_the_tiniest_tilt_off_the_axis_keeps_its_sense():
    """The exact amplitudes subtract from 1: rounding leaves 1e-16 sqrt(paths), far below (k theta L)^2."""
    found = sg.memory_effect(slab(3), wavelength=WAVELENGTH, tilts=[1e-7, 2e-7], paths=20_000, seed=1,
                             mode="reflection")  # fmt: skip
    assert (found.decorrelation > 0).all()
    assert found.decorrelation[1] / found.decorrelation[0] == pytest.approx(4, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("g", "gate", "q"), [(0.0, 0.02, 1.5), (0.9, 0.002, 6.0)])
def test_both_ways_agree_on_both_sides_of_the_gate(g, gate, q):
    """A long wavelength (k L = q/gate) keeps correlation at the tilt where the way changes."""
    medium = slab(5, g)
    wavelength = 2 * np.pi * THICKNESS * gate / q

    def at(angles, seed):
        return sg.memory_effect(medium, wavelength=wavelength, tilts=angles, paths=200_000, seed=seed)

    below = np.array([0.3, 0.7, 0.999]) * gate
    axial = at(below, 1)
    exact = at([*below, 1.001 * gate], 2)  # one tilt beyond the gate takes all of them the exact way
    error = np.hypot(axial.standard_error, exact.standard_error[:3])
    # The axial way drops terms of the order of the tilt squared over (1 - g)^2, here 4e-4.
    assert_z(axial.intensity, exact.intensity[:3], error, degrees=DEGREES, slack=1e-3)
    assert 0.2 < exact.intensity[2] < 0.9
    assert_z(np.abs(axial.field) ** 2, axial.intensity, axial.standard_error, degrees=DEGREES)
    assert_z(exact.single_share, axial.single_share, 0.02)
    # Power: the same comparison at tilts one tenth apart fails.
    refute_z(at(1.1 * below[:2], 1).intensity, exact.intensity[:2], error[:2], degrees=DEGREES, slack=1e-3)


def test_oblique_view_matches_its_bank():
    """C = E[W a_0 a_t*] along an oblique view, against Eq. 41 for single scattering (an all but absorbing slab)."""
    medium = slab(2, albedo=1e-9)
    angles = np.array([1e-4, 3e-4, 1e-3])
    view = np.array([0.3, 0.2, np.sqrt(1 - 0.13)])
    found = sg.memory_effect(medium, wavelength=WAVELENGTH, tilts=angles, paths=64_000, seed=1, view=view)
    k, sigma = 2 * np.pi / WAVELENGTH, medium.extinction
    lights = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], 1)
    views = view + lights * [1, 0, 0]
    views[:, 2] = np.sqrt(1 - (views[:, :2] ** 2).sum(axis=1))
    # Only z enters: C ~ int e^(ik z (di_z - dv_z)) tau dz, moduli of the two attenuations included.
    z = (np.arange(100_000) + 0.5) / 100_000 * THICKNESS
    amplitude = lambda i, v: np.exp(-0.5 * sigma * (z / i + (THICKNESS - z) / v) + 1j * k * z * (i - v))  # noqa: E731
    reference = amplitude(1.0, view[2])
    expected = []
    for i, v in zip(lights, views, strict=True):
        other = amplitude(i[2], v[2])
        product = abs((reference * other.conj()).sum()) ** 2
        expected.append(product / np.square(np.abs(reference)).sum() / np.square(np.abs(other)).sum())
    assert_z(found.intensity, expected, found.standard_error, degrees=DEGREES)
    assert found.single_share == pytest.approx(1)
    assert min(expected) < 0.9


# ---- Standard errors -----------------------------------------------------------------------------------
def test_jackknife_removes_the_bias_of_a_square():
    """|mean|^2 is too high by its own variance; the jackknife is not, and says its error."""
    generator = np.random.default_rng(0)
    shape = (4000, 64)
    batches = 0.3 + (generator.normal(size=shape) + 1j * generator.normal(size=shape)) / np.sqrt(2)
    counted = np.stack([batches, np.ones(shape)], axis=2)
    both = [jackknife(b, lambda total: np.square(np.abs(total[0] / total[1]))) for b in counted]
    values, errors = (np.array(x) for x in zip(*both, strict=True))
    assert_mean(values, 0.09)
    refute_mean(np.square(np.abs(batches.mean(axis=1))), 0.09)  # the plain estimate is high by 1/64
    # What is stated holds the truth; the variance alone, of 3.4 standard errors, would in 9 cases of ten.
    assert errors.var() > 0
    assert np.mean(np.abs(values - 0.09) <= 1.96 * errors) > 0.93
    assert np.sqrt(np.mean(errors**2)) < 2 * values.std()


def test_jackknife_of_one_lit_batch_has_no_error():
    """Without that batch nothing is left to divide by: the ratio stands, its error is unknown."""
    batches = np.zeros((64, 2))
    batches[5] = 3.0, 4.0
    value, error = jackknife(batches, lambda total: total[0] / total[1])
    assert value == 0.75
    assert np.isnan(error)


def test_jackknife_keeps_a_faint_batch_beside_a_bright_one():
    """What the bright batch leaves is the faint one's own ratio, not the rounding of a difference."""
    batches = np.zeros((3, 2))
    batches[0], batches[2] = (1e20, 1e20), (0.3, 0.4)
    value, error = jackknife(batches, lambda total: total[0] / total[1])
    # Ratios without each batch: 0.75, 1, 1; the mean 11/12, so 3 - 2 * 11/12: 1/6 off the value of 1.
    assert value == pytest.approx(7 / 6, rel=1e-12)
    spread = 1 / 6 * student.ppf(0.975, 2) / norm.ppf(0.975)  # sqrt(2/3 (1/36 + 2/144)), of two degrees of freedom
    assert error == pytest.approx(spread + 2 / 6, rel=1e-12)


def test_faint_light_has_its_correlation():
    """At an albedo of 1e-160 the product of two intensities underflows; their roots do not."""
    found, right = (
        sg.memory_effect(slab(1.0, albedo=a), wavelength=WAVELENGTH, tilts=[0.0, 1e-3], paths=6400, mode="reflection")
        for a in (1e-160, 1e-50)
    )
    assert found.intensity[0] == pytest.approx(1, abs=1e-12)
    assert_z(found.intensity[1], right.intensity[1], np.hypot(found.standard_error, right.standard_error)[1],
             degrees=DEGREES)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, pytest.param({"mode": "reflection"}, marks=pytest.mark.slow)])
def test_standard_errors_are_calibrated(options):
    """z of independent seeds about their common mean has variance 1, or less: errors are 1 to 1.3 times the spread.
    They are what 1.96 of hold the truth in 95 % of cases, heavy tails and bends included (`jackknife`)."""
    seeds, q = 200, [0.7, 1.5]
    runs = [curve(slab(2), q, 2000, (9, seed), **options) for seed in range(seeds)]
    values, errors = np.array([r.intensity for r in runs]), np.array([r.standard_error for r in runs])
    z = (values - values.mean(axis=0)) / errors
    score = np.square(z).sum(axis=0)
    share = FALSE_ALARM / 4
    # 64 batches of oblique weights spread the errors themselves: Student's t has variance 63/61, and as much again.
    low, high = chi2.isf(1 - share, seeds - 1), chi2.isf(share, seeds - 1) * 1.1
    assert (low / 1.3**2 < score).all(), score / seeds
    assert (score < high).all(), score / seeds
    # Power: errors too small by a half, or too large by eight tenths, are seen.
    assert (score * 2**2 > high).all()
    assert (score / 1.8**2 < low / 1.3**2).all()


def test_errors_of_tilts_that_no_estimate_is_right_at_hold_the_doubt():
    """At 60 degrees, mean free paths in the near field of the lobe, it was .003."""
    dense = sg.Slab(thickness=100.0, mean_free_path=5.0, scatterer=sg.HenyeyGreenstein(0.9))
    with pytest.warns(sg.DoubtWarning, match="standard errors hold"):
        found = sg.memory_effect(dense, wavelength=1.0, tilts=np.deg2rad([0.0, 10.0, 60.0]), paths=2000)
    assert (found.standard_error[1:] >= np.minimum(np.square(found.tilts[1:]), 1)).all()
    assert found.standard_error[0] < 1e-9


def test_what_takes_long_is_said_before(caplog, monkeypatch):
    """The same slab ten times as deep; nothing is traced here."""
    monkeypatch.setattr("specklegen.memory_effects.curve._axial", lambda *arguments: _dark(1))
    deep = sg.Slab(thickness=100.0, mean_free_path=0.1, scatterer=sg.Isotropic())
    with pytest.warns(sg.DoubtWarning):
        sg.memory_effect(deep, wavelength=1e-3, tilts=[0.0], paths=10**6, threads=1)
    assert "about 28 s for 1 tilts of 1000000 paths" in caplog.text
    with pytest.raises(RuleError, match="memory_effect tilts must be done within 30 days"):
        sg.memory_effect(deep, wavelength=1e-3, tilts=[0.0], paths=10**11, threads=1)
    caplog.clear()
    sg.memory_effect(slab(2), wavelength=WAVELENGTH, tilts=[0.0], paths=100)
    assert not caplog.text


# ---- The kernel ----------------------------------------------------------------------------------------
def test_kernel_is_the_bessel_mean_of_its_bank():
    """K(q) = E[w J0(q r)]/E[w]: the histogram of r against the sum over connections, on the same paths."""
    medium = slab(5, 0.5)
    kernel = estimate_correlation(medium, 50_000, 1)
    tracer = axial_tracer(medium)
    bank = tracer.trace(1, 50_000)
    w = contributions(tracer.layout, bank)
    q = np.array([0.0, 0.1, 0.5, 1.0, 3.0, 10.0]) / THICKNESS
    expected = (w * j0(q[:, None] * lateral_distance(bank))).sum(axis=1) / w.sum()
    # Bins are 2.7 % wide about their mean square: the error is (0.027 q r)^2 / 24.
    np.testing.assert_allclose(kernel(q), expected, atol=2e-4)
    assert float(kernel(0.0)) == pytest.approx(1, rel=1e-14)
    assert kernel.single_share == pytest.approx(w[bank.orders == 1].sum() / w.sum(), rel=1e-12)


def test_half_range_is_where_it_says():
    kernel = estimate_correlation(slab(10, 0.9), 300_000, 1)
    half, floor = kernel.half_range(), kernel.single_share**2
    assert kernel(half) ** 2 == pytest.approx(0.5 * (1 + floor), rel=1e-9)
    assert half * THICKNESS == pytest.approx(3.93, abs=0.1)  # physics.md 8
    assert estimate_correlation(slab(2, albedo=1e-12), 1000, 1).half_range() == np.inf


# ---- Errors --------------------------------------------------------------------------------------------

BAD = {"tilts of 90 degrees": ({"tilts": [90.0]}, "memory_effect tilts must be radians.*got .*90.*np.deg2rad"),
       "tilts of two axes": ({"tilts": [[0.0, 0.1]]}, r"memory_effect tilts must be.*shape \(T,\)"),
       "view behind": ({"view": [0.0, 0.0, -1.0]}, "memory_effect view must be .*side of transmission"),
       "view beyond the horizon": ({"view": [0.8, 0.0, 0.6], "tilts": [0.5]}, "inside the unit circle")}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_named(case):
    changes, message = BAD[case]
    good = {"wavelength": WAVELENGTH, "tilts": [0.0], "paths": 10}
    assert_refused(lambda: sg.memory_effect(slab(2), **(good | changes)), message)


@pytest.mark.parametrize("mode", ["transmission", "reflection"])
def test_light_without_digits_is_dark(mode):
    """At an albedo of 2e-308 weights are denormal: their ratios were 1.001 for 1, or overflowed."""
    particles = sg.VonMisesFisher(concentration=5.6)
    medium = sg.Slab(thickness=1e-9, mean_free_path=1.0, albedo=2.2250738585072014e-308, scatterer=particles)
    with np.errstate(all="raise", under="ignore"), pytest.warns(sg.DoubtWarning, match="none of 64 paths"):
        found = sg.memory_effect(medium, wavelength=1.0, tilts=[0.0, 0.01], mode=mode, paths=64)
    assert np.isnan(found.intensity).all()
    assert np.isnan(found.field).all()
