"""Frames from films of lossless codecs by FFmpeg (PyAV, extra ``video``), and from SPE files of spectroscopy cameras.

The header says codec, type of pixel and size before any frame is decoded, and frames of a film are counted while they
come: its header may not say how many there are.
"""

from math import prod
from pathlib import Path

import numpy as np

from specklegen.core.file_limits import require_small

_LOSSLESS = {"rawvideo", "ffv1", "huffyuv", "ffvhuff", "utvideo", "png", "magicyuv", "zlib"}
_CONTAINERS = {".avi": "avi", ".mkv": "matroska", ".mov": "mov"}
"""The one reader of a container that a name calls for: among all of FFmpeg's are some that read other files."""
_GREY = ("gray", "gray10le", "gray12le", "gray16le")
_THREE_TIMES = ("pal8", "bgr24", "rgb24", "bgr0", "rgb0", "bgra", "rgba", "gbrp")
"""Types of pixel in which programs store grey frames as three equal colours."""
_SPE_HEADER = np.dtype({"names": ["columns", "kind", "rows", "frames"], "formats": ["<u2", "<i2", "<u2", "<i4"],
                        "offsets": [42, 108, 656, 1446], "itemsize": 4100})  # fmt: skip
_SPE_KINDS = {0: "<f4", 1: "<i4", 2: "<i2", 3: "<u2", 5: "<f8", 6: "u1", 8: "<u4"}


def read_video(path: Path, most_pixels: int) -> np.ndarray:
    """Read the frames[n, h, w] of a film.

    Raise a `ValueError` if it is compressed with loss, holds colours, or is too large, an `OSError` if it cannot be
    read, and an `ImportError` if PyAV is not installed.
    """
    try:
        import av  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ImportError(f'{path} needs PyAV: pip install "specklegen-torch[video]"', name="av") from None
    frames: list[np.ndarray] = []
    with av.open(str(path.absolute()), format=_CONTAINERS[path.suffix.lower()]) as film:
        films = list(film.streams.video)
        if not films:
            raise ValueError("it holds no frames")
        if len(films) > 1:
            raise ValueError(f"it holds {len(films)} films: write each to a file of its own")
        context = films[0].codec_context
        codec, pixels, size = context.name, str(context.pix_fmt), context.width * context.height
        if codec not in _LOSSLESS:
            raise ValueError(f"its codec {codec} is lossy, which changes the noise: save raw or FFV1 films, "
                             "TIFF, PNG or BMP")
        require_small(size, most_pixels)
        for frame in film.decode(video=0):
            grey = frame.to_ndarray() if pixels in _GREY else _of_equal_colours(frame, pixels)
            frames.append(grey)
            require_small(size * len(frames), most_pixels)
    if not frames:
        raise ValueError("it holds no frames")
    return np.stack(frames)


def _of_equal_colours(frame, pixels: str) -> np.ndarray:
    colours = frame.to_ndarray(format="rgb24") if pixels in _THREE_TIMES else None
    if colours is None or (colours != colours[..., :1]).any():
        raise ValueError(f"it holds colours ({pixels}), not counts of one kind of pixel")
    return colours[..., 0]


def read_spe(path: Path, most_pixels: int) -> np.ndarray:
    """Read the frames[n, h, w] of an SPE file.

    Raise a `ValueError` if it is shorter than its header says, or too large, and an `OSError` if it cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_SPE_HEADER.itemsize)
        if len(head) < _SPE_HEADER.itemsize:
            raise ValueError("it is shorter than the header of an SPE file")
        columns, kind, rows, frames = np.frombuffer(head, _SPE_HEADER)[0].item()
        if kind not in _SPE_KINDS or min(columns, rows, frames) < 1:
            raise ValueError(f"its header states {frames} frames of {rows} x {columns} of the type {kind}")
        shape = frames, rows, columns
        require_small(prod(shape), most_pixels)
        dtype = np.dtype(_SPE_KINDS[kind])
        data = file.read(prod(shape) * dtype.itemsize)
    if len(data) < prod(shape) * dtype.itemsize:
        raise ValueError(f"it is shorter than the {frames} frames that its header states")
    return np.frombuffer(data, dtype).reshape(shape).astype(dtype.newbyteorder("="))
