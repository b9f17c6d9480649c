"""The multi-exposure model turned round: what it was made of comes back, and noise as another program has it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from refusals import assert_refused
from scipy.optimize import least_squares

from specklegen.theory.multi_exposure import REACH, multi_exposure_fit
from specklegen.theory.speckle_contrast import exponential_contrast_squared

EXPOSURES = np.geomspace(5e-5, 5e-2, 5)


def made(times, shares, beta=1.0):
    """K^2 float64[n, T] of the model."""
    pairs = zip(times, shares, strict=True)
    return np.array([exponential_contrast_squared(EXPOSURES, t, dynamic_share=s, beta=beta) for t, s in pairs])


def test_what_it_was_made_of_comes_back():
    """Shares of light at rest of any size, times inside the exposures; a map keeps its shape."""
    rng = np.random.default_rng(0)
    times, shares = np.exp(rng.uniform(*np.log([1e-4, 2e-2]), 60)), rng.uniform(0.2, 1, 60)
    found = multi_exposure_fit(made(times, shares, 0.4).reshape(6, 10, 5), EXPOSURES, beta=0.4)
    assert found.correlation_time.shape == (6, 10)
    # Half of the digits: of a square the minimum is as flat as that.
    assert_allclose(found.correlation_time.ravel(), times, rtol=1e-6)
    assert_allclose(found.dynamic_share.ravel(), shares, atol=1e-6)
    assert found.misfit.max() < 1e-7
    off = multi_exposure_fit(made(1.01 * times, shares), EXPOSURES)
    assert np.abs(off.correlation_time / times - 1).min() > 5e-3  # a time 1 % off is told


def test_noisy_contrasts_are_fitted_as_another_program_does():
    """Both minima of 40 noisy rows: the costs of scipy's bounded least squares, begun at the truth, or less."""
    rng = np.random.default_rng(1)
    times, shares = np.exp(rng.uniform(*np.log([1e-4, 2e-2]), 40)), rng.uniform(0.4, 1, 40)
    noisy = made(times, shares) * (1 + 0.06 * rng.standard_normal((40, 5)))
    found = multi_exposure_fit(noisy, EXPOSURES)
    for n, row in enumerate(noisy):

        def misfit(numbers, row=row):
            return exponential_contrast_squared(EXPOSURES, np.exp(numbers[0]), dynamic_share=numbers[1]) / row - 1

        begun = np.log(times[n]), min(shares[n], 0.999)
        other = least_squares(misfit, begun, bounds=([-14, 0], [2, 1]), xtol=1e-12, ftol=1e-12, gtol=1e-12)
        cost = np.square(misfit([np.log(found.correlation_time[n]), found.dynamic_share[n]])).sum()
        assert found.misfit[n] == pytest.approx(np.sqrt(cost / 5), rel=1e-9)
        assert cost <= 2 * other.cost * (1 + 1e-6), (n, other.x)


def test_ends_of_the_range():
    """Nothing has moved, or all has been forgotten, before an exposure could tell."""
    times, shares, misfit = multi_exposure_fit([np.ones(5), np.full(5, 0.09)], EXPOSURES)
    assert shares[0] < 1e-3 or times[0] > 1.0
    assert shares[1] == pytest.approx(0.7, abs=0.01)
    assert times[1] < 1e-6
    assert misfit[0] < 1e-3
    # The time ends at a hundredth of the shortest exposure, where what moves still adds to its K^2.
    shares = np.linspace(0.6, 0.8, 20_001)
    models = [exponential_contrast_squared(EXPOSURES, EXPOSURES[0] / REACH, dynamic_share=share) for share in shares]
    assert misfit[1] == pytest.approx(np.sqrt(np.square(np.array(models) / 0.09 - 1).mean(axis=1)).min(), rel=1e-4)
    assert multi_exposure_fit(np.full(5, 1e-9), EXPOSURES).dynamic_share > 0.99


@pytest.mark.parametrize(("asked", "words"), [
    (([0.5, 0.2], [1.0, 1.0]), "exposures must be a list of at least two different"),
    (([0.5, 0.2], [0.0, 1.0]), "exposures must be finite and above 0"),
    (([0.5, 0.0], [1.0, 2.0]), "contrast_squared must be finite and above 0"),
    (([0.5, np.nan], [1.0, 2.0]), "contrast_squared must be finite and above 0"),
    (([0.5, 0.2, 0.1], [1.0, 2.0]), "contrast_squared must be of 2 exposures along the last axis"),
    (("ab", [1.0, 2.0]), "contrast_squared must be an array of numbers"),
])  # fmt: skip
def test_bad_input_is_named(asked, words):
    assert_refused(lambda: multi_exposure_fit(*asked), words)
    assert_refused(lambda: multi_exposure_fit([0.5, 0.2], [1.0, 2.0], beta=1.1), "beta must be above 0 and at most 1")
