"""Exporting samples from a store to files that other programs read: npy arrays, PNG pictures, Parquet."""

import csv
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from specklegen.core.arguments import whole_number
from specklegen.core.display.escape import csv_cell
from specklegen.core.errors import reject
from specklegen.datasets.loading.cache import SpeckleCache
from specklegen.datasets.loading.parquet import write_parquet


def export(
    folder: str | os.PathLike, out: str | os.PathLike, format: Literal["npy", "png", "parquet"] = "npy",
    samples: Sequence[int] | None = None,
) -> list[Path]:  # fmt: skip
    """Write samples of a store as files, with a table of their indices, seed and parameters.

    "npy" writes one array a key, ``<key>.npy``, with the samples along the first axis. "png" writes one picture a
    sample and key with at least two axes, ``<key>_<index>.png``: counts as 16 bits, unchanged; other arrays as 16 bits
    from the picture's least to its greatest value, which the table gives. Frames of a stack stand side by side.
    "parquet" writes a data set for the Hugging Face hub; see :mod:`specklegen.datasets.loading.parquet`. All write
    ``samples.csv``. Raise a `RuleError` if the format is unknown or there is nothing to write and a `MissingSample` if
    a sample has not been generated.

    Parameters
    ----------
    folder, out : path
        The store, and the folder to write to.
    format : {"npy", "png", "parquet"}
        Kind of files.
    samples : sequence of int, optional
        Which samples; by default all.

    Returns
    -------
    list of Path
        The files written.
    """
    cache = SpeckleCache(folder)
    chosen = list(range(len(cache))) if samples is None else _there(samples, len(cache))
    if format not in _WRITERS:
        reject("export.format", f"one of {', '.join(map(repr, _WRITERS))}", format)
    if not chosen:
        reject("export.samples", "at least one sample", samples)
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    files, columns = _WRITERS[format](cache, chosen, out)
    table = out / "samples.csv"
    with table.open("w", newline="") as handle:
        writer = csv.writer(handle)
        for row, sample in enumerate(chosen):
            values = cache.numpy(sample)
            line = (
                {"index": values["index"], "seed": cache.identity["seed"]}
                | values["parameters"]
                | ({"file_name": csv_cell(values["file"])} if isinstance(values.get("file"), str) else {})
                | columns[row]
            )
            if row == 0:
                writer.writerow([csv_cell(name) for name in line])
            writer.writerow(line.values())
    return [*files, table]


def _there(samples: Sequence[int], length: int) -> list[int]:
    """The samples asked for, each of which has to be in the store; one that is not ends the search."""
    chosen = []
    for sample in samples:
        chosen.append(whole_number("export.samples", sample, 0, length - 1, remedy=f"The store has {length}."))
    return chosen


def _write_npy(cache: SpeckleCache, chosen: list[int], out: Path) -> tuple[list[Path], list[dict]]:
    arrays = {}
    for row, index in enumerate(chosen):
        sample = cache.numpy(index)
        for key in cache.keys:
            if key not in arrays:
                shape = (len(chosen), *sample[key].shape)
                arrays[key] = np.lib.format.open_memmap(out / f"{key}.npy", "w+", sample[key].dtype, shape)
            arrays[key][row] = sample[key]
    for array in arrays.values():
        array.flush()
    return [out / f"{key}.npy" for key in arrays], [{}] * len(chosen)


def _write_png(cache: SpeckleCache, chosen: list[int], out: Path) -> tuple[list[Path], list[dict]]:
    from PIL import Image

    files, columns = [], []
    for index in chosen:
        sample, scales = cache.numpy(index), {}
        for key in cache.keys:
            if sample[key].ndim < 2:
                continue
            picture = _side_by_side(sample[key])
            if picture.dtype != np.uint16:
                least, greatest = float(picture.min()), float(picture.max())
                scales |= {f"{key}_min": least, f"{key}_max": greatest}
                picture = np.rint((picture - least) / ((greatest - least) or 1.0) * 65535).astype(np.uint16)
            files.append(out / f"{key}_{index:06d}.png")
            Image.fromarray(np.ascontiguousarray(picture)).save(files[-1])
        columns.append(scales)
    return files, columns


def _side_by_side(array: np.ndarray) -> np.ndarray:
    """Lay the frames of ``(..., H, W)`` out as one row: ``(H, frames · W)``."""
    frames = np.abs(array) if np.iscomplexobj(array) else array
    frames = frames.reshape(-1, *array.shape[-2:])
    return np.moveaxis(frames, 0, 1).reshape(array.shape[-2], -1)


_WRITERS = {"npy": _write_npy, "png": _write_png, "parquet": write_parquet}
