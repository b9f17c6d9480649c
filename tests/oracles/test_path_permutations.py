"""A16: the six orders of three nodes, against the Monte Carlo of forward and reversed paths."""

import numpy as np
import pytest
from references.path_permutations import permutation_covariance
from zscore import assert_mean, assert_z, refute_mean, refute_z

from specklegen.oracles.box_algorithms import Far, Setup, contributions
from specklegen.oracles.box_media import box, henyey_greenstein

pytestmark = pytest.mark.slow  # the oracle's own checks

AXIS = np.array([0.0, 1.0])
ANGLES = np.deg2rad([0.0, 90.0, 180.0])
VIEWS = np.stack([np.sin(ANGLES), np.cos(ANGLES)], axis=-1)
FORWARD, REVERSED, OTHERS = 0, 5, slice(1, 5)


def square(side):
    """Optical depth 2."""
    return box((-side / 2,) * 2, (side / 2,) * 2, extinction=2 / side, particles=(henyey_greenstein(0.0, 2),))


def shares(side, paths, apart=0.0):
    """Contributions over the forward one's mean, complex128[64, 6, V], and the forward ones float64[64, V]."""
    seeds = np.random.SeedSequence(1).spawn(64)
    found = np.array(
        [
            permutation_covariance(square(side), 1.0, (AXIS, AXIS), (VIEWS, VIEWS), paths, np.random.default_rng(s),
                                   apart=apart)
            for s in seeds
        ]
    )  # fmt: skip
    return found / found[:, FORWARD].real.mean(axis=0), found[:, FORWARD].real


def test_forward_is_positive_and_the_reverse_counts_at_backscattering_only():
    found, forward = shares(20, 4000)
    assert (forward > 0).all()
    np.testing.assert_allclose(found[:, REVERSED, 2], found[:, FORWARD, 2], rtol=1e-10)  # rounding of 1e2 rad
    assert_mean(found[:, REVERSED, :2].real, 0.0, slack=1e-2)


def test_forward_paths_are_those_of_the_monte_carlo():
    """Absolute: sigma_s^3 and every factor, against the third order of Algorithm 1."""
    _, forward = shares(20, 4000)
    setup = Setup(square(20), 1.0, Far(AXIS[None]), Far(VIEWS))
    third = []
    for seed in np.random.SeedSequence(2).spawn(64):
        parts = contributions(setup, 1000, np.random.default_rng(seed), reverse=False)
        third.append(next(np.square(np.abs(p.amplitude)) @ p.weight / 1000 for p in parts if p.order == 3))
    third = np.array(third)
    error = np.sqrt((forward.var(axis=0, ddof=1) + third.var(axis=0, ddof=1)) / 64)
    assert_z(forward.mean(axis=0), third.mean(axis=0), error, degrees=63)
    refute_z(forward.mean(axis=0), 1.1 * third.mean(axis=0), error, degrees=63)


@pytest.mark.slow
def test_other_orders_vanish_for_nodes_apart():
    """Within 1e-2 of forward away from backscattering, with nodes two wavelengths apart."""
    found, _ = shares(20, 6000, apart=2.0)
    assert_mean(found[:, OTHERS, :2].real, 0.0, slack=1e-2)


@pytest.mark.slow
def test_other_orders_come_from_nodes_within_a_wavelength():
    """Without that, exchanged neighbours add some 4 % in transmission, and half as much in a box twice as large."""
    small, large = (shares(side, 12_000)[0][:, [1, 2], 0].real.mean(axis=1) for side in (20, 40))
    refute_mean(small, 0.0, slack=1e-2)
    assert_z(small.mean() / 2, large.mean(), np.sqrt((small.var(ddof=1) / 4 + large.var(ddof=1)) / 64), degrees=63)
