"""Numba kernels: functions of floats and arrays, serial, without the interpreter lock.

A kernel knows no units and no physics object; the layers above validate, then call it with plain
numbers. Every kernel is serial and releases the interpreter lock, so that one place above
(`specklegen.core.parallel`) decides how blocks of work are spread over threads, and a data-loader worker
can run the same code on one.

Compiled code is cached on disk (:mod:`specklegen.kernels.cache`). Where nothing can be written, the kernels compile
anew in each process, with a warning.
"""

from collections.abc import Callable
from typing import Any

from numba import njit

from specklegen.kernels.borrowing import BorrowingCompiler
from specklegen.kernels.cache import KernelCache
from specklegen.kernels.helpers import Helper

ROOM = 128
"""Draws, connections or views that a kernel takes side by side; what they need stays in the first-level cache."""


_COMPILED: dict[str, Any] = {
    "nogil": True, "error_model": "numpy", "fastmath": {"contract"},
    "no_cfunc_wrapper": True,  # for callers in C: nobody, and more to compile
}  # fmt: skip

_FOLDED: dict[str, Any] = {"nopython": True, "nogil": True, "forceinline": True, "error_model": "numpy"}


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel: serial, no interpreter lock, cached under the digest of all that its file imports.

    It borrows its arrays (:mod:`specklegen.kernels.borrowing`), and returns none.
    """
    return _cached(function, njit(pipeline_class=BorrowingCompiler, **_COMPILED)(function))


def returning(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that may return an array that it was given, or a longer one: it counts references."""
    return _cached(function, njit(**_COMPILED)(function))


def _cached(function: Callable[..., Any], compiled: Any) -> Any:
    compiled._cache = KernelCache(function)
    return compiled


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a helper that LLVM folds into the kernels that call it, always: a loop with a call is no vector loop.

    Its arithmetic is strict (no contraction but by :func:`specklegen.kernels.arithmetic.fma`), so that a value has
    the same bits in every lane of a vector loop and in the scalar loop that finishes it.
    """
    return Helper(function, targetoptions=_FOLDED | {"fastmath": False})


def folded(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a helper as :func:`inlined` does, with the kernels' own arithmetic: for what is no part of vector loops.

    It is typed and translated once, however often it is called; a spliced helper, once at every call.
    """
    return Helper(function, targetoptions=_FOLDED | {"fastmath": {"contract"}})


def spliced(function: Callable[..., Any]) -> Callable[..., Any]:
    """Copy a small helper into its callers before they are compiled: for few lines that take a tuple of arrays.

    A call counts a reference to each array, which LLVM removes from a body but not from a call: 450 ns a draw
    against 5 ns.
    """
    return njit(nogil=True, inline="always", error_model="numpy", fastmath={"contract"})(function)
