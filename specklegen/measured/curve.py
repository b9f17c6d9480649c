"""Measured curves from text: a correlation over tilts, shifts or lags, with its errors where there are any."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from specklegen.core.arguments import whole_number
from specklegen.core.display.plot import Pictured, draw_curve
from specklegen.core.errors import reject
from specklegen.core.file_limits import LARGEST_CURVE as MOST_BYTES


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredCurve(Pictured):
    """A curve that was measured at some places.

    Attributes
    ----------
    at, values : ndarray
        float64[n]; ``at`` rises.
    errors : ndarray or None
        Standard errors of the values, float64[n]; None where the file has none.
    names : tuple of str
        Heads of the columns, as the file has them; empty without.
    file : str
    lines : tuple of int
        Where each value stands in the file, from 1; empty where nothing was read.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.measured import MeasuredCurve
    >>> MeasuredCurve(np.array([0.0, 1.0]), np.array([1.0, 0.5]), None, ("lag", "g2"), "curve.csv")
    MeasuredCurve(2 values from 0 to 1)
    """

    at: np.ndarray
    values: np.ndarray
    errors: np.ndarray | None
    names: tuple[str, ...]
    file: str
    lines: tuple[int, ...] = ()

    _named = {"file": "file", "columns": "names", "at": "at", "values": "values", "standard errors": "errors"}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        xlabel, ylabel, *_ = *self.names, "", ""
        draw_curve(axes, self.at, self.values, self.errors, label, fmt="o", xlabel=xlabel, ylabel=ylabel)


OWN_FILE = "If a second measurement begins here, put it into its own file."
"""What to do with a file of several measurements, where a table cannot go on."""


def read_curve(path: str | Path, columns: Sequence[int] | None = None) -> MeasuredCurve:
    r"""Read a measured curve from a text of columns: where, value, and standard error if there is a third.

    Columns stand apart by commas, semicolons, tabs or spaces; lines that begin with # and empty ones are passed over,
    and so is one line of names before the first number.

    Parameters
    ----------
    path
        The file, in UTF-8.
    columns
        Numbers of the two or three columns, from 0; by default the first ones.

    Raises
    ------
    RuleError
        If the file cannot be read; or a line has too few columns, something that is no finite number, a place that is
        not above the one before, or an error that is not above 0. The line is named.

    Examples
    --------
    >>> import tempfile
    >>> from specklegen.measured import read_curve
    >>> with tempfile.NamedTemporaryFile("w", suffix=".csv") as file:
    ...     _ = file.write("tilt,C_I,error\n0.0,1.0,0.01\n0.5,0.61,0.02\n1.0,0.12,0.02\n")
    ...     file.flush()
    ...     curve = read_curve(file.name)
    >>> curve, curve.names, curve.errors.tolist()
    (MeasuredCurve(3 values from 0 to 1), ('tilt', 'C_I', 'error'), [0.01, 0.02, 0.02])
    """
    chosen = _columns(columns)
    names: tuple[str, ...] = ()
    rows: list[list[float]] = []
    lines: list[int] = []
    separator: str | None = None
    for number, line in enumerate(text_of("read_curve path", path).splitlines(), 1):
        text = line.strip().lstrip("\ufeff")
        if not text or text.startswith("#"):
            continue
        if not rows and separator is None:
            separator = next((each for each in (";", "\t", ",") if each in text), " ")
        where = f"read_curve {path}, line {number},"
        cells = [cell.strip() for cell in (re.split(r"\s+", text) if separator == " " else text.split(separator))]
        if not rows and not names and not any(map(_is_number, cells)):
            names = tuple(cell.strip('"') for cell in cells)
            separator = None if separator == " " else separator  # names may have spaces of their own
            continue
        if not chosen and not rows and len(cells) > 3:
            reject(where, "of two or three columns, or of more with columns=", line.strip(),
                   "For two measurements in a file read columns=(0, 1) and columns=(0, 2).")  # fmt: skip
        taken = chosen or tuple(range(min(3, len(cells))) if not rows else range(len(rows[0])))
        if max(taken) >= len(cells) or len(taken) < 2:
            reject(where, f"of at least {max(2, max(taken) + 1)} columns", line.strip(),
                   "Separate columns by , ; or a tab.")  # fmt: skip
        row = [_number(where, cells[column]) for column in taken]
        if rows and not row[0] > rows[-1][0]:
            reject(where, f"of increasing places: the line before has {rows[-1][0]:g}", row[0],
                   f"Sort the lines and average repeated places. {OWN_FILE}")  # fmt: skip
        if len(row) == 3 and not row[2] > 0:
            reject(where, "of a standard error greater than 0", row[2], "Leave the column out by columns=(0, 1).")
        rows.append(row)
        lines.append(number)
    if len(rows) < 2:
        reject(f"read_curve {path}", "of at least two lines of numbers", len(rows))
    table = np.array(rows).T
    kept = tuple(names[column] for column in chosen or range(len(table)) if column < len(names))
    return MeasuredCurve(table[0], table[1], table[2] if len(table) == 3 else None, kept, str(path), tuple(lines))


def _columns(columns: Sequence[int] | None) -> tuple[int, ...]:
    if columns is None:
        return ()
    if not isinstance(columns, list | tuple | range) or len(columns) not in (2, 3):
        reject("read_curve columns", "two or three numbers of columns", columns)
    return tuple(whole_number("read_curve columns", each) for each in columns)


def text_of(field: str, path: str | Path) -> str:
    """Text of a file in UTF-8 of at most 16 MiB, or refuse it by the name of a field."""
    try:
        with Path(path).open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise ValueError(f"it is longer than {MOST_BYTES} bytes")
        return content.decode("utf-8")
    except (OSError, ValueError, TypeError) as error:
        given = path if isinstance(path, str) else str(path)
        if isinstance(error, FileNotFoundError):
            reject(field, "an existing file", given, "Check the path.")
        reject(field, "a text file that can be read", given, f"It cannot: {error}.")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(where: str, text: str) -> float:
    if not _is_number(text) or not np.isfinite(float(text)):
        remedy = "Write a decimal point." if re.fullmatch(r"[+-]?\d+,\d+", text) else OWN_FILE
        reject(where, "of finite numbers", text, remedy)
    return float(text)
