"""Results as data: every array with its axes, coordinates and unit, for xarray, NumPy files and tables.

A result names its arrays once (:meth:`Labelled._arrays`); all formats are made here.
"""

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from operator import attrgetter
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.whole_files import write_whole

if TYPE_CHECKING:
    import xarray

MOST_ROWS = 5_000_000
"""Rows of a table; more are no longer read as one."""

_META = "specklegen"


class Labels(NamedTuple):
    """An array of a result.

    Attributes
    ----------
    axes : tuple of str
        Name of each axis.
    values : ndarray
        The array.
    unit : str
        "1" for a plain number, "rad", or in words the unit that the scene decides ("length of the scene").
    coordinate : bool
        Whether it says where the others are, rather than being one of the results.
    """

    axes: tuple[str, ...]
    values: np.ndarray
    unit: str = "1"
    coordinate: bool = False


class Labelled:
    """Result that can be taken along as data; a subclass names its arrays and its single numbers."""

    def _arrays(self) -> Mapping[str, Labels]:
        """Name arrays, coordinates first."""
        raise NotImplementedError

    _single: ClassVar[Sequence[str]] = ()
    """Attributes that are one number or word for the whole result, as ``report.paths``."""

    def _numbers(self) -> Mapping[str, str | int | float | bool]:
        return {name.rpartition(".")[2]: attrgetter(name)(self) for name in self._single}

    def to_xarray(self) -> "xarray.Dataset":
        """Return an xarray.Dataset: arrays with named axes, coordinates, and units as the attribute ``units``.

        Raises
        ------
        ImportError
            Without xarray: ``pip install "specklegen-torch[xarray]"``.
        """
        try:
            import xarray
        except ImportError:
            raise ImportError('to_xarray needs xarray: pip install "specklegen-torch[xarray]"', name="xarray") from None
        data: dict[bool, dict[str, Any]] = {False: {}, True: {}}
        for name, (axes, values, unit, coordinate) in self._arrays().items():
            data[coordinate][name] = (axes, values, {"units": unit})
        return xarray.Dataset(data[False], data[True], {**self._numbers(), "result": type(self).__name__})

    def save(self, path: str | PathLike) -> None:
        """Write a NumPy file of all arrays, which ``numpy.load`` reads without this library.

        Beside the arrays, under their names, it holds the text ``specklegen``: JSON of the result's class, its single
        numbers, and the axes and unit of every array. The file appears whole, or not at all.

        Parameters
        ----------
        path
            Ends in ".npz". A file that is there is replaced.

        Raises
        ------
        RuleError
            For another ending.
        OSError
            If it cannot be written.
        """
        file, arrays = _file("save", path, ".npz"), self._arrays()
        header = {
            "result": type(self).__name__, "numbers": _strict(self._numbers()),
            "arrays": {name: {"axes": each.axes, "unit": each.unit, "coordinate": each.coordinate}
                       for name, each in arrays.items()},
        }  # fmt: skip
        text = json.dumps(header, allow_nan=False)
        buffer, held = io.BytesIO(), {name: each.values for name, each in arrays.items()} | {_META: np.array(text)}
        np.savez(buffer, **held)  # type: ignore[arg-type]
        write_whole(file, buffer.getvalue())

    def to_csv(self, path: str | PathLike) -> None:
        """Write a table: one row for each element, coordinates first, units in brackets behind the names.

        Complex values take two columns, ``name.real`` and ``name.imag``. Numbers are written so that they are read back
        to the bit; what is undefined is an empty cell. Axes without a coordinate of their name are counted from 0.

        Parameters
        ----------
        path
            Ends in ".csv". A file that is there is replaced.

        Raises
        ------
        RuleError
            For another ending, or more than five million rows.
        OSError
            If it cannot be written.
        """
        file, arrays = _file("to_csv", path, ".csv"), self._arrays()
        shape = _shape(arrays)
        rows = math.prod(shape.values())
        if rows > MOST_ROWS:
            reject(f"{type(self).__name__}.to_csv", f"of at most {MOST_ROWS} rows", f"{rows} rows", "Use .save().")
        columns: dict[str, list[str]] = {}
        for axis, length in shape.items():
            if axis not in arrays:
                columns[axis] = _cells(_spread(Labels((axis,), np.arange(length)), shape))
        for name, each in arrays.items():
            values, unit = _spread(each, shape), "" if each.unit == "1" else f" [{each.unit}]"
            if np.iscomplexobj(values):
                columns[f"{name}.real{unit}"], columns[f"{name}.imag{unit}"] = _cells(values.real), _cells(values.imag)
            else:
                columns[name + unit] = _cells(values)
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
        write_whole(file, text.getvalue().encode())


def _file(verb: str, path: str | PathLike, suffix: str) -> Path:
    if not isinstance(path, str | PathLike) or Path(fspath(path)).suffix != suffix:
        reject(f"{verb} path", f"the path of a file that ends in {suffix}", path)
    return Path(path)


def _strict(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Replace what JSON has no word for (NaN, infinity) by None."""
    return {name: None if isinstance(x, float) and not math.isfinite(x) else x for name, x in numbers.items()}


def _shape(arrays: Mapping[str, Labels]) -> dict[str, int]:
    """Length of every axis, in the order of the largest array."""
    ordered = sorted(arrays.values(), key=lambda each: -len(each.axes))
    return {axis: n for each in ordered for axis, n in zip(each.axes, each.values.shape, strict=True)}


def _spread(each: Labels, shape: Mapping[str, int]) -> np.ndarray:
    """Repeat values along the axes that they do not have; flat."""
    order = [each.axes.index(axis) for axis in shape if axis in each.axes]
    own = tuple(n if axis in each.axes else 1 for axis, n in shape.items())
    return np.broadcast_to(each.values.transpose(order).reshape(own), tuple(shape.values())).ravel()


def _cells(values: np.ndarray) -> list[str]:
    if values.dtype.kind == "f":
        return ["" if math.isnan(x) else repr(x) for x in values.tolist()]
    return [str(x) for x in values.tolist()]
