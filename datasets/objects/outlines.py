"""Outlines of the characters of matplotlib's fonts, in straight pieces: made once, and kept on disk.

matplotlib is asked for curves, once for all characters of all fonts; after that its file is read, and a process that
shows characters does not import it. A folder that cannot be written, or a damaged file, costs that second and no more.
"""

import hashlib
import math
import os
import tempfile
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

import numpy as np
import platformdirs

from specklegen.core.errors import reject

CHARACTERS = "0123456789ABCDEFGHJKLMNPQRSTUVWXYZabdefghnqrt"

FONTS = (
    "DejaVuSans.ttf",
    "DejaVuSans-Bold.ttf",
    "DejaVuSans-BoldOblique.ttf",
    "DejaVuSans-Oblique.ttf",
    "DejaVuSansMono.ttf",
    "DejaVuSansMono-Bold.ttf",
    "DejaVuSansMono-BoldOblique.ttf",
    "DejaVuSansMono-Oblique.ttf",
    "DejaVuSerif.ttf",
    "DejaVuSerif-Bold.ttf",
    "DejaVuSerif-BoldItalic.ttf",
    "DejaVuSerif-Italic.ttf",
    "STIXGeneral.ttf",
    "STIXGeneralBol.ttf",
    "STIXGeneralBolIta.ttf",
    "STIXGeneralItalic.ttf",
    "cmb10.ttf",
    "cmmi10.ttf",
    "cmr10.ttf",
    "cmss10.ttf",
    "cmtt10.ttf",
)

_DEVIATION = 0.01  # of a curve from its chords, at a size of 100
_FORM = 1  # of the file


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
    """All outlines, from the disk where they are there.

    Raises
    ------
    RuleError
        If they are made anew, and this matplotlib does not carry one of the fonts.
    """
    file = _file()
    try:
        content = memoryview(file.read_bytes())
        if hashlib.sha256(content[:-32]).digest() == content[-32:]:
            count = len(FONTS) * len(CHARACTERS) + 1
            starts = np.frombuffer(content, np.int64, count)
            return Outlines(np.frombuffer(content[:-32], np.float64, offset=8 * count).reshape(-1, 4), starts)
    except OSError:
        pass
    made = _made()
    payload = made.starts.astype(np.int64).tobytes() + made.edges.tobytes()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as new:
            new.write(payload + hashlib.sha256(payload).digest())
        os.replace(new.name, file)
    except OSError:
        pass
    return made


def _file() -> Path:
    root = Path(os.environ.get("SPECKLEGEN_CACHE") or platformdirs.user_cache_dir("specklegen"))
    return root / f"outlines-{_FORM}-matplotlib-{version('matplotlib')}.bin"


def _made() -> Outlines:
    parts = [drawn(font, character) for font in FONTS for character in CHARACTERS]
    return Outlines(np.concatenate(parts), np.cumsum([0, *map(len, parts)]))


def drawn(font: str, character: str) -> np.ndarray:
    """Outline as matplotlib draws it, float64[n, 4]."""
    import matplotlib
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / font
    if not path.is_file():
        reject("Glyphs font", "one that this matplotlib carries", font, "Reinstall matplotlib.")
    return flattened(TextPath((0, 0), character, size=100, prop=FontProperties(fname=str(path))))


def flattened(path) -> np.ndarray:
    """Edges float64[n, 4] of a path of matplotlib's, every contour closed, curves in pieces ``_DEVIATION`` off."""
    vertices, codes = path.vertices.tolist(), path.codes.tolist()
    contours: list[list[list[float]]] = []
    place = 0
    while place < len(codes):
        code = codes[place]
        if code == path.MOVETO:
            contours.append([vertices[place]])
        elif code != path.CLOSEPOLY:
            contours[-1].extend(_pieces([contours[-1][-1], *vertices[place : place + _POINTS[code]]]))
        place += _POINTS.get(code, 1)
    ends = [np.array([*contour, contour[0]]) for contour in contours]
    edges = np.concatenate([np.concatenate([points[:-1], points[1:]], axis=1) for points in ends])
    return edges[(edges[:, :2] != edges[:, 2:]).any(axis=1)]


_POINTS = {2: 1, 3: 2, 4: 3}  # that follow matplotlib's LINETO, CURVE3, CURVE4


def _pieces(control: list[list[float]]) -> list[list[float]]:
    """Points of a Bezier curve after its first, for chords that leave it by ``_DEVIATION`` at most."""
    order = len(control) - 1
    if order == 1:
        return control[1:]
    bend = max(
        abs(a[0] - 2 * b[0] + c[0]) + abs(a[1] - 2 * b[1] + c[1])
        for a, b, c in zip(control, control[1:], control[2:], strict=False)
    )
    count = max(1, math.ceil(math.sqrt(order * (order - 1) * bend / (8 * _DEVIATION))))
    t = np.arange(1, count + 1)[:, None] / count
    weights = np.hstack([math.comb(order, n) * t**n * (1 - t) ** (order - n) for n in range(order + 1)])
    return (weights @ np.array(control)).tolist()
