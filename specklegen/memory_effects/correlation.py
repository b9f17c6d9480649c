"""The memory-effect correlation K of a wide slab at normal incidence.

    K(q) = E[w J0(q r)] / E[w],     C_I = |K|^2                           [Bar19] sec. 6; physics.md 5

with r the lateral distance from a path's entrance to its exit, w the contribution of its connection and q
= k times the difference of two tilts' direction sines. K is stored as what it is, a distribution of r:
a histogram on a geometric grid, one row per independent batch. It has no end (no table to run off), it is
positive semidefinite for any set of tilts, and its errors are those of the batches.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
from scipy.special import j0

from specklegen.core.parallel import map_blocks
from specklegen.core.random_streams import Seed
from specklegen.core.statistics import BATCHES, jackknife
from specklegen.core.values import remembered
from specklegen.kernels.bessel import bessel_mixture
from specklegen.paths.analog_walk import axial_light
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.endpoints import AXIS
from specklegen.paths.rare_paths import Implied, implied_error
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.paths.steps import inside_share, refracting_layers
from specklegen.paths.tracer import plane_tracer
from specklegen.scene.media import PlaneMedium
from specklegen.scene.polarisation import require_scalar

RADIUS_BINS = 640
"""Bins of lateral distances."""
_AT_ONCE = 2**13  # q's
SCAN_STEP, SCAN_POINTS, SCAN_MOST = 1.25, 16, 64
ROOT_NODES = (1 + 1 / SCAN_STEP) / 2 - (1 - 1 / SCAN_STEP) / 2 * np.cos(np.pi * (np.arange(6) + 0.5) / 6)
"""Chebyshev's nodes from 1 / SCAN_STEP to 1."""
ROOT_STEP = 1e-4


@dataclass(frozen=True)
class MemoryEffectCorrelation:
    """K as a distribution of lateral distances.

    Attributes
    ----------
    radius : float64[n]
        Root mean square distance of each bin; 0 for single scattering.
    weights : float64[batches, n]
        Contribution that each batch found in each bin.
    paths : int
        What to divide the sum of the weights by for the intensity per unit area: the paths behind them.
    single_share : float
        Share of single scattering in the intensity.
    source : "estimate", "atlas" or "closed form"
        Where the kernel comes from: paths, the table of materials, a formula.
    stated_error : float
        Standard error of C_I at its worst q, where it is not to be had from batches; else NaN.
    """

    isotropic: ClassVar[bool] = True
    """Whether K depends on |q| alone."""
    radius: np.ndarray
    weights: np.ndarray
    paths: int
    single_share: float
    source: Literal["estimate", "atlas", "closed form"] = "estimate"
    stated_error: float = float("nan")

    def __call__(self, q: np.ndarray | float) -> np.ndarray:
        """K at lateral wavevector differences q (radians per unit length), any shape; K(0) = 1."""
        q = np.asarray(q, dtype=np.float64)
        values = np.empty(q.size)
        bessel_mixture(np.ascontiguousarray(q).reshape(-1), *self._mixture, values)
        return values.reshape(q.shape)

    @cached_property
    def _mixture(self) -> tuple[np.ndarray, np.ndarray]:
        """Radii with light, and their shares."""
        share = self.weights.sum(axis=0)
        used = share > 0
        return self.radius[used], share[used] / share[used].sum()

    def matrix(self, sines: np.ndarray, wavenumber: float) -> np.ndarray:
        """Matrix float64[T, T] of K between beams at direction sines float64[T, 2]; positive semidefinite."""
        difference = sines[:, None, :] - sines[None, :, :]
        q = wavenumber * np.hypot(difference[..., 0], difference[..., 1])
        unique, inverse = np.unique(q, return_inverse=True)
        return self(unique)[inverse].reshape(q.shape)

    def intensity(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """C_I = |K|^2 without bias, 1 - C_I to full relative precision, and their standard error, at q float64[T].

        Of a single batch the error is ``stated_error``, at most 1 - C_I itself.
        """
        q = np.asarray(q, dtype=np.float64)
        # E[w (1 - J0)] of the batches, [batches, T].
        parts = [q[start : start + _AT_ONCE, None] for start in range(0, max(len(q), 1), _AT_ONCE)]
        lost = np.concatenate([self.weights @ self._lost(part).T for part in parts], axis=1)
        sums = np.concatenate([lost, self.weights.sum(axis=1, keepdims=True)], axis=1)

        def decorrelation(total: np.ndarray) -> np.ndarray:
            delta = total[:-1] / total[-1]
            return delta * (2 - delta)

        value, error = jackknife(sums, decorrelation)
        if len(self.weights) == 1:
            error = np.minimum(self.stated_error, np.abs(value))
        return 1 - value, value, error

    def _lost(self, q: np.ndarray) -> np.ndarray:
        """Loss of the field correlation in each bin, 1 - J0(q r), float64[..., n] at q float64[..., 1]."""
        return _one_minus_bessel(q, self.radius)

    def implied_error(self, medium: PlaneMedium, q: np.ndarray) -> Implied:
        """Error of K at q float64[T] that the phase function of its medium implies."""
        off = np.square(self(q)[:, None] - 1 + self._lost(q[:, None]))
        share = self.weights.sum(axis=0)
        return implied_error(medium, float(share.sum()), self.weights @ off.T, np.square(off) @ share)

    def half_range(self, share: float = 0.5) -> float:
        """Half range q at which (C_I - floor)/(1 - floor) falls to ``share``; the floor is (single share)^2.

        A half range need not exist for thin forward-scattering slabs in the sense of C_I = 1/2; in this
        sense, above the floor, it does unless all light is singly scattered (then infinite).
        """
        floor = self.single_share**2
        if floor > 1 - 1e-9:
            return float("inf")
        level = np.sqrt(floor + share * (1 - floor))  # K falls through it first where C_I does
        # 1 - K <= q^2 <r^2> / 4: nothing falls to the level before.
        start = 1.999 * np.sqrt((1 - level) / self.mean_square_radius)
        for first in range(0, SCAN_MOST, SCAN_POINTS):
            q = start * SCAN_STEP ** np.arange(first, first + SCAN_POINTS)
            below = np.flatnonzero(self(q) < level)
            if len(below):
                return self._root(q[below[0]], level)
        return float("inf")

    def _root(self, high: float, level: float) -> float:
        """Return q at which K falls to a level, between high / SCAN_STEP and high: by interpolation and a Newton step.

        Six nodes are off by some 1e-6, the step then by the square of that.
        """
        q = high * ROOT_NODES
        root = float(inverse_interpolation(q, self(q), level))
        below, at, above = self(root * np.array([1 - ROOT_STEP, 1.0, 1 + ROOT_STEP]))
        return root * (1 + 2 * ROOT_STEP * float((at - level) / (below - above)))

    @property
    def mean_square_radius(self) -> float:
        """Return ``<r^2>_w``, which sets ``C_I = 1 - q^2 <r^2>/2`` at small tilts."""
        share = self.weights.sum(axis=0)
        return float((share * self.radius**2).sum() / share.sum())


def inverse_interpolation(x, y, level):
    """Return x at which a falling function has a level, by Lagrange's polynomial of x in y float64[..., n]."""
    total = 0.0
    for i in range(x.shape[-1]):
        weight = x[..., i]
        for j in range(x.shape[-1]):
            if i != j:
                weight = weight * ((level - y[..., j]) / (y[..., i] - y[..., j]))
        total = total + weight
    return total


def _one_minus_bessel(q: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """1 - J0(q r) without cancellation at small arguments."""
    x = q * radius
    square = 0.25 * x * x
    series = square * (1 - square / 4 * (1 - square / 9 * (1 - square / 16)))
    return np.where(x < 0.3, series, 1 - j0(x))


@remembered(64)
def axial_tracer(medium: PlaneMedium, transfer: bool = False) -> SlabTracer:
    """Paths of a plane wave along the axis, seen along the axis; of wavelength 1, which decides nothing.

    ``transfer`` collects what motion needs, along the same paths.
    """
    return plane_tracer(medium, 1.0, AXIS[None], AXIS[None], reverse=False, transfer=transfer)


def estimate_correlation(
    medium: PlaneMedium, paths: int, seed: Seed, *, threads: int | None = None
) -> MemoryEffectCorrelation:
    """Estimate K of a slab in transmission along the axis, from ``paths`` paths in 64 batches.

    K does not depend on the wavelength: q r does.
    """
    require_scalar("estimate_correlation medium", medium)
    if refracting_layers(medium):
        return _of_axial_light(medium, paths, seed, threads)
    tracer = axial_tracer(medium)
    edges = np.log(_told_apart(medium))
    rows = np.zeros((min(BATCHES, max(paths, 1)), RADIUS_BINS))
    bounds = np.linspace(0, paths, len(rows) + 1).astype(int)
    bank = tracer.trace(seed, paths, threads=threads)
    starts = np.searchsorted(bank.paths, bounds)
    radius, weight = np.empty((2, len(bank)))
    place = np.empty(len(bank), np.int64)

    def batch(n: int) -> None:
        part = slice(starts[n], starts[n + 1])
        some = bank.select(part)
        radius[part], weight[part] = lateral_distance(some), contributions(tracer.layout, some)
        place[part] = _bins(radius[part], edges)
        rows[n] = np.bincount(place[part], weight[part], minlength=RADIUS_BINS)

    map_blocks(batch, range(len(rows)), threads)
    return correlation_of_bins(rows, radius, weight, place, weight[bank.orders == 1].sum(), paths)


def _of_axial_light(medium: PlaneMedium, paths: int, seed: Seed, threads: int | None) -> MemoryEffectCorrelation:
    """K of layers that refract, from light that is not aimed (:mod:`specklegen.kernels.analog_walk`)."""
    light, batches = axial_light(medium, paths, seed, threads), min(BATCHES, max(paths, 1))
    weight, once = (inside_share(medium) * each for each in (light.weight, light.once))  # as of a slab between faces
    radius = np.hypot(*light.displacement.T)
    place = radius_bins(medium, radius)
    batch = np.arange(paths) * batches // max(paths, 1)
    rows = np.bincount(batch * RADIUS_BINS + place, weight, batches * RADIUS_BINS).reshape(batches, RADIUS_BINS)
    return correlation_of_bins(rows, radius, weight, place, once.sum(), paths)


def radius_bins(medium: PlaneMedium, radius: np.ndarray) -> np.ndarray:
    """Bin int64[n] of each lateral distance behind a medium, of :data:`RADIUS_BINS`; 0 is that of distance 0 alone."""
    return _bins(radius, np.log(_told_apart(medium)))


def _bins(radius: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Bin int64[n] of each radius, between ``edges`` of its logarithm; 0 is that of radius 0 alone."""
    with np.errstate(divide="ignore"):
        bins = (np.log(radius) - edges[0]) / (edges[1] - edges[0]) * (RADIUS_BINS - 1)
    return np.where(radius > 0, np.clip(bins, 0, RADIUS_BINS - 2) + 1, 0).astype(np.int64)


def correlation_of_bins(
    rows: np.ndarray, radius: np.ndarray, weight: np.ndarray, place: np.ndarray, single: float, paths: int
) -> MemoryEffectCorrelation:
    """K of radii and weights float64[M] in bins int64[M], of which batches hold ``rows`` float64[batches, bins]."""
    squares = np.bincount(place, weight * radius**2, minlength=RADIUS_BINS)
    share = rows.sum(axis=0)
    total = share.sum()
    return MemoryEffectCorrelation(
        radius=np.sqrt(np.divide(squares, share, out=np.zeros(RADIUS_BINS), where=share > 0)), weights=rows,
        paths=paths, single_share=float(single / total) if total else 0.0,
    )  # fmt: skip


def _told_apart(medium: PlaneMedium) -> tuple[float, float]:
    """Smallest and largest radius with a bin of its own.

    Thin forward-scattering slabs need the 1 - g: light that is scattered twice walks about (1 - g) L sideways,
    far less than a transport length.
    """
    drop = min(1.0, 1 - medium.scatterer.mean_cosine())
    thickness = medium.thickness or 1.0  # without depth there is no light, and any bins will do
    return 1e-3 * drop * thickness, 1e3 * (thickness + medium.mean_free_path)


def lateral_distance(bank: PathBank) -> np.ndarray:
    """float64[M], distance between entrance and exit points across the axis."""
    difference = bank.exit[:, :2] - bank.entry[:, :2]
    return np.hypot(difference[:, 0], difference[:, 1])
