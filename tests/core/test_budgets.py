"""Stopping at an error or at a time: the count is fixed before the run, reported, and reproduces the bits."""

import numpy as np
import pytest
from zscore import assert_z

import specklegen as sg
from specklegen.core.budgets import paths_for

BOX = sg.Box(lower=[-5.0, -5.0], upper=[5.0, 5.0], mean_free_path=10.0, scatterer=sg.Isotropic())
SCENE = sg.Scene(
    wavelength=1.0,
    medium=BOX,
    illumination=sg.PlaneWaves.tilts([0.0, 0.05], dimensions=2),
    sensor=sg.FarField.angles([0.5, 2.0]),
)
SLAB = sg.Slab(thickness=50.0, mean_free_path=10.0, scatterer=sg.Isotropic())
TILTS = np.deg2rad([0.1, 0.3])


def test_covariance_reaches_the_error_asked_for():
    for wanted in (0.1, 0.05):
        found = sg.covariance(SCENE, rel_error=wanted, seed=1)
        # 64 batches know their own standard error to 9 %; the largest of 16 entries scatters about as much.
        assert 0.7 * wanted < found.rel_error < 1.3 * wanted
        scale = np.sqrt(np.multiply.outer(found.intensity, found.intensity))
        assert found.rel_error == pytest.approx((found.standard_error / scale).max(), rel=1e-9)


def test_memory_effect_reaches_the_error_asked_for():
    curve = sg.memory_effect(SLAB, wavelength=0.5, tilts=TILTS, rel_error=0.02, seed=1)
    assert 0.7 * 0.02 < curve.standard_error.max() < 1.3 * 0.02


@pytest.mark.slow
def test_the_count_comes_from_the_scene_alone_so_stopping_cannot_bias():
    """Every seed runs as many paths: what is averaged never decides when to stop. And the mean over seeds is right."""
    runs = [sg.covariance(SCENE, rel_error=0.3, seed=seed) for seed in range(36)]
    assert len({run.paths for run in runs}) == 1
    means = np.array([run.intensity for run in runs])
    reference = sg.covariance(SCENE, paths=60_000, seed=99)
    error = np.hypot(
        means.std(axis=0, ddof=1) / 6,
        reference.standard_error.reshape(4, 4).diagonal().reshape(2, 2),
    )
    assert_z(means.mean(axis=0), reference.intensity, error, degrees=35)


def test_a_count_found_by_a_budget_reproduces_the_bits():
    timed = sg.covariance(SCENE, seconds=0.2, seed=3)
    assert timed.paths >= 64
    np.testing.assert_array_equal(sg.covariance(SCENE, paths=timed.paths, seed=3).value, timed.value)
    curve = sg.memory_effect(SLAB, wavelength=0.5, tilts=TILTS, seconds=0.2, seed=3)
    again = sg.memory_effect(SLAB, wavelength=0.5, tilts=TILTS, paths=curve.paths, seed=3)
    np.testing.assert_array_equal(again.intensity, curve.intensity)
    stack = sg.render(SCENE, seconds=0.2, seed=3)
    np.testing.assert_array_equal(sg.render(SCENE, paths=stack.report.paths, seed=3).field, stack.field)


def test_time_limits_what_an_error_asks_for():
    assert sg.covariance(SCENE, rel_error=1e-4, seconds=0.2).paths < 1e6
    few = sg.covariance(SCENE, rel_error=0.3, seconds=60.0)
    assert few.paths == sg.covariance(SCENE, rel_error=0.3).paths


def test_paths_for_scales_with_the_square_of_the_error():
    def pilot(count):
        return 2.0 / np.sqrt(count)

    few, many = (paths_for(7, None, wanted, None, pilot) for wanted in (0.02, 0.01))
    assert few == pytest.approx(1.1 * (2.0 / 0.02) ** 2, rel=1e-3)
    assert many == pytest.approx(4 * few, rel=1e-3)
    assert paths_for(7, None, None, None, pilot) == 7
    assert paths_for(7, 12, None, None, pilot) == 12


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"paths": 10, "rel_error": 0.1}, "paths must be left out where rel_error or seconds is given"),
        ({"paths": 10, "seconds": 1.0}, "paths must be left out where rel_error or seconds is given"),
        ({"rel_error": 0.0}, "rel_error must be between 0 and 1"),
        ({"rel_error": float("nan")}, "rel_error must be between 0 and 1"),
        ({"seconds": 0.0}, "seconds must be greater than 0"),
        ({"seconds": float("nan")}, "seconds must be greater than 0"),
    ],
)
def test_budgets_out_of_range_are_refused(arguments, message):
    with pytest.raises(sg.RuleError, match=message):
        sg.covariance(SCENE, **arguments)
    with pytest.raises(sg.RuleError, match=message):
        sg.render(SCENE, **arguments)
    with pytest.raises(sg.RuleError, match=message):
        sg.memory_effect(SLAB, wavelength=0.5, tilts=TILTS, **arguments)
