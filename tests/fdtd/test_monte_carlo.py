"""Brute-force means: both ways agree, and the standard errors are those of the mean."""

import numpy as np
import pytest
from refusals import assert_refused

from specklegen.fdtd import Pulse, RandomLayer, illuminate, monte_carlo_mean, transfer_matrix, yee

LAYER = RandomLayer(correlation_length=0.1, n_points=300)
PULSE = Pulse(duration=0.5, delay=5.0)  # begins at 1e-11 of its peak
ROOT_ROUNDING = 2 * np.sqrt(np.finfo(float).eps)  # of a variance that is a difference of squares, where it is small
SIDES = ("back", "forward", "back_error", "forward_error")


def rel(a, b):
    return np.linalg.norm(a - b) / np.linalg.norm(b)


@pytest.mark.slow
def test_marches_and_transfer_matrix_give_the_same_mean():
    marched = monte_carlo_mean(LAYER, 200, "fdtd", pulse=PULSE, margin=2500)
    exact = monte_carlo_mean(LAYER, 200, pulse=PULSE)
    for side in SIDES:
        assert rel(getattr(marched, side), getattr(exact, side)) < 1e-6
    near = monte_carlo_mean(LAYER, 200, "fdtd", pulse=PULSE)
    for side in SIDES:
        assert rel(getattr(near, side), getattr(exact, side)) < 1e-3


def test_mean_is_the_mean_of_single_runs():
    fields = yee(LAYER, pulse=PULSE, kappa=LAYER.sample(10, 3))
    mean = monte_carlo_mean(LAYER, 10, "fdtd", pulse=PULSE, seed=3)
    assert rel(mean.back, fields.back.mean(axis=0)) < 1e-12
    assert rel(mean.forward_error, fields.forward.std(axis=0, ddof=1) / np.sqrt(10)) < ROOT_ROUNDING
    assert mean.realizations == 10
    assert mean.validity is None


def test_transfer_matrix_mean_and_error_are_those_of_the_single_media():
    incidence = illuminate(LAYER, PULSE)
    r, t = transfer_matrix(LAYER.sample(300, 5), incidence.omega, incidence.courant)
    back, forward = incidence.series(r), incidence.series((t - 1) * np.exp(-1j * incidence.theta * 299))
    mean = monte_carlo_mean(LAYER, 300, pulse=PULSE, seed=5)
    assert rel(mean.back, back.mean(axis=0)) < 1e-12
    assert rel(mean.forward, forward.mean(axis=0)) < 1e-12
    assert rel(mean.back_error, back.std(axis=0, ddof=1) / np.sqrt(300)) < ROOT_ROUNDING
    assert rel(mean.forward_error, forward.std(axis=0, ddof=1) / np.sqrt(300)) < ROOT_ROUNDING


def test_result_does_not_depend_on_threads_and_is_pure():
    one, two = (monte_carlo_mean(LAYER, 300, pulse=PULSE, threads=t) for t in (1, 2))
    for side in SIDES:
        assert np.array_equal(getattr(one, side), getattr(two, side))
    assert not np.array_equal(one.back, monte_carlo_mean(LAYER, 300, pulse=PULSE, seed=1).back)


def test_the_transform_is_long_enough():
    """A layer that rings (n = 1.59 in 1.45) does not wrap around: the march agrees over the whole record."""
    layer = RandomLayer(correlation_length=np.inf, n_points=300, rms_index=0)
    kappa = np.full(300, 0.2)
    field = yee(layer, pulse=PULSE, kappa=kappa, margin=3000)
    incidence = illuminate(layer, PULSE)
    r, _ = transfer_matrix(kappa, incidence.omega, incidence.courant)
    assert rel(field.back, incidence.series(r)) < 1e-6


def test_bad_input_is_refused():
    assert_refused(lambda: monte_carlo_mean(LAYER, 0), "n_realizations must be at least 1")
    with pytest.raises(ValueError, match="method must be one of"):
        monte_carlo_mean(LAYER, 2, "guess")  # type: ignore[arg-type]
    assert_refused(lambda: monte_carlo_mean(LAYER, 20, courant=1.0), "the largest that is stable")
