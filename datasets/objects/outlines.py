"""Outlines of characters in the fonts of DejaVu, STIX and Computer Modern, as data of this package.

``specklegen/data/glyphs.npz`` holds lines and parabolas by whole numbers, written once by
``scripts/build/make_glyphs.py`` from the fonts that matplotlib carries; no font file and no other library has a say in
what an object looks like. Curves are cut into chords that leave them by 1e-4 of the size at most, in whole numbers up
to one division, so that every processor gets the same ends to the last bit. Licences: ``glyphs-licences.txt`` beside
the file.
"""

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np

CHARACTERS = "0123456789ABCDEFGHJKLMNPQRSTUVWXYZabdefghnqrt"

FONTS = (
    "DejaVuSans.ttf", "DejaVuSans-Bold.ttf", "DejaVuSans-BoldOblique.ttf", "DejaVuSans-Oblique.ttf",
    "DejaVuSansMono.ttf", "DejaVuSansMono-Bold.ttf", "DejaVuSansMono-BoldOblique.ttf", "DejaVuSansMono-Oblique.ttf",
    "DejaVuSerif.ttf", "DejaVuSerif-Bold.ttf", "DejaVuSerif-BoldItalic.ttf", "DejaVuSerif-Italic.ttf",
    "STIXGeneral.ttf", "STIXGeneralBol.ttf", "STIXGeneralBolIta.ttf", "STIXGeneralItalic.ttf", "cmb10.ttf",
    "cmmi10.ttf", "cmr10.ttf", "cmss10.ttf", "cmtt10.ttf",
)  # fmt: skip

FILE = Path(str(files("specklegen") / "data" / "glyphs.npz"))
UNIT = 64  # of the whole numbers in the file, in one of the outlines


@dataclass(frozen=True)
class Outlines:
    """Outlines of all characters of all fonts, a font after the other, y upwards.

    Attributes
    ----------
    edges : float64[n, 4]
        Ends (x, y), (x, y) of the edges of closed contours, for characters about 70 high.
    starts : int64[945 + 1]
        First edge of each outline, and their number.
    """

    edges: np.ndarray
    starts: np.ndarray

    def __getitem__(self, place: int) -> np.ndarray:
        """Edges float64[m, 4] of one outline."""
        return self.edges[self.starts[place] : self.starts[place + 1]]


def place_of(font: str, character: str) -> int:
    """Number of an outline."""
    return FONTS.index(font) * len(CHARACTERS) + CHARACTERS.index(character)


def outline(font: str, character: str) -> np.ndarray:
    """Edges float64[n, 4] of one character of one font; see :class:`Outlines`."""
    return outlines()[place_of(font, character)]


@lru_cache(maxsize=1)
def outlines() -> Outlines:
    """All outlines, read-only."""
    with np.load(FILE, allow_pickle=False) as tables:
        segments, pieces, counts = (tables[name] for name in ("segments", "pieces", "counts"))
    edges = chords(segments, pieces)
    starts = np.cumsum([0, *np.add.reduceat(pieces.astype(np.int64), np.cumsum([0, *counts[:-1]], dtype=np.int64))])
    for array in (edges, starts):
        array.flags.writeable = False
    return Outlines(edges, starts)


def chords(segments: np.ndarray, pieces: np.ndarray) -> np.ndarray:
    """Cut segments into chords.

    Parameters
    ----------
    segments : int[s, 3, 2]
        Start, control point and end of parabolas, in units of 1 / :data:`UNIT`; of what is one chord the control point
        does not matter.
    pieces : int[s]
        Chords of each, evenly spaced in the parameter.

    Returns
    -------
    float64[sum of pieces, 4]
        Both ends of each, one after the other.
    """
    number = np.repeat(pieces.astype(np.int64), pieces)[:, None]
    step = np.arange(len(number))[:, None] - np.repeat(np.cumsum(pieces, dtype=np.int64) - pieces, pieces)[:, None]
    start, control, end = np.repeat(segments.astype(np.int64), pieces, axis=0).transpose(1, 0, 2)

    def at(k: np.ndarray) -> np.ndarray:
        weighed = (number - k) ** 2 * start + 2 * k * (number - k) * control + k**2 * end
        return weighed / (UNIT * number**2)

    return np.hstack([at(step), at(step + 1)])
