"""Errors from batches, also of heavy tails."""

from collections.abc import Callable

import numpy as np
import pytest
import zscore
from scipy.stats import norm
from scipy.stats import t as student

from specklegen.core import statistics
from specklegen.core.statistics import BATCHES, effective_count, jackknife, rarity, tail_factor

# ---- Rare values of great weight -----------------------------------------------------------------------

_SAMPLES = 2000


def rare_batches(hits: float) -> np.ndarray:
    """Sums of 64 batches, float64[64, samples]: on average ``hits`` exponential weights in all, whose variance is 2."""
    rng = np.random.default_rng(1)
    number = rng.poisson(hits / BATCHES, (BATCHES, _SAMPLES))
    return 1 + rng.gamma(np.maximum(number, 1)) * (number > 0)


def share_not_understated(hits: float) -> float:
    """How many of the samples state an error of their mean that is at least the true one."""
    x = rare_batches(hits)
    sums = np.stack([x, np.ones_like(x)], axis=1)
    _, error = jackknife(sums, lambda total: total[0] / total[1])
    return float((error >= np.sqrt(2 * hits) / BATCHES).mean())


@pytest.mark.parametrize("hits", [3.0, 6.0, 12.0, 24.0])
def test_errors_that_rest_on_rare_values_are_not_low_more_often_than_high(hits, monkeypatch):
    """Half of 2000 samples, at a false-alarm rate of 1e-6; without the factor it is .31, .35, .40, .41 of them."""
    least = 0.5 - zscore.limit() * 0.5 / np.sqrt(_SAMPLES)
    assert share_not_understated(hits) > least
    monkeypatch.setattr(statistics, "tail_factor", lambda deviations: 1.0)
    assert share_not_understated(hits) < least


def test_errors_of_normal_batches_are_those_of_student():
    x = np.random.default_rng(2).normal(size=(BATCHES, _SAMPLES))
    assert 1.01 < np.median(tail_factor(x - x.mean(axis=0))) < 1.04
    assert (rarity(x - x.mean(axis=0)) == 0).mean() > 0.999
    assert effective_count(x).mean() == pytest.approx(BATCHES / 3, rel=0.1)  # more by 2 / 3 of a kurtosis' own bias


def test_effective_count_by_hand():
    """Two values as likely both count; of one that is far off there is one, of faint ones as of bright ones."""
    assert effective_count(np.array([1.0, -1.0, 1.0, -1.0])) == 4
    far = np.zeros(BATCHES)
    far[5] = 1.0
    assert effective_count(far) == effective_count(1e-200 * far) == 1
    assert rarity(far) == pytest.approx(1 - 3 / BATCHES)
    freedom = 2 / (1 - 1 / BATCHES)
    expected = np.sqrt(1 + 1.5 * np.sqrt(1 - 3 / BATCHES)) * student.ppf(0.975, freedom) / norm.ppf(0.975)
    assert tail_factor(far) == pytest.approx(expected)
    assert effective_count(np.zeros((BATCHES, 2))).tolist() == [np.inf, np.inf]
    assert tail_factor(np.zeros(BATCHES)) == pytest.approx(student.ppf(0.975, 63) / norm.ppf(0.975))


def covered(truth: float, weights: Callable[..., np.ndarray]) -> float:
    """How often 1.96 standard errors of a mean's square hold its truth."""
    x = truth + weights(size=(BATCHES, _SAMPLES))
    value, error = jackknife(np.stack([x, np.ones_like(x)], axis=1), lambda total: np.square(total[0] / total[1]))
    return float((np.abs(value - truth**2) <= 1.96 * error).mean())


@pytest.mark.parametrize("truth", [0.0, 0.125, 0.25, 0.375, 0.5, 1.0, 4.0])
def test_errors_of_a_square_hold_the_truth_near_zero_too(truth, monkeypatch):
    """0 to 32 standard errors of the mean; of 2000 samples, so many as .93 leaves at a false-alarm rate of 1e-6."""
    least = 0.93 - zscore.limit() * np.sqrt(0.93 * 0.07 / _SAMPLES)
    rng = np.random.default_rng(3)
    assert covered(truth, rng.normal) > least
    monkeypatch.setattr(statistics, "_BEND", 0.0)
    monkeypatch.setattr(statistics, "tail_factor", lambda deviations: 1.0)
    if truth in (0.125, 0.25):
        assert covered(truth, np.random.default_rng(3).normal) < least
