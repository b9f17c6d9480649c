"""Which summation sums a scene's connections on a regular grid: the NUFFT, in how many tiles, or the direct sum."""

from bisect import bisect_left
from dataclasses import dataclass, replace

import numpy as np

from specklegen.core.cached_results import cached_result
from specklegen.core.decision import Decision
from specklegen.core.nanoseconds import seconds
from specklegen.core.parallel import one_blas_thread
from specklegen.core.values import remembered
from specklegen.paths.chunks import Chunks
from specklegen.paths.pilot import Pilot, scene_pilot
from specklegen.samplers.path_sums.cost import direct_operations, nufft_operations
from specklegen.samplers.path_sums.direct import is_plain_slab
from specklegen.samplers.path_sums.nufft import NufftPlan, build_nufft_plan, together
from specklegen.samplers.path_sums.tiling import Tiling, tilings
from specklegen.samplers.path_sums.view_factor import MAX_RANK, ViewFactor, constant_factor
from specklegen.scene.scene import Scene

_PATHS = 100_000
"""For which costs are compared: a fixed number, so that every run of a scene sums its fields the same way."""


@dataclass(frozen=True)
class _Factors:
    """A :class:`NufftPlan` without the grid and the tolerance, which are the scene's and the caller's."""

    shape: tuple[int, int]
    multiple: ViewFactor
    single: ViewFactor | None
    single_share: float


@remembered(64)
def scene_nufft(scene: Scene, reverse: bool, tolerance: float) -> NufftPlan | None:
    """NUFFT with the cheapest tiles, by counted operations.

    Ever smaller tiles are tried until they cost more than the best before, or than the direct sum, be their rank as
    low as can be; None where none is possible within the tolerance and cheaper than that.
    """
    about = ("view factors", scene, reverse, tolerance)
    found = cached_result(_Factors | None, about, lambda: _factors(_cheapest_tiles(scene, reverse, tolerance)))
    if found is None:
        return None
    return NufftPlan(Tiling(scene.grid, found.shape), found.multiple, found.single, found.single_share, tolerance)


def _factors(best: NufftPlan | None) -> _Factors | None:
    """Cached part of a plan."""
    return None if best is None else _Factors(best.tiling.shape, best.multiple, best.single, best.single_share)


def _cheapest_tiles(scene: Scene, reverse: bool, tolerance: float) -> NufftPlan | None:
    """Search of :func:`scene_nufft`."""
    pilot = scene_pilot(scene, reverse)
    layout = pilot.tracer.layout
    tilts = len(scene.beams.directions)
    rows, columns = scene.sensor.shape
    per_path = pilot.connections_per_path
    connections = _PATHS * per_path
    at_once = 1 if layout.middle is not None else tilts  # lights that see the same connections

    def cost(summation: NufftPlan) -> float:
        chunks = Chunks(_PATHS, per_path, summation.points).count
        return seconds(nufft_operations(summation, at_once, connections, chunks), 1)

    best, least = None, seconds(direct_operations(at_once, connections, rows * columns, is_plain_slab(layout)), 1)
    share = float(np.mean(pilot.bank.orders == 1)) if len(pilot.bank) else 0.0

    def least_cost(tiling: Tiling, rank: int) -> float:
        """Least seconds of tiles on which multiple scattering takes so many terms; the rest joins it or takes one."""
        flat = constant_factor(tiling)
        terms = replace(flat, steps=np.zeros((rank, 2)))
        return min(cost(NufftPlan(tiling, terms, single, share, tolerance)) for single in (None, flat))

    with one_blas_thread():
        for tiling in tilings(scene.grid):
            if least_cost(tiling, 1) >= least:
                break
            most = bisect_left(range(2, MAX_RANK + 1), least, key=lambda rank: least_cost(tiling, rank)) + 1
            candidate = build_nufft_plan(layout, pilot.bank, scene.grid, tolerance, tiling, most)
            if candidate is not None:
                candidate = min(filter(None, (candidate, together(layout, candidate))), key=cost)
                if cost(candidate) < least:
                    best, least = candidate, cost(candidate)
                    continue
            if best is not None:
                break
    return best


def summation_decision(
    scene: Scene, pilot: Pilot, tolerance: float, reverse: bool
) -> tuple[NufftPlan | None, Decision]:
    """The NUFFT summation where it is possible and cheaper than the direct sum, and why."""
    part = "NUFFT summation"
    if scene.sensor.regular_grid is None:
        return None, Decision(part, False, "needs a regular far-field grid; the direct sum serves any directions")
    if scene.polarisers is not None:
        return None, Decision(part, False, "polarised light is summed directly")
    if reverse:
        return None, Decision(part, False, "reversed paths are summed directly")
    if not pilot.connections:
        return None, Decision(part, False, "nothing scatters")
    nufft = scene_nufft(scene, reverse, tolerance)
    if nufft is None:
        rows, columns = scene.sensor.shape
        return None, Decision(part, False, f"the direct sum of {rows * columns} views is faster")
    rows, columns = nufft.tiling.counts
    tiles = "" if nufft.tiles == 1 else f" in {rows}x{columns} tiles"
    return nufft, Decision(
        part, True, f"rank {nufft.rank}{tiles} at a relative field error of {nufft.error:.1g} on held-out connections"
    )
