"""A regular grid of views cut into tiles of one shape, each seen along a middle direction of its own."""

from dataclasses import dataclass

import numpy as np

from specklegen.illumination import directions_of_sines
from specklegen.sensors import FarFieldGrid

_PARTS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)  # tiles along the longer side


@dataclass(frozen=True)
class Tile:
    """A rectangle of a grid.

    Attributes
    ----------
    rows, columns : slice
        Which views of the grid.
    middle : float64[3]
        Direction of the view at row h // 2, column w // 2 of the tile: mode 0 of a transform.
    """

    rows: slice
    columns: slice
    middle: np.ndarray


@dataclass(frozen=True)
class Tiling:
    """Tiles that cover a grid; the last of a row or column overlaps its neighbour where they do not divide it.

    Attributes
    ----------
    grid : FarFieldGrid
    shape : (int, int)
        Rows and columns of every tile.
    """

    grid: FarFieldGrid
    shape: tuple[int, int]

    @property
    def tiles(self) -> tuple[Tile, ...]:
        """All tiles, row by row."""
        (height, width), (x, y) = self.shape, self.grid.sines
        firsts = [_firsts(n, size) for n, size in zip(self.grid.shape, self.shape, strict=True)]
        return tuple(
            Tile(
                slice(row, row + height),
                slice(column, column + width),
                directions_of_sines("tile", (x[column + width // 2], y[row + height // 2]), self.grid.sign),
            )
            for row in firsts[0]
            for column in firsts[1]
        )

    @property
    def counts(self) -> tuple[int, int]:
        """Tiles along (y, x)."""
        rows, columns = (len(_firsts(n, size)) for n, size in zip(self.grid.shape, self.shape, strict=True))
        return rows, columns

    @property
    def steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Direction sines relative to a tile's middle (x of the columns, y of the rows), float64[w] and float64[h]."""
        height, width = self.shape
        return (np.arange(width) - width // 2) * self.grid.pitch, (np.arange(height) - height // 2) * self.grid.pitch


def tilings(grid: FarFieldGrid, least: int = 8) -> list[Tiling]:
    """The whole grid as one tile, then ever smaller tiles, squarish and down to about ``least`` views a side."""
    found = [Tiling(grid, grid.shape)]
    for parts in _PARTS:
        side = -(-max(grid.shape) // parts)
        if side < least:
            break
        rows, columns = (-(-n // -(-n // side)) for n in grid.shape)
        found.append(Tiling(grid, (rows, columns)))
    return found


def _firsts(count: int, size: int) -> list[int]:
    """First view of every tile of ``size`` along an axis of ``count``."""
    parts = -(-count // size)
    return np.linspace(0, count - size, parts).round().astype(int).tolist()
