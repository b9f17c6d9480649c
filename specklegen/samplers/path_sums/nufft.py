"""Fields on a regular far-field grid by type-1 non-uniform FFTs, tile by tile.

    u_t(v) = sum_m c_t(m) F(m; v) e^(-ik(v - v_c)_xy . y_m),    y_m = x_xy - z v_c,xy / v_c,z

on a tile of views about v_c. The view factor F varies slowly with v (:mod:`specklegen.samplers.path_sums.view_factor`):
through its values at a few skeleton views, the field is a sum over r of P_r times one transform of strengths with the
exact F at v_r. Few views are one tile; a wide field of view is cut until each tile needs a low rank.
"""

import threading
from dataclasses import dataclass, replace

import finufft
import numpy as np

from specklegen.core.parallel import Threads, map_blocks, slices
from specklegen.kernels import sums
from specklegen.kernels.walk import EXIT
from specklegen.paths.bank import PathBank
from specklegen.paths.chunks import CONNECTIONS
from specklegen.paths.displacements import Moved
from specklegen.paths.endpoint_factors import BLOCK, light_strengths, single_factors, turned_over
from specklegen.paths.endpoints import offsets
from specklegen.paths.kept_angles import each_light
from specklegen.paths.layout import Layout
from specklegen.samplers.path_sums.tiling import Tile, Tiling
from specklegen.samplers.path_sums.view_factor import (
    MAX_RANK,
    ViewFactor,
    error_of_single,
    factor_values,
    multiple_factor,
    sagitta,
    seen_exits,
    single_factor,
)
from specklegen.scene.sensors import FarFieldGrid

TILTS_AT_ONCE = 2
_RANKS_AT_ONCE = 4  # skeleton views that share a transform's plan, one after the other
_SORT_FROM = 2**19  # bytes of a transform that no longer stays in the cache: finufft then sorts the points first
_FACTOR_SHARE = 0.7  # of the tolerance for view factors; transforms are asked for the rest
_LOWER_SHARES = (_FACTOR_SHARE / 2, _FACTOR_SHARE / 4, _FACTOR_SHARE / 8)  # for single scattering too
_SINGLE_PRECISION_FROM = 1e-4  # complex64 carries tolerances down to here
_KERNEL = 8  # finufft's number of its prolate kernel
_FINE_GRID_BELOW = 1e-9  # tolerance of a transform up to which its grid is 2 times as fine, not 1.25 times


@dataclass(frozen=True)
class NufftPlan:
    """All that the NUFFT needs to know before the run: tiles, view factors and the tolerance.

    Attributes
    ----------
    single : ViewFactor or None
        None where that of multiple scattering serves single scattering too: both are then transformed at once.
    single_share : float
        Share of single scattering among the connections of the pilot.
    tolerance : float
        Relative field error asked for.
    """

    tiling: Tiling
    multiple: ViewFactor
    single: ViewFactor | None
    single_share: float
    tolerance: float

    @property
    def grid(self) -> FarFieldGrid:
        """All views."""
        return self.tiling.grid

    @property
    def rank(self) -> int:
        """Transforms a tilt and tile."""
        return self.multiple.rank + (self.single.rank if self.single else 0)

    @property
    def spreads(self) -> float:
        """Mean number of transforms a tilt and tile that one connection takes part in."""
        other = self.single or self.multiple
        return self.single_share * other.rank + (1 - self.single_share) * self.multiple.rank

    @property
    def dtype(self) -> type:
        """Precision of the field."""
        return np.complex64 if self.tolerance >= _SINGLE_PRECISION_FROM else np.complex128

    @property
    def tiles(self) -> int:
        """Number of tiles."""
        rows, columns = self.tiling.counts
        return rows * columns

    @property
    def points(self) -> int:
        """Connections to transform at a time: on a large grid more, as its transforms cost much beside spreading."""
        return max(CONNECTIONS, int(np.prod(self.tiling.shape)))

    @property
    def error(self) -> float:
        """Relative field error to expect: the decomposition's, measured, and the transform's, asked."""
        return float(np.hypot(self.multiple.error, 0.3 * self.tolerance))


def build_nufft_plan(
    layout: Layout, bank: PathBank, grid: FarFieldGrid, tolerance: float, tiling: Tiling | None = None,
    most: int = MAX_RANK,
) -> NufftPlan | None:  # fmt: skip
    """Decompose a scene's view factors on a pilot bank; None where the tiles (by default, the grid) are too wide.

    Nor is there one where that of multiple scattering takes clearly more than ``most`` terms. Single scattering has a
    view factor of its own, unless the rest's of rank one serves it: nothing is cheaper. Where layers refract, or of
    several types of particles, it cannot have one: the rest's takes more terms then, until it serves both.
    """
    tiling = tiling or Tiling(grid, grid.shape)
    multiple = multiple_factor(layout, bank.multiple, tiling, _FACTOR_SHARE * tolerance, most)
    share = float(np.mean(bank.orders == 1)) if len(bank) else 0.0
    if multiple is None:
        return None
    joined = NufftPlan(tiling, multiple, None, share, tolerance)
    # Layers that refract: connections differ in s(i . v) by their legs. Types: each has an s(i . v) of its own.
    if layout.ways is not None or len(layout.table.kinds) > 1:
        return _joined(layout, bank, joined, most)
    if multiple.rank == 1 and _serves_single(layout, joined):
        return joined
    single = single_factor(layout, tiling, _FACTOR_SHARE * tolerance)
    return None if single is None else replace(joined, single=single)


def _joined(layout: Layout, bank: PathBank, plan: NufftPlan, most: int) -> NufftPlan | None:
    """The plan with as many terms as it takes to serve single scattering too; None where these are too many."""
    for share in _LOWER_SHARES:
        if _serves_single(layout, plan, bank.single):
            return plan
        multiple = multiple_factor(layout, bank.multiple, plan.tiling, share * plan.tolerance, most)
        if multiple is None:
            return None
        plan = replace(plan, multiple=multiple)
    return plan if _serves_single(layout, plan, bank.single) else None


def together(layout: Layout, summation: NufftPlan) -> NufftPlan | None:
    """Copy with single scattering among the rest; None where that leaves the tolerance.

    Nor where faces reflect. It saves the transforms of single scattering, but spreads it at the rank of multiple
    scattering.
    """
    if summation.single is None or not _serves_single(layout, summation):
        return None
    return replace(summation, single=None)


def _serves_single(layout: Layout, summation: NufftPlan, single: PathBank | None = None) -> bool:
    """Return whether the view factor of multiple scattering serves single scattering within the tolerance.

    Behind layers that refract, the connections of ``single`` scattering are what it has to serve.
    """
    if not layout.faces.matched:
        return False  # connections differ in s(i . v) by their reflections
    if layout.ways is None:
        single = None
    elif not single:
        return True
    error = error_of_single(layout, summation.multiple, summation.tiling, single)
    return error <= _FACTOR_SHARE * summation.tolerance


def nufft_field(
    layout: Layout, bank: PathBank, phases: np.ndarray, summation: NufftPlan, *, threads: Threads = None
) -> np.ndarray:
    """Sum over the connections of a bank, complex[T, H, W], divided by the root of the number of paths.

    complex64 for tolerances of 1e-4 and above, complex128 below. Every transform runs on one thread
    (finufft with more is not reproducible); tiles, or transforms of one tile, run side by side.
    """
    field = np.zeros((len(layout.lights), *summation.grid.shape), summation.dtype)
    tiles, plans = summation.tiling.tiles, _Plans()
    inside = threads if len(tiles) == 1 else 1
    for light, own, seen, phased in each_light(layout, bank, phases):
        lights = _lights(own, seen, phased, summation, threads)

        def fill(tile: Tile, light: slice = light, own: Layout = own, lights: list[_Light] = lights) -> None:
            field[light, tile.rows, tile.columns] = _tile_field(own, lights, tile, summation, plans, inside)

        map_blocks(fill, tiles, threads)
    field *= 1 / np.sqrt(max(bank.count, 1))
    return field


def nufft_tile(
    layout: Layout, bank: PathBank, phases: np.ndarray, summation: NufftPlan, tile: Tile, *, threads: Threads = None
) -> np.ndarray:
    """The part of :func:`nufft_field` on one of the summation's tiles, complex[T, h, w]: the same bits."""
    plans = _Plans()
    parts = [
        _tile_field(own, _lights(own, seen, phased, summation, threads), tile, summation, plans, threads)
        for _, own, seen, phased in each_light(layout, bank, phases)
    ]
    field = np.concatenate(parts)
    field *= 1 / np.sqrt(max(bank.count, 1))
    return field


def nufft_frame(
    layout: Layout, bank: PathBank, phases: np.ndarray, summation: NufftPlan, tile: Tile, moved: Moved, *,
    threads: Threads = None,
) -> np.ndarray:  # fmt: skip
    """:func:`nufft_tile` of one light and one frame of a film, complex[1, h, w].

    A particle that has moved by d is seen as one that has moved sideways alone, by d_xy - d_z c_xy / c_z, c the middle
    of the tile: v . d is d_xy . v_xy + d_z v_z, and v_z = (1 - c_xy . v_xy) / c_z to first order about it.
    """
    slope, reference = tile.middle[:2] / tile.middle[2], layout.views.reference
    aside = moved.last[:, :2] - moved.last[:, 2:] * slope
    along = aside @ reference[:2] + moved.last[:, 2] / tile.middle[2]
    records = bank.records.copy()
    records[:, EXIT : EXIT + 2] += aside * (layout.wavelength / (2 * np.pi))
    (seen,) = each_light(layout, bank, phases)
    turned = phases * moved.turns(seen.bank, -layout.lights.vectors[0]) * np.exp(-1j * along)
    return nufft_tile(layout, replace(bank, records=records), turned, summation, tile, threads=threads)


@dataclass(frozen=True)
class _Light:
    """Connections that share a view factor, and what they bring to every tile of views.

    Attributes
    ----------
    strengths : complex128[T, M]
        Illumination ends.
    alone : bool
        Whether these are connections of single scattering alone, whose s(i . v) is left to the end.
    once : int64[...]
        Else, which of them are of single scattering: neither of their endpoint factors holds an s.
    """

    factor: ViewFactor
    bank: PathBank
    strengths: np.ndarray
    alone: bool
    once: np.ndarray


def _lights(layout: Layout, bank: PathBank, phases: np.ndarray, summation: NufftPlan, threads: Threads) -> list[_Light]:
    """All connections, or multiple and single scattering, whichever there are."""
    is_single = bank.orders == 1
    if summation.single is None:
        strengths = light_strengths(layout, bank, phases, threads)
        lights = [_Light(summation.multiple, bank, strengths, False, np.flatnonzero(is_single))]
    else:
        lights, turned = [], turned_over(bank)  # by faces: connections of another s(i . v)
        kinds = (is_single & ~turned, is_single & turned) if turned.any() else (is_single,)
        parts = [(summation.multiple, ~is_single, False), *((summation.single, kind, True) for kind in kinds)]
        for factor, chosen, alone in parts:
            own = bank.select(chosen)
            strengths = light_strengths(layout, own, phases[chosen], threads)
            lights.append(_Light(factor, own, strengths, alone, np.empty(0, np.int64)))
    return [light for light in lights if light.strengths.size]


@dataclass(frozen=True)
class _Load:
    """A :class:`_Light` ready to be transformed onto one tile: M connections, R skeleton views.

    Attributes
    ----------
    points : float[2, M]
        Phases a step of the grid along (y, x).
    sensor : complex128[R, M]
        Sensor ends at the skeleton views, with all that is common to the tile's views.
    coupling : complex128[T, R, n]
        s(i . v_r), a factor of the connections ``light.once``; n is 1 where they share it.
    """

    light: _Light
    points: np.ndarray
    sensor: np.ndarray
    coupling: np.ndarray


def _load(layout: Layout, light: _Light, tile: Tile, summation: NufftPlan, threads: Threads) -> _Load:
    bank, steps, pitch = light.bank, light.factor.steps, summation.grid.pitch
    points = np.empty((2, len(bank)), summation.dtype().real.dtype)
    sensor = np.empty((light.factor.rank, len(bank)), np.complex128)
    slope_x, slope_y = tile.middle[:2] / tile.middle[2]
    offset = offsets(tile.middle.copy(), layout.views.reference, layout.wavelength)

    def fill(part: slice) -> None:
        some, common = bank.select(part), np.empty(part.stop - part.start, np.complex128)
        sums.grid_points(seen_exits(layout, some, tile.middle), pitch / layout.wavelength, slope_x, slope_y, offset,
                         points[0, part], points[1, part], common)  # fmt: skip
        sensor[:, part] = factor_values(layout, some, tile, steps)
        sensor[:, part] *= common

    map_blocks(fill, slices(len(bank), BLOCK), threads)
    once = light.bank.select(light.once)
    coupling = single_factors(layout.of_views(tile.views(steps)), once) if len(once) else np.ones((1, 1, 1))
    return _Load(light, points, sensor, coupling)


def _tile_field(
    layout: Layout, lights: list[_Light], tile: Tile, summation: NufftPlan, plans: "_Plans", threads: Threads
) -> np.ndarray:
    """Field on one tile, complex[T, h, w], times the root of the number of paths."""
    loads = [_load(layout, light, tile, summation, threads) for light in lights]
    # Fixed parts of skeleton views and tilts: the bits must not depend on the number of threads.
    groups = slices(len(layout.lights), TILTS_AT_ONCE)
    parts = [
        (load, ranks, group)
        for load in loads
        for ranks in slices(load.light.factor.rank, _RANKS_AT_ONCE)
        for group in groups
    ]
    transforms = map_blocks(lambda part: _transform(*part, summation, plans), parts, threads)
    field = np.zeros((len(layout.lights), *summation.tiling.shape), summation.dtype)
    x, y = summation.tiling.steps
    steps = np.stack(np.broadcast_arrays(x, y[:, None]), -1)
    bend = np.exp(2j * np.pi * layout.exit_face * sagitta(steps, tile.middle) / layout.wavelength)
    bend = bend.astype(field.dtype)

    def gather(group: slice) -> None:
        for load in loads:
            mine = [t for part, t in zip(parts, transforms, strict=True) if part[0] is load and part[2] == group]
            total = mine[0]
            for transform in mine[1:]:
                total += transform
            if load.light.alone:
                seen = layout.of_lights(group).of_views(tile.views(steps).reshape(-1, 3))
                s = single_factors(seen, load.light.bank)[..., 0]
                total *= s.reshape(total.shape).astype(total.dtype)
            field[group] += total
        field[group] *= bend

    map_blocks(gather, groups, threads)
    return field[:, *tile.kept]


class _Plans(threading.local):
    """Plans of transforms of one shape, those of each thread, which tiles, ranks and tilts use one after the other."""

    def __init__(self) -> None:
        self._plans: dict[int, tuple[finufft.Plan, np.ndarray]] = {}

    def ready(self, count: int, points: np.ndarray, summation: NufftPlan) -> finufft.Plan:
        """Return the plan of so many transforms at once, of points real[2, M] a step of the grid along (y, x)."""
        plan, last = self._plans.get(count, (None, None))
        if plan is None:
            shape, dtype = summation.tiling.shape, np.dtype(summation.dtype)
            tolerance = 0.3 * summation.tolerance
            # Kernel and upsampling are those that finufft 2.5 chooses by itself: another choice differs by the
            # tolerance.
            plan = finufft.Plan(1, shape, n_trans=count, eps=tolerance, isign=-1, dtype=dtype.name, nthreads=1,
                                spread_sort=int(np.prod(shape) * dtype.itemsize > _SORT_FROM),
                                spread_kerformula=_KERNEL,
                                upsampfac=2.0 if tolerance <= _FINE_GRID_BELOW else 1.25)  # fmt: skip
        if last is not points:
            plan.setpts(*points)
            self._plans[count] = plan, points
        return plan


def _transform(load: _Load, ranks: slice, tilts: slice, summation: NufftPlan, plans: _Plans) -> np.ndarray:
    """Contribution of the connections to some terms of the field of some tilts, complex[tilts, h, w]."""
    dtype, shape = np.dtype(summation.dtype), summation.tiling.shape
    strengths = load.light.strengths[tilts]
    plan = plans.ready(len(strengths), load.points, summation)
    total = np.zeros((len(strengths), *shape), dtype)
    for r in range(ranks.start, ranks.stop):
        values = (strengths * load.sensor[r]).astype(dtype)
        if len(load.light.once):
            values[:, load.light.once] *= load.coupling[tilts, r]
        transform = plan.execute(values).reshape(total.shape)
        transform *= load.light.factor.pattern(r).astype(dtype)
        total += transform
    return total
