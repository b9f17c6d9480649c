"""Limits on the decompressed size of a file, for every reader of files that others made.

A reader takes sizes from a header and compares them before it reads, or unpacks, what they are of: a small file can
hold what fills the memory.
"""

from math import prod
from pathlib import Path

import numpy as np

MOST_PIXELS = 2**28
"""Pixels of all frames of a file, at most: a minute of 2048 x 2048 at one a second."""
MOST_PIXELS_OF_PICTURES = 2**26
"""Pixels of a picture of an object, at most."""
LARGEST_CHUNK = 2**28
"""Bytes of a chunk of HDF5, which is unpacked whole, however few of its numbers belong to the data set."""
LARGEST_TEXT = 64 * 2**20
"""Bytes of a table in TOML or JSON, at most."""
DEEPEST = 64
"""Tables and lists inside one another, at most; what reads them recurses."""
LARGEST_CURVE = 2**24
"""Bytes of a measured curve, or of readings, at most."""
LARGEST_MODEL, LARGEST_HEADER = 2 * 2**30, 2**20
"""Bytes of the file of a model, and of its header, at most."""


def require_small(pixels: int, most: int) -> None:
    """Refuse a file of more pixels than may be held.

    Raise a `ValueError` for such a file.
    """
    if pixels > most:
        raise ValueError(f"it has {pixels} pixels, more than {most}")


def read_npy(path: Path, most: int, colours: bool = False) -> np.ndarray:
    """Read an array of a NumPy file, after its header has said that it is small enough; nothing in it is run.

    Where ``colours`` may be the last of three axes, at most 4 of them count as one pixel.
    """
    mapped = np.load(path, mmap_mode="r", allow_pickle=False)  # the header; the numbers when they are asked for
    colours = colours and mapped.ndim == 3 and mapped.shape[2] <= 4
    require_small(prod(mapped.shape[:2] if colours else mapped.shape), most)
    return np.array(mapped)
