import numpy as np
import pytest
from scipy.stats import chi2, poisson

from specklegen.instrument.poisson import LARGEST, _table, poisson_field

FALSE_ALARM = 1e-6  # chance that a right build fails, per test


@pytest.mark.parametrize("mean", [1e-3, 0.3, 5.0, 50.0, LARGEST])
def test_the_table_holds_the_exact_probabilities(mean):
    """Added up column by column; the tail beyond the table is below 2**-53."""
    threshold, values = _table(mean)
    share = threshold.astype(np.float64) / 2**53
    found = np.bincount(values, np.stack([share, 1 - share], axis=1).ravel()) / len(threshold)
    np.testing.assert_allclose(found, poisson.pmf(np.arange(len(found)), mean), atol=1e-14)
    assert poisson.sf(len(found) - 1, mean) < 2.0**-53
    assert len(threshold) <= 2048  # the low 11 bits choose the column


def assert_poisson(numbers, mean):
    """Chi squared over the values that are expected at least 20 times, tails pooled."""
    low, high = int(poisson.ppf(1e-3, mean)), int(poisson.isf(1e-3, mean))
    edges = np.arange(low, high + 1)
    counts = np.bincount(np.clip(numbers, low, high).ravel() - low, minlength=len(edges))
    share = poisson.pmf(edges, mean)
    share[0], share[-1] = poisson.cdf(low, mean), poisson.sf(high - 1, mean)
    statistic = (np.square(counts - numbers.size * share) / (numbers.size * share)).sum()
    assert statistic < chi2.isf(FALSE_ALARM, len(edges) - 1), f"chi2 = {statistic:.0f} of {len(edges) - 1}"


@pytest.mark.parametrize("mean", [0.3, 5.0, 50.0, 2 * LARGEST])
def test_numbers_are_poisson(mean):
    numbers = poisson_field(np.random.Generator(np.random.Philox(3)), mean, (500, 400))
    assert numbers.shape == (500, 400)
    assert_poisson(numbers, mean)
    with pytest.raises(AssertionError, match="chi2"):
        assert_poisson(numbers, 1.02 * mean + 0.005)


def test_neighbours_are_independent():
    numbers = poisson_field(np.random.Generator(np.random.Philox(4)), 50.0, (200_000,)) - 50.0
    assert abs((numbers[1:] * numbers[:-1]).mean()) / 50 < 5 / np.sqrt(len(numbers))
