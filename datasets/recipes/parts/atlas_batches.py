"""The memory-effect lookup table for a batch of slabs: :mod:`specklegen.memory_effects.atlas` in torch."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch

from specklegen.kernels.slab_lookup import fill_slab_mixtures
from specklegen.memory_effects.atlas import load
from specklegen.synthesis.fused import fused


@dataclass(frozen=True)
class AtlasTables:
    """The lookup table on a device.

    Attributes
    ----------
    axes : three float64[n]
        Nodes along ln(optical depth), ln(1 - g), absorption.
    shares : float64[96]
    table : float32[D * G * A, 97]
    bounds : float32[(D - 1) * (G - 1) * (A - 1)]
        Error of C_I in each cell.
    """

    axes: tuple[torch.Tensor, torch.Tensor, torch.Tensor]
    shares: torch.Tensor
    table: torch.Tensor
    bounds: torch.Tensor


@lru_cache(maxsize=4)
def atlas_tables(device: torch.device) -> AtlasTables:
    """Bring the packaged lookup table to a device."""
    atlas = load()
    put = lambda array: torch.from_numpy(array).to(device)  # noqa: E731
    x, y, z = (put(nodes) for nodes in atlas.axes)
    flat = atlas.table.reshape(-1, atlas.table.shape[-1])
    return AtlasTables((x, y, z), put(atlas.shares), put(flat), put(atlas.bounds[..., 0].reshape(-1).copy()))


def _stencil(x: torch.Tensor, nodes: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Cell and places int64[B], int64[B, 4] of four nodes about x, and Lagrange's weights on them, float64[B, 4]."""
    below = torch.searchsorted(nodes, x, right=True) - 1
    four = torch.arange(4, device=x.device)
    place = (below - 1).clamp(0, len(nodes) - 4)[:, None] + four
    at = nodes[place]
    same = torch.eye(4, dtype=torch.bool, device=x.device)
    ratio = (x[:, None, None] - at[:, None, :]) / (at[:, :, None] - at[:, None, :]).masked_fill(same, 1.0)
    return below.clamp(0, len(nodes) - 2), place, ratio.masked_fill(same, 1.0).prod(-1)


def stencils(
    depth: torch.Tensor, drop: torch.Tensor, albedo: torch.Tensor, axes: list[torch.Tensor]
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Places of slabs float64[B] in a table: whether inside, their cells, 64 nodes int64[B, 64] and their weights."""
    order = depth * (1 + 0.5 * depth * drop)
    coordinates = [torch.log(depth), torch.log(drop), torch.sqrt(1 - torch.log(albedo) * order) - 1]
    inside = torch.ones_like(depth, dtype=torch.bool)
    cell = torch.zeros_like(depth, dtype=torch.int64)
    place, weight = cell[:, None], torch.ones_like(depth)[:, None]
    for x, nodes in zip(coordinates, axes, strict=True):
        inside = inside & (nodes[0] <= x) & (x <= nodes[-1])
        below, four, along = _stencil(x.contiguous(), nodes)
        cell = cell * (len(nodes) - 1) + below
        place = (place[:, :, None] * len(nodes) + four[:, None, :]).flatten(1)
        weight = (weight[:, :, None] * along[:, None, :]).flatten(1)
    return inside, cell, place, weight


@dataclass(frozen=True)
class Correlations:
    """Memory-effect correlations of a batch, in the form of :class:`MemoryEffectCorrelation`.

    Attributes
    ----------
    radius, share : float64[B, 97]
    single : float64[B]
        Share of single scattering.
    served : bool[B]
        Whether the slab is in the table, and its error there within the tolerance.
    """

    radius: torch.Tensor
    share: torch.Tensor
    single: torch.Tensor
    served: torch.Tensor


def single_radiance(depth: torch.Tensor, drop: torch.Tensor, albedo: torch.Tensor) -> torch.Tensor:
    """Radiance of single scattering straight ahead over the irradiance, 1/sr: albedo OD e^-OD rho(0)."""
    return albedo * depth * torch.exp(-depth) * (2 - drop) / (4 * torch.pi * drop.square())


def correlations(
    tables: AtlasTables, thickness: torch.Tensor, depth: torch.Tensor, g: torch.Tensor, albedo: torch.Tensor,
    tolerance: float,
) -> Correlations:  # fmt: skip
    """Correlations of slabs float64[B] each."""
    slabs = torch.stack([thickness, depth, g, albedo], -1)
    return Correlations(
        *slab_correlations(slabs, [*tables.axes], tables.shares, tables.table, tables.bounds, tolerance)
    )


def _shapes(
    slabs: torch.Tensor, axes: list[torch.Tensor], shares: torch.Tensor, *_: object
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    wide = (len(slabs), len(shares) + 1)
    single = slabs.new_empty(len(slabs))
    return slabs.new_empty(wide), slabs.new_empty(wide), single, single.new_empty(len(slabs), dtype=torch.bool)


def _on_the_cpu(
    slabs: torch.Tensor, axes: list[torch.Tensor], shares: torch.Tensor, table: torch.Tensor, bounds: torch.Tensor,
    tolerance: float,
) -> tuple[torch.Tensor, ...]:  # fmt: skip
    wide, served = (len(slabs), len(shares) + 1), np.empty(len(slabs), np.bool_)
    radius, share, single = np.empty(wide), np.empty(wide), np.empty(len(slabs))
    known = (part.contiguous().numpy() for part in (slabs, *axes, shares, table, bounds))
    fill_slab_mixtures(*known, tolerance, radius, share, single, served)
    return tuple(torch.from_numpy(part) for part in (radius, share, single, served))


@fused(
    "slab_correlations(Tensor slabs, Tensor[] axes, Tensor shares, Tensor table, Tensor bounds, float tolerance)"
    " -> (Tensor, Tensor, Tensor, Tensor)",
    _shapes,
    _on_the_cpu,
    kernels=4,
)
def slab_correlations(
    slabs: torch.Tensor, axes: list[torch.Tensor], shares: torch.Tensor, table: torch.Tensor, bounds: torch.Tensor,
    tolerance: float,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:  # fmt: skip
    """Radius, share, single share and whether served (:class:`Correlations`) of slabs float64[B, 4].

    A slab is its thickness, optical depth, g and albedo; the tables are those of :class:`AtlasTables`.
    """
    thickness, depth, g, albedo = slabs.unbind(-1)
    drop = 1 - g
    inside, cell, place, weight = stencils(depth, drop, albedo, axes)
    row = (table[place].to(weight.dtype) * weight[:, :, None]).sum(1)
    single = single_radiance(depth, drop, albedo)
    multiple = albedo.square() * torch.exp(row[:, -1])
    weights = torch.cat([single[:, None], multiple[:, None] * shares], 1)
    radius = torch.cat([torch.zeros_like(single)[:, None], thickness[:, None] * torch.exp(row[:, :-1])], 1)
    served = inside & (bounds[cell] <= tolerance)
    return radius, weights / weights.sum(1, keepdim=True), single / (single + multiple), served
