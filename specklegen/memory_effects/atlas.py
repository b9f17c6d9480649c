"""Memory-effect lookup tables: K of Henyey-Greenstein and von Mises-Fisher slabs, in microseconds.

K of an infinite slab depends on q times its thickness, its optical depth, its phase function and albedo, and on nothing
else. The phase function of one family is fixed by g, but phase functions of equal g and different families have memory
effects of their own: each family has its tables. A table holds, at nodes of these three, the quantiles of r /
thickness, the lateral distance of multiply scattered light, and its intensity. Between nodes both are interpolated by
cubic polynomials:

    K(q) = s + (1 - s) sum_n p_n J0(q r_n),     p_n >= 0 fixed, r_n = thickness exp(interpolated ln r_n)

Whatever the interpolated radii are, this is a mixture of J0 with non-negative weights, so it is positive
semidefinite for any set of tilts, is 1 at q = 0 and has no end. Single scattering is exact: its intensity
per unit area is albedo OD e^-OD rho(0), at r = 0.  scripts/build/make_atlas.py made the tables; docs/atlas.md.
"""

import hashlib
import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import NamedTuple

import numpy as np

from specklegen.core.values import remembered
from specklegen.memory_effects.cached import axial_correlation
from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.scene.media import PlaneMedium, Slab, as_slab
from specklegen.scene.scatterers import Scatterer, VonMisesFisher

TOLERANCE = 0.01
HENYEY_GREENSTEIN, FORWARD, VON_MISES_FISHER = "henyey-greenstein", "henyey-greenstein-forward", "von-mises-fisher"
TABLES = {
    "HenyeyGreenstein": (HENYEY_GREENSTEIN, FORWARD),
    "Isotropic": (HENYEY_GREENSTEIN,),
    "VonMisesFisher": (VON_MISES_FISHER,),
}
"""Tables of each type of scatterer; the first that holds a slab serves it."""


class Errors(NamedTuple):
    """Bounds of a correlation's errors: two standard errors of the paths plus the error of interpolation."""

    correlation: float
    """Of C_I, at the worst q."""
    intensity: float
    """Of ln(intensity)."""
    half_range: float
    """Of ln(half range)."""


def mean_order(depth, drop):
    """Vertices of a transmitted path, about: OD straight through, ``OD^2 drop / 2`` by diffusion, ``drop = 1 - g``."""
    return depth * (1 + 0.5 * depth * drop)


def absorption_coordinate(loss, depth, drop):
    """Table's third axis from ``loss`` = -ln(albedo): linear in weak absorption, in its square root in strong."""
    return math.sqrt(1 + loss * mean_order(depth, drop)) - 1


def loss_at(coordinate, depth, drop):
    """-ln(albedo) at a coordinate: inverse of :func:`absorption_coordinate`."""
    return ((1 + coordinate) ** 2 - 1) / mean_order(depth, drop)


def single_intensity(depth, albedo, scatterer: Scatterer):
    """Intensity of single scattering along the axis per unit area: albedo OD e^-OD rho(0)."""
    if isinstance(scatterer, VonMisesFisher):
        return albedo * depth * np.exp(-depth) * scatterer.forward_power()
    drop = 1 - scatterer.mean_cosine()
    return albedo * depth * np.exp(-depth) * (2 - drop) / (4 * np.pi * drop**2)


@dataclass(frozen=True)
class Atlas:
    """The table.

    Attributes
    ----------
    depths : float64[D]
        Optical depths, ascending.
    drops : float64[G]
        1 - g, ascending.
    absorptions : float64[A]
        Absorption coordinates, ascending from 0.
    shares : float64[n]
        Share of multiply scattered light in each quantile bin.
    table : float32[D, G, A, n + 1]
        ln(root mean square r / thickness) of each bin; last, ln(intensity / albedo^2) of multiple scattering.
    bounds : float32[D - 1, G - 1, A - 1, 3]
        :class:`Errors` of each cell between nodes.
    """

    depths: np.ndarray
    drops: np.ndarray
    absorptions: np.ndarray
    shares: np.ndarray
    table: np.ndarray
    bounds: np.ndarray

    @cached_property
    def axes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes along the coordinates ln(optical depth), ln(1 - g), absorption."""
        return np.log(self.depths), np.log(self.drops), self.absorptions

    def place(self, slab: Slab) -> tuple[float, float, float] | None:
        """Coordinates of a slab, of the family that the table is for; None outside it, and where faces reflect."""
        if not slab.faces.matched or slab.polarisation != "scalar":
            return None
        depth, drop = slab.optical_depth, _drop(slab.scatterer)
        if depth <= 0 or slab.albedo <= 0:
            return None
        place = (math.log(depth), math.log(drop), absorption_coordinate(-math.log(slab.albedo), depth, drop))
        inside = all(nodes[0] <= x <= nodes[-1] for x, nodes in zip(place, self.axes, strict=True))
        return place if inside else None

    def errors(self, place: tuple[float, float, float]) -> Errors:
        """Errors of the cell at a place."""
        cell = (min(_below(x, nodes), len(nodes) - 2) for x, nodes in zip(place, self.axes, strict=True))
        return Errors(*self.bounds[tuple(cell)].tolist())

    def row(self, place: tuple[float, float, float]) -> np.ndarray:
        """Interpolated row of the table, float64[n + 1]."""
        (i, a), (j, b), (k, c) = (stencil(x, nodes) for x, nodes in zip(place, self.axes, strict=True))
        block = self.table[i : i + 4, j : j + 4, k : k + 4]
        weights = (a[:, None, None] * b[:, None] * c).reshape(-1)
        return weights @ block.reshape(64, -1)

    def of(self, slab: Slab, place: tuple[float, float, float]) -> MemoryEffectCorrelation:
        """K of a slab at a place."""
        row = self.row(place)
        albedo = slab.albedo
        single = single_intensity(slab.optical_depth, albedo, slab.scatterer)
        multiple = albedo**2 * np.exp(row[-1])
        radius = np.empty(len(row))
        radius[0] = 0.0
        radius[1:] = slab.thickness * np.exp(row[:-1])
        weights = np.empty((1, len(row)))
        weights[0, 0] = single
        weights[0, 1:] = multiple * self.shares
        return MemoryEffectCorrelation(
            radius=radius, weights=weights, paths=1, single_share=float(single / (single + multiple)), source="atlas",
            stated_error=0.5 * self.errors(place).correlation,
        )  # fmt: skip


def _below(x: float, nodes: np.ndarray) -> int:
    """Number of the last node at or below x."""
    return int(nodes.searchsorted(x, side="right")) - 1


def stencil(x: float, nodes: np.ndarray) -> tuple[int, np.ndarray]:
    """First of the four nodes about x, and Lagrange's cubic weights float64[4] on them; exact at nodes."""
    first = min(max(_below(x, nodes) - 1, 0), len(nodes) - 4)
    a, b, c, d = nodes[first : first + 4].tolist()
    t, u, v, w = x - a, x - b, x - c, x - d
    return first, np.array([
        u * v * w / ((a - b) * (a - c) * (a - d)),
        t * v * w / ((b - a) * (b - c) * (b - d)),
        t * u * w / ((c - a) * (c - b) * (c - d)),
        t * u * v / ((d - a) * (d - b) * (d - c)),
    ])  # fmt: skip


@lru_cache(maxsize=len(TABLES))
def load(table: str = HENYEY_GREENSTEIN) -> Atlas:
    """Read a packaged table, once."""
    with file_of(table).open("rb") as file, np.load(file, allow_pickle=False) as data:
        return Atlas(**{name: data[name] for name in data.files})


def file_of(table: str) -> Traversable:
    """Path of a packaged table."""
    return files("specklegen") / f"data/atlas-{table}.npz"


def atlas_digest(slabs: Iterable[Slab]) -> str:
    """SHA-256, in hexadecimal, of the tables for phase functions between the least and most forward of these.

    Other tables make other pixels.
    """
    slabs = list(slabs)
    drops = [_drop(slab.scatterer) for slab in slabs]
    families = {table: None for slab in slabs for table in TABLES.get(slab.scatterer.type, ())}
    digest = hashlib.sha256()
    for table in families:
        nodes = load(table).drops
        if nodes[0] <= max(drops) and min(drops) <= nodes[-1]:
            digest.update(file_of(table).read_bytes())
    return digest.hexdigest()


def _drop(scatterer: Scatterer) -> float:
    """1 - g."""
    return 1 - scatterer.mean_cosine()


def _placed(medium: PlaneMedium) -> tuple[Slab, Atlas, tuple[float, float, float]] | None:
    """The slab that a medium is, the table that holds it, and its place there; None where there is none."""
    slab = as_slab(medium)
    if slab is None:
        return None
    for table in TABLES.get(slab.scatterer.type, ()):
        place = load(table).place(slab)
        if place is not None:
            return slab, load(table), place
    return None


@remembered(64)
def atlas_errors(medium: PlaneMedium) -> Errors | None:
    """Errors of the lookup table at a slab; None where it is outside the tables, and of layers that are no slab."""
    placed = _placed(medium)
    return None if placed is None else placed[1].errors(placed[2])


def atlas_correlation(medium: PlaneMedium, tolerance: float = TOLERANCE) -> MemoryEffectCorrelation | None:
    """K of a slab from the lookup table, on the axis in transmission.

    Parameters
    ----------
    medium
        The slab, with any thickness; or layers, of which it knows those that are alike.
    tolerance
        Largest error of C_I = |K|^2 wanted at any q.

    Returns
    -------
    correlation
        With one row of weights: radii of r, and the intensity per unit area among them. None outside the
        tables, and where the table's stated error is above the tolerance.
    """
    placed = _placed(medium)
    if placed is None:
        return None
    slab, atlas, place = placed
    return atlas.of(slab, place) if atlas.errors(place).correlation <= tolerance else None


def correlation_for(slab: Slab, *, paths: int = 100_000, tolerance: float = TOLERANCE) -> MemoryEffectCorrelation:
    """K of a slab from where it is cheapest: the lookup table, or ``paths`` paths, which are cached.

    A function of the material alone: an estimate's seed is the slab in units of its thickness, and the cache returns
    its bits. ``source`` of the result is ``"atlas"`` or ``"estimate"``.

    Parameters
    ----------
    slab
        The slab.
    paths
        Paths of an estimate, where one is needed.
    tolerance
        Largest error of C_I with which the lookup table will do; 0 leaves it out.
    """
    correlation = atlas_correlation(slab, tolerance)
    return axial_correlation(slab, paths) if correlation is None else correlation
