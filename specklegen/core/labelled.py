"""Results as data: every array with its axes, coordinates and unit, for xarray, NumPy files and tables.

A result names its arrays once (:meth:`Labelled._arrays`); all formats are made here.
"""

import csv
import inspect
import io
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from operator import attrgetter
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, ParamSpec, TypeVar

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.extras import extras_named
from specklegen.core.quantities import mark_of
from specklegen.core.units import WAVELENGTH, quantity
from specklegen.core.whole_files import write_whole

if TYPE_CHECKING:
    import xarray

MOST_ROWS = 5_000_000
"""Rows of a table; more are no longer read as one."""

_META = "specklegen"
ASKED = "_asked"
"""Name under which a result holds its arguments in its ``__dict__``."""
_LONGEST = 10_000  # characters of an attribute

P = ParamSpec("P")
R = TypeVar("R")


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


def recorded(function: Callable[P, R]) -> Callable[P, R]:
    """Let results of a function hold its arguments, for :attr:`Labelled.physics`."""
    signature = cache(lambda: inspect.signature(function))

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        result = function(*args, **kwargs)
        if isinstance(result, Labelled):
            bound = signature().bind(*args, **kwargs)
            bound.apply_defaults()
            vars(result)[ASKED] = bound.arguments
        return result

    return call


class Labelled:
    """Result that can be taken along as data; a subclass names its arrays and its single numbers."""

    def _arrays(self) -> Mapping[str, Labels]:
        """Name arrays, coordinates first."""
        raise NotImplementedError

    _single: ClassVar[Sequence[str]] = ()
    """Attributes that are one number or word for the whole result, as ``report.paths``."""

    def _numbers(self) -> Mapping[str, str | int | float | bool]:
        return {**self.physics, **{name.rpartition(".")[2]: attrgetter(name)(self) for name in self._single}}

    @property
    def physics(self) -> dict[str, str | int | float]:
        """Arguments that it was computed from: medium, wavelength and its unit, mode, view, seed, version and others.

        Media and other values are JSON, or their hash where that is long.
        """
        asked = dict(vars(self).get(ASKED, {}))
        if not asked:
            return {}
        asked |= asked.pop("fields", {})
        budget, scene = asked.pop("budget", None), asked.pop("scene", None)
        asked = {"seed": 0, **({} if budget is None else vars(budget)), **asked}
        if asked.get("view", 0) is None:
            asked["view"] = "axis"
        marks = [mark for each in (scene, *asked.values()) if (mark := mark_of(each)) and mark.metres]
        asked = ({} if scene is None else {name: getattr(scene, name) for name in type(scene).model_fields}) | asked
        metres, wavelength = marks[0].metres if marks else None, asked.get("wavelength")
        if isinstance(wavelength, str) and (read := quantity(wavelength)):
            metres = metres or 1e-6
            asked["wavelength"] = read.number(WAVELENGTH, metres)
        attributes = {name: _attribute(each) for name, each in asked.items() if name not in self._arrays()}
        unit = "length of the scene" if metres is None else "micrometre" if metres == 1e-6 else f"{metres:g} metre"
        told = {"wavelength_unit": unit, "version": sys.modules["specklegen"].__version__}
        return {name: each for name, each in attributes.items() if each is not None} | told

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

    def to_netcdf(self, path: str | PathLike) -> None:
        """Write a NetCDF 3 file, which ``xarray.open_dataset`` reads without this library.

        NetCDF 3 has no complex numbers: such an array becomes two, ``name.real`` and ``name.imag``. It has no whole
        numbers of 64 bits either: a seed that is one is written as a text. The attribute ``mode`` is named
        ``mode_of_views``, for SciPy cannot close a file that has an attribute ``mode``.

        Parameters
        ----------
        path
            Ends in ".nc". A file that is there is replaced.

        Raises
        ------
        ImportError
            Without xarray: ``pip install "specklegen-torch[xarray]"``.
        RuleError
            For another ending.
        OSError
            If it cannot be written.
        """
        file, data = _file("to_netcdf", path, ".nc"), self.to_xarray()
        for name in [str(name) for name, each in data.variables.items() if np.iscomplexobj(each)]:
            for part in ("real", "imag"):
                data[f"{name}.{part}"] = getattr(data[name], part).assign_attrs(data[name].attrs)
            data = data.drop_vars(name)
        data.attrs = {"mode_of_views" if name == "mode" else name: x for name, x in _written(data.attrs).items()}
        write_whole(file, bytes(data.to_netcdf(engine="scipy")))

    def to_hdf5(self, path: str | PathLike) -> None:
        """Write an HDF5 file: a dataset an array, its unit as the attribute ``units``, its axes as labels.

        Single numbers, and the arguments of :attr:`physics`, are attributes of the file.

        Parameters
        ----------
        path
            Ends in ".h5". A file that is there is replaced.

        Raises
        ------
        ImportError
            Without h5py: ``pip install "specklegen-torch[hdf5]"``.
        RuleError
            For another ending.
        OSError
            If it cannot be written.
        """
        file, buffer = _file("to_hdf5", path, ".h5"), io.BytesIO()
        with extras_named():
            import h5py
        with h5py.File(buffer, "w") as target:
            target.attrs.update(_written({**self._numbers(), "result": type(self).__name__}))
            for name, each in self._arrays().items():
                values = each.values.astype(object) if each.values.dtype.kind == "U" else each.values
                data = target.create_dataset(name, data=values)
                data.attrs["units"] = each.unit
                for n, axis in enumerate(each.axes):
                    data.dims[n].label = axis
        write_whole(file, buffer.getvalue())

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

        Lines before it that begin with # say what was computed, as ``# wavelength = 0.5``. pandas skips them with
        ``comment="#"``, NumPy by itself.

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
        text.writelines(f"# {name} = {each}\n" for name, each in self.physics.items())
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
        write_whole(file, text.getvalue().encode())


def _attribute(value: Any) -> str | int | float | None:
    """Return an argument as an attribute of a file; None of what is left out."""
    if isinstance(value, str | int | float):
        return int(value) if isinstance(value, bool) else value
    if hasattr(value, "canonical_json"):
        text = value.canonical_json()
        return text if len(text) <= _LONGEST else f"sha256 {value.fingerprint()}"
    if isinstance(value, list | tuple | np.ndarray):
        text = json.dumps(np.asarray(value).tolist(), default=str)
        return text if len(text) <= _LONGEST else None
    return getattr(value, "name", None)


def _written(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes that files hold: True as 1, whole numbers of more than 32 bits as texts."""
    numbers = {name: int(x) if isinstance(x, bool) else x for name, x in numbers.items()}
    return {name: str(x) if isinstance(x, int) and abs(x) >= 2**31 else x for name, x in numbers.items()}


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
