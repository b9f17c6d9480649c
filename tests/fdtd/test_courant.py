"""The Courant limit of random media: computed, enforced, and sharp."""

import numpy as np
import pytest
from refusals import assert_refused

from specklegen.fdtd import RandomLayer, courant_limit, single_realization, transfer_matrix, yee
from specklegen.kernels.fdtd import march_total


def dense_limit(kappa, pad=8):
    permittivity = np.pad(1 + kappa, pad, constant_values=1.0)
    laplace = 2 * np.eye(permittivity.size) - np.eye(permittivity.size, k=1) - np.eye(permittivity.size, k=-1)
    root = 1 / np.sqrt(permittivity)
    return min(1.0, 2 / np.sqrt(np.linalg.eigvalsh(root[:, None] * laplace * root)[-1]))


def late_growth(kappa, courant, steps):
    """March a seed of 1e-12 and return (growth a step over the last quarter, largest field)."""
    steps -= steps % 8
    first, last = np.empty((2, 1, steps))
    source = np.zeros(steps)
    source[0] = 1e-12
    march_total(kappa[None], courant, (courant - 1) / (courant + 1), 20, source, 10, first, last)
    envelope = np.abs(last[0]).reshape(8, -1).max(axis=1)
    return (envelope[-1] / envelope[-3]) ** (4 / steps), np.abs(last).max()


@pytest.mark.parametrize("lc", [0.002, 0.02, 0.5, 3])
def test_eigen_limit_matches_a_dense_solver_and_exceeds_the_bound(lc):
    kappa = RandomLayer(correlation_length=lc, n_points=200).sample(4, 0)
    for row in kappa:
        assert courant_limit(row, "eigen") == pytest.approx(dense_limit(row), rel=1e-12)
        assert courant_limit(row, "bound") == pytest.approx(min(1, np.sqrt(1 + row.min())), rel=1e-15)
        assert courant_limit(row, "bound") <= courant_limit(row, "eigen") <= 1
    assert courant_limit(kappa, "eigen") == min(courant_limit(row, "eigen") for row in kappa)


def test_reference_limits():
    """Worst of 8 media lies between 0.93-0.97 by eigenvalue, 0.92-0.95 by the bound."""
    for lc in (0.002, 0.02, 0.5, 3):
        kappa = RandomLayer(correlation_length=lc).sample(8, 0)
        assert 0.92 < courant_limit(kappa, "eigen") < 0.975
        assert 0.91 < courant_limit(kappa) < 0.955


def test_the_eigen_limit_is_sharp():
    """Stable just below it, growing just above it; the bound is safe."""
    kappa = RandomLayer(correlation_length=0.02, n_points=300).sample(1, 5)[0]
    limit = courant_limit(kappa, "eigen")
    assert late_growth(kappa, limit * 0.9999, 20_000)[1] < 1e-10
    assert late_growth(kappa, limit * 1.0001, 8_000)[1] > 1
    assert late_growth(kappa, 1.0, 1_000)[1] > 1  # S = 1 in the background is never legal for a zero-mean index


def test_index_below_one_needs_a_reduced_courant_number():
    """A slab of n = 0.95 in 1.45: local Courant number 1 stays bounded, 1.01 blows up."""
    kappa = np.full(300, (0.95 / 1.45) ** 2 - 1)
    layer = RandomLayer(correlation_length=1, n_points=300)
    assert courant_limit(kappa) == pytest.approx(0.95 / 1.45)
    assert late_growth(kappa, 0.95 / 1.45, 20_000)[1] < 1e-11
    assert late_growth(kappa, 1.01 * 0.95 / 1.45, 2_000)[1] > 1
    assert_refused(lambda: yee(layer, kappa=kappa), r"courant must be greater than 0 and at most 0\.655172")
    assert np.isfinite(yee(layer, courant=0.65, kappa=kappa).back).all()


def test_an_unstable_run_is_refused_and_the_limit_named():
    layer = RandomLayer(correlation_length=0.5)
    kappa = layer.sample(1, 0)[0]
    assert_refused(lambda: yee(layer, courant=1.0), f"at most {courant_limit(kappa):.6g}, the largest that is stable")
    between = (courant_limit(kappa) + courant_limit(kappa, "eigen")) / 2
    assert_refused(lambda: yee(layer, courant=between), "courant must be")
    assert np.abs(yee(layer, courant=between, stability="eigen").forward).max() < 2
    with pytest.raises(ValueError, match="at most 1, the stability limit of a uniform background"):
        yee(layer, courant=1.0001, kappa=np.zeros(1500))
    with pytest.raises(ValueError, match="the largest that is stable"):
        single_realization(layer, covariance="sample", kappa=kappa, courant=1.0)  # shares brute force's limit


@pytest.mark.parametrize("bad", [-1.0, -2.0, np.nan, np.inf])
def test_permittivities_that_are_not_positive_are_refused(bad):
    kappa = np.zeros(1500)
    kappa[7] = bad
    layer = RandomLayer(correlation_length=1)
    for call in (courant_limit, lambda k: yee(layer, kappa=k), lambda k: transfer_matrix(k, np.array([0.1]))):
        with pytest.raises(ValueError, match="kappa must be finite and above -1"):
            call(kappa)
