"""TIFF files of frames and of pictures: sizes are read from headers first, and pages come as they were written."""

from math import prod
from pathlib import Path

import numpy as np

from specklegen.core.file_limits import require_small

_LOSSLESS = {1, 5, 8, 32773, 32946, 50000}  # none, LZW, deflate, PackBits, deflate, zstandard
_WITHOUT_CODECS = {1, 8, 32773, 32946}  # that tifffile decodes by itself
_PALETTE = 3
_PLAIN_MODES = ("1", "L", "LA", "RGB", "RGBA")


def read_tiff(path: Path, most_pixels: int, lossless: bool = False) -> np.ndarray:
    """Read all pages of a TIFF file: real[n, h, w], or [n, h, w, samples] of colours.

    Planes that are stored apart are pages: tifffile writes three or four frames that way by default. Raise a
    `ValueError` if pages differ in shape, or are compressed with loss or too large, and an `OSError` if the file cannot
    be read.

    Parameters
    ----------
    path
        Of the file. Other files that its metadata name are not read.
    most_pixels
        Pixels of all pages, at most.
    lossless
        Refuse a compression that may lose noise.
    """
    from tifffile import TiffFile

    with TiffFile(path, is_ome=False) as file:
        series = file.series
        shapes = {each.shape[-3 if each.axes.endswith("S") else -2 :] for each in series}
        types = {str(each.dtype) for each in series}
        if len(shapes) != 1 or len(types) != 1:
            raise ValueError(f"its pages have the shapes {sorted(shapes)} and the types {sorted(types)}, not one of "
                             "each: save each measurement to its own file")  # fmt: skip
        compressions = {int(each.keyframe.compression) for each in series}
        if lossless and not compressions <= _LOSSLESS:
            raise ValueError(f"its compression (TIFF number {max(compressions)}) may be lossy: save without "
                             "compression")
        shape = shapes.pop()
        pages = sum(prod(each.shape) for each in series) // prod(shape)
        require_small(pages * prod(shape[:2]), most_pixels)
        if compressions <= _WITHOUT_CODECS and all(each.keyframe.photometric != _PALETTE for each in series):
            return np.concatenate([each.asarray().reshape(-1, *shape) for each in series])
    return _by_pillow(path)


def _by_pillow(path: Path) -> np.ndarray:
    """Read pages that tifffile has no codec for, and pages of a palette, whose colours Pillow looks up."""
    from PIL import Image, ImageSequence

    with Image.open(path, formats=("TIFF",)) as picture:
        return np.stack([np.array(with_plain_mode(page)) for page in ImageSequence.Iterator(picture)])


def with_plain_mode(page):
    """Return an image of Pillow whose numbers are grey or colours: a palette is looked up."""
    if page.mode in _PLAIN_MODES or page.mode.startswith(("I", "F")):
        return page
    return page.convert("RGBA" if page.has_transparency_data else "RGB")
