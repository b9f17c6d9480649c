"""Checking arguments of functions: numbers, arrays and values that are not fields of a :class:`Value`.

A field of a value is checked by its type; what a function takes beside it is checked here, so that a wrong type
reads like any other broken rule.
"""

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.errors import reject

T = TypeVar("T")


def instance(field: str, value: object, kind: type[T]) -> T:
    """Return the value, which has to be of a type.

    Raises
    ------
    RuleError
        If it is not.
    """
    if not isinstance(value, kind):
        reject(field, f"a {kind.__name__}", value)
    return value


def whole_number(field: str, value: object, least: int = 0, most: int | None = None, *, remedy: str = "") -> int:
    """Return a whole number in a range, ends included.

    Raises
    ------
    RuleError
        If it is none: 2.0 and True are not whole numbers here.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        reject(field, "a whole number", value, remedy)
    if value < least or (most is not None and value > most):
        reject(field, f"at least {least}" + ("" if most is None else f" and at most {most}"), value, remedy)
    return int(value)


def real_number(field: str, value: object) -> float:
    """Return a number as a float; its range, and whether it may be infinite, are for the caller to judge.

    Raises
    ------
    RuleError
        If it is none: "1" and True are not numbers here.
    """
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        reject(field, "a number", value)
    if isinstance(value, str | bool):
        reject(field, "a number", value)
    return number


def real_array(field: str, value: ArrayLike) -> np.ndarray:
    """Return an array of numbers as float64.

    Raises
    ------
    RuleError
        If it holds something else.
    """
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        reject(field, "an array of numbers", value)


def finite_numbers(field: str, value: ArrayLike, dimensions: int | None = None) -> np.ndarray:
    """Return an array of real or complex numbers, all of them finite.

    Raises
    ------
    RuleError
        If it holds something else, or has another number of dimensions.
    """
    try:
        array = np.asarray(value)
    except ValueError:
        reject(field, "an array of numbers", value)
    if array.dtype.kind not in "iufc":
        reject(field, "an array of numbers", value)
    if dimensions is not None and array.ndim != dimensions:
        reject(field, f"an array of {dimensions} dimensions", array.shape)
    if not np.isfinite(array).all():
        reject(field, "finite everywhere", array)
    return array
