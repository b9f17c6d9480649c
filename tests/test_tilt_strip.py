"""What the picture of tilted stacks says under each image: the correlation along the moved pattern."""

import numpy as np
import pytest

from specklegen.pictures import moved_correlation


@pytest.mark.parametrize("move", [(5, 0), (-3, 2), (0, -7), (4, 4)])
def test_a_pattern_that_only_moves_is_the_same(move):
    wide = np.random.default_rng(0).exponential(size=(40, 50))
    x, y = move
    first, image = wide[8:32, 8:40], wide[8 - y : 32 - y, 8 - x : 40 - x]
    assert moved_correlation(first, image, np.array(move)) == pytest.approx(1)
    assert abs(moved_correlation(first, image, -np.array(move))) < 0.5  # the other way it is another pattern
