"""Reading pictures and bringing them to the frame of an object.

A picture becomes grey (Rec. 709 luminance), float32, at least 0; its scale does not matter, since every
object is brought to a peak of 1. Resampling averages areas (a triangle as wide as the reduction), so
that nothing is aliased and nothing turns negative.

A file is decoded by the reader that its name calls for and by no other, and only after its header says that it is
small enough: a small file can hold a picture that fills the memory.
"""

from pathlib import Path

import numpy as np

from specklegen.core.file_limits import MOST_PIXELS_OF_PICTURES as MOST_PIXELS
from specklegen.core.file_limits import read_npy, require_small
from specklegen.instrument.tiff import read_tiff, with_plain_mode

_LUMINANCE = np.array([0.2125, 0.7154, 0.0721], dtype=np.float32)


def read_grey(path: Path) -> np.ndarray:
    """Read a picture: float32[h, w], at least 0, somewhere greater than 0.

    Colours become luminance; a transparent pixel counts as dark in proportion; a picture is turned upright as its
    camera noted. Raise a `ValueError` if the file is no single picture of finite values that are at least 0 and not all
    0, or is too large, and an `OSError` if the file cannot be read.
    """
    return _grey(_READERS[path.suffix.lower()](path))


def read_shares(path: Path) -> np.ndarray:
    """Read a grey picture as shares of full scale, float64[h, w]: whole numbers over the largest of their type.

    Errors are those of :func:`read_grey`.
    """
    data = _READERS[path.suffix.lower()](path)
    return _grey(data).astype(np.float64) / (np.iinfo(data.dtype).max if data.dtype.kind in "ui" else 1)


def _read_common(path: Path) -> np.ndarray:
    from PIL import Image, ImageOps

    with Image.open(path, formats=("PNG", "JPEG")) as picture:
        require_small(picture.width * picture.height, MOST_PIXELS)
        return np.asarray(with_plain_mode(ImageOps.exif_transpose(picture)))


def _read_tiff(path: Path) -> np.ndarray:
    pages = read_tiff(path, MOST_PIXELS)
    if len(pages) != 1:
        raise ValueError(f"it has {len(pages)} pages, not one grey or colour picture")
    return pages[0]


def _read_numpy(path: Path) -> np.ndarray:
    return read_npy(path, MOST_PIXELS, colours=True)


_READERS = {
    ".png": _read_common, ".jpg": _read_common, ".jpeg": _read_common, ".tif": _read_tiff, ".tiff": _read_tiff,
    ".npy": _read_numpy,
}  # fmt: skip


def _grey(data: np.ndarray) -> np.ndarray:
    if data.dtype.kind not in "buif":
        raise ValueError(f"its values are {data.dtype}, not real numbers")
    picture = data.astype(np.float32)
    if picture.ndim == 3 and picture.shape[2] in (2, 4):
        opacity = picture[:, :, -1] / (np.iinfo(data.dtype).max if data.dtype.kind in "ui" else 1)
        picture = picture[:, :, :-1] * opacity[:, :, None]
    if picture.ndim == 3 and picture.shape[2] in (1, 3):
        picture = picture @ _LUMINANCE if picture.shape[2] == 3 else picture[:, :, 0]
    if picture.ndim != 2 or picture.size == 0:
        raise ValueError(f"it has the shape {data.shape}, not one grey or colour picture")
    if not np.isfinite(picture).all() or picture.min() < 0:
        raise ValueError("it holds values that are negative or not finite")
    if picture.max() == 0:
        raise ValueError("all of its pixels are black")
    return picture


SUFFIXES = tuple(_READERS)

Box = tuple[float, float, float, float]


def resampled(picture: np.ndarray, box: Box, shape: tuple[int, int]) -> np.ndarray:
    """Resample the part ``box`` = (left, top, right, bottom) of a picture to ``shape``: float32[h, w]."""
    from PIL import Image

    size = (shape[1], shape[0])
    return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.BILINEAR, box=box))


def fitted(picture: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Bring a whole picture into a frame, its aspect kept, centred, dark around it: float32[h, w]."""
    rows, columns = picture.shape
    scale = min(shape[0] / rows, shape[1] / columns)
    inner = (max(1, round(rows * scale)), max(1, round(columns * scale)))
    frame = np.zeros(shape, dtype=np.float32)
    top, left = (shape[0] - inner[0]) // 2, (shape[1] - inner[1]) // 2
    frame[top : top + inner[0], left : left + inner[1]] = resampled(picture, (0, 0, columns, rows), inner)
    return frame
