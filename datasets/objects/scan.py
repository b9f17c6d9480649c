"""Scan: a wide object of which each sample shows what one spot of light falls on.

An object many memory-effect ranges wide cannot be seen in one image: pairs of its points further apart than the range
have no speckle in common, and nothing in the image tells how its parts lie to each other. Users of such systems light
it a part at a time, by spots that overlap (Gardner, Divitt and Watnik, Applied Optics 58, 3564 (2019): ptychography
by speckle correlations). The places of the spots are known; the medium may be another one each time.
"""

from math import prod
from typing import Any, Literal, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.memory import memory_limit
from specklegen.core.random_streams import seed_words
from specklegen.core.values import IDENTITY, PositiveInt
from specklegen.datasets.objects.family import AnyFamily, ObjectFamily, Source
from specklegen.datasets.split import Seed, Split


def spot_of(shape: tuple[int, int]) -> np.ndarray:
    """Brightness of a spot, float64[h, w]: raised cosines that fall to 0 half a pixel outside, 1 in the middle."""
    rows, columns = (np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2 for n in shape)
    return np.outer(rows, columns)


class Scan(ObjectFamily):
    """Parts of a page of pictures under a moving spot of light; a page has rows x columns samples.

    Samples of a page come row by row, and then those of the next page. Each is shown at full brightness; ``light``
    among its labels is the sum of its pixels on the page, which a camera measures as the mean of its image.

    Parameters
    ----------
    shape
        (rows, columns) of the spot in pixels, a raised cosine either way.
    grid
        (rows, columns) of places of the spot.
    step
        Pixels from place to place either way, at most the spot's side.
    of
        Pictures that the page is made of, edge to edge; what its right and lower edges cut off is not seen.

    Examples
    --------
    >>> from specklegen.datasets.objects import Glyphs, Scan
    >>> scan = Scan(shape=(16, 16), grid=(2, 4), step=5, of=Glyphs(shape=(14, 14)))
    >>> scan.page(0, "train", 0).shape
    (21, 31)
    """

    label_names = ("label", "page", "scan_row", "scan_column", "light")
    type: Literal["Scan"] = "Scan"
    grid: tuple[PositiveInt, PositiveInt] = (3, 14)
    step: PositiveInt = 5
    of: AnyFamily

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.step > min(self.shape):
            reject("Scan.step", f"at most the side of the spot, {min(self.shape)}", self.step)
        if 64 * prod(self.wide) > 0.1 * memory_limit():
            most = 0.1 * memory_limit() / 64
            reject("Scan.grid", f"such that a page has at most {most:.1e} pixels here", self.grid,
                   "A page is drawn whole for every sample: use fewer places.")  # fmt: skip
        if isinstance(self.of, Scan):
            reject("Scan.of", "a family of pictures", self.of.type)
        return self

    @property
    def wide(self) -> tuple[int, int]:
        """(rows, columns) of a page."""
        rows, columns = ((n - 1) * self.step + side for n, side in zip(self.grid, self.shape, strict=True))
        return rows, columns

    @property
    def places(self) -> np.ndarray:
        """First (row, column) of every spot of a page, int64[rows * columns, 2], in the order of the samples."""
        return np.indices(self.grid).reshape(2, -1).T * self.step

    def page(self, seed: Seed, split: Split, number: int) -> np.ndarray:
        """Wide object of a number, float32[H, W], brightness 0 to 1; a pure function."""
        across = [-(-n // side) for n, side in zip(self.wide, self.of.shape, strict=True)]
        cells = prod(across)
        pictures = [self.of.image(seed, split, number * cells + n) for n in range(cells)]
        rows = [np.hstack(pictures[n : n + across[1]]) for n in range(0, cells, across[1])]
        return np.vstack(rows)[: self.wide[0], : self.wide[1]]

    def lit(self, seed: Seed, split: Split, index: int) -> np.ndarray:
        """Part of the page under the spot of a sample, float64[h, w], at the brightness of the page."""
        number, place = divmod(index, prod(self.grid))
        row, column = self.places[place]
        page = self.page(seed, split, number)
        return spot_of(self.shape) * page[row : row + self.shape[0], column : column + self.shape[1]]

    def identity(self, context: dict[str, bool] | None = IDENTITY) -> dict[str, Any]:
        """Fields, and the identity of the pictures."""
        return super().identity(context) | {"of": self.of.identity(context)}

    def source(self, seed: Seed, split: Split, index: int) -> Source:
        """(split, index, seed): pages of two splits have no picture in common."""
        return split, index, *seed_words(seed)

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:  # noqa: ARG002
        """Lit part of a page; float64[h, w]."""
        return self.lit(*_addressed(source))

    def labels(self, source: Source) -> dict[str, float]:
        """Number of the page, row and column of the spot among its places, and the light of what it shows."""
        number, place = divmod(int(source[1]), prod(self.grid))
        row, column = divmod(place, self.grid[1])
        light = float(self.lit(*_addressed(source)).sum())
        return {"label": -1.0, "page": float(number), "scan_row": float(row), "scan_column": float(column),
                "light": light}  # fmt: skip


def _addressed(source: Source) -> tuple[Seed, Split, int]:
    """Seed, split and index of a source."""
    return [int(word) for word in source[2:]], source[0], int(source[1])  # type: ignore[return-value]
