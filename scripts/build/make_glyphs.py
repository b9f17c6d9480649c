"""Make the packaged outlines of characters, ``specklegen/data/glyphs.npz``, from the fonts of this matplotlib.

    python scripts/build/make_glyphs.py            # write the file
    python scripts/build/make_glyphs.py --check    # compare it with what this matplotlib draws

The file is data and stays as it is: outlines drawn by another version of matplotlib (or of FreeType in it) differ by
more than rounding, and who writes them anew changes pixels (``DATA_VERSION``). matplotlib gives coordinates at a size
of 100 in whole 64ths, so whole numbers hold them exactly.
"""

import argparse
import math
import sys
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path as Outline
from matplotlib.textpath import TextPath

from specklegen.datasets.objects.outlines import CHARACTERS, FILE, FONTS, UNIT

DEVIATION = 0.01  # of a curve from its chords, at a size of 100


def segments_of(path: Outline) -> tuple[list, list]:
    """Segments of a path, every contour closed: (start, control point, end) each, and chords that it is cut into.

    A line is its own chord; its control point is its end.
    """
    segments, pieces = [], []
    first = last = np.zeros(2)

    def add(control: np.ndarray, end: np.ndarray, chords: int) -> None:
        if (end != last).any():
            segments.append([last, control, end])
            pieces.append(chords)

    place = 0
    while place < len(path.codes):
        code, at = path.codes[place], path.vertices[place]
        if code == path.MOVETO:
            if place:
                add(first, first, 1)
            first = last = at
        elif code == path.LINETO:
            add(at, at, 1)
            last = at
        elif code == path.CURVE3:
            end = path.vertices[place + 1]
            bend = np.abs(last - 2 * at + end).sum()
            add(at, end, max(1, math.ceil(math.sqrt(2 * bend / (8 * DEVIATION)))))
            last, place = end, place + 1
        elif code != path.CLOSEPOLY:
            raise ValueError(f"a piece of code {code}: fonts of lines and parabolas only")
        place += 1
    add(first, first, 1)
    return segments, pieces


def tables() -> dict[str, np.ndarray]:
    """What the file holds, from the fonts of this matplotlib."""
    fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    points, pieces, counts = [], [], []
    for font in FONTS:
        for character in CHARACTERS:
            path = TextPath((0, 0), character, size=100, prop=FontProperties(fname=str(fonts / font)))
            own, chords = segments_of(path)
            points += own
            pieces += chords
            counts.append(len(own))
    exact = np.array(points) * UNIT
    if (exact != np.round(exact)).any():
        raise ValueError(f"coordinates that are no whole numbers of 1/{UNIT}")
    return {
        "segments": exact.astype(np.int16), "pieces": np.array(pieces, np.int16), "counts": np.array(counts, np.int16),
    }  # fmt: skip


def main() -> None:
    """Write or compare the file."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="compare, write nothing; exit 1 where outlines differ")
    made = tables()
    if not parser.parse_args().check:
        np.savez_compressed(FILE, **made)
        print(f"{FILE}: {len(made['segments'])} segments, {FILE.stat().st_size / 1024:.0f} KiB")
        return
    with np.load(FILE) as packaged:
        same = all(np.array_equal(packaged[name], table) for name, table in made.items())
    print(f"matplotlib {matplotlib.__version__} draws {'the same' if same else 'other'} outlines")
    sys.exit(not same)


if __name__ == "__main__":
    main()
