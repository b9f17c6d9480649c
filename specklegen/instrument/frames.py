"""Frames of a camera from files: raw counts, neither scaled nor made grey.

A file is decoded by the reader that its name calls for and by no other, and only after its header says that it is small
enough: a small file can hold frames that fill the memory.
"""

from math import prod
from pathlib import Path

import numpy as np

MOST_PIXELS = 2**28
"""Pixels of all frames of a file, at most: a minute of 2048 x 2048 at one a second."""

_LOSSLESS = {1, 5, 8, 32773, 32946, 50000}  # none, LZW, deflate, PackBits, deflate, zstandard
_WITHOUT_CODECS = {1, 8, 32773, 32946}  # that tifffile decodes by itself


def read_frames(path: str | Path) -> np.ndarray:
    """Read raw counts[n, h, w]: a TIFF of one or many pages, PNG, BMP, or an NPY of [h, w] or [n, h, w].

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
        raise ValueError(f"its name ends in none of {', '.join(_READERS)}")
    frames = reader(path)
    if frames.ndim != 3 or frames.dtype.kind not in "buif" or not frames.size:
        raise ValueError(f"it holds {frames.dtype} of the shape {frames.shape}, not frames of grey counts")
    return frames


def _require_small(pixels: int) -> None:
    if pixels > MOST_PIXELS:
        raise ValueError(f"it has {pixels} pixels, more than {MOST_PIXELS}")


def _read_tiff(path: Path) -> np.ndarray:
    from tifffile import TiffFile

    with TiffFile(path) as file:
        pages = [page for page in file.pages]
        shapes = {page.shape for page in pages}
        if len(shapes) != 1 or len(pages[0].shape) != 2:
            raise ValueError(f"its pages have the shapes {sorted(shapes)}, not one of rows and columns")
        compressions = {int(page.compression) for page in pages}
        if not compressions <= _LOSSLESS:
            raise ValueError(f"it is compressed by a method (TIFF number {max(compressions)}) that may lose noise")
        _require_small(len(pages) * prod(pages[0].shape))
        if compressions <= _WITHOUT_CODECS:
            return np.stack([page.asarray() for page in pages])
    return _read_common(path, "TIFF")


def _read_common(path: Path, format: str) -> np.ndarray:
    from PIL import Image, ImageSequence

    with Image.open(path, formats=(format,)) as picture:
        _require_small(picture.width * picture.height * getattr(picture, "n_frames", 1))
        frames = []
        for page in ImageSequence.Iterator(picture):
            if page.mode not in ("1", "L", "F") and not page.mode.startswith("I"):
                raise ValueError(f"it holds colours (mode {page.mode}), not counts of one kind of pixel")
            frames.append(np.array(page))
        return np.stack(frames)


def _read_numpy(path: Path) -> np.ndarray:
    mapped = np.load(path, mmap_mode="r", allow_pickle=False)  # the header; the numbers when they are asked for
    _require_small(prod(mapped.shape))
    return np.array(mapped)[None] if mapped.ndim == 2 else np.array(mapped)


def _read_lossy(path: Path) -> np.ndarray:
    raise ValueError("JPEG is compressed with loss, which takes the noise: let the camera write TIFF, PNG or BMP")


_READERS = {
    ".tif": _read_tiff, ".tiff": _read_tiff, ".png": lambda path: _read_common(path, "PNG"),
    ".bmp": lambda path: _read_common(path, "BMP"), ".npy": _read_numpy, ".jpg": _read_lossy, ".jpeg": _read_lossy,
}  # fmt: skip
