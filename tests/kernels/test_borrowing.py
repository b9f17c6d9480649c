"""Arrays without an owner hold what their owners hold, and writing reaches these."""

from typing import NamedTuple

import numpy as np

from specklegen.kernels import kernel
from specklegen.kernels.borrowing import borrowed


class Pair(NamedTuple):
    numbers: np.ndarray
    places: np.ndarray


@kernel
def doubled(pair, more):
    pair, more = borrowed(pair), borrowed(more)
    for n in range(pair.places.shape[0]):
        more[pair.places[n]] += 2.0 * pair.numbers[n, 1]
    return more[1:].sum()


def test_arrays_are_read_and_written_and_stay_their_owners():
    pair, more = Pair(np.arange(6.0).reshape(3, 2), np.array([2, 0, 2])), np.ones(3)
    for _ in range(1000):
        doubled(pair, more)
    assert more.tolist() == [6001.0, 1.0, 12001.0]
    assert pair.numbers.tolist() == [[0, 1], [2, 3], [4, 5]]
    assert doubled(pair, more) == 1.0 + 12013.0
