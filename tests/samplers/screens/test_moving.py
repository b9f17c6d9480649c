"""Screens that move, against phases that are drawn and moved, and waves that are propagated through them."""

import numpy as np
import pytest
import screen_waves_by_hand as by_hand
from refusals import assert_refused
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.oracles.screen_waves import ScreenWaves
from specklegen.samplers.screens.rule import errors
from specklegen.theory.phase_screens import coherence, lobes

SCREEN = sg.PhaseScreen(rms_phase=3.0, correlation_length=15.0)
TIMES, HALF, WIDTH = np.array([0.0, 1.0, 2.0]), 8, 110.0
POINTS, SPACING, DRAWS = 128, 1.875, 64
APART = sg.ScreenStack(  # whole points of the waves' grid in a unit of time
    screens=(SCREEN, SCREEN), gaps=(300.0,), velocities=((1.875, 0.0), (-1.875, 1.875))
)
TOGETHER = APART.replace(velocities=((22.5, 0.0), (22.5, 0.0)))
AGAINST = APART.replace(velocities=((-3.75, 0.0), (0.0, 0.0)))
"""Light that is tilted by three steps, 1/80, meets the first screen 3.75 further on: in time 1 that moves as far."""


def film(stack, times=TIMES, tilted=0, profile="gaussian", width=WIDTH, half=HALF):
    waves = ScreenWaves(stack, 1.0, POINTS, SPACING)
    steps = [(0, 0), *[(tilted, 0)] * (len(times) - 1)]
    return waves, by_hand.scene_of(waves, half, steps, width, profile, times)


def moments(fields, tilted):
    """Per realization: intensity, and correlations of frame 0 with later ones on three parts of the camera."""
    found = [np.square(np.abs(fields[:, t])).mean((-2, -1)) + 0j for t in range(len(TIMES))]
    for t in range(1, len(TIMES)):
        one, two = by_hand.moved(fields, t, tilted)
        third = one.shape[-1] // 3
        parts = [slice(0, third), slice(third, -third), slice(-third, None)]
        product, neighbour = one * two.conj(), one[..., 1:] * two[..., :-1].conj()
        found += [part.mean((-2, -1)) for part in (*(product[..., p] for p in parts), neighbour)]
    return np.array(found).T


@pytest.fixture(scope="module", params=[
    pytest.param("apart", marks=pytest.mark.slow), "together", pytest.param("against a tilt", marks=pytest.mark.slow),
])  # fmt: skip
def both(request):
    """Moments [R, n] by waves and by the sampler: screens that move apart; together, out of the window; as tilts do."""
    stack = {"apart": APART, "together": TOGETHER, "against a tilt": AGAINST}[request.param]
    tilted = 3 * (stack is AGAINST)
    waves, scene = film(stack, [0.0, 1.0, -1.0] if tilted else TIMES, tilted)
    exact = moments(by_hand.wave_fields(waves, scene, DRAWS, seed=1), tilted)
    with pytest.warns(sg.DoubtWarning, match="contrast"):  # moments of second order do not mind
        drawn = moments(sg.render(scene, realizations=500, seed=2, sampler="screens").field, tilted)
    return exact, drawn


def assert_same(one, two, slack):
    for part in (np.real, np.imag):
        a, b = part(one), part(two)
        error = np.sqrt(a.var(axis=0) / len(a) + b.var(axis=0) / len(b))
        assert_z(a.mean(axis=0), b.mean(axis=0), error + 1e-12, degrees=len(a) - 1, slack=slack)


def test_films_have_the_moments_of_waves(both):
    exact, drawn = both
    # Paraxial, as for tilts: half a per cent of the walk and of the lobe.
    assert_same(exact, drawn, 0.01 * np.abs(exact[:, 0].mean()))


def test_films_that_run_backwards_or_stand_still_would_be_caught(both):
    exact, drawn = both
    slack, frames = 0.01 * np.abs(exact[:, 0].mean()), len(TIMES)
    still = np.concatenate([drawn[:, :frames], np.tile(drawn[:, 1:2], drawn.shape[1] - frames)], axis=1)
    swapped = np.concatenate([drawn[:, :frames], np.roll(drawn[:, frames:], 4, axis=1)], axis=1)
    for wrong in (still, swapped):
        with pytest.raises(AssertionError, match="z ="):
            assert_same(exact, wrong, slack)


def test_over_all_views_frames_are_correlated_by_the_product_of_the_screens_autocorrelations():
    """gamma_1(s_1) gamma_2(s_2), each exp{-sigma^2 [1 - e^(-s^2 / xi^2)]}: waves, and the closed form."""
    waves = ScreenWaves(APART, 1.0, POINTS, SPACING)
    rng, products = np.random.default_rng(5), []
    for _ in range(40):
        phases = waves.phases(rng)
        shown = [waves.fields(by_hand.at(phases, waves, t), [[0, 0]])[0] for t in TIMES]
        products.append([(each.conj() * shown[0]).mean() for each in shown])
    found = np.array(products)  # lossless: the power is 1
    expected = [coherence(APART, 1.0, np.zeros(2), way) for way in APART.moved(TIMES)]
    literal = np.prod([[np.exp(-9 * (1 - np.exp(-(np.hypot(*v) * t) ** 2 / 225))) for v in APART.velocities]
                       for t in TIMES], axis=1)  # fmt: skip
    np.testing.assert_allclose(expected, literal, rtol=1e-12)
    error = found.real.std(axis=0) / np.sqrt(len(found)) + 1e-12
    assert_z(found.real.mean(axis=0), expected, error, degrees=len(found) - 1)
    refute_z(found.real.mean(axis=0), np.square(expected), error, degrees=len(found) - 1)


def test_a_screen_that_moves_before_another_is_a_tilt():
    """Behind two screens a gap d apart, s between them is a tilt by s / d: only a_1 - a_2 tells."""
    terms, shift = lobes(APART, 1.0), np.array([2.0, -1.0])
    tilt = shift / 300.0
    by_tilt = terms.decorrelation(np.outer([300.0, 0.0], tilt))
    assert terms.decorrelation(np.array([shift, [0, 0]])) == pytest.approx(float(by_tilt), rel=1e-12)
    assert terms.decorrelation(np.array([shift, shift])) == pytest.approx(1.0, abs=1e-12)
    both = terms.decorrelation(np.array([[shift, 0 * shift], [shift, shift]]))
    np.testing.assert_allclose(both, [by_tilt, 1.0], rtol=1e-12)


def test_a_film_of_screens_at_rest_is_one_image_and_a_single_screen_only_moves():
    times = [0.0, 1.0, 5.0]
    rest = APART.replace(velocities=((0.0, 0.0), (0.0, 0.0)))
    one = sg.ScreenStack(screens=(SCREEN,), velocities=((3.0, 0.0),))
    scene = film(rest, times, width=4000.0)[1].replace(sensor=sg.FarField.grid((16, 16), 1e-4))
    still = sg.render(scene, seed=4).intensity
    np.testing.assert_allclose(still[1:], np.broadcast_to(still[:1], still[1:].shape), rtol=2e-4)
    moved = sg.render(scene.replace(medium=one), seed=4).intensity  # 15 of 4000: nearly all of the window is the same
    assert np.corrcoef(moved.reshape(3, -1))[0].min() > 0.98
    wide = scene.replace(illumination=scene.beams.replace(times=[0.0, 10.0, 5000.0]))
    gone = sg.render(wide.replace(medium=one), seed=4, realizations=30).intensity.reshape(30, 3, -1)
    gone = gone - gone.mean(axis=(0, 2), keepdims=True)
    assert abs((gone[:, 0] * gone[:, 2]).mean() / gone[:, 0].var()) < 0.1


def test_the_planner_judges_a_film_and_refuses_what_does_not_move():
    scene = film(APART, width=4000.0)[1].replace(sensor=sg.FarField.grid((16, 16), 1e-4))
    assert sg.plan(scene).sampler == "screens"
    assert all(error < 0.02 for error in errors(scene).values())
    assert sg.Scene.from_json(scene.canonical_json()) == scene
    with pytest.raises(sg.RuleError, match="times must be left out for a medium at rest"):
        scene.replace(medium=sg.ScreenStack(screens=APART.screens, gaps=APART.gaps))
    assert_refused(lambda: sg.CollimatedBeams.tilts([0.0, 0.0, 0.0], 100.0, times=[1.0]), "times must be 3 numbers")
    assert_refused(lambda: APART.replace(velocities=((0.0, 0.0),)), "velocities must be 2 pairs")
    with pytest.raises(sg.RuleError, match="so few that the pattern shifts"):
        sg.render(scene.replace(medium=TOGETHER, illumination=scene.beams.replace(times=[0.0, 1.0, 1e9])))
    still = sg.ScreenStack(screens=APART.screens, gaps=APART.gaps)
    assert "velocities" not in still.canonical_json()
    assert "times" not in sg.CollimatedBeams.tilts([0.0], 10.0).canonical_json()
