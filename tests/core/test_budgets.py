"""Stopping at an error or at a time: the count is fixed before the run, reported, and reproduces the bits."""

from functools import partial

import numpy as np
import pytest
from refusals import assert_refused
from zscore import assert_z

import specklegen as sg
from specklegen.core.budgets import DEFAULT_PATHS

BOX = sg.Box(lower=[-5.0, -5.0], upper=[5.0, 5.0], mean_free_path=10.0, scatterer=sg.Isotropic())
SCENE = sg.Scene(wavelength=1.0, medium=BOX, illumination=sg.PlaneWaves.tilts([0.0, 0.05], dimensions=2),
                 sensor=sg.FarField.angles([0.5, 2.0]))  # fmt: skip
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
    error = np.hypot(means.std(axis=0, ddof=1) / 6, reference.standard_error.reshape(4, 4).diagonal().reshape(2, 2))
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


@pytest.mark.slow
def test_time_limits_what_an_error_asks_for():
    assert sg.covariance(SCENE, rel_error=1e-4, seconds=0.2).paths < 1e6
    few = sg.covariance(SCENE, rel_error=0.5, seconds=60.0)
    assert few.paths == sg.covariance(SCENE, rel_error=0.5).paths


def test_paths_scale_with_the_square_of_the_error():
    def pilot(count):
        return 2.0 / np.sqrt(count)

    few, many = (sg.Budget(rel_error=wanted).count(pilot) for wanted in (0.02, 0.01))
    assert few == pytest.approx(1.1 * (2.0 / 0.02) ** 2, rel=1e-3)
    assert many == pytest.approx(4 * few, rel=1e-3)
    assert sg.Budget().count(pilot) == DEFAULT_PATHS
    assert sg.Budget(paths=12).count(pilot) == 12
    assert sg.Budget(rel_error=0.9).count(pilot, 640) == 640


LIGHT = sg.CollimatedBeams.tilts([0.0, 1e-3], width=500.0)
BEHIND = sg.Scene(wavelength=0.5, medium=SLAB, illumination=LIGHT, sensor=sg.FarField.grid((2, 2), 1e-4))
EVERY = {"render": partial(sg.render, SCENE), "render_tiles": partial(sg.render_tiles, BEHIND),
         "covariance": partial(sg.covariance, SCENE), "covariance_blocks": partial(sg.covariance_blocks, SCENE, rows=1),
         "memory_effect": partial(sg.memory_effect, SLAB, wavelength=0.5, tilts=TILTS),
         "joint_correlation": partial(sg.joint_correlation, SLAB, wavelength=0.5, tilts=TILTS, shifts=[0.0]),
         "reflectance_transmittance": partial(sg.reflectance_transmittance, SLAB),
         "transmission_matrix": partial(sg.transmission_matrix, BEHIND),
         "render_partially_coherent": partial(sg.render_partially_coherent, BEHIND, 100.0),
         "plan": partial(sg.plan, SCENE)}  # fmt: skip
"""Every verb that takes a budget."""

UNUSED = {"render": ["tolerance"], "transmission_matrix": ["tolerance"], "render_partially_coherent": ["tolerance"],
          "plan": ["seconds", "tolerance"], "render_tiles": ["seconds", "tolerance"],
          "joint_correlation": ["reverse", "tolerance"], "reflectance_transmittance": ["reverse", "tolerance"],
          "covariance_blocks": ["rel_error", "seconds"]}  # fmt: skip
"""Fields of the budget that a verb refuses."""


@pytest.mark.parametrize("fields", [{"paths": 0}, {"paths": 2.5}, {"paths": 10, "rel_error": 0.1},
                                    {"paths": 10, "seconds": 1.0}, {"rel_error": 0.0}, {"rel_error": np.nan},
                                    {"rel_error": "little"}, {"seconds": 0.0}, {"seconds": np.nan}, {"seed": -1},
                                    {"threads": 0}, {"reverse": "sometimes"}, {"tolerance": 0.0}])  # fmt: skip
def test_a_budget_refuses_fields_out_of_their_range(fields):
    assert_refused(lambda: sg.Budget(**fields), rf"^(Budget\.)?{next(iter(fields))} must be")


def test_fields_by_name_take_the_place_of_those_of_the_budget():
    measure, budget = EVERY["memory_effect"], sg.Budget(paths=500, seed=3)
    np.testing.assert_array_equal(measure(budget=budget).intensity, measure(paths=500, seed=3).intensity)
    np.testing.assert_array_equal(measure(budget=budget, seed=4).intensity, measure(paths=500, seed=4).intensity)
    with pytest.raises(TypeError, match="unexpected keyword argument 'path'"):
        measure(path=500)


@pytest.mark.parametrize("owner", EVERY)
def test_every_verb_takes_a_budget_and_refuses_fields_that_it_does_not_use(owner):
    assert_refused(lambda: EVERY[owner](budget=500), f"{owner} budget must be a Budget")
    assert_refused(lambda: EVERY[owner](paths=0), r"^Budget\.paths must be at least 1; got 0")
    for name in UNUSED.get(owner, ()):
        budget = sg.Budget(**{name: True if name == "reverse" else 0.5})
        with pytest.raises(sg.RuleError, match=f"{owner} {name} must be left out"):
            EVERY[owner](budget=budget)


@pytest.mark.parametrize("kind", [np.int8, np.int32, np.uint64])
def test_a_count_of_numpy_is_a_count(kind):
    """As Python's own: kernels are compiled for the types of their arguments, and int32 would have all made again."""
    assert type(sg.Budget(paths=kind(100)).paths) is int
