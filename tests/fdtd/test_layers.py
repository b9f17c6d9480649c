"""Random layers: exact AR(1) media and the moments of their permittivity."""

import math
import warnings

import numpy as np
import pytest
from refusals import assert_refused
from scipy.stats import norm

from specklegen.fdtd import RandomLayer, sample_moments

FALSE_ALARM = 1e-6  # chance that a right build fails one test, shared over its comparisons


def standardized_index(layer, kappa):
    return (np.sqrt(1 + kappa) - 1) * layer.n_background / layer.rms_index


def innovation_z(g, rho):
    """Scores of: start variance, innovation mean and variance, against the past, and among themselves."""
    w = (g[:, 1:] - rho * g[:, :-1]) / math.sqrt(1 - rho**2)
    n = w.size
    return np.array(
        [((g[:, 0] ** 2).mean() - 1) * math.sqrt(len(g) / 2), w.mean() * math.sqrt(n),
         ((w**2).mean() - 1) * math.sqrt(n / 2), (w * g[:, :-1]).mean() * math.sqrt(n),
         (w[:, 1:] * w[:, :-1]).mean() * math.sqrt(w[:, 1:].size)]
    )  # fmt: skip


@pytest.mark.parametrize("lc", [0.002, 0.02, 0.5])
def test_index_is_exactly_ar1(lc):
    layer = RandomLayer(correlation_length=lc, n_points=400)
    z = innovation_z(standardized_index(layer, layer.sample(1000, seed=1)), math.exp(-layer.dx / lc))
    assert np.abs(z).max() < norm.isf(FALSE_ALARM / (2 * 5 * 3)), z


def test_ar1_test_has_power():
    """A correlation length wrong by 2 % must be caught."""
    layer = RandomLayer(correlation_length=0.02, n_points=400)
    z = innovation_z(standardized_index(layer, layer.sample(1000, seed=1)), math.exp(-layer.dx / 0.0204))
    assert np.abs(z).max() > norm.isf(FALSE_ALARM / (2 * 5 * 3)), z


@pytest.mark.parametrize(("rho", "sigma"), [(1.0, 0.03), (0.8, 0.2), (0.0, 0.5)])
def test_closed_form_moments_against_quadrature(rho, sigma):
    """Gauss-Hermite quadrature over two correlated normals, exact for these polynomials."""
    lc = {1.0: np.inf, 0.8: -0.002 / math.log(0.8), 0.0: 0.0}[rho]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        moments = RandomLayer(correlation_length=lc, rms_index=sigma, n_points=2).moments()
    x, weight = np.polynomial.hermite_e.hermegauss(8)
    weight = weight / weight.sum()
    kappa = lambda g: (1 + sigma / 1.45 * g) ** 2 - 1  # noqa: E731
    pair = kappa(rho * x[:, None] + math.sqrt(1 - rho**2) * x)
    second = weight @ (kappa(x)[:, None] * pair) @ weight
    assert moments.mean == pytest.approx([weight @ kappa(x)] * 2, rel=1e-13)
    assert moments.second[1] == pytest.approx(second, rel=1e-12)
    assert moments.second[0] == pytest.approx(weight @ kappa(x) ** 2, rel=1e-13)


def test_sample_moments_agree_with_closed_form():
    layer = RandomLayer(correlation_length=0.02, n_points=30, rms_index=0.1)
    kappa = layer.sample(40_000, seed=3)
    sample, exact = sample_moments(kappa), layer.moments()
    lag = np.abs(np.subtract.outer(np.arange(30), np.arange(30)))
    products = kappa[:, :, None] * kappa[:, None, :]
    z_second = (sample.second - exact.second[lag]) / (products.std(axis=0) / 200)
    z_mean = (sample.mean - exact.mean) / (kappa.std(axis=0) / 200)
    limit = norm.isf(FALSE_ALARM / (2 * 930))
    assert max(np.abs(z_second).max(), np.abs(z_mean).max()) < limit
    # power: a mean of 0, which a Gaussian kappa would have, is caught
    assert np.abs(sample.mean / (kappa.std(axis=0) / 200)).max() > limit


def test_a_realization_depends_on_seed_and_number_only():
    layer = RandomLayer(correlation_length=0.1, n_points=50)
    assert np.array_equal(layer.sample(10, 7)[3:7], layer.sample(4, 7, first=3))
    assert not np.array_equal(layer.sample(1, 7), layer.sample(1, 8))


@pytest.mark.parametrize(("fields", "message"), [
    ({"correlation_length": -1}, "RandomLayer.correlation_length must be at least 0"),
    ({"correlation_length": math.nan}, "RandomLayer.correlation_length"),
    ({"correlation_length": 1, "dx": 0}, "RandomLayer.dx must be greater than 0"),
    ({"correlation_length": 1, "n_points": 0}, "RandomLayer.n_points must be at least 1"),
    ({"correlation_length": 1, "rms_index": -0.1}, "RandomLayer.rms_index must be at least 0"),
    ({"correlation_length": 1, "correlation": "gaussian"}, "RandomLayer.correlation must be one of"),
])  # fmt: skip
def test_bad_layers_are_refused(fields, message):
    assert_refused(lambda: RandomLayer(**fields), message)


def test_bad_samples_are_refused():
    layer = RandomLayer(correlation_length=0.5, rms_index=0.6)
    assert_refused(lambda: layer.sample(50, 0), "RandomLayer.rms_index must be small enough that every index")
    assert_refused(lambda: layer.sample(0, 0), "at least 1")
    assert_refused(lambda: layer.sample(1, 0, first=-1), "at least 0")
