"""Quantiles against SciPy's, addresses against the known words of Philox, and the torch form against the kernels."""

import numpy as np
import pytest
import torch
from scipy.special import ndtri
from scipy.stats import poisson

from specklegen.instrument import torch_quantiles
from specklegen.kernels import quantiles
from specklegen.kernels.quantiles import SUMMED
from specklegen.synthesis.gaussian_noise import philox

KEY = (0x12345678, 0x9ABCDEF0)
N = 100_000
MEANS = [0.0, 1e-3, 0.5, 4.0, SUMMED - 1e-9, SUMMED, 45.0, 300.0, 1e4, 1e6]


def words(blocks):
    return torch.stack(philox(torch.tensor(KEY), torch.arange(blocks)), -1)


def units(count=N):
    return torch_quantiles.units(words((count + 1) // 2)).reshape(-1)[:count].numpy()


def numbers(mean, count=N):
    out = np.zeros(count)
    quantiles.add_poisson(*KEY, np.full(count, float(mean)), out)
    return out


def test_every_uniform_number_has_an_address():
    """Two pixels a block: 52 bits from its first two words, 52 from its last two."""
    whole = words(4).numpy().astype(np.uint64)
    bits = (whole[:, 0::2] << np.uint64(32) | whole[:, 1::2]) >> np.uint64(12)
    np.testing.assert_array_equal(units(7), ((bits.astype(np.float64) + 0.5) / 2**52).ravel()[:7])
    np.testing.assert_array_equal(units(1000)[:7], units(7))


def test_normal_quantiles_in_the_middle_and_in_both_tails():
    u = np.concatenate([units(), np.geomspace(1e-300, 0.5, 2000), 1 - np.geomspace(1.2e-16, 0.5, 2000)])
    found = torch_quantiles.normal_quantile(torch.from_numpy(u)).numpy()
    np.testing.assert_allclose(found, ndtri(u), rtol=1e-13, atol=1e-15)
    out = np.zeros(N)
    quantiles.add_normal(*KEY, 3.0, out)
    np.testing.assert_allclose(out, 3 * ndtri(units()), rtol=1e-13, atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("mean", MEANS)
def test_poisson_numbers_are_the_exact_quantiles(mean):
    """Over six decades and more: all of 1e5 equal, but at most 2 of them, by 1, for the expansion's error of 1e-6. (The
    chance of 3 where 0.1 are expected is 2e-4, and the numbers are the same in every run.)"""
    exact = poisson.ppf(units(), mean) if mean else np.zeros(N)
    found = numbers(mean)
    off = found != exact
    assert off.sum() <= 2
    assert np.abs(found - exact).max() <= 1
    means = torch.full((N,), float(mean), dtype=torch.float64)
    by_torch = torch_quantiles.poisson_quantile(means, torch.from_numpy(units()))
    assert (by_torch.numpy() != found).sum() <= 2
    if mean >= 1:
        wrong = poisson.ppf(units(), mean * (1 + 1e-3))  # power
        assert (wrong != exact).sum() > 100


@pytest.mark.parametrize("u", [2.0**-53, 1e-9, 0.5, 1 - 1e-9, 1 - 2.0**-53])
def test_quantiles_rise_with_the_mean(u):
    """And are finite, and not below 0, at the ends of the uniform numbers, across the change of method. At the very
    last uniform number, 2^-53 below 1, the rounding of a sum of probabilities decides, by up to 6."""
    means = torch.linspace(0, 200, 4001, dtype=torch.float64)
    found = torch_quantiles.poisson_quantile(means, torch.full_like(means, u))
    assert (found[1:] >= found[:-1] - 6 * (u > 1 - 1e-15)).all()
    assert found.min() >= 0
    exact = poisson.ppf(u, means[1:].numpy())
    # Where |s| > 0.9 the functions of s are held: off by less than 2 % there.
    np.testing.assert_allclose(found[1:].numpy(), exact, atol=1 + 4 * (u > 1 - 1e-15), rtol=0.02)
