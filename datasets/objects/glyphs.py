"""Glyphs: letters and digits of the fonts that matplotlib carries, so that no file is needed.

The outline of a character (unhinted, so it is the same at every size) is scaled, turned and placed,
then filled by Agg, matplotlib's rasteriser, whose grey levels are areas covered. The characters are the
47 that EMNIST "balanced" keeps apart (Cohen et al. 2017, arXiv 1702.05373), less I and O, which turned
and scaled are other characters' strokes: no two are one shape at two sizes, as c and C are.
"""

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.values import NonNegative
from specklegen.datasets.objects.family import ListedFamily, Source, place_within, source_key

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

Fraction = Annotated[float, Field(gt=0, le=1)]


class Glyphs(ListedFamily):
    """One character of one font, at a random size, angle and place, wholly inside the frame.

    Parameters
    ----------
    shape
        (rows, columns) of an object.
    size
        (smallest, largest) longer side of the turned character, as a fraction of the frame's shorter side.
    rotation
        Largest rotation either way, in degrees.
    disjoint
        What no two splits share: a "glyph" (one character of one font; the same character of a similar
        font may be in another split), a "character" (in any font), or a "font".
    """

    type: Literal["Glyphs"] = "Glyphs"
    size: tuple[Fraction, Fraction] = (0.4, 0.9)
    rotation: Annotated[NonNegative, Field(le=180)] = 30.0
    disjoint: Literal["glyph", "character", "font"] = "glyph"

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.size[0] > self.size[1]:
            reject("Glyphs.size", "given as (smallest, largest)", self.size)
        return self

    def sources(self) -> tuple[Source, ...]:
        """(font, character), each font with each character."""
        return tuple((font, character) for font in FONTS for character in CHARACTERS)

    def split_key(self, source: Source) -> str:
        """Whole source, its character or its font, as ``disjoint`` says."""
        font, character = source
        return {"glyph": source_key(source), "character": str(character), "font": str(font)}[self.disjoint]

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Character turned, scaled to its turned extent and put where it fits; float[h, w], area covered."""
        angle = np.deg2rad(rng.uniform(-self.rotation, self.rotation))
        cosine, sine = np.cos(angle), np.sin(angle)
        outline = _outline(*map(str, source))
        turned = outline.transformed(_affine(cosine, sine, -sine, cosine))
        extents = turned.get_extents()
        rows, columns = self.shape
        scale = rng.uniform(*self.size) * min(rows, columns) / max(extents.width, extents.height)
        x = place_within(rng, columns - scale * extents.width) - scale * extents.x0
        y = place_within(rng, rows - scale * extents.height) - scale * extents.y0
        return _filled(turned.transformed(_affine(scale, 0.0, 0.0, scale, x, y)), rows, columns)


@lru_cache(maxsize=len(FONTS) * len(CHARACTERS))
def _outline(font: str, character: str):
    import matplotlib
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / font
    if not path.is_file():
        reject("Glyphs font", "one that this matplotlib carries", font, "Reinstall matplotlib.")
    return TextPath((0, 0), character, size=100, prop=FontProperties(fname=str(path)))


def _affine(a: float, b: float, c: float, d: float, e: float = 0.0, f: float = 0.0):
    from matplotlib.transforms import Affine2D

    return Affine2D.from_values(a, b, c, d, e, f)


def _filled(path, rows: int, columns: int) -> np.ndarray:
    """Area of each pixel that a closed path covers, float[h, w] in steps of 1/255."""
    from matplotlib.backends.backend_agg import RendererAgg
    from matplotlib.transforms import IdentityTransform

    renderer = RendererAgg(columns, rows, 72)
    context = renderer.new_gc()
    context.set_linewidth(0)
    context.set_snap(False)  # else upright strokes would jump to whole pixels
    renderer.draw_path(context, path, IdentityTransform(), (1.0, 1.0, 1.0))
    return np.asarray(renderer.buffer_rgba())[:, :, 3] / 255
