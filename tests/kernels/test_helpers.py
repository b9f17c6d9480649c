"""Helpers are folded into kernels, and what kernels are compiled for does not differ without need."""

import numba
import numpy as np
import pytest

import specklegen as sg
from specklegen.core.values import read_only
from specklegen.kernels import folded, inlined, kernel
from specklegen.paths.endpoints import Endpoints
from specklegen.paths.jones import ends_of, type_matrices, walk_matrices
from specklegen.paths.phase_tables import walk_lobes


@inlined
def _half(x):
    return 0.5 * x


@inlined
def _quarter(pair, extra):
    if extra is not None:
        return _half(_half(pair[0])) + extra
    return _half(_half(pair[0]))


@kernel
def _quarters(values, extra, out):
    for n in range(values.shape[0]):
        out[n] = _quarter((values[n], 0.0), extra)
    return _half(4)


@pytest.mark.parametrize("extra", [None, 1.0])
def test_helpers_of_helpers_give_what_python_gives(extra):
    values = np.array([1.0, -3.0, np.nan, np.inf])
    out = np.empty(4)
    assert _quarters(values, extra, out) == 2.0
    np.testing.assert_array_equal(out, values / 4 + (extra or 0.0))
    np.testing.assert_array_equal([_quarter((x, 0.0), extra) for x in values], out)  # called from Python


def test_helpers_are_linked_in_and_never_machine_code():
    alone = kernel(_quarters.py_func)
    alone._cache = numba.core.caching.NullCache()  # a kernel from the disk compiles no helpers
    alone(np.ones(1), None, np.empty(1))
    made = [each for helper in (_half, _quarter) for each in helper.overloads.values()]
    assert made
    assert {each.library.get_pointer_to_function(each.fndesc.llvm_func_name) for each in made} == {0}
    (whole,) = alone.overloads.values()
    assert whole.library.get_pointer_to_function(whole.fndesc.llvm_func_name) > 0
    # Numba's own way makes machine code of either.
    plain = numba.njit(_half.py_func)
    numba.njit(lambda x: plain(x))(1.0)
    (known,) = plain.overloads.values()
    assert known.library.get_pointer_to_function(known.fndesc.llvm_func_name) > 0


@folded
def _place(row, axis, doubled):
    return 2 * row[axis] if doubled else row[axis]


@kernel
def _sum(row):
    total = 0.0
    for axis in range(row.shape[0]):
        total += _place(row, axis, False)
    return total + _place(row, 0, True) + _place(row, 1, False)


def test_numbers_that_stand_in_a_call_compile_no_helper_anew():
    """Numba alone takes every literal for a type of its own."""
    alone = kernel(_sum.py_func)
    alone._cache = numba.core.caching.NullCache()
    assert alone(np.array([1.0, 3.0])) == 4.0 + 2.0 + 3.0
    (types,) = _place.overloads
    assert [str(each) for each in types[1:]] == ["int64", "bool"]
    plain = numba.njit(lambda axis: axis)
    numba.njit(lambda axis: plain(axis) + plain(0) + plain(1))(2)
    assert len(plain.overloads) > 1


def test_walks_are_compiled_once_for_all_lobes_and_matrices():
    """A writable array, or one not in C order, is another type to Numba, for which a walk takes ten seconds more."""
    scatterers = sg.HenyeyGreenstein(0.9), sg.Isotropic(), sg.Rayleigh(), sg.VonMisesFisher(40.0)
    assert len({numba.typeof(lobe) for each in scatterers for lobe in walk_lobes(each)}) == 1
    layer = sg.Layer(thickness=1.0, mean_free_path=1.0, scatterer=sg.Rayleigh())
    for matrices, media in (
        (lambda medium: walk_matrices(ends_of(medium)), lambda how: layer_as_slab(layer, how)),
        (type_matrices, lambda how: sg.Layers(layers=[layer, layer], polarisation=how)),
    ):
        assert len({numba.typeof(matrices(media(how))) for how in ("projector", "vector")}) == 1


def layer_as_slab(layer: sg.Layer, polarisation: str) -> sg.Slab:
    return sg.Slab(thickness=1.0, mean_free_path=1.0, scatterer=layer.scatterer, polarisation=polarisation)


def test_endpoints_are_of_one_type():
    vectors = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.6, 0.8]])
    grid = sg.FarField.grid((3, 3), 1e-3)
    given = vectors, read_only(vectors.copy()), np.asfortranarray(vectors), grid
    assert len({numba.typeof(Endpoints(False, each, 1.0).vectors) for each in given}) == 1
    assert vectors.flags.writeable
