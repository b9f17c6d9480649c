"""Frames in files that hold arrays by name: HDF5, and MATLAB's of every version.

MATLAB keeps the frames of a stack along its last axis, HDF5 and NumPy along the first. A file's table of contents is
read before any number is, and says whether it is small enough.
"""

from collections.abc import Mapping
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from specklegen.core.file_limits import LARGEST_CHUNK, MOST_PIXELS

_NUMERIC = {"double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}


def read_hdf5(path: Path, variable: str | None) -> np.ndarray:
    """Read frames[n, h, w] from a data set [h, w] or [n, h, w] of an HDF5 file.

    Raise a `ValueError` if there is no such data set, more than one without a name, or too much in it, and an
    `ImportError` if h5py is not installed.
    """
    with _opened(path) as file:
        return _frames(_read(_sets(file), variable), first=True)


def read_matlab(path: Path, variable: str | None) -> np.ndarray:
    """Read frames[n, h, w] from a variable [h, w] or [h, w, n] of a MATLAB file; errors as of :func:`read_hdf5`."""
    with path.open("rb") as file:
        newest = file.read(10) == b"MATLAB 7.3"
    if newest:
        with _opened(path) as file:  # as HDF5, with every axis in the opposite order
            return _frames(_read(_sets(file), variable).T, first=False)
    from scipy.io import loadmat, whosmat

    shapes = {name: shape for name, shape, kind in whosmat(path) if kind in _NUMERIC}
    chosen = _chosen(shapes, variable)
    return _frames(np.asarray(loadmat(path, variable_names=[chosen])[chosen]), first=False)


def _opened(path: Path) -> Any:
    try:
        import h5py  # type: ignore[import-not-found]
    except ImportError:
        raise ImportError(f'{path} needs h5py: pip install "specklegen-torch[hdf5]"', name="h5py") from None
    return h5py.File(path, "r")


def _sets(file: Any) -> dict[str, Any]:
    """Data sets of numbers by name; those that lie in other files are left out."""
    sets: dict[str, Any] = {}

    def add(name: str, item: Any) -> None:
        kind = item.attrs.get("MATLAB_class")
        text = kind.decode() if isinstance(kind, bytes) else kind
        if getattr(item, "dtype", None) is not None and not name.startswith("#") and text in (None, *_NUMERIC):
            if item.dtype.kind in "buif" and not item.external and not item.is_virtual:
                sets[name] = item

    file.visititems(add)
    return sets


def _read(sets: Mapping[str, Any], variable: str | None) -> np.ndarray:
    chosen = sets[_chosen({name: item.shape for name, item in sets.items()}, variable)]
    if prod(chosen.chunks or ()) * chosen.dtype.itemsize > LARGEST_CHUNK:
        raise ValueError(f"its chunks of {chosen.chunks} decompress to more than {LARGEST_CHUNK // 2**20} MiB each")
    return np.asarray(chosen[()])


def _chosen(shapes: Mapping[str, tuple[int, ...]], variable: str | None) -> str:
    """Name of the array to read: the one that is asked for, or the only one that can be frames."""
    fit = {name: shape for name, shape in shapes.items() if len(shape) in (2, 3) and min(shape) > 0 and max(shape) > 1}
    fit = {name: shape for name, shape in fit.items() if min(sorted(shape)[-2:]) > 1}  # no scalar and no list
    names = ", ".join(f"{name} {' x '.join(map(str, shape))}" for name, shape in list(fit.items())[:8])
    if variable is None:
        if len(fit) != 1:
            there = ", ".join(f"{name} {' x '.join(map(str, shape))}" for name, shape in list(shapes.items())[:8])
            none = f"it holds no frames [h, w] or [n, h, w]: {there or 'no numbers'}"
            raise ValueError(f"choose one array by variable=: it has {names}" if fit else none)
        variable = next(iter(fit))
    if variable not in fit:
        raise ValueError(f'it has no frames named "{variable}"' + (f", but {names}" if fit else ""))
    if prod(fit[variable]) > MOST_PIXELS:
        raise ValueError(f"it has {prod(fit[variable])} pixels, more than {MOST_PIXELS}")
    return variable


def _frames(array: np.ndarray, first: bool) -> np.ndarray:
    if array.ndim == 2:
        return array[None]
    return array if first else np.ascontiguousarray(np.moveaxis(array, -1, 0))
