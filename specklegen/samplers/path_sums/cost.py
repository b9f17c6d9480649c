"""Cost of path sums: counted operations and bytes, through a slab or through anything."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from specklegen.core.nanoseconds import seconds
from specklegen.paths.bank import BLOCK
from specklegen.paths.chunks import CONNECTIONS, Chunks
from specklegen.paths.pilot import Pilot
from specklegen.samplers.path_sums.direct import FIELD_ELEMENTS, VIEWS_AT_ONCE
from specklegen.samplers.path_sums.nufft import TILTS_AT_ONCE, NufftPlan
from specklegen.samplers.path_sums.tiling import MOST_VIEWS, coarsest
from specklegen.samplers.sampler import FIXED_BYTES, RECORD_BYTES, TILTS_STREAMED
from specklegen.scene.polarisation import Polarisation
from specklegen.scene.scene import Scene

CONNECTIONS_KEPT = 2**20  # of a bank between the pieces of a stream; more are traced anew for each
_SEARCH = 70 * 2**20  # what looking for cheap tiles takes, in vain


@dataclass(frozen=True)
class Work:
    """Work of path sums.

    Attributes
    ----------
    lock_step : bool
        Whether the walk is that of beams through a homogeneous slab.
    event : str
        Name of an operation: a scattering event of the tracer.
    nufft : NufftPlan or None
        Without it, the direct sum.
    ways : int
        2 where paths are evaluated in both directions.
    plain : bool
        Whether the direct sum is the fused one of a slab of one closed kind of particle.
    streamed : bool
        Whether the stack comes piece by piece.
    one_by_one : bool
        Whether every light sees connections of its own (:mod:`specklegen.paths.kept_angles`).
    """

    scene: Scene
    paths: int
    events_per_path: float
    connections_per_path: float
    lock_step: bool
    nufft: NufftPlan | None
    ways: int
    plain: bool = True
    streamed: bool = False
    one_by_one: bool = False
    event: str = "event"

    @property
    def polarisation(self) -> Polarisation:
        """Effect of the medium on polarised light."""
        return "scalar" if self.scene.polarisers is None else self.scene.volume.polarisation

    @property
    def chunks(self) -> Chunks:
        """Paths that are traced and summed at a time."""
        return Chunks(self.paths, self.connections_per_path, self.nufft.points if self.nufft else CONNECTIONS)

    @property
    def connections(self) -> float:
        """Connections of all paths."""
        return self.paths * self.connections_per_path

    @property
    def lights(self) -> int:
        """Number of lights."""
        return len(self.scene.lights)

    @property
    def views(self) -> int:
        """Number of views."""
        return int(np.prod(self.scene.sensor.shape))


def nufft_operations(nufft: NufftPlan, tilts: int, connections: float, chunks: int) -> dict[str, float]:
    """Operations to evaluate connections by NUFFT on all tiles, in so many chunks."""
    width = np.ceil(-np.log10(0.3 * nufft.tolerance)) + 1
    precision = np.dtype(nufft.dtype).itemsize // 8
    spreads = nufft.tiles * nufft.spreads * connections
    views = nufft.tiles * float(np.prod(nufft.tiling.shape)) * chunks
    return {
        "end": connections * tilts + spreads,
        "spread": float(spreads * tilts * (width / 5) ** 2 * precision),
        "FFT point": nufft.rank * tilts * 4.0 * views * precision,
        "pattern": nufft.rank * np.ceil(tilts / TILTS_AT_ONCE) * views,
        "phasor": 3 * views,  # of every view from the face, and how far it is off the plane of the grid
    }


_POLARISED: dict[Polarisation, float] = {"scalar": 1.0, "projector": 3.0, "vector": 10.0}
"""Times the time of a scalar end, and the memory, that one of polarised light takes; as measured."""


def direct_operations(tilts: int, connections: float, views: int, plain: bool = True) -> dict[str, float]:
    """Operations to evaluate connections by the direct sum."""
    if not plain:
        return {"end": connections * (tilts + views), "product": connections * tilts * views}
    return {"end": connections * tilts, "direct view": connections * views, "direct tilt": connections * views * tilts}


def least_operations(scene: Scene, pilot: Pilot, paths: int) -> Mapping[str, float]:
    """Operations that a realization takes at least, by its pilot alone, before its sums are looked into."""
    lights, views, connections = len(scene.lights), math.prod(scene.sensor.shape), paths * pilot.connections_per_path
    tracing = {"path": paths, pilot.event: paths * pilot.events_per_path, "connection": connections}
    transformed = {"end": connections * lights, "spread": connections * lights, "FFT point": 4.0 * lights * views}
    summed = direct_operations(lights, connections, views)
    return tracing | min(transformed, summed, key=lambda each: seconds(each, 1))


def tracing_operations(work: Work) -> dict[str, float]:
    """Operations to trace the paths alone."""
    if work.lock_step:
        return {"path": work.paths, work.event: work.paths * work.events_per_path, "connection": work.connections}
    return {
        "volume path": work.paths,
        "volume event": work.paths * work.events_per_path,
        "volume connection": work.connections,
    }


def operations(work: Work) -> dict[str, float]:
    """Operations of one realization of a render, its preparation included."""
    tracing = tracing_operations(work)
    if work.lock_step:
        if work.streamed and work.connections > CONNECTIONS_KEPT:
            tracing = {name: _pieces(work) * count for name, count in tracing.items()}
        moving = work.scene.film
        together, groups = (1, work.lights) if work.one_by_one or moving else (work.lights, 1)
        if work.nufft:
            summation = nufft_operations(work.nufft, together, work.connections, work.chunks.count)
        else:
            both = work.connections * work.ways
            summation = direct_operations(together, both, work.views, work.plain and not moving)
            summation["end"] *= _POLARISED[work.polarisation]
            if moving:
                summation["phasor"] = both * work.views
        if moving:
            summation["moved connection"] = work.connections * work.ways * (work.nufft.tiles if work.nufft else 1)
        return tracing | {name: groups * count for name, count in summation.items()}
    both = work.connections * work.ways
    light, sensor = work.scene.illumination, work.scene.sensor
    near = both * ((work.lights if light.near else 0) + (work.views if sensor.near else 0))
    far = both * (work.lights + work.views) - near
    medium = work.scene.volume
    crossed = 0.0 if medium.homogeneous else max(medium.voxel_counts) / 2
    return tracing | {
        "voxel": (work.paths * work.events_per_path + near + far) * crossed,
        "volume end": far,
        "near end": near,
        "product": both * float(work.lights * work.views),
    }


def _pieces(work: Work) -> int:
    """Tiles and groups of tilts in which path sums are streamed."""
    grid = work.scene.grid
    rows, columns = (work.nufft.tiling if work.nufft else coarsest(grid)).counts
    return rows * columns * -(-work.lights // TILTS_STREAMED)


def memory_bytes(work: Work, threads: int) -> int:
    """Bytes by which the process grows at most in its first plan and render, of one realization."""
    if not work.lock_step:
        return _volume_bytes(work, threads)
    views, tilts = float(work.views), work.lights
    if work.streamed:
        return _streamed_bytes(work, threads)
    connections, bank = work.chunks.connections, work.chunks.connections * RECORD_BYTES * 2
    bank *= 1.5 if work.one_by_one else 1.0
    beside = work.chunks.side_by_side(threads, tilts * views)
    if work.nufft:
        per = np.dtype(work.nufft.dtype).itemsize
        tiles = beside if work.nufft.tiles == 1 else threads  # at a time
        tile = tilts * float(np.prod(work.nufft.tiling.shape)) * per
        field = 2 * tilts * views * per + tile * ((work.nufft.rank / 4 + 1) * tiles + threads)
        strengths = 16 * (tilts * beside + work.nufft.rank * tiles) + per * tilts * threads
        return int(bank * 1.5 * beside + connections * strengths + field + FIXED_BYTES)
    looked = _SEARCH if work.scene.sensor.regular_grid is not None and work.ways == 1 else 0
    held = bank + connections * 16 * 2 * tilts + tilts * views * 16 * 2
    if not work.plain:
        some = min(connections, FIELD_ELEMENTS / max(tilts + views, 1))
        held += 16 * some * min(views, VIEWS_AT_ONCE) * _POLARISED[work.polarisation]
    return int(held * beside + tilts * views * 16 + looked + FIXED_BYTES)


def _streamed_bytes(work: Work, threads: int) -> int:
    """Bytes by which the process grows where one tile is in work at a time."""
    together = min(work.lights, TILTS_STREAMED)
    side = np.minimum(work.scene.sensor.shape, MOST_VIEWS)
    piece = together * float(np.prod(side))
    beside = work.chunks.side_by_side(threads, piece)
    connections, kept = work.chunks.connections, work.connections
    kept = kept if kept <= CONNECTIONS_KEPT else connections * beside
    rank = work.nufft.rank if work.nufft else 0
    ends = connections * (RECORD_BYTES * 2 + 16 * (2 * together + rank))
    return int(kept * (RECORD_BYTES + 16) + (ends + 16 * piece * (2 + rank / 4)) * beside + 16 * piece + FIXED_BYTES)


def _volume_bytes(work: Work, threads: int) -> int:
    pairs = float(work.lights * work.views)
    capacity = threads * 8 * min(work.paths, BLOCK) * RECORD_BYTES
    beside = work.chunks.side_by_side(threads, pairs)
    some = min(work.chunks.connections, FIELD_ELEMENTS / max(work.lights + work.views, 1))
    held = 16 * some * work.lights + work.chunks.connections * RECORD_BYTES + pairs * 16 * 2
    views = 16 * some * threads * min(work.views, VIEWS_AT_ONCE)
    return int(capacity + held * beside + views + pairs * 16 + FIXED_BYTES)
