"""The wave oracle of screens: it refuses what it cannot hold, and loses no light."""

import numpy as np
import pytest
from refusals import assert_refused

import specklegen as sg
from specklegen.oracles.screen_waves import ScreenWaves

PAIR = sg.ScreenStack(screens=(sg.PhaseScreen(rms_phase=2.0, correlation_length=10.0),) * 2, gaps=(50.0,))


@pytest.mark.parametrize(("points", "spacing", "says"), [
    (64, 3.0, "aliased"), (64, 1.1, "8 correlation lengths"),
])  # fmt: skip
def test_grids_that_are_too_coarse_or_too_small_are_refused(points, spacing, says):
    assert_refused(lambda: ScreenWaves(PAIR, 1.0, points, spacing), says)


def test_a_grid_coarser_than_the_correlation_length_is_refused_where_angles_are_small():
    weak = sg.PhaseScreen(rms_phase=0.01, correlation_length=10.0).stack
    assert_refused(lambda: ScreenWaves(weak, 1.0, 64, 6.0), "half the correlation length")


def test_screens_lose_no_light():
    waves = ScreenWaves(PAIR, 1.0, 64, 1.25)
    fields = waves.fields(waves.phases(np.random.default_rng(0)), [[0, 0], [2, -1]])
    np.testing.assert_allclose(np.square(np.abs(fields)).mean((1, 2)), 1.0, rtol=1e-6)


def test_phases_have_the_variance_and_the_correlation_that_they_are_asked_for():
    waves, rng = ScreenWaves(PAIR, 1.0, 64, 1.25), np.random.default_rng(1)
    phases = np.concatenate([waves.phases(rng) for _ in range(200)])
    shifted = np.roll(phases, 8, axis=-1)  # 10 lengths, a correlation of 1/e
    value = [(phases**2).mean((1, 2)), (phases * shifted).mean((1, 2))]
    for each, expected in zip(value, (4.0, 4.0 / np.e), strict=True):
        assert abs(each.mean() - expected) < 5.5 * each.std() / np.sqrt(len(each))
