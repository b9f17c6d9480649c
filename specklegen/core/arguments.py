"""Checking arguments of functions: numbers, arrays and values that are not fields of a :class:`Value`.

A field of a value is checked by its type; what a function takes beside it is checked here, so that a wrong type
reads like any other broken rule.
"""

import os
from collections.abc import Collection
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.errors import RuleError, reject

if TYPE_CHECKING:
    from torch import Tensor

T = TypeVar("T")

_MOST = 2**512  # of a whole number without a bound of its own: its float is finite


def instance(field: str, value: object, kind: type[T]) -> T:
    """Return the value, which has to be of a type."""
    if not isinstance(value, kind):
        reject(field, f"a {kind.__name__}", value)
    return value


def whole_number(field: str, value: object, least: int = 0, most: int | None = None, *, remedy: str = "") -> int:
    """Return a whole number in a range, ends included.

    Raise a `RuleError` if it is none: 2.0 and True are not whole numbers here.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        reject(field, "a whole number", value, remedy)
    if most is None and value > _MOST:
        reject(field, "a whole number of fewer digits", value, remedy)
    if value < least or (most is not None and value > most):
        reject(field, f"at least {least}" + ("" if most is None else f" and at most {most}"), value, remedy)
    return int(value)


def whole_numbers(field: str, value: object, least: int = 0, most: int | None = None) -> list[int]:
    """Return at least one whole number in a range, from a sequence or an array of one dimension."""
    try:
        numbers = value.tolist() if hasattr(value, "tolist") else list(value)  # type: ignore[call-overload, attr-defined]
    except (TypeError, ValueError, NotImplementedError, RuntimeError):  # the last two of torch, of "meta"
        numbers = []
    if not isinstance(numbers, list) or not numbers or isinstance(value, str | bytes | dict | set):
        reject(field, "at least one whole number", value)
    return [whole_number(field, number, least, most) for number in numbers]


def file_path(field: str, value: object) -> Path:
    """Return the path of a file or folder, given as text or as such."""
    if not isinstance(value, str | os.PathLike) or not isinstance(os.fspath(value), str) or not os.fspath(value):
        reject(field, "a path", value)
    return Path(value)


def several(field: str, value: object, kind: type[T]) -> tuple[T, ...]:
    """Return one value of a type, or a sequence of them, as a tuple of at least one."""
    try:
        members = (value,) if isinstance(value, kind) else tuple(value)  # type: ignore[arg-type]
    except TypeError:
        members = ()
    if not members or not all(isinstance(member, kind) for member in members):
        reject(field, f"a {kind.__name__}, or a sequence of them", value)
    return members  # type: ignore[return-value]


def flag(field: str, value: object) -> bool:
    """Return True or False, which has to be given as such.

    Raise a `RuleError` if it is something else: "no" and arrays have no truth here.
    """
    if not isinstance(value, bool | np.bool_):
        reject(field, "True or False", value)
    return bool(value)


def choice(field: str, value: object, choices: Collection[str]) -> str:
    """Return a name, which has to be one of some."""
    if not isinstance(value, str) or value not in choices:
        near = get_close_matches(value, choices, 1, 0.6) if isinstance(value, str) else ()
        meant = f"Did you mean {near[0]}?" if near else ""
        reject(field, "one of " + ", ".join(f'"{name}"' for name in choices), value, meant)
    return str(value)


def real_number(field: str, value: object) -> float:
    """Return a number as a float; its range, and whether it may be infinite, are for the caller to judge.

    Raise a `RuleError` if it is none: "1", True and 1j are not numbers here.
    """
    if isinstance(value, str | bytes | bool | np.bool_ | np.complexfloating) or getattr(value, "shape", ()) != ():
        reject(field, "a number", value)
    try:
        if isinstance(value, complex):
            raise TypeError
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError, RuntimeError):  # the last of torch, of what has gradients
        reject(field, "a number", value)


def number_from_zero(field: str, value: object, *, above: bool = False, finite: bool = False) -> float:
    """Return a number of at least 0 (or above it) as a float, where ``finite`` no infinite one."""
    return float(array_from_zero(field, real_number(field, value), above=above, finite=finite))


def complex_number(field: str, value: object) -> complex:
    """Return a real or complex number as a complex one, finite or not.

    Raise a `RuleError` if it is none: "1" and True are not numbers here.
    """
    if isinstance(value, np.ndarray) and value.shape == ():
        value = value[()]
    if isinstance(value, complex | np.complexfloating):
        return complex(value)
    return complex(real_number(field, value))


def positive_number(field: str, value: object) -> float:
    """Return a finite number greater than 0 as a float."""
    return number_from_zero(field, value, above=True, finite=True)


def real_array(field: str, value: ArrayLike) -> np.ndarray:
    """Return an array of numbers as float64."""
    return _array(field, value, np.float64)


def array_from_zero(field: str, value: ArrayLike, *, above: bool = False, finite: bool = False) -> np.ndarray:
    """Return an array of numbers of at least 0 (or above it) as float64, where ``finite`` none of them infinite."""
    array = real_array(field, value)
    if not ((array > 0) if above else (array >= 0)).all() or (finite and not np.isfinite(array).all()):
        reject(field, ("finite and " if finite else "") + ("above 0" if above else "at least 0"), array)
    return array


def complex_array(field: str, value: ArrayLike) -> np.ndarray:
    """Return an array of real or complex numbers as complex128."""
    return _array(field, value, np.complex128)


def _array(field: str, value: ArrayLike, kind: type[np.inexact]) -> np.ndarray:
    try:
        array = np.asarray(on_host(value))
        lost = array.dtype.kind == "c" and kind is np.float64  # imaginary parts
        if not lost and array.dtype.kind not in "SUmMV":
            return array.astype(kind, copy=False)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # the last of torch, of what has gradients
        reject(field, "an array of numbers", value)
    reject(field, "an array of real numbers" if lost else "an array of numbers", value)


def together(owner: str, **arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return arrays in the one shape to which all of them are broadcast."""
    try:
        return tuple(np.broadcast_arrays(*arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise RuleError(f"{owner} {' and '.join(arrays)} must be of shapes that go together; got {shapes}.") from None


def on_host(value: Any) -> Any:
    """Return a tensor of a device as one of the host, which arrays can be made of; anything else as it is."""
    return value.cpu() if hasattr(value, "cpu") and hasattr(value, "device") else value


def host_tensor(field: str, value: object) -> "Tensor":
    """Return a torch tensor of real numbers on the host; see :func:`real_tensor`."""
    return real_tensor(field, value).cpu()


def real_tensor(field: str, value: object) -> "Tensor":
    """Return a torch tensor of real numbers.

    Raise a `RuleError` if it is something else, or has no numbers because it lies on "meta".
    """
    from torch import Tensor

    if not isinstance(value, Tensor) or value.is_complex() or value.is_meta:
        reject(field, "a torch tensor of real numbers", value)
    return value


def finite_numbers(field: str, value: ArrayLike, dimensions: int | None = None) -> np.ndarray:
    """Return an array of real or complex numbers, all of them finite."""
    try:
        array = np.asarray(on_host(value))
    except (TypeError, ValueError, RuntimeError):
        reject(field, "an array of numbers", value)
    if array.dtype.kind not in "iufc":
        reject(field, "an array of numbers", value)
    if dimensions is not None and array.ndim != dimensions:
        reject(field, f"an array of {dimensions} dimensions", array.shape)
    if not np.isfinite(array).all():
        reject(field, "finite everywhere", array)
    return array.astype(np.float64) if array.dtype == np.float16 else array  # which linear algebra does not know
