"""Rows of docs/notes/stability.md: small functions that run one case each, for the report and for the tests alike."""

from . import geometry, limits, media, points, sizes, slow

FAST = (*media.ROWS, *geometry.ROWS, *points.ROWS, *sizes.ROWS, *limits.ROWS)
SLOW = slow.ROWS
