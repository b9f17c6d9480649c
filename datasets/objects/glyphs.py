"""Glyphs: letters and digits in 21 faces of three families of fonts, whose outlines this package carries.

The outline of a character (unhinted, so it is the same at every size), its curves in straight pieces that leave
them by 1e-4 of the size at most, is scaled, turned and placed; grey levels are the areas of pixels inside, exactly
(:mod:`specklegen.kernels.coverage`). The characters are the
47 that EMNIST "balanced" keeps apart (Cohen et al. 2017, arXiv 1702.05373), less I and O, which turned
and scaled are other characters' strokes: no two are one shape at two sizes, as c and C are.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.values import NonNegative
from specklegen.datasets.objects.family import ListedFamily, Source, place_within, source_key
from specklegen.datasets.objects.outlines import CHARACTERS, FONTS, outline, place_of
from specklegen.datasets.split import Purpose, Split
from specklegen.kernels.coverage import fill_coverage

if TYPE_CHECKING:
    import torch

    from specklegen.datasets.addresses import Addresses

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
    test, validation
        Characters of these splits, in any font; both or neither, with ``disjoint = "character"``. By default the hashes
        of the characters decide, which leaves four for each.
    """

    type: Literal["Glyphs"] = "Glyphs"
    size: tuple[Fraction, Fraction] = (0.4, 0.9)
    rotation: Annotated[NonNegative, Field(le=180)] = 30.0
    disjoint: Literal["glyph", "character", "font"] = "glyph"
    test: str = ""
    validation: str = ""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.size[0] > self.size[1]:
            reject("Glyphs.size", "given as (smallest, largest)", self.size)
        if self.test or self.validation:
            self._check_held_out()
        return self

    def _check_held_out(self) -> None:
        if self.disjoint != "character":
            reject("Glyphs.disjoint", '"character" if characters of test and validation are named', self.disjoint)
        for name, own, other in (("test", self.test, self.validation), ("validation", self.validation, self.test)):
            if not own or len(set(own)) < len(own) or not set(own) <= set(CHARACTERS) - set(other):
                reject(f"Glyphs.{name}", f"different characters of {CHARACTERS}, none of them in the other split", own)
        if set(self.test + self.validation) == set(CHARACTERS):
            reject("Glyphs.test", "such that some characters are left for training", self.test)

    @cached_property
    def by_split(self) -> dict[Split, tuple[Source, ...]]:
        """Sources of each split: by the named characters, or dealt."""
        if not self.test:
            return super().by_split
        held_out: dict[Split, str] = {"validation": self.validation, "test": self.test}
        held_out["train"] = "".join(c for c in CHARACTERS if c not in self.validation + self.test)
        return {split: tuple(s for s in self.sources() if str(s[1]) in chosen) for split, chosen in held_out.items()}

    def labels(self, source: Source) -> dict[str, float]:
        """Label: the number of the character in :data:`~specklegen.datasets.objects.outlines.CHARACTERS`."""
        return {"label": float(CHARACTERS.index(str(source[1])))}

    def sources(self) -> tuple[Source, ...]:
        """(font, character), each font with each character."""
        return tuple((font, character) for font in FONTS for character in CHARACTERS)

    def split_key(self, source: Source) -> str:
        """Whole source, its character or its font, as ``disjoint`` says."""
        font, character = source
        return {"glyph": source_key(source), "character": str(character), "font": str(font)}[self.disjoint]

    @property
    def drawn_together(self) -> bool:
        """True if pictures of many samples are drawn where the samples are made: not those of a class of one's own."""
        return type(self).picture is Glyphs.picture and self.dealt

    def images(self, drawn: "Addresses", numbers: Sequence[int]) -> "torch.Tensor":
        """Characters of samples, float32[B, h, w], drawn where they are wanted; of a class of one's own, here."""
        if not self.drawn_together:
            return super().images(drawn, numbers)
        from specklegen.datasets.objects.glyph_batches import glyphs

        places = drawn.put(self._outlines_by_split[drawn.split][self.positions(drawn, numbers)])
        return glyphs(places, drawn.uniforms(Purpose.OBJECT, numbers), self.shape, self.rotation, self.size)

    @cached_property
    def _outlines_by_split(self) -> dict[Split, np.ndarray]:
        """Numbers int64[n] of the outlines of each split's sources."""
        return {
            split: np.array([place_of(*map(str, source)) for source in sources], np.int64)
            for split, sources in self.by_split.items()
        }

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Character turned, scaled to its turned extent and put where it fits; float[h, w], area covered."""
        angle = np.deg2rad(rng.uniform(-self.rotation, self.rotation))
        cosine, sine = np.cos(angle), np.sin(angle)
        ends = outline(*map(str, source)).reshape(-1, 2) @ np.array([[cosine, sine], [-sine, cosine]])
        ends = np.ascontiguousarray(ends.T)  # NumPy is slow along axes of two
        low = ends.min(axis=1)
        extents = ends.max(axis=1) - low
        rows, columns = self.shape
        scale = rng.uniform(*self.size) * min(rows, columns) / extents.max()
        x = place_within(rng, columns - scale * extents[0])
        y = place_within(rng, rows - scale * extents[1])
        placed = scale * (ends - low[:, None]) + np.array([[x], [y]])
        return _filled(np.ascontiguousarray(placed.T).reshape(-1, 4), rows, columns)


def _filled(edges: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Area of each pixel inside closed contours, float64[h, w]; y upwards."""
    covered = np.empty((rows, columns))
    fill_coverage(edges, covered)
    return covered[::-1]
