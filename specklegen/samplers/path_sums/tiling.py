"""A regular grid of views cut into tiles of one shape, each seen along a middle direction of its own."""

from dataclasses import dataclass

import numpy as np

from specklegen.scene.illumination import directions_of_sines
from specklegen.scene.sensors import FarFieldGrid

_PARTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)  # tiles along the longer side
_LEAST_VIEWS = 8
MOST_VIEWS = 512  # along a side of a tile: what is in work at a time, and the piece that a streamed stack comes in


@dataclass(frozen=True)
class Tile:
    """A rectangle of a grid.

    Attributes
    ----------
    rows, columns : slice
        Which views of the grid; no view is in two tiles.
    kept : (slice, slice)
        Where these lie in a transform of the tiling's shape.
    middle : float64[3]
        Direction of the view at row h // 2, column w // 2 of that: mode 0 of the transform.
    """

    rows: slice
    columns: slice
    kept: tuple[slice, slice]
    middle: np.ndarray

    def views(self, steps: np.ndarray) -> np.ndarray:
        """Directions float64[..., 3] whose sines lie ``steps`` float64[..., 2] from those of the middle."""
        return directions_of_sines("tile", self.middle[:2] + steps, np.sign(self.middle[2]))


@dataclass(frozen=True)
class Tiling:
    """Tiles that cover a grid. Transforms have one shape and overlap where that does not divide the grid.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of every tile's transform.
    """

    grid: FarFieldGrid
    shape: tuple[int, int]

    @property
    def tiles(self) -> tuple[Tile, ...]:
        """All tiles, row by row."""
        (height, width), (x, y) = self.shape, self.grid.sines
        rows, columns = (_cuts(n, size) for n, size in zip(self.grid.shape, self.shape, strict=True))
        return tuple(
            Tile(
                own_rows,
                own_columns,
                (_within(own_rows, row), _within(own_columns, column)),
                directions_of_sines("tile", (x[column + width // 2], y[row + height // 2]), self.grid.sign),
            )
            for row, own_rows in rows
            for column, own_columns in columns
        )

    @property
    def counts(self) -> tuple[int, int]:
        """Tiles along (y, x)."""
        rows, columns = (len(_cuts(n, size)) for n, size in zip(self.grid.shape, self.shape, strict=True))
        return rows, columns

    @property
    def steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Direction sines relative to a tile's middle (x of the columns, y of the rows), float64[w] and float64[h]."""
        height, width = self.shape
        return (np.arange(width) - width // 2) * self.grid.pitch, (np.arange(height) - height // 2) * self.grid.pitch


def tilings(grid: FarFieldGrid) -> list[Tiling]:
    """Cuts of a grid: one tile where it is small enough, then ever smaller ones down to 8 views a side."""
    cuts = []
    for parts in _PARTS:
        side = -(-max(grid.shape) // parts)
        if cuts and side < _LEAST_VIEWS:
            break
        if side <= MOST_VIEWS:
            rows, columns = (-(-n // -(-n // side)) for n in grid.shape)
            cuts.append(Tiling(grid, (rows, columns)))
    return cuts


def coarsest(grid: FarFieldGrid) -> Tiling:
    """The fewest tiles of at most 512 views a side."""
    rows, columns = (-(-n // -(-n // MOST_VIEWS)) for n in grid.shape)
    return Tiling(grid, (rows, columns))


def _cuts(count: int, size: int) -> list[tuple[int, slice]]:
    """First view of every transform of ``size`` along an axis of ``count``, and the views that are its own."""
    return [(min(begin, count - size), slice(begin, min(begin + size, count))) for begin in range(0, count, size)]


def _within(own: slice, first: int) -> slice:
    return slice(own.start - first, own.stop - first)
