"""The screens sampler against drawn phases and propagated waves."""

import numpy as np
import pytest
import screen_waves_by_hand as by_hand
from refusals import assert_refused
from zscore import assert_z

import specklegen as sg
from specklegen.oracles.screen_waves import ScreenWaves
from specklegen.samplers.screens.correlation import screen_correlation
from specklegen.samplers.screens.rule import FACETS, errors

WIDTH, STEPS, HALF = 150.0, ((0, 0), (3, 0), (6, 0)), 10
DOUBLE = sg.ScreenStack(screens=(sg.PhaseScreen(rms_phase=3.0, correlation_length=15.0),) * 2, gaps=(300.0,))
WEAK = sg.PhaseScreen(rms_phase=0.3, correlation_length=6.0)


def moments(fields):
    """Per realization: intensities of three annuli, correlations of tilt pairs there, and those of mirrored views."""
    rows, columns = fields.shape[-2:]
    y, x = np.mgrid[:rows, :columns] - HALF
    rings = [np.hypot(y, x) < 4, (np.hypot(y, x) >= 4) & (np.hypot(y, x) < 8), np.hypot(y, x) >= 8]
    power = np.square(np.abs(fields[:, 0]))
    found = [power[:, ring].mean(-1) for ring in rings]
    for t, (step, _) in enumerate(STEPS[1:], start=1):
        one, two = by_hand.moved(fields, t, step)
        product = one * two.conj()
        found += [product[:, ring[:, : columns - step]].mean(-1) for ring in rings[:2]]
    mirrored = fields[:, 0] * fields[:, 0, ::-1, ::-1]
    off = np.hypot(y, x) >= 2
    return np.array([*found, mirrored[:, off].mean(-1)]).T


@pytest.fixture(scope="module", params=[pytest.param("double", marks=pytest.mark.slow), "weak"])
def both(request):
    """Moments [R, n] by waves and by the sampler."""
    stack = DOUBLE if request.param == "double" else WEAK.stack
    waves = ScreenWaves(stack, 1.0, 160, 1.875)
    scene = by_hand.scene_of(waves, HALF, STEPS, WIDTH)
    exact = by_hand.wave_fields(waves, scene, 120, seed=1)
    with pytest.warns(sg.DoubtWarning, match="contrast"):  # moments of second order do not mind
        drawn = sg.render(scene, realizations=1000, seed=2, sampler="screens").field
    return request.param, moments(exact), moments(drawn)


def assert_same_means(one, two, slack):
    """Moments of both kinds of fields, real and imaginary parts, agree within the z limit of :mod:`zscore`."""
    for part in (np.real, np.imag):
        a, b = part(one), part(two)
        error = np.sqrt(a.var(axis=0) / len(a) + b.var(axis=0) / len(b))
        assert_z(a.mean(axis=0), b.mean(axis=0), error, degrees=len(a) - 1, slack=slack)


def test_fields_have_the_moments_of_waves(both):
    _, exact, drawn = both
    # Paraxial: angles of .06 lengthen the walk by 3 angle^2 / 2, half a per cent, and the lobe by as much.
    assert_same_means(exact, drawn, 0.01 * np.abs(exact[:, 0].mean()))


def test_the_comparison_has_power(both):
    _, exact, drawn = both
    with pytest.raises(AssertionError, match="z ="):
        assert_same_means(exact, drawn * 1.1, 0.0)


def test_weak_screens_mirror_their_image(both):
    kind, exact, drawn = both
    share = [abs(m[:, -1].mean()) / m[:, 0].mean().real for m in (exact, drawn)]
    assert (min(share) > 0.5) == (kind == "weak")


def grid_scene(medium, width=2000.0, tilts=(0.0,), shape=(32, 32), **light):
    return sg.Scene(wavelength=1.0, medium=medium,
                    illumination=sg.CollimatedBeams.tilts(np.asarray(tilts), width, **light),
                    sensor=sg.FarField.grid(shape, 0.4 / width))  # fmt: skip


def test_the_planner_knows_screens_and_says_what_is_off():
    plan = sg.plan(grid_scene(DOUBLE, tilts=(0.0, 0.005)))
    assert plan.sampler == "screens"
    assert "2 phase screens" in plan.explain()
    assert all(0 <= error <= 0.02 for error in errors(plan.scene).values())


@pytest.mark.parametrize(("scene", "says"), [
    (grid_scene(sg.PhaseScreen(rms_phase=4.0, correlation_length=200.0)), "contrast"),
    (grid_scene(sg.ScreenStack(screens=(WEAK, WEAK), gaps=(100.0,))), "mirror"),
    (grid_scene(sg.ScreenStack(screens=DOUBLE.screens, gaps=(1e4,)), width=800.0), "correlations"),
])  # fmt: skip
def test_a_scene_beyond_the_model_is_refused_with_the_figure_and_the_remedy(scene, says):
    assert_refused(lambda: sg.plan(scene), says)
    with pytest.warns(sg.DoubtWarning, match="screens"):
        sg.render(scene, sampler="screens")


def test_samplers_of_volumes_do_not_take_screens_nor_the_reverse():
    for covariance in (sg.covariance, lambda scene: next(sg.covariance_blocks(scene, rows=1))):
        with pytest.raises(sg.RuleError, match="memory_effect"):
            covariance(grid_scene(DOUBLE))
    assert_refused(lambda: sg.plan(grid_scene(DOUBLE), sampler="paths"), '"auto" or "screens"')
    slab = sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=sg.Isotropic())
    assert_refused(lambda: sg.plan(grid_scene(slab), sampler="screens"), "thin screens only")


@pytest.mark.parametrize("phase", [0.0, 0.1, 100.0])
def test_extreme_phases_give_the_intensity_that_energy_leaves(phase):
    """The integral of f is the scattered share; the mean at the beam is e^(-sigma^2 / 2) times the window's."""
    screen = sg.PhaseScreen(rms_phase=phase, correlation_length=max(10.0, phase))
    scene = grid_scene(screen, width=4000.0)
    stack = sg.render(scene, realizations=8)
    kernel = screen_correlation(screen.stack, 1.0)
    expected = kernel.weights.sum() * 4000.0**2
    assert np.isfinite(stack.intensity).all()
    assert stack.intensity.mean() == pytest.approx(expected, rel=0.2, abs=1e-30)
    axis = scene.replace(sensor=sg.FarField(directions=[[0.0, 0.0, 1.0]]))
    assert abs(sg.mean_field(axis).item()) == pytest.approx(np.exp(-(phase**2) / 2) * 4000.0**2, rel=1e-12)


def test_all_beams_behind_one_screen_see_one_pattern_under_an_envelope_that_moves():
    screen = sg.PhaseScreen(rms_phase=4.0, correlation_length=10.0)  # rms angle .09
    scene = grid_scene(screen, width=1000.0, tilts=np.arcsin([0.0, 0.08]), shape=(1, 501))
    field = sg.render(scene, seed=3).field[:, 0]
    still, moved = field[0, :-200], field[1, 200:]  # .08 is 200 views of .0004
    np.testing.assert_allclose(np.abs(moved), np.abs(still), rtol=0.016, atol=0)  # cos of views at .18
    # Without the envelope's move they would differ: at the same view the lobe is lower by e^(-p^2 / 2 theta^2).
    angle, views = screen.rms_angle(1.0), scene.sensor.sines[0]
    lobe = np.square(np.abs(field[:, 350:])).mean(axis=1)
    lobes = [np.exp(-np.square(views[350:] - i) / (2 * angle**2)).mean() for i in (0.0, 0.08)]
    assert abs(lobes[0] / lobes[1] - 1) > 0.2
    assert lobe[0] / lobe[1] == pytest.approx(lobes[0] / lobes[1], rel=0.35)


def test_an_object_is_the_sum_of_its_beams():
    brightness = np.array([[1.0, 0.0], [0.5, 2.0]])
    scene = grid_scene(DOUBLE)
    light = sg.IncoherentObject(brightness=brightness, pitch=0.001, width=2000.0)
    image = sg.render(scene.replace(illumination=light), seed=1).intensity
    stack = sg.render(scene.replace(illumination=light.beams), seed=1).intensity
    np.testing.assert_allclose(image, np.tensordot([1.0, 0.5, 2.0], stack, axes=1), rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("phase", [1.0, 3.0, 10.0])
def test_contrast_exceeds_that_of_gaussian_speckle_by_no_more_than_the_rule_says(phase):
    screen = sg.PhaseScreen(rms_phase=phase, correlation_length=10.0 * max(1.0, phase / 4))
    spacing = min(1 / (8 * screen.rms_angle(1.0)), screen.correlation_length / 2.5)
    waves = ScreenWaves(screen.stack, 1.0, 256, spacing)
    width = waves.side / 2
    scene = by_hand.scene_of(waves, int(1.2 * screen.rms_angle(1.0) / waves.step), ((0, 0),), width, "disc")
    power = np.square(np.abs(by_hand.wave_fields(waves, scene, 200, seed=4)[:, 0]))
    excess = (np.square(power).mean(0) / np.square(power.mean(0)) - 2).mean()
    facets = scene.beams.window.area / (np.pi * screen.correlation_length**2)
    assert excess < FACETS / facets


def test_screens_finer_than_the_wavelength_or_too_wide_are_refused_with_the_reason():
    with pytest.raises(sg.RuleError, match="length must be at least the wavelength, 1; got 0.9.*evanescent"):
        grid_scene(sg.PhaseScreen(rms_phase=0.1, correlation_length=0.9))
    assert_refused(lambda: grid_scene(sg.PhaseScreen(rms_phase=100.0, correlation_length=10.0)), "rms angle")
    with pytest.raises(sg.RuleError, match="undersamples"):
        sg.plan(grid_scene(DOUBLE).replace(sensor=sg.FarField.grid((8, 8), 0.6 / 2000)))


def test_scenes_of_screens_are_lit_by_beams_and_seen_in_transmission():
    scene = grid_scene(DOUBLE)
    assert_refused(lambda: scene.replace(illumination=sg.PlaneWaves.tilts([0.0])), "CollimatedBeams")
    assert_refused(lambda: scene.replace(sensor=sg.FarField.grid((8, 8), 1e-4, side="reflection")), "transmission")


@pytest.mark.parametrize("glass", [sg.GroundGlass(grit=220), sg.GroundGlass(angle=0.26)])
def test_a_ground_glass_scatters_as_wide_as_it_says_at_any_wavelength_and_unit(glass):
    for wavelength in (0.4, 0.8):
        assert glass.screen.rms_angle(wavelength) * 2.3548 == pytest.approx(0.26, rel=1e-4)
    metres = glass.replace(unit=1.0)
    assert metres.screen.rms_height == pytest.approx(1e-6 * glass.screen.rms_height)
    assert metres.screen.correlation_length == pytest.approx(1e-6 * glass.screen.correlation_length)


@pytest.mark.parametrize(("fields", "says"), [({"grit": 219}, "one of 120, 220"), ({}, "one of grit and angle"),
                                              ({"grit": 120, "rms_height": 1.0}, "left out")])  # fmt: skip
def test_a_ground_glass_that_is_not_known_is_refused(fields, says):
    assert_refused(lambda: sg.GroundGlass(**fields), says)


def test_a_screen_is_given_one_way_and_a_stack_has_its_gaps():
    assert_refused(lambda: sg.PhaseScreen(correlation_length=5.0, rms_phase=1.0, index=1.5), "rms_height and index")
    assert_refused(lambda: sg.ScreenStack(screens=DOUBLE.screens, gaps=()), "1 numbers for 2 screens")
