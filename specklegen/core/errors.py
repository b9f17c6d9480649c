"""Errors and warnings, and the one place that words them.

An error reads ``Owner.field must be RULE; got VALUE.`` and then the remedy, if there is one.
"""

import sys
import warnings
from typing import NoReturn

import numpy as np

_INNER = ("specklegen", "contextlib", "pydantic")
"""Packages between a user's line and where a warning arises: this one, decorators (the shield), checked values."""


class ToldError(Exception):
    """An error whose message says all that a user needs; the command line prints it without a traceback."""


class RuleError(ToldError, ValueError):
    """A value that breaks a rule; the message names the field, the rule, the value and the remedy.

    Parameters
    ----------
    message
        What is said, in the words of a program: ``Material.g must be ...``.
    in_tables
        The same in the words of a file, ``material.g must be ...``, where that differs; by default the message.

    Examples
    --------
    >>> import specklegen as sg
    >>> try:
    ...     sg.media.HenyeyGreenstein(1.5)
    ... except sg.RuleError as error:
    ...     print(str(error).partition(";")[0])
    HenyeyGreenstein.g must be between -1 and 1, both excluded
    """

    def __init__(self, message: str, in_tables: str | None = None) -> None:
        super().__init__(message)
        self.in_tables = message if in_tables is None else in_tables
        """The message in the words of a file: ``material.g`` of its tables, where ``Material.g`` names a class."""


def reject(field: str, rule: str, value: object, remedy: str = "", in_tables: str = "") -> NoReturn:
    """Raise the house error: ``field must be rule; got value.`` and then the remedy.

    ``in_tables`` is the field's name in a file, where that is another.
    """
    text = f"must be {rule}; got {shown(value)}." + (f" {remedy}" if remedy else "")
    raise RuleError(f"{field} {text}", f"{in_tables or field} {text}")


def shown(value: object) -> str:
    """Write a value in one short line for an error message."""
    try:
        text = np.array2string(value, threshold=6) if isinstance(value, np.ndarray) else repr(value)
    except (ValueError, RecursionError):  # whole numbers of thousands of digits, lists in lists without end
        text = f"<{type(value).__name__} too long to show>"
    text = " ".join(text.split())
    return text if len(text) <= 120 else text[:117] + "..."


def counted(number: int, thing: str) -> str:
    """Write a number with its noun: "1 shard", "2 shards"."""
    return f"{number} {thing}" + ("" if number == 1 else "s")


class DoubtWarning(UserWarning):
    """The model is applied where what it assumes is doubtful; results are finite, but may not be physical.

    Examples
    --------
    >>> import warnings
    >>> import specklegen as sg
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", sg.DoubtWarning)  # stop where there is doubt
    ...     slab = sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=sg.media.Isotropic())
    """


def warn_user(text: str) -> None:
    """Issue a :class:`DoubtWarning` that points at the line outside this package from which all was called."""
    # Counted, not written down: decorators and helpers add frames.
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] in _INNER:
        level, frame = level + 1, frame.f_back
    warnings.warn(text, DoubtWarning, stacklevel=level)
