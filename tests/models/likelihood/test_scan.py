"""Intervals of scanned likelihoods, of a likelihood whose interval is known."""

import numpy as np
import pytest
from scipy.stats import t

from specklegen.models.likelihood.scan import interval

AT = np.geomspace(0.5, 20.0, 400)
SPREAD = 0.3  # of the logarithm, about 3
LIKELY = -np.square(np.log(AT / 3)) / 2 / SPREAD**2


@pytest.mark.parametrize(("level", "freedom"), [(0.68, np.inf), (0.95, np.inf), (0.95, 4.0)])
def test_a_parabola_has_the_interval_of_its_spread(level, freedom):
    reach = SPREAD * t.ppf((1 + level) / 2, freedom)
    np.testing.assert_allclose(np.log(interval(AT, LIKELY, level, freedom)), np.log(3) + [-reach, reach], atol=1e-3)


def test_an_interval_that_does_not_end_is_open():
    assert interval(AT[:240], LIKELY[:240], 0.95) == (pytest.approx(3 * np.exp(-1.96 * SPREAD), rel=1e-3), np.inf)
    assert interval(AT[200:], LIKELY[200:], 0.95)[0] == 0.0
