"""Closed draws of von Mises and Fisher's phase function by its distribution, and walks by them against its table."""

import numpy as np
import pytest
from numba import njit
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.kernels.lobes import fisher_density, sample_fisher
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.paths.phase_tables import walk_lobes


@njit
def draws(kappa, u, out):
    for i in range(len(u)):
        out[i] = sample_fisher(kappa, u[i])


@njit
def densities(kappa, v, out):
    for i in range(len(v)):
        out[i] = fisher_density(kappa, v[i])


def evaluated(function, kappa, x):
    out = np.empty_like(x)
    function(float(kappa), x, out)
    return out


@pytest.mark.parametrize("kappa", [1.5, 20.0, 1e4, 1e10])
def test_draws_are_the_inverse_of_the_distribution(kappa):
    """F(v(u)) = 1 - u: an even grid of u has to come back, and the density is the slope of F."""
    u = (np.arange(4000) + 0.5) / 4000
    v = evaluated(draws, kappa, u)
    below = np.expm1(-kappa * v) / np.expm1(-2 * kappa)
    np.testing.assert_allclose(below, 1 - u, atol=1e-14 if kappa < 1e9 else 1e-12)
    step = 1e-4 / kappa
    rise = np.exp(-kappa * v) * -np.expm1(-kappa * step) / -np.expm1(-2 * kappa)
    np.testing.assert_allclose(evaluated(densities, kappa, v) * step, rise, rtol=1e-4)


def test_lobes_name_their_concentration():
    walked, aimed = walk_lobes(sg.media.VonMisesFisher(20.0))
    assert (walked.g, aimed.g) == (20.0, 0.0)
    assert walk_lobes(sg.media.VonMisesFisher(0.5))[0].g == 0.0
    assert walk_lobes(table(20.0))[0].g == 0.0


def table(kappa):
    """The same phase function, which walks draw from a table since it has two parts."""
    part = sg.media.VonMisesFisher(kappa)
    return sg.media.Mixture(types=[part, sg.media.VonMisesFisher(kappa * (1 + 1e-9))], fractions=[0.5, 0.5])


def curves(scatterer, seeds):
    """Intensity, and K at two differences, of a slab by independent estimates: float64[seeds, 3]."""
    slab = sg.Slab(thickness=50.0, mean_free_path=10.0, scatterer=scatterer)
    found = [estimate_correlation(slab, 3000, seed) for seed in seeds]
    return np.array([[k.weights.sum() / k.paths, *k(np.array([0.1, 0.3]))] for k in found])


def test_walks_are_those_of_the_table():
    one, other = curves(sg.media.VonMisesFisher(20.0), range(16)), curves(table(20.0), range(16, 32))
    error = np.hypot(one.std(0, ddof=1), other.std(0, ddof=1)) / 16**0.5
    assert_z(one.mean(0), other.mean(0), error, degrees=30)
    wrong = curves(sg.media.VonMisesFisher(23.0), range(32, 48))
    refute_z(wrong.mean(0), other.mean(0), error, degrees=30)
