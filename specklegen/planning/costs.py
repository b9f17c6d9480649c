"""What a plan costs: counted operations, each times its nanoseconds, and bytes.

``scripts/plan_accuracy.py`` measures both and fits the nanoseconds, those of one core of the machine of the README's
table. They scale predictions; a choice between evaluators rests on this table, never on a clock.
"""

from dataclasses import dataclass

import numpy as np

from specklegen.core.statistics import BATCHES
from specklegen.paths.chunks import CONNECTIONS, Chunks
from specklegen.paths.slab_tracer import BLOCK
from specklegen.samplers.covariance.covariance import COVARIANCE_ELEMENTS, batches_side_by_side
from specklegen.samplers.path_sums.cost import (
    CONNECTIONS_KEPT,
    TILTS_STREAMED,
    direct_operations,
    nufft_operations,
)
from specklegen.samplers.path_sums.nufft import NufftPlan
from specklegen.samplers.path_sums.tiling import MOST_VIEWS, coarsest
from specklegen.samplers.path_sums.volume_field import FIELD_ELEMENTS, VIEWS_AT_ONCE
from specklegen.samplers.stationary.exit_grid import fft_flops, matrix_flops, stack_axes
from specklegen.scene.illumination import PointSources
from specklegen.scene.media import VoxelGrid
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid, NearField

_FIXED = 58 * 2**20  # what compiled kernels, libraries and the plan itself take at the first render
_TORCH = 197 * 2**20  # what importing torch takes, which the stationary sampler does
_SEARCH = 70 * 2**20  # what looking for cheap tiles takes, in vain
_RECORD = 14 * 8 + 20  # bytes of a connection


@dataclass(frozen=True)
class Work:
    """What there is to do for beams through a slab; without ``stationary`` or ``nufft``, the direct sum.

    ``streamed`` where the stack comes piece by piece.
    """

    scene: Scene
    paths: int
    events_per_path: float
    connections_per_path: float
    stationary: bool
    nufft: NufftPlan | None
    reverse: bool
    oblique: bool = False
    streamed: bool = False

    @property
    def chunks(self) -> Chunks:
        """Paths that are traced and summed at a time."""
        return Chunks(self.paths, self.connections_per_path, self.nufft.points if self.nufft else CONNECTIONS)


@dataclass(frozen=True)
class VolumeWork:
    """What there is to do in any geometry; ``ways`` is 2 where paths serve in both directions."""

    scene: Scene
    paths: int
    events_per_path: float
    connections_per_path: float
    ways: int
    covariance: bool

    @property
    def chunks(self) -> Chunks:
        """Paths that are traced and summed at a time."""
        return Chunks(self.paths, self.connections_per_path)


def tracing_operations(work: Work) -> dict[str, float]:
    """Operations to trace the paths alone."""
    return {
        "path": work.paths,
        "event": work.paths * work.events_per_path,
        "connection": work.paths * work.connections_per_path,
    }


def operations(work: Work) -> dict[str, float]:
    """Operations of one realization of a render, its preparation included."""
    views = int(np.prod(work.scene.sensor.shape))
    tilts = len(work.scene.beams.directions)
    connections = work.paths * work.connections_per_path
    tracing = tracing_operations(work)
    if work.stationary:
        return tracing | _stack_operations(work.scene, connections if work.oblique else 0.0)
    if work.streamed and connections > CONNECTIONS_KEPT:
        tracing = {name: _pieces(work) * count for name, count in tracing.items()}
    if work.nufft:
        return tracing | nufft_operations(work.nufft, tilts, connections, work.chunks.count)
    return tracing | direct_operations(tilts, connections * (2 if work.reverse else 1), views)


def _pieces(work: Work) -> int:
    """Tiles and groups of tilts in which path sums are streamed."""
    grid = work.scene.sensor
    assert isinstance(grid, FarFieldGrid)
    rows, columns = (work.nufft.tiling if work.nufft else coarsest(grid)).counts
    return rows * columns * -(-len(work.scene.beams.directions) // TILTS_STREAMED)


def _stack_operations(scene: Scene, phasors: float) -> dict[str, float]:
    """Operations of one stack of the stationary sampler; an object's modes are fewer than its beams, at most these."""
    grid = scene.sensor
    assert isinstance(grid, FarFieldGrid)
    x, y = stack_axes(scene)
    tilts, views = len(scene.beams.directions), np.prod(grid.shape)
    size = x.count * y.count
    return {
        "normal": tilts * size,
        "flop": tilts * (8.0 * tilts * size + min(matrix_flops(x, y, grid.shape), fft_flops(x, y))),
        "stack view": tilts * (views + 4.0 * size),
        "phasor": tilts * phasors,
    }


def volume_operations(work: VolumeWork) -> dict[str, float]:
    """Operations of the first realization of a scene of any geometry."""
    lights, views = len(work.scene.lights), len(work.scene.views)
    connections = work.paths * work.connections_per_path
    pairs = float(lights * views)
    both = connections * work.ways
    events, ends = work.paths * work.events_per_path, both * (lights + views)
    near_lights = isinstance(work.scene.illumination, PointSources)
    near_views = isinstance(work.scene.sensor, NearField)
    medium = work.scene.medium
    crossed = max(medium.extinction.shape) / 2 if isinstance(medium, VoxelGrid) else 0.0
    return {
        "volume path": work.paths,
        "volume event": events,
        "voxel": (events + ends) * crossed,
        "volume connection": connections,
        "volume end": both * (0 if near_lights else lights) + both * (0 if near_views else views),
        "near end": both * (lights if near_lights else 0) + both * (views if near_views else 0),
        "product": both * pairs * (pairs / 2 if work.covariance else 1.0),
        "amplitude": both * pairs if work.covariance else 0.0,
        "batch": min(BATCHES, work.paths) if work.covariance else 0,
    }


def memory_bytes(work: Work, threads: int) -> int:
    """Bytes by which the process grows at most in its first plan and render, of one realization."""
    views = float(np.prod(work.scene.sensor.shape))
    tilts = len(work.scene.beams.directions)
    if work.streamed:
        return _streamed_bytes(work, tilts, threads)
    if work.stationary:
        return int(work.paths * work.connections_per_path * 160 + 8 * views * tilts * 4 + _TORCH + _FIXED)
    connections, bank = work.chunks.connections, work.chunks.connections * _RECORD * 2
    beside = work.chunks.side_by_side(threads, tilts * views)
    if work.nufft:
        per = np.dtype(work.nufft.dtype).itemsize
        tiles = beside if work.nufft.tiles == 1 else threads  # at a time
        tile = tilts * float(np.prod(work.nufft.tiling.shape)) * per
        field = 2 * tilts * views * per + tile * ((work.nufft.rank / 4 + 1) * tiles + threads)
        strengths = 16 * (tilts * beside + work.nufft.rank * tiles) + per * tilts * threads
        return int(bank * 1.5 * beside + connections * strengths + field + _FIXED)
    looked = _SEARCH if isinstance(work.scene.sensor, FarFieldGrid) and not work.reverse else 0
    held = bank + connections * 16 * 2 * tilts + tilts * views * 16 * 2
    return int(held * beside + tilts * views * 16 + looked + _FIXED)


def _streamed_bytes(work: Work, tilts: int, threads: int) -> int:
    """Bytes by which the process grows where one tile, or one tilt, is in work at a time."""
    if work.stationary:
        x, y = stack_axes(work.scene)
        cells, period = float(x.count * y.count), float(x.period * y.period)
        kernel = work.paths * work.connections_per_path * 160
        views = float(np.prod(work.scene.sensor.shape))
        return int(kernel + cells * (8 * tilts + 64) + 8 * 4 * period + 48 * views + _TORCH + _FIXED)
    together = min(tilts, TILTS_STREAMED)
    side = np.minimum(work.scene.sensor.shape, MOST_VIEWS)
    piece = together * float(np.prod(side))
    beside = work.chunks.side_by_side(threads, piece)
    connections, kept = work.chunks.connections, work.paths * work.connections_per_path
    kept = kept if kept <= CONNECTIONS_KEPT else connections * beside
    rank = work.nufft.rank if work.nufft else 0
    ends = connections * (_RECORD * 2 + 16 * (2 * together + rank))
    return int(kept * (_RECORD + 16) + (ends + 16 * piece * (2 + rank / 4)) * beside + 16 * piece + _FIXED)


def volume_memory_bytes(work: VolumeWork, threads: int) -> int:
    """Bytes by which the process grows at most in its first plan and render, of one realization."""
    lights, views = len(work.scene.lights), len(work.scene.views)
    pairs = float(lights * views)
    room = threads * 8 * min(work.paths, BLOCK) * _RECORD
    if work.covariance:
        paths = min(work.paths / BATCHES, 8 * BLOCK)
        amplitudes = min(paths * work.connections_per_path * pairs, COVARIANCE_ELEMENTS)
        beside = batches_side_by_side(int(pairs) ** 2, threads)
        waiting = 32 * pairs**2 * (1 if beside == 1 else 3 * beside)
        held = 3 * 16 * amplitudes + paths * work.connections_per_path * _RECORD
        return int(room + held * beside + waiting + pairs**2 * (16 * 4 + 8 * 3) + _FIXED)
    beside = work.chunks.side_by_side(threads, pairs)
    some = min(work.chunks.connections, FIELD_ELEMENTS / max(lights + views, 1))
    held = 16 * some * lights + work.chunks.connections * _RECORD + pairs * 16 * 2
    return int(room + held * beside + 16 * some * threads * min(views, VIEWS_AT_ONCE) + pairs * 16 + _FIXED)
