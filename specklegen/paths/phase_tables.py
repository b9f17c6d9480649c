"""Scatterers as arrays: the tables that kernels read, of amplitudes for endpoints and of phase functions for walks."""

import math
from collections.abc import Callable

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.values import read_only, remembered
from specklegen.kernels import lobes
from specklegen.kernels import phase_table as table
from specklegen.kernels.lobes import Lobe
from specklegen.kernels.phase_table import PhaseTable
from specklegen.scene.scatterers import Dimensions, Scatterer

_KINDS = {
    "isotropic": (table.ISOTROPIC_2D, table.ISOTROPIC_3D), "henyey": (table.HENYEY_2D, table.HENYEY_3D),
    "fisher": (table.FISHER_2D, table.FISHER_3D), "tabulated": (table.TABULATED_2D, table.TABULATED_3D),
}  # fmt: skip
_CELLS = 2048  # of a guide to the nodes of a table
LOBE_ERROR = 1e-5
"""Light that a walk's table may send elsewhere: the integral of |f - f of the scatterer| over v, at most about this."""
_OCTAVE = range(5, 15)  # log2 of the nodes an octave of v that are tried
_SPREAD = 0.1  # of first directions, drawn from Henyey and Greenstein's lobe of the same g where there is a table


@remembered(32)
def phase_table(materials: tuple[Scatterer, ...], dimensions: Dimensions) -> PhaseTable:
    """Lay out the particle types of some materials for the kernels, in order; arrays are read-only."""
    if dimensions not in (2, 3):
        reject("phase_table dimensions", "2 or 3", dimensions)
    parts = [material.components for material in materials]
    rows = [particle.row(dimensions) for part in parts for particle, _ in part]
    shares = [np.array([share for _, share in part]) for part in parts]
    shares = [share / math.fsum(share) for share in shares]
    offsets = np.cumsum([0] + [row.nodes.size for row in rows], dtype=np.int64)
    arrays = PhaseTable(
        kinds=np.array([_KINDS[row.kind][dimensions - 2] for row in rows], np.int64),
        parameters=np.array([row.parameters for row in rows], np.float64),
        offsets=offsets,
        nodes=np.concatenate([row.nodes for row in rows]),
        amplitudes=np.concatenate([row.amplitudes for row in rows]),
        cumulative=np.concatenate([row.cumulative for row in rows]),
        guides=np.array([start + _guide(row.nodes) for start, row in zip(offsets, rows, strict=False)], np.int64),
        material_starts=np.cumsum([0] + [share.size for share in shares], dtype=np.int64),
        shares=np.concatenate(shares),
        shares_cumulative=np.concatenate([_running(share) for share in shares]),
    )
    for array in arrays:
        array.flags.writeable = False
    return arrays


def _running(shares: np.ndarray) -> np.ndarray:
    """Running sum, from the last share above 0 on exactly 1."""
    sums = np.cumsum(shares)
    return sums / sums[-1]


def _guide(nodes: np.ndarray) -> np.ndarray:
    """Last node at or below each of the edges of even cells from 0 to pi."""
    if not nodes.size:
        return np.zeros(_CELLS + 1, np.int64)
    return np.maximum(np.searchsorted(nodes, np.linspace(0, math.pi, _CELLS + 1), side="right") - 1, 0)


@remembered(32)
def walk_lobes(scatterer: Scatterer) -> tuple[Lobe, Lobe]:
    """The phase functions of a scatterer in three dimensions: to scatter by, and to draw first directions from.

    The latter is never much narrower than Henyey and Greenstein's of the same g, so that lights beside the one that
    paths follow find no hole in it.
    """
    components = scatterer.components
    if len(components) == 1 and components[0][0].row(3).kind in ("isotropic", "henyey"):
        row = components[0][0].row(3)
        lobe = closed_lobe(row.parameters[0] if row.kind == "henyey" else 0.0)
        return lobe, lobe
    g = float(np.clip(scatterer.mean_cosine(3), -0.99999, 0.99999))

    def density(v: np.ndarray) -> np.ndarray:
        each = [share * np.square(np.abs(particle.amplitude(1 - v))) for particle, share in components]
        return 2 * np.pi * np.sum(each, axis=0)

    def broader(v: np.ndarray) -> np.ndarray:
        base = (1 - g) ** 2 + 2 * g * v
        return (1 - _SPREAD) * density(v) + _SPREAD * 0.5 * (1 - g * g) / base**1.5

    row = components[0][0].row(3)
    kappa = row.parameters[0] if len(components) == 1 and row.kind == "fisher" else 0.0
    return _tabulated(density)._replace(g=kappa if kappa > 1 else 0.0), _tabulated(broader)


def common_lobe(materials: tuple[Scatterer, ...], dimension: int) -> Lobe | None:
    """The phase function by which all of a medium scatters, where it has three dimensions and one material."""
    return walk_lobes(materials[0])[0] if dimension == 3 and len(materials) == 1 else None


def closed_lobe(g: float) -> Lobe:
    """Henyey-Greenstein phase function as read-only arrays like those of tables: walks then compile once."""
    return Lobe(g, *map(read_only, (np.empty((0, 4)), np.empty(0, np.int32), np.zeros(2, np.int64))))


def _tabulated(density: Callable[[np.ndarray], np.ndarray]) -> Lobe:
    """Tabulate a density of v = 1 - cos on nodes whose bits are evenly spaced, as closely as ``LOBE_ERROR`` asks."""
    lowest = _lowest_octave(density)
    nodes, places = _nodes(lowest, _OCTAVE[0])
    at = density(nodes)
    for log_nodes in _OCTAVE:
        nodes, places = _nodes(lowest, log_nodes)
        at = density(nodes)
        middles = (nodes[:-1] + nodes[1:]) / 2
        missed = np.abs(density(middles) - (at[:-1] + at[1:]) / 2)
        # Of a smooth density a third of the gap at the middles is the mean over a bin of what the line is off.
        if 2 / 3 * float(missed @ np.diff(nodes)) <= LOBE_ERROR:
            break
    shares = (at[:-1] + at[1:]) / 2 * np.diff(nodes)
    at = at / math.fsum(shares)
    rows = np.zeros((len(nodes), 4))
    rows[:, lobes.NODE], rows[:, lobes.DENSITY] = nodes, at
    rows[:-1, lobes.SLOPE] = np.diff(at) / np.diff(nodes)
    rows[1:, lobes.BELOW] = _running(shares)
    cells = 2 ** math.ceil(math.log2(2 * len(nodes)))
    guide = np.searchsorted(rows[:, lobes.BELOW], np.arange(cells) / cells, side="right") - 1
    arrays = rows, np.minimum(guide, len(nodes) - 2).astype(np.int32), places
    return Lobe(0.0, *map(read_only, arrays))


def _lowest_octave(density: Callable[[np.ndarray], np.ndarray]) -> int:
    """log2 of the v below which a density is straight."""
    for exponent in range(-2, -60, -1):
        v = np.array([0.0, 0.25, 0.5, 0.75, 1.0]) * 2.0**exponent
        f = density(v)
        if np.abs(f - np.linspace(f[0], f[-1], 5)).max() * 2.0**exponent < 0.1 * LOBE_ERROR:
            return exponent
    return -60


def _nodes(lowest: int, log_nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes: 0 and ``2^log_nodes`` numbers an octave from ``2^lowest`` to 2; bits of the first, log2 of the step."""
    first = np.float64(2.0**lowest).view(np.int64)
    step = 52 - log_nodes
    count = (1 - lowest) * 2**log_nodes + 1
    bits = first + (np.arange(count, dtype=np.int64) << step)
    return np.append(0.0, bits.view(np.float64)), np.array([first, step], np.int64)
