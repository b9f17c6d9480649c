"""Glyphs on a device: the outlines of all characters lie there once, a sample turns, scales, places and fills one."""

from functools import lru_cache

import numpy as np
import torch

from specklegen.datasets.objects.outlines import outlines
from specklegen.kernels.coverage import fill_coverage
from specklegen.synthesis.fused import fused


@lru_cache(maxsize=4)
def glyph_edges(device: torch.device) -> torch.Tensor:
    """Bring the outlines float64[945, n, 4] to a device, each filled up to one length with edges of no extent."""
    known = outlines()
    length = int(np.diff(known.starts).max())
    edges = np.empty((len(known.starts) - 1, length, 4))
    for place, row in enumerate(edges):
        own = known[place]
        row[: len(own)], row[len(own) :] = own, np.tile(own[-1, 2:], 2)
    return torch.from_numpy(edges).to(device)


@fused(
    "turned(Tensor edges, Tensor place, Tensor angle) -> Tensor", lambda e, p, a: e.new_empty((len(p), *e.shape[1:]))
)
def turned(edges: torch.Tensor, place: torch.Tensor, angle: torch.Tensor) -> torch.Tensor:
    """Outlines float64[B, n, 4] of places int64[B], turned by angles float64[B]."""
    ends = edges[place].unflatten(2, (2, 2))
    cosine, sine = torch.cos(angle)[:, None, None], torch.sin(angle)[:, None, None]
    x, y = ends[..., 0], ends[..., 1]
    return torch.stack([x * cosine - y * sine, x * sine + y * cosine], -1).flatten(2)


def _on_the_cpu(edges: torch.Tensor, rows: int, columns: int) -> torch.Tensor:
    out = np.empty((len(edges), rows, columns))
    for outline, covered in zip(edges.contiguous().numpy(), out, strict=True):
        fill_coverage(outline, covered)
    return torch.from_numpy(out)


def _filled(z: torch.Tensor) -> torch.Tensor:
    """Integral of the share of a pixel that lies right of an edge."""
    inside = z.clamp(0, 1)
    return inside * (z.clamp(min=0) - 0.5 * inside)


@fused(
    "coverage(Tensor edges, int rows, int columns) -> Tensor",
    lambda e, rows, columns: e.new_empty((len(e), rows, columns)),
    _on_the_cpu,
)
def coverage(edges: torch.Tensor, rows: int, columns: int) -> torch.Tensor:
    """Area of each pixel inside closed contours float64[B, n, 4]: float64[B, rows, columns]; see the kernel."""
    x0, y0, x1, y1 = (edges[:, :, n, None, None] for n in range(4))
    level = y0 == y1
    slope = (x1 - x0) / torch.where(level, 1.0, y1 - y0)
    row = torch.arange(rows, device=edges.device, dtype=edges.dtype)[:, None]
    column = torch.arange(columns, device=edges.device, dtype=edges.dtype)
    upper = torch.maximum(torch.minimum(y0, y1), row)
    lower = torch.minimum(torch.maximum(y0, y1), row + 1)
    height = torch.where(level, 0.0, (lower - upper).clamp(min=0) * torch.sign(y1 - y0))
    one, two = x0 + slope * (upper - y0), x0 + slope * (lower - y0)
    left, right = torch.minimum(one, two), torch.maximum(one, two)
    wide = right - left > 1e-9
    strip = _filled(column + 1 - left) - _filled(column + 1 - right)
    upright = (column + 1 - 0.5 * (left + right)).clamp(0, 1)
    share = torch.where(wide, strip / torch.where(wide, right - left, 1.0), upright)
    share = torch.where(column >= right, 1.0, share)  # where the difference would have lost its digits
    return (height * share).sum(1).abs().clamp(max=1)


def glyphs(
    place: torch.Tensor, uniform: torch.Tensor, shape: tuple[int, int], rotation: float, size: tuple[float, float]
) -> torch.Tensor:
    """Objects float32[B, h, w] with a peak of 1, from places int64[B] and the four draws float64[B, 4] of each.

    Shape, largest rotation in degrees and range of sizes are those of the family.
    """
    rows, columns = shape
    limit = np.deg2rad(1.0) * rotation
    angle = limit * (2 * uniform[:, 0] - 1)
    edges = turned(glyph_edges(place.device), place, angle)
    ends = edges.unflatten(2, (2, 2)).flatten(1, 2)
    low = ends.amin(1)
    extents = ends.amax(1) - low
    small, large = size
    scale = (small + (large - small) * uniform[:, 1]) * min(rows, columns) / extents.amax(1)
    free = [side - scale * extents[:, axis] for axis, side in ((0, columns), (1, rows))]
    x = torch.where(free[0] > 0, free[0].clamp(min=0) * uniform[:, 2], 0.0)
    # Where there was no room along x, no number was drawn for it.
    y = torch.where(free[1] > 0, free[1].clamp(min=0) * torch.where(free[0] > 0, uniform[:, 3], uniform[:, 2]), 0.0)
    shift = torch.stack([x, y], -1)
    placed = scale[:, None, None] * (edges.unflatten(2, (2, 2)) - low[:, None, None]).flatten(2)
    covered = coverage(placed + shift.repeat(1, 2)[:, None], rows, columns).flip(1)
    return (covered / covered.amax((1, 2), keepdim=True)).to(torch.float32)
