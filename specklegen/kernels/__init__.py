"""Numba kernels: functions of floats and arrays, serial, without the interpreter lock.

A kernel knows no units and no physics object; the layers above validate, then call it with plain
numbers. Every kernel is serial and releases the interpreter lock, so that one place above
(`specklegen.core.parallel`) decides how blocks of work are spread over threads, and a data-loader worker
can run the same code on one.

Compiled code is cached in the user's cache directory under a digest of *all* kernel sources: Numba
notices a change in the file of a function but not in the files of the functions that it calls.
Where nothing is writable the kernels compile anew in each process, with a warning.
"""

import hashlib
import os
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba import njit

ROOM = 128
"""Draws, connections or views that a kernel takes side by side; what they need stays in the first-level cache."""


def _source_digest() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _writable_cache() -> str | None:
    root = os.environ.get("SPECKLEGEN_CACHE")
    if root is None:
        import platformdirs

        root = platformdirs.user_cache_dir("specklegen")
    folder = Path(root) / "kernels" / _source_digest()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return str(folder)
    except OSError:
        warnings.warn(
            f"no compiled-kernel cache: {folder} is not writable, so kernels compile in every process; "
            "set SPECKLEGEN_CACHE to a writable folder",
            stacklevel=3,
        )
        return None


_CACHE = _writable_cache()


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel: serial, no interpreter lock, cached under the digest of all kernels."""
    if _CACHE is None:
        return njit(nogil=True, error_model="numpy", fastmath={"contract"})(function)
    before = numba.config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
    numba.config.CACHE_DIR = _CACHE  # pyright: ignore[reportAttributeAccessIssue]
    try:
        return njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)(function)
    finally:
        numba.config.CACHE_DIR = before  # pyright: ignore[reportAttributeAccessIssue]


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a helper that LLVM folds into the kernels that call it, always: a loop with a call is no vector loop.

    Its arithmetic is strict (no contraction but by :func:`specklegen.kernels.arithmetic.fma`), so that a value has
    the same bits in every lane of a vector loop and in the scalar loop that finishes it.
    """
    return njit(nogil=True, forceinline=True, error_model="numpy", fastmath=False)(function)


def spliced(function: Callable[..., Any]) -> Callable[..., Any]:
    """Copy a small helper into its callers before they are compiled: for helpers that take a tuple of arrays.

    A call counts a reference to each array, which LLVM removes from a body but not from a call: 450 ns a draw
    against 5 ns.
    """
    return njit(nogil=True, inline="always", error_model="numpy", fastmath={"contract"})(function)
