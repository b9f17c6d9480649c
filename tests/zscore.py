"""Statistical assertions: a z-score against a stated false-alarm rate, shared over the comparisons."""

import numpy as np
import pytest
from scipy.stats import t as student

FALSE_ALARM = 1e-6  # chance that a right build fails one assertion, shared by its comparisons


def limit(comparisons: int = 1, degrees: float = np.inf) -> float:
    """Two-sided bound on |z| for ``comparisons`` values with errors from ``degrees`` + 1 batches."""
    return float(student.isf(FALSE_ALARM / (2 * comparisons), degrees))


def assert_z(value, expected, standard_error, *, degrees: float = np.inf, slack=0.0) -> None:
    """Every |value - expected| must be within ``limit`` standard errors (plus ``slack``, a stated tolerance)."""
    value, expected, standard_error = np.broadcast_arrays(value, expected, standard_error)
    bound = limit(value.size, degrees)
    excess = np.maximum(np.abs(value - expected) - slack, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(excess == 0, 0.0, excess / standard_error)
    assert np.isfinite(z).all(), f"undefined z: {value} vs {expected} +- {standard_error}"
    worst = int(z.argmax())
    assert z.max() < bound, (
        f"{value.flat[worst]:.6g} vs {np.real_if_close(expected.flat[worst]):.6g}: z = {z.max():.2f}, limit {bound:.2f}"
    )


def assert_mean(samples, expected, *, slack=0.0) -> None:
    """The mean over the first axis (independent batches) must be ``expected``, by Student's t."""
    samples = np.asarray(samples)
    error = samples.std(axis=0, ddof=1) / np.sqrt(len(samples))
    assert_z(samples.mean(axis=0), expected, np.abs(error), degrees=len(samples) - 1, slack=slack)


def refute_z(*arguments, **options) -> None:
    """A deliberate error must be caught: `assert_z` of the same arguments fails by a z beyond its limit."""
    with pytest.raises(AssertionError, match="z ="):
        assert_z(*arguments, **options)


def refute_mean(*arguments, **options) -> None:
    """A deliberate error must be caught: `assert_mean` of the same arguments fails by a z beyond its limit."""
    with pytest.raises(AssertionError, match="z ="):
        assert_mean(*arguments, **options)
