"""Exposures of media that move: their contrast by every sampler that draws them, against closed forms."""

import numpy as np
import pytest
from refusals import assert_refused
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.core.statistics import jackknife
from specklegen.samplers.screens.film import frame_correlation
from specklegen.theory.speckle_contrast import class_field, contrast_squared, sub_frame_contrast_squared

K = 2 * np.pi
FLUID = sg.Brownian(diffusion=1 / K**2)  # of wavelength 1: times are x
THIN = sg.Slab(thickness=40.0, mean_free_path=10.0, scatterer=sg.HenyeyGreenstein(0.5), motion=FLUID)
WIDE = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(0.9), motion=FLUID)
EXPOSURES, STARTS = [0.2, 1.0, 3.0], [0.0, 0.5, 2.0]
SCREEN = sg.PhaseScreen(rms_phase=4.0, correlation_length=20.0)
MOVING = sg.ScreenStack(screens=[SCREEN, SCREEN], gaps=[200.0], velocities=[[1.0, 0.0], [0.0, 0.0]])


def exposed(exposure=0.3, times=(0.0,), medium=THIN, width=200.0, shape=(16, 16), pitch=0.002, sines=0.0, **beams):
    tilts = np.arcsin(np.broadcast_to(sines, len(times)))
    light = sg.CollimatedBeams.tilts(tilts, width=width, times=times, exposure=exposure).replace(**beams)
    return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sg.FarField.grid(shape, pitch))


def contrast(intensity):
    """K^2 of images [R, T, ...] over media and views, and its standard error, both [T]."""
    i = intensity.astype(float).reshape(*intensity.shape[:2], -1)
    t = i.shape[1]
    sums = np.concatenate([i.mean(-1), np.square(i).mean(-1), np.ones((len(i), 1))], axis=1)
    return jackknife(sums, lambda s: s[t:-1] * s[-1] / np.square(s[:t]) - 1)


def law(medium, paths=40_000):
    """The light behind a slab by its momentum transfer, g1 of a lag and all."""
    found = sg.temporal_correlation(medium, wavelength=1.0, lags=[0.0], paths=paths, seed=4)
    return found, class_field(found.classes.transfer, found.classes.shares.sum(axis=0))


@pytest.mark.parametrize(("sampler", "realizations"), [("stationary", 40), ("paths", 16)])
def test_exposures_have_the_contrast_of_the_class_formula(sampler, realizations):
    """That of their instants, which is above the formula by what the plan says, and within its tolerance."""
    scene = exposed(EXPOSURES, STARTS, WIDE, 20_000.0, (48, 48), 2.5e-5)
    made = sg.plan(scene, sampler=sampler)
    counts = made.scene.illumination.instants
    stack = sg.render(scene, sampler=sampler, paths=40_000 if sampler == "stationary" else 4000, seed=3,
                      realizations=realizations)  # fmt: skip
    assert stack.intensity.shape == (realizations, 3, 48, 48)
    found, error = contrast(stack.intensity)
    known, field = law(WIDE)
    formula = known.contrast(EXPOSURES)
    instants = [sub_frame_contrast_squared(field, t, n) for t, n in zip(EXPOSURES, counts, strict=True)]
    noise = np.hypot(error, formula.standard_error)
    assert_z(found, instants, noise, degrees=realizations - 1)
    assert_z(found, formula.squared, noise, degrees=realizations - 1, slack=0.02 * formula.squared)
    with pytest.raises(AssertionError, match="z ="):  # of a medium that moves twice as fast
        assert_z(found, known.contrast(2 * np.array(EXPOSURES)).squared, noise, degrees=realizations - 1)


def test_too_few_instants_overstate_the_contrast():
    """4 of an exposure three times as long as the field takes to fall to 1/e: seen, and said."""
    scene = exposed(6.0, (0.0,), WIDE, 20_000.0, (48, 48), 2.5e-5, sub_frames=4)
    with pytest.warns(DoubtWarning, match="exposure: 4 instants an exposure"):
        stack = sg.render(scene, paths=20_000, seed=3, realizations=30)
    found, error = contrast(stack.intensity)
    known, field = law(WIDE)
    assert_z(found, sub_frame_contrast_squared(field, 6.0, 4), np.hypot(error, 0.01), degrees=29)
    refute_z(found, known.contrast(6.0).squared, np.hypot(error, 0.01), degrees=29)


def test_screens_that_move_blur_in_closed_form():
    scene = exposed([20.0, 80.0], [0.0, 100.0], MOVING, 2000.0, (24, 24), 1.5e-4)
    made = sg.plan(scene)
    found, error = contrast(sg.render(scene, seed=2, realizations=30).intensity)

    def field(lags):
        return frame_correlation(MOVING, 1.0, MOVING.moved(lags), scene.beams.window)

    counts = made.scene.illumination.instants
    instants = [sub_frame_contrast_squared(field, t, n) for t, n in zip([20.0, 80.0], counts, strict=True)]
    assert_z(found, instants, error, degrees=29, slack=0.02 * np.array(instants))  # its own tolerance
    assert_z(instants, [contrast_squared(field, t) for t in (20.0, 80.0)], 0.0, slack=0.02 * np.array(instants))


@pytest.mark.parametrize("sampler", ["paths", "stationary"])
def test_a_short_exposure_is_the_medium_at_rest_and_a_longer_film_keeps_its_exposures(sampler):
    parts = {} if sampler == "paths" else {"medium": WIDE, "width": 20_000.0, "pitch": 2.5e-5}
    asked = {"sampler": sampler, "paths": 1000, "seed": 1}
    scene = exposed(1e-9, **parts)
    still = sg.render(scene.at_rest, **asked).intensity
    np.testing.assert_array_equal(sg.render(scene, **asked).intensity, still)
    short, longer = (sg.render(exposed(0.3, times, **parts), **asked).intensity for times in ([0.0, 1.0], [0, 1, 2]))
    np.testing.assert_allclose(longer[:2], short, rtol=1e-4, atol=1e-5 * short.max())


def test_exposures_are_means_of_films():
    """Of the instants that they are made of, each beam at its own tilt."""
    scene = exposed([0.2, 0.1], [0.0, 0.5], sines=[0.0, 0.002], sub_frames=[3, 2])
    asked = {"sampler": "paths", "paths": 500, "seed": 1}
    with pytest.warns(DoubtWarning, match="instants an exposure"):
        found = sg.render(scene, **asked).intensity
    film = scene.beams
    np.testing.assert_allclose(film.times, [0.2 / 6, 0.1, 1 / 6, 0.525, 0.575])
    frames = sg.render(scene.replace(illumination=film), **asked).intensity
    np.testing.assert_allclose(found, [frames[:3].mean(0), frames[3:].mean(0)], rtol=1e-4, atol=1e-6 * frames.max())
    np.testing.assert_allclose(scene.illumination.shares.sum(axis=1), 1.0)


def through_a_lens(exposure, times, sines=0.0, **parts):
    """Before pixels half a grain apart, of which twelve make the whole image of the middle of the window."""
    light = {key: parts.pop(key) for key in ("medium", "width") if key in parts}
    camera = {"shape": (12, 12), "pitch": 5.0, "aperture": 0.05} | parts.pop("camera", {})
    scene = exposed(exposure, times, sines=sines, **light, **parts)
    return scene.replace(sensor=sg.Imaging(**camera))


@pytest.mark.slow
def test_exposures_through_a_lens_have_the_contrast_of_the_light_over_its_pupil():
    """In the middle of a wide window, where speckle is Gaussian whatever the number of paths."""
    scene = through_a_lens(EXPOSURES, STARTS, width=800.0, camera={"focus": -10.0})
    made = sg.plan(scene, paths=2000, sampler="stationary")
    assert "exposure: used" in made.explain()
    assert made.scene.illumination.instants.tolist() == sorted(made.scene.illumination.instants)
    stack = sg.render(scene, paths=20_000, sampler="stationary", seed=3, realizations=100)
    found, error = contrast(stack.intensity)
    known, _ = law(THIN)
    formula = known.contrast(EXPOSURES)
    noise = np.hypot(error, formula.standard_error)
    # Two per cent of instants, and as much of views aside of the axis.
    assert_z(found, formula.squared, noise, degrees=99, slack=0.04 * formula.squared)
    refute_z(found, known.contrast(2 * np.array(EXPOSURES)).squared, noise, degrees=99)


STILL, BLURRED = (
    sg.Layer(thickness=5.0, mean_free_path=5.0, scatterer=sg.Isotropic(), motion=each) for each in (None, FLUID)
)
BOX = sg.Box(lower=[-100, -100, 0], upper=[100, 100, 5], mean_free_path=5.0, scatterer=sg.Isotropic(), motion=FLUID)


HALF = sg.Layers(layers=[STILL, BLURRED])


@pytest.mark.slow
@pytest.mark.parametrize(("medium", "layers"), [(BOX, [BLURRED]), (HALF, [STILL, BLURRED])], ids=["box", "layers"])
def test_other_media_blur_as_their_light_says(medium, layers):
    """A wide box as a slab, and light that stands still for a while beside light that does not."""
    scene = exposed(0.3, (0.0,), medium, 60.0, (6, 6), 0.008)
    stack = sg.render(scene, sampler="paths", paths=500, seed=2, realizations=100, reverse=False)
    found, error = contrast(stack.intensity)
    asked = {"wavelength": 1.0, "lags": [0.0], "paths": 10_000, "seed": 4, "reverse": False}
    known = sg.temporal_correlation(sg.Layers(layers=layers), **asked).contrast(0.3)
    assert_z(found, known.squared, np.hypot(error, known.standard_error), degrees=99, slack=0.02)
    assert_z(known.squared, 1.0, 0.0, slack=0.6)


@pytest.mark.parametrize(("changes", "field", "rule"), [
    ({"exposure": 0.0}, "CollimatedBeams.exposure", "above 0"),
    ({"exposure": np.inf}, "CollimatedBeams.exposure", "finite everywhere"),
    ({"exposure": [1.0, 2.0]}, "CollimatedBeams.exposure", "one number, or 1, one for each beam"),
    ({"exposure": 1e308}, "CollimatedBeams.times", "such that k"),
    ({"times": (0.0, 0.2)}, "CollimatedBeams.times", "at least one exposure apart"),
    ({"times": (1.0, 0.0)}, "CollimatedBeams.times", "increasing, since the medium moves"),
    ({"sub_frames": 0}, "CollimatedBeams.sub_frames", "whole numbers from 1 to"),
    ({"exposure": None, "sub_frames": 4}, "CollimatedBeams.sub_frames", "left out without an exposure"),
    ({"medium": THIN.replace(motion=None)}, "CollimatedBeams.times", "left out for a medium at rest"),
    ({"medium": SCREEN}, "CollimatedBeams.times", "left out for a medium at rest"),
])  # fmt: skip
def test_exposures_that_are_refused(changes, field, rule):
    assert_refused(lambda: exposed(**changes), f"{field} must be {rule}")
    with pytest.raises(RuleError, match="CollimatedBeams.exposure must be left out without times"):
        sg.CollimatedBeams.tilts([0.0], width=1.0, exposure=1.0)


def test_verbs_that_have_no_exposure():
    scene = exposed()
    for verb in (sg.covariance, sg.transmission_matrix):
        with pytest.raises(RuleError, match="scene must be a scene without times"):
            verb(scene)
    assert_refused(lambda: sg.render(scene, mean=True), "mean must be False .* and for exposures")
    assert_refused(lambda: next(sg.render_tiles(scene)), "render_tiles scene must be .*exposure")
    with pytest.raises(RuleError, match="field must be asked of coherent illumination"):
        _ = sg.render(scene, sampler="paths", paths=100).field
    assert_refused(lambda: sg.plan(exposed(1e4)), "CollimatedBeams.exposure must be so short that 4096 instants")


@pytest.mark.filterwarnings("ignore::specklegen.DoubtWarning")
def test_no_light_and_no_beams():
    black = THIN.replace(thickness=4e5, albedo=0.01)  # e^-40000 is 0
    dark = sg.temporal_correlation(black, wavelength=1.0, lags=[0.0], paths=3, reverse=False)
    assert np.isnan(dark.contrast([0.0, 1.0]).squared).all()
    nothing = sg.CollimatedBeams.tilts([], width=200.0, times=[], exposure=1.0)
    assert sg.render(exposed().replace(illumination=nothing)).intensity.shape == (0, 16, 16)


def test_the_contrast_of_any_exposure():
    known, field = law(THIN, 4000)
    exposures = np.array([[0.0, 1e-4], [0.3, 50.0]])
    found = known.contrast(exposures)
    np.testing.assert_allclose(found.x, exposures)
    assert found.squared.shape == (2, 2)
    assert found.squared[0, 0] == pytest.approx(1.0)
    right = [contrast_squared(field, t) for t in exposures.ravel()]
    np.testing.assert_allclose(found.squared.ravel(), right, atol=3 * found.standard_error.max())
    np.testing.assert_allclose(found.contrast**2, found.squared)
    for wrong in (-1.0, np.nan, np.inf, "long"):
        with pytest.raises(RuleError, match="TemporalCorrelation.contrast exposures must be"):
            known.contrast(wrong)
    assert_refused(lambda: known.contrast(1e308), "TemporalCorrelation.contrast exposures must be such that k")
