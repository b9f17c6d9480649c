"""Raw frames from what a user names: an array, a file, a folder, a pattern, or several of them."""

import glob
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import on_host
from specklegen.core.errors import RuleError, counted, reject
from specklegen.core.file_limits import MOST_PIXELS
from specklegen.instrument.frames import KNOWN, SUFFIXES, read_frames
from specklegen.measured.array_files import read_hdf5, read_matlab

Source = str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | ArrayLike
"""Files by path, folder or pattern, several of them, or an array [h, w] or [n, h, w]."""

_ARRAY_FILES = {".h5": read_hdf5, ".hdf5": read_hdf5, ".mat": read_matlab}
FRAME_FILES = (*SUFFIXES, *_ARRAY_FILES)
"""Endings of the files that are taken from a folder."""

LARGEST = 1e18
"""Largest number of a pixel; of a larger one no sum of squares could be trusted."""


class Raw(NamedTuple):
    """Raw numbers[n, h, w] as they were written, the files that they came from, and what was left out."""

    frames: np.ndarray
    files: tuple[str, ...]
    notes: tuple[str, ...]


def read_raw(field: str, source: Source, variable: str | None = None) -> Raw:
    """Read the frames of a source, in the order of the files' names, numbers in them by value.

    Raise a `RuleError` if there is no file, or one cannot be read, or holds no grey frames, or frames of another size.
    Raise an `ImportError` if a file needs a library that is not installed.
    """
    if isinstance(source, str | os.PathLike):
        named: list[str | os.PathLike[str]] = [source]
    elif isinstance(source, list | tuple) and source and all(isinstance(each, str | os.PathLike) for each in source):
        named = [each for each in source if isinstance(each, str | os.PathLike)]
    else:
        return Raw(_in_range(field, _array(field, source)), (), ())
    notes: list[str] = []
    files = [file for each in named for file in _files(field, os.fspath(each), notes)]
    frames: list[np.ndarray] = []
    unreadable: list[RuleError] = []
    for file in files:
        try:
            stack = _read(field, file, variable)
        except RuleError as error:
            unreadable.append(error)
            continue
        if frames and stack.shape[1:] != frames[0].shape[1:]:
            shapes = f"{frames[0].shape[1:]} in {files[0]} and {stack.shape[1:]} in {file}"
            reject(field, "frames of one size", shapes,
                   "Give the files of one measurement by a pattern, such as folder/light_*.tif.")
        frames.append(stack)
        if sum(each.size for each in frames) > MOST_PIXELS:
            reject(field, f"of at most {MOST_PIXELS} pixels in all", str(file), "Read fewer frames at a time.")
    if len(unreadable) > 1:
        raise RuleError("\n".join(map(str, unreadable)))
    if unreadable:
        raise unreadable[0]
    return Raw(_in_range(field, np.concatenate(frames)), tuple(map(str, files)), tuple(notes))


def _files(field: str, name: str, notes: list[str]) -> list[Path]:
    """Files of one path, folder or pattern, in order."""
    path = Path(name)
    try:
        if path.is_dir():
            inside = [each for each in path.iterdir() if each.is_file() and not each.name.startswith(".")]
            paths = [each for each in inside if each.suffix.lower() in FRAME_FILES]
            if paths and len(paths) < len(inside):
                notes.append(
                    f"{counted(len(inside) - len(paths), 'file')} of {path} left out, since their file type is unknown"
                )
        else:
            paths = [path] if path.exists() else [Path(each) for each in glob.glob(name)]
    except (OSError, ValueError, re.error) as error:  # names too long, or with a zero in them
        reject(field, "an existing file, folder or pattern of frames", name, f"{error}.")
    if not paths:
        remedy = f"A folder holds frames as {', '.join(FRAME_FILES)}." if path.is_dir() else "Check the path."
        reject(field, "an existing file, folder or pattern of frames", name, remedy)
    return sorted(paths, key=lambda file: [int(p) if p.isdecimal() else p for p in re.split(r"(\d+)", str(file))])


def _read(field: str, file: Path, variable: str | None) -> np.ndarray:
    suffix = file.suffix.lower()
    reader = _ARRAY_FILES.get(suffix)
    if reader is None and suffix not in KNOWN:
        reject(field, f"files whose names end in {', '.join(FRAME_FILES)}", str(file))
    try:
        frames = read_frames(file) if reader is None else reader(file, variable)
    except ImportError:
        raise
    except Exception as error:  # each reader has errors of its own kind
        reject(field, "files of frames that can be read", str(file),
               f"Reading the file failed: {str(error) or repr(error)}.")
    if frames.ndim != 3 or frames.dtype.kind not in "buif" or not frames.size:
        reject(field, "files of grey frames", str(file), f"The file has {frames.dtype} of shape {frames.shape}.")
    return frames


def _in_range(field: str, frames: np.ndarray) -> np.ndarray:
    """Frames whose sums and squares are finite, where they are."""
    if frames.dtype.kind == "f":
        largest = float(np.abs(frames, where=np.isfinite(frames), out=np.zeros_like(frames)).max())
        if largest > LARGEST:
            reject(field, f"of numbers of at most {LARGEST:g}", largest, "Check the type of the file.")
    return frames


def _array(field: str, source: object) -> np.ndarray:
    try:
        array = np.asarray(on_host(source))
    except (TypeError, ValueError, OverflowError, RuntimeError):  # the last of torch, of what has gradients
        reject(field, "files, or an array of numbers", type(source).__name__)
    if array.dtype.kind not in "buif" or array.ndim not in (2, 3) or not array.size:
        reject(field, "files, or an array of real numbers [h, w] or [n, h, w]", f"{array.dtype} of {array.shape}")
    return array[None] if array.ndim == 2 else array
