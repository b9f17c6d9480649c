"""Arrays without an owner hold what their owners hold; kernels borrow all theirs, and return none of them."""

import ast
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit
from scenes import ROOT

from specklegen.kernels import kernel, returning
from specklegen.kernels.borrowing import BorrowingCompiler, borrowed


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


def _kernels(file):
    for node in ast.walk(ast.parse(file.read_text())):
        names = [each.id for each in getattr(node, "decorator_list", ()) if isinstance(each, ast.Name)]
        if isinstance(node, ast.FunctionDef) and {"kernel", "returning"} & {*names}:
            yield node, "returning" in names


def _returned(function):
    """Names of parameters among what a function returns as it is, or a part of."""
    parameters = {each.arg for each in function.args.args}
    for node in ast.walk(function):
        if isinstance(node, ast.Return) and node.value is not None:
            for each in node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]:
                part = each.value if isinstance(each, ast.Attribute) else each
                if isinstance(part, ast.Name) and part.id in parameters:
                    yield part.id


FILES = [*ROOT.glob("specklegen/kernels/*.py"), *ROOT.glob("specklegen/wavetracing/kernels/*.py")]
NUMBERS = {"counter", "count", "hit"}
"""Parameters that are numbers."""


def test_no_kernel_returns_an_array_that_it_borrows():
    found = {
        (function.name, name): returning_one
        for file in FILES for function, returning_one in _kernels(file) for name in _returned(function)
        if name not in NUMBERS
    }  # fmt: skip
    assert {name for (name, _), returning_one in found.items() if not returning_one} == set()
    assert {name for (name, _), returning_one in found.items() if returning_one} == {
        "collect_all", "edges_about", "edges_near",
    }  # fmt: skip


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
