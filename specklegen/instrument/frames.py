"""Frames of a camera from files: raw counts, neither scaled nor made grey.

A file is decoded by the reader that its name calls for and by no other, and only after its header says that it is small
enough: a small file can hold frames that fill the memory.
"""

from pathlib import Path

import numpy as np

from specklegen.core.file_limits import MOST_PIXELS, read_npy, require_small
from specklegen.instrument.tiff import read_tiff
from specklegen.instrument.videos import read_spe, read_video


def read_frames(path: str | Path) -> np.ndarray:
    """Read raw counts[n, h, w]: a TIFF of one or many pages or planes, PNG, BMP, or an NPY of [h, w] or [n, h, w].

    Also SPE files, and with the extra ``video`` films without loss (AVI, MKV, MOV; raw, FFV1, HuffYUV).

    Parameters
    ----------
    path
        Of the file, whose suffix says what it is.

    Raises
    ------
    ValueError
        If the file holds no grey frames, is compressed with loss, or is too large.
    OSError
        If it cannot be read.
    ImportError
        If it needs a library that is not installed.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from specklegen.instrument import read_frames
    >>> with tempfile.NamedTemporaryFile(suffix=".npy") as file:
    ...     np.save(file, np.zeros((8, 20, 30), np.uint16))
    ...     _ = file.seek(0)
    ...     print(read_frames(file.name).shape)
    (8, 20, 30)
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise ValueError(f"its file type is none of {', '.join(SUFFIXES)}")
    frames = reader(path)
    if frames.ndim != 3 or frames.dtype.kind not in "buif" or not frames.size:
        there = f"{frames.dtype} of the shape {frames.shape}"
        raise ValueError(f"it holds {there}, not frames of grey counts [h, w] or [n, h, w]")
    return frames


def _read_tiff(path: Path) -> np.ndarray:
    return read_tiff(path, MOST_PIXELS, lossless=True)


def _read_common(path: Path, format: str) -> np.ndarray:
    from PIL import Image, ImageSequence

    with Image.open(path, formats=(format,)) as picture:
        require_small(picture.width * picture.height * getattr(picture, "n_frames", 1), MOST_PIXELS)
        frames = []
        for page in ImageSequence.Iterator(picture):
            if page.mode not in ("1", "L", "F") and not page.mode.startswith("I"):
                raise ValueError(f"it holds colours (mode {page.mode}), not counts of one kind of pixel")
            frames.append(np.array(page))
        return np.stack(frames)


def _read_numpy(path: Path) -> np.ndarray:
    array = read_npy(path, MOST_PIXELS)
    return array[None] if array.ndim == 2 else array


def _read_lossy(path: Path) -> np.ndarray:
    raise ValueError("its compression is lossy, which changes the noise: save TIFF, PNG or BMP")


def _read_video(path: Path) -> np.ndarray:
    return read_video(path, MOST_PIXELS)


_READERS = {
    ".tif": _read_tiff, ".tiff": _read_tiff, ".png": lambda path: _read_common(path, "PNG"),
    ".bmp": lambda path: _read_common(path, "BMP"), ".npy": _read_numpy, ".jpg": _read_lossy, ".jpeg": _read_lossy,
    ".mp4": _read_lossy, ".avi": _read_video, ".mkv": _read_video, ".mov": _read_video,
    ".spe": lambda path: read_spe(path, MOST_PIXELS),
}  # fmt: skip
SUFFIXES = tuple(suffix for suffix, reader in _READERS.items() if reader is not _read_lossy)
"""Endings of the names of files that are read."""
KNOWN = tuple(_READERS)
"""These, and those that are refused with a reason."""
