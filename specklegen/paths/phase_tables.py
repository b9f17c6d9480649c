"""Scatterers as arrays: the :class:`~specklegen.kernels.phase_table.PhaseTable` that kernels read."""

import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss

from specklegen.core.errors import reject
from specklegen.core.values import remembered
from specklegen.kernels import phase_table as table
from specklegen.kernels.phase_table import PhaseTable
from specklegen.scene.scatterers.closed_form import Dimensions, all_directions
from specklegen.scene.scatterers.scatterer import (
    HenyeyGreenstein,
    Isotropic,
    Mie,
    Particle,
    Scatterer,
    Tabulated,
    VonMisesFisher,
    components,
)


class _Row(NamedTuple):
    """One particle type: its kind, two parameters, and its bins of theta if it is drawn from any."""

    kind: int
    parameters: tuple[float, float]
    nodes: np.ndarray = np.empty(0)
    amplitudes: np.ndarray = np.empty(0, np.complex128)
    cumulative: np.ndarray = np.empty(0)


@remembered(32)
def phase_table(materials: tuple[Scatterer, ...], dimensions: Dimensions) -> PhaseTable:
    """Lay out the particle types of some materials for the kernels, in order; arrays are read-only.

    Raises
    ------
    RuleError
        If ``dimensions`` is neither 2 nor 3, or a particle has no meaning in that many.
    """
    if dimensions not in (2, 3):
        reject("phase_table dimensions", "2 or 3", dimensions)
    parts = [components(material) for material in materials]
    rows = [_row(particle, dimensions) for types, _ in parts for particle in types]
    shares = [np.array(fractions) / math.fsum(fractions) for _, fractions in parts]
    arrays = PhaseTable(
        kinds=np.array([row.kind for row in rows], np.int64),
        parameters=np.array([row.parameters for row in rows], np.float64),
        offsets=np.cumsum([0] + [row.nodes.size for row in rows], dtype=np.int64),
        nodes=np.concatenate([row.nodes for row in rows]),
        amplitudes=np.concatenate([row.amplitudes for row in rows]),
        cumulative=np.concatenate([row.cumulative for row in rows]),
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


def _row(particle: Particle, dimensions: Dimensions) -> _Row:
    flat = dimensions == 2
    match particle:
        case Isotropic():
            power = 1 / all_directions(dimensions)
            return _Row(table.ISOTROPIC_2D if flat else table.ISOTROPIC_3D, (power, math.sqrt(power)))
        case HenyeyGreenstein(g=g):
            return _Row(table.HENYEY_2D if flat else table.HENYEY_3D, (g, 0.0))
        case VonMisesFisher():
            parameters = (particle.concentration, particle.forward_power(dimensions))
            if not flat:
                return _Row(table.FISHER_3D, parameters)
            return _Row(table.FISHER_2D, parameters, *_fisher_bins(particle.concentration))
        case Tabulated() | Mie():
            bins = particle.bins(dimensions)
            cumulative = _running(np.append(0.0, bins.power))
            return _Row(table.TABULATED_2D if flat else table.TABULATED_3D, (0.0, 0.0), *bins[:2], cumulative)


def _fisher_bins(concentration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bins of a von Mises lobe, up to the angle beyond which less than e^-100 of it is left.

    So narrow that five points of Gauss and Legendre find the place in a bin to 2e-14, but for the last 3e-9 of the
    light at either side (2e-11 at the very edge).
    """
    nodes = np.linspace(0.0, 2 * math.asin(math.sqrt(min(1.0, 50 / concentration))), 129)
    x, w = leggauss(12)
    theta = (nodes[:-1] + nodes[1:])[:, None] / 2 + np.diff(nodes)[:, None] / 2 * x
    shares = np.exp(-2 * concentration * np.sin(theta / 2) ** 2) @ w
    return nodes, np.zeros(nodes.size, np.complex128), _running(np.append(0.0, shares))
