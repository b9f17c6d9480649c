"""Bilinear intensities: the unbiased estimate, the bias of the other, and their stated errors (W24)."""

import numpy as np
import pytest
from zscore import assert_mean, assert_z

from specklegen.core.errors import RuleError
from specklegen.wavetracing import bilinear_intensity

FIELD = np.array([1.0 + 0.5j, 0.0, 0.2j])
SPREAD = np.array([2.0, 1.0, 0.5])
BATCHES = 20_000


def batches(rays, seed=0):
    """Amplitudes complex[rays, BATCHES, 3] of mean FIELD and variance SPREAD^2, of uneven distribution."""
    rng = np.random.default_rng(seed)
    noise = rng.exponential(size=(rays, BATCHES, 3)) - 1
    return FIELD + SPREAD * noise * np.exp(0.7j)


@pytest.mark.parametrize("rays", [3, 8])
def test_unbiased(rays):
    intensity, _ = bilinear_intensity(batches(rays))
    assert_mean(intensity, np.abs(FIELD) ** 2)
    assert (intensity < 0).any()


def test_the_other_is_too_large_by_the_variance_over_n():
    intensity, _ = bilinear_intensity(batches(8), unbiased=False)
    assert_mean(intensity, np.abs(FIELD) ** 2 + SPREAD**2 / 8)
    with pytest.raises(AssertionError, match="z ="):
        assert_mean(intensity, np.abs(FIELD) ** 2)
    assert (intensity >= 0).all()


def test_standard_error():
    """Mean square of the jackknife's error against the variance of the estimate, where the field is not 0.

    The jackknife is unbiased to first order in 1 / n: 200 rays leave less than the slack of 3 %.
    """
    rng = np.random.default_rng(1)
    f = 1.0 + rng.exponential(size=(200, 4000)) - 1
    intensity, error = bilinear_intensity(f)
    variance = intensity.var(ddof=1)
    # standard error of a variance from 4000 normal values: its size times sqrt(2 / 4000)
    assert_z((error**2).mean(), variance, variance * np.sqrt(2 / 4000), slack=0.03 * variance)


def test_refused():
    with pytest.raises(RuleError, match="at least 3"):
        bilinear_intensity([1.0, 2.0])
    with pytest.raises(RuleError, match="finite"):
        bilinear_intensity([1.0, 2.0, np.nan])
