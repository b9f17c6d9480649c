"""Errors from batches, also of heavy tails; Wilson's interval: against SciPy, by its equation, and its coverage."""

import numpy as np
import pytest
import zscore
from scipy.stats import binom, binomtest

from specklegen.core import statistics
from specklegen.core.errors import RuleError
from specklegen.core.statistics import BATCHES, carriers, jackknife, rarity, tail_factor, wilson

CASES = [(0, 1), (1, 1), (0, 20), (3, 20), (172, 188), (50, 50), (1, 10**6)]


@pytest.mark.parametrize("confidence", [0.5, 0.95, 1 - 1e-6])
@pytest.mark.parametrize(("successes", "n"), CASES)
def test_wilson_is_scipys(successes, n, confidence):
    expected = binomtest(successes, n).proportion_ci(confidence, method="wilson")
    assert wilson(successes, n, confidence) == pytest.approx(tuple(expected), rel=1e-9, abs=1e-12)


def test_wilson_of_the_literature():
    """Newcombe, Statistics in Medicine 17, 857 (1998), table I, method 3."""
    for case, ends in {(81, 263): (0.2553, 0.3662), (15, 148): (0.0624, 0.1605), (1, 29): (0.0061, 0.1718)}.items():
        assert wilson(*case) == pytest.approx(ends, abs=5e-5)


@pytest.mark.parametrize(("successes", "n"), [(3, 20), (172, 188), (1, 10**6)])
def test_the_ends_lie_the_same_number_of_sigmas_away(successes, n):
    ends = np.array(wilson(successes, n, 0.95))
    sigmas = (successes / n - ends) / np.sqrt(ends * (1 - ends) / n)
    assert sigmas == pytest.approx([1.959964, -1.959964], rel=1e-6)


def test_wilson_covers_on_average():
    """Over even rates, 30 trials: 95.2 %. At confidences of 94 and 96 % it is 94.3 and 96.2; Wald's interval: 87.5."""
    rates = (np.arange(2000) + 0.5) / 2000
    ends = np.array([wilson(k, 30) for k in range(31)])
    inside = (ends[:, :1] <= rates) & (rates <= ends[:, 1:])
    found = (binom.pmf(np.arange(31)[:, None], 30, rates) * inside).sum(0).mean()
    assert found == pytest.approx(0.95, abs=0.005)


@pytest.mark.parametrize("bad", [(0, 0), (-1, 3), (4, 3), (1, 3, 0.0), (1, 3, 1.0)])
def test_bad_counts_are_refused(bad):
    with pytest.raises(RuleError, match="wilson"):
        wilson(*bad)


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


def test_errors_of_normal_batches_are_left_alone():
    x = np.random.default_rng(2).normal(size=(BATCHES, _SAMPLES))
    assert (tail_factor(x - x.mean(axis=0)) == 1).mean() > 0.999
    assert carriers(x).mean() == pytest.approx(BATCHES / 3, rel=0.1)  # more by 2 / 3 of a kurtosis' own bias


def test_carriers_by_hand():
    """Two values as likely are all carriers; of one that is far off there is one, of faint ones as of bright ones."""
    assert carriers(np.array([1.0, -1.0, 1.0, -1.0])) == 4
    far = np.zeros(BATCHES)
    far[5] = 1.0
    assert carriers(far) == carriers(1e-200 * far) == 1
    assert rarity(far) == pytest.approx(1 - 3 / BATCHES)
    assert tail_factor(far) == pytest.approx(np.sqrt(1 + np.sqrt(1 - 3 / BATCHES)))
    assert carriers(np.zeros((BATCHES, 2))).tolist() == [np.inf, np.inf]
    assert tail_factor(np.zeros(BATCHES)) == 1
