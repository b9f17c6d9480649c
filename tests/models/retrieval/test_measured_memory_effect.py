"""A table of a measured memory effect in the likelihood: positive definite, near the truth, of the right deviance."""

import numpy as np
import pytest
import torch
from refusals import assert_refused

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.models.learning.measurement import memory_effect_of
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import periodogram
from specklegen.models.retrieval.autocorrelation import at_distances
from specklegen.models.retrieval.measured_memory_effect import measured_memory_effect

AT = np.linspace(0, 40, 14)  # object pixels


@pytest.fixture(scope="module")
def setup():
    """Likelihood of eight images 3.5 ranges wide, their objects, and C_I."""
    recipe = load_recipe("one-angular-size", {"material": {"thickness": 4000.0, "optical_depth": 20.0, "g": 0.9}})
    batch = recipe.batch(3, "test", range(8))
    drawn = {key: float(value[0]) for key, value in batch["parameters"].items() if np.ndim(value)}
    optics = Optics(drawn["object_pitch"] / drawn["camera_pitch"], 3.0)
    likelihood = SpeckleLikelihood(periodogram(torch.from_numpy(batch["image"])[:, None].double()), (28, 28), optics)
    c_i = memory_effect_of(recipe.material_of(3, "test", 0).correlation, recipe.wavelength, drawn["object_pitch"])
    return likelihood, torch.from_numpy(batch["object"]).double(), c_i


def deviance(setup, c_i):
    likelihood, objects, _ = setup
    steps = np.arange(-27, 28)
    return likelihood(objects, at_distances(c_i, np.hypot(steps[:, None], steps))).numpy()


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_the_true_object_keeps_its_deviance(setup, noise):
    """Fourteen values, with noise: .575 here, as with C_I itself; straight lines between them give .62 to 1.65."""
    values = setup[2](AT) + noise * np.random.default_rng(0).standard_normal(14)
    found = deviance(setup, measured_memory_effect(AT, values))
    assert 0.55 < found.mean() < 0.62
    assert np.abs(found - deviance(setup, setup[2])).max() < 0.01
    assert deviance(setup, lambda d: np.interp(d, AT, values)).mean() > found.mean() + 0.03


def test_the_table_is_met():
    law = np.exp(-0.5 * np.square(AT / 9.0))
    assert np.abs(measured_memory_effect(AT, 0.8 * law + 0.2)(AT) - 0.8 * law - 0.2).max() < 1e-3
    assert np.abs(measured_memory_effect(AT, np.ones(14))(AT) - 1).max() < 1e-9


def test_its_transform_is_at_least_zero():
    """On a ring three times as long as the table, of noise alone too; that of straight lines is not."""
    values = np.exp(-0.5 * np.square(AT / 9.0)) + 0.05 * np.random.default_rng(1).standard_normal(14)
    ring = np.minimum(np.arange(240), 240 - np.arange(240)).astype(float)
    far = np.hypot(ring[:, None], ring)
    smooth, straight = (np.fft.fft2(c(far)).real for c in (
        measured_memory_effect(AT, values), lambda d: np.interp(d, AT, values)))  # fmt: skip
    assert smooth.min() > -1e-9 * smooth.max()
    assert straight.min() < -1e-4 * straight.max()


def test_odd_tables_are_refused():
    assert_refused(lambda: measured_memory_effect([0, 1, 2], [1.0, 0.5]), "measured_memory_effect distance, values")
    with pytest.raises(RuleError, match="measured_memory_effect distance, values"):
        measured_memory_effect([0, 1, 2], [1.0, np.nan, 0.5])
    assert_refused(lambda: measured_memory_effect([0, 0, 2], [1.0, 1.0, 0.5]), "measured_memory_effect distance")
