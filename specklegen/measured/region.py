"""The part of a frame that is looked at: as given, or the largest rectangle that is lit."""

from typing import Any, NamedTuple

import numpy as np

from specklegen.core.arguments import whole_number
from specklegen.core.errors import reject

LIT = 0.25
"""Share of the brightest light, averaged over a block, above which a block is lit."""
LEAST = 8
"""Pixels along each side of a region, at least."""
_BLOCKS = 64  # along the longer side


class Region(NamedTuple):
    """A rectangle of pixels: its first row and column, and its sides."""

    top: int
    left: int
    height: int
    width: int

    def of(self, frames: np.ndarray) -> np.ndarray:
        """The part of arrays[..., h, w]."""
        return frames[..., self.top : self.top + self.height, self.left : self.left + self.width]


def given_region(given: Any, shape: tuple[int, int], field: str) -> Region:
    """Check a region (top, left, height, width) of a frame of a shape."""
    if not (isinstance(given, tuple | list) or getattr(given, "shape", ()) == (4,)) or len(given) != 4:
        reject(f"{field} region", '"find", or (top, left, height, width) in pixels', given)
    numbers = Region(*(whole_number(f"{field} region", each) for each in given))
    if numbers.top + numbers.height > shape[0] or numbers.left + numbers.width > shape[1]:
        reject(f"{field} region", f"inside the frame of {shape[0]} x {shape[1]} pixels", tuple(numbers))
    if min(numbers.height, numbers.width) < LEAST:
        reject(f"{field} region", f"of at least {LEAST} x {LEAST} pixels", tuple(numbers))
    return numbers


def lit_region(light: np.ndarray, good: np.ndarray, field: str) -> Region:
    """Find the largest rectangle of a mean image[h, w] whose blocks all have light."""
    side = max(1, -(-max(light.shape) // _BLOCKS))
    edges = [np.arange(0, pixels, side) for pixels in light.shape]
    total, number = (
        np.add.reduceat(np.add.reduceat(each, edges[0], axis=0), edges[1], axis=1)
        for each in (np.where(good, light, 0.0), good.astype(float))
    )
    means = np.divide(total, number, out=np.zeros_like(total), where=number > 0)
    top, left, height, width = _largest(means > LIT * means.max())
    bottom, right = min(light.shape[0], (top + height) * side), min(light.shape[1], (left + width) * side)
    region = Region(top * side, left * side, bottom - top * side, right - left * side)
    if min(region.height, region.width) < LEAST:
        reject(f"{field} region", f"given, since less than {LEAST} x {LEAST} pixels are illuminated", tuple(region))
    return region


def _largest(lit: np.ndarray) -> tuple[int, int, int, int]:
    """Largest rectangle of True: (top, left, height, width); the first of several."""
    best = (0, 0, 0, 0)
    above = np.zeros(lit.shape[1], int)  # True in a row, upwards from this one
    for row, line in enumerate(lit):
        above = np.where(line, above + 1, 0)
        for left in range(len(above)):
            low = np.minimum.accumulate(above[left:])
            area = low * np.arange(1, len(low) + 1)
            width = int(area.argmax())
            if area[width] > best[2] * best[3]:
                best = (row - int(low[width]) + 1, left, int(low[width]), width + 1)
    return best
