"""J0 against mpmath's, and its mixtures against the literal sum; torch's own J0 is shown to be worse."""

import mpmath
import numpy as np
import torch
from scipy.special import j0

from specklegen.kernels.bessel import NEAR, bessel_mixture


def one(x):
    out = np.empty(len(x))
    bessel_mixture(x, np.ones(1), np.ones(1), out)
    return out


def test_j0_is_that_of_mpmath():
    """On both sides of 8, at 8 and far out, where the phase of 1e4 radians has lost 1e-12."""
    near = np.concatenate([np.linspace(0, 40, 1501), NEAR + np.array([-1e-9, 0.0, 1e-9])])
    exact = np.array([float(mpmath.besselj(0, mpmath.mpf(x))) for x in near])
    np.testing.assert_allclose(one(np.sort(near)), exact[np.argsort(near)], rtol=0, atol=2e-15)
    far = np.geomspace(40, 1e4, 200)
    exact = np.array([float(mpmath.besselj(0, mpmath.mpf(x))) for x in far])
    np.testing.assert_allclose(one(far), exact, rtol=0, atol=2e-14)
    theirs = torch.special.bessel_j0(torch.from_numpy(near)).numpy()
    assert np.abs(theirs - j0(near)).max() > 1e-8, "torch mended its J0: ours may go"


def test_a_mixture_is_the_literal_sum():
    """In any order of the arguments, whose runs on either side of 8 it takes apart."""
    rng = np.random.default_rng(0)
    q, radius, share = rng.uniform(0, 5, 333), rng.uniform(0, 9, 57), rng.random(57)
    found = np.empty(len(q))
    bessel_mixture(q, radius, share, found)
    np.testing.assert_allclose(found, j0(q[:, None] * radius) @ share, rtol=0, atol=57 * 2e-15)
    ascending, order = np.empty(len(q)), np.argsort(q)
    bessel_mixture(q[order], radius, share, ascending)
    np.testing.assert_array_equal(ascending, found[order])
