"""Rows of docs/stability.md: small functions that run one case each, for the report and for the tests alike."""

from . import geometry, limits, media, points, slow

FAST = (*media.ROWS, *geometry.ROWS, *points.ROWS, *limits.ROWS)
SLOW = slow.ROWS
