"""Arrays without an owner hold what their owners hold; kernels borrow all that they are given, and return none."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit
from numba.core.errors import LoweringError

from specklegen.kernels import kernel, returning
from specklegen.kernels.borrowing import BorrowingCompiler


class Pair(NamedTuple):
    numbers: np.ndarray
    places: np.ndarray


@kernel
def doubled(pair, more):
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


def _many(given, count):
    total = 0.0
    for n in range(count):
        for rows in given:  # each in turn, whichever it is
            total += rows[n % rows.shape[0]] * n
    return total


def _counts(compiled):
    """Whether anything in what was compiled may count a reference."""
    return "@NRT_incref" in "".join(compiled.inspect_llvm().values())


def test_no_reference_is_counted():
    given, ways = (np.arange(3.0), np.arange(5.0)), (njit(pipeline_class=BorrowingCompiler)(_many), njit(_many))
    one, other = (way(given, 100) for way in ways)
    assert one == other
    assert [_counts(way) for way in ways] == [False, True]


@pytest.mark.parametrize("given", [lambda a: a, lambda a: (1.0, a), lambda a: np.zeros(a.size)])
def test_a_kernel_that_returns_an_array_is_refused(given):
    """Its memory might be the caller's, who may free it first."""
    with pytest.raises(LoweringError, match="must not return one: compile it by `returning`"):
        kernel(given)(np.ones(3))


def test_what_is_returned_lives_on():
    @returning
    def same_or_longer(places, count):
        if count > places.shape[0]:
            places = np.zeros(count)
        return places

    first = np.arange(1000.0)
    kept = [same_or_longer(first, n) for n in (10, 2000)]
    del first
    for _ in range(100):
        np.full(1000, np.nan)
    assert kept[0].sum() == 499500.0
    assert not kept[1].any()


@pytest.mark.parametrize("kind", [np.float64, np.complex64, np.int32])
def test_what_is_written_arrives(kind):
    @kernel
    def fill(out, pair):
        for n in range(out.shape[0]):
            out[n] = pair[0][n] + pair[1]

    out = np.zeros(7, kind)
    fill(out, (np.arange(7).astype(kind), kind(3)))
    assert out.tolist() == [n + 3 for n in range(7)]
