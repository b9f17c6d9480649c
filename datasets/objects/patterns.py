"""Patterns drawn at random: bright points and bar groups, the classical test objects.

A source is a pattern up to where it lies in the frame, as for the other families; its hash decides
its split.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from specklegen.core.errors import reject
from specklegen.datasets.objects.family import DrawnFamily, Source


class Points(DrawnFamily):
    """Points, each one pixel, at random places; splits share no constellation.

    Parameters
    ----------
    shape
        (rows, columns) of an object.
    count
        Number of points, at least 2: a single point is the same object wherever it lies.
    faintest
        Brightness of a point is drawn between this and 1, and the brightest has 1; by default all are alike.
    """

    type: Literal["Points"] = "Points"
    count: Annotated[int, Field(ge=2)] = 5
    faintest: Annotated[float, Field(gt=0, le=1)] = 1.0

    def propose(self, rng: np.random.Generator) -> Source:
        """(row, column, row, column, ...) of the points, moved to touch the first row and column."""
        rows, columns = self.shape
        if self.count > rows * columns:
            reject("Points.count", "at most the number of pixels", self.count, f"The shape is {self.shape}.")
        places = np.sort(rng.choice(rows * columns, self.count, replace=False))
        y, x = np.divmod(places, columns)
        return tuple(int(n) for pair in zip(y - y.min(), x - x.min(), strict=True) for n in pair)

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Constellation, somewhere in the frame; float32[h, w]."""
        y, x = np.array(source, dtype=int).reshape(-1, 2).T
        frame = np.zeros(self.shape, dtype=np.float32)
        places = y + rng.integers(self.shape[0] - y.max()), x + rng.integers(self.shape[1] - x.max())
        frame[places] = rng.uniform(self.faintest, 1, self.count) if self.faintest < 1 else 1
        return frame


class Bars(DrawnFamily):
    """A group of equal bars, upright or level, as on a resolution target; splits share no group.

    Parameters
    ----------
    shape
        (rows, columns) of an object, at least 3 by 3.
    count
        (fewest, most) bars in a group.
    """

    type: Literal["Bars"] = "Bars"
    shape: tuple[Annotated[int, Field(ge=3)], Annotated[int, Field(ge=3)]] = (28, 28)
    count: tuple[Annotated[int, Field(ge=2)], Annotated[int, Field(ge=2)]] = (2, 4)

    def propose(self, rng: np.random.Generator) -> Source:
        """(level, count, width, gap, length) of a group that fits into the frame."""
        level = int(rng.integers(2))
        across, along = self.shape if level else self.shape[::-1]
        fewest, most = self.count
        if fewest > most or 2 * fewest - 1 > min(self.shape):
            reject("Bars.count", "(fewest, most), with the fewest bars fitting into the shape", self.count)
        count = int(rng.integers(fewest, min(most, (across + 1) // 2) + 1))
        width = int(rng.integers(1, (across - count + 1) // count + 1))
        gap = int(rng.integers(1, (across - count * width) // (count - 1) + 1))
        return level, count, width, gap, int(rng.integers(1, along + 1))

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Group, somewhere in the frame; float32[h, w]."""
        level, count, width, gap, length = map(int, source)
        group = np.zeros((count * width + (count - 1) * gap, length), dtype=np.float32)
        for bar in range(count):
            group[bar * (width + gap) :][:width] = 1
        group = group if level else group.T
        frame = np.zeros(self.shape, dtype=np.float32)
        top, left = (int(rng.integers(n - m + 1)) for n, m in zip(self.shape, group.shape, strict=True))
        frame[top : top + group.shape[0], left : left + group.shape[1]] = group
        return frame
