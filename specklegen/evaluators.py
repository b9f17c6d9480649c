"""Which evaluator sums a scene's connections on a regular grid: the NUFFT, in how many tiles, or the direct sum."""

from specklegen.chunks import Chunks
from specklegen.costs import direct_operations, nufft_operations, seconds
from specklegen.fields.ends import Optics
from specklegen.fields.nufft import NufftEvaluator, build_evaluator, together
from specklegen.fields.tiling import tilings
from specklegen.fields.view_factor import constant_factor
from specklegen.parallel import one_blas_thread
from specklegen.pilots import scene_pilot
from specklegen.scene import Scene
from specklegen.sensors import FarFieldGrid
from specklegen.values import remembered

_PATHS = 100_000
"""For which costs are compared: a fixed number, so that every run of a scene sums its fields the same way."""


@remembered(64)
def scene_evaluator(scene: Scene, reverse: bool, tolerance: float) -> NufftEvaluator | None:
    """NUFFT with the cheapest tiles, by counted operations.

    Ever smaller tiles are tried until they cost more than the best before, or than the direct sum, be their rank as
    low as can be; None where none is possible within the tolerance and cheaper than that.
    """
    assert isinstance(scene.sensor, FarFieldGrid)
    pilot, optics = scene_pilot(scene, reverse), Optics.of_scene(scene)
    tilts = len(scene.beams.directions)
    rows, columns = scene.sensor.shape
    per_path = len(pilot.bank) / max(pilot.bank.count, 1)
    connections = _PATHS * per_path

    def cost(evaluator: NufftEvaluator) -> float:
        chunks = Chunks(_PATHS, per_path, evaluator.points).count
        return seconds(nufft_operations(evaluator, tilts, connections, chunks), 1)

    best, least = None, seconds(direct_operations(tilts, connections, rows * columns), 1)
    with one_blas_thread():
        for tiling in tilings(scene.sensor):
            flat = constant_factor(tiling)
            if cost(NufftEvaluator(tiling, flat, None, 0.0, tolerance)) >= least:
                break
            found = build_evaluator(pilot.bank, optics, scene.sensor, tolerance, tiling)
            if found is None:
                continue
            found = min(filter(None, (found, together(found, optics))), key=cost)
            if cost(found) < least:
                best, least = found, cost(found)
            elif best is not None:
                break
    return best
