"""Tracing in any geometry: (scene, sources, seed) -> VolumeBank."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from specklegen.core.parallel import Threads, map_blocks
from specklegen.core.random_streams import Seed, Stream, pilot_seed, stream_key
from specklegen.core.values import remembered
from specklegen.kernels import volume_walk, walk
from specklegen.kernels.phase_table import PhaseTable
from specklegen.kernels.sources import Sources
from specklegen.kernels.volume import Volume
from specklegen.paths.bank import PathBank, concatenate
from specklegen.paths.endpoints import Endpoints, light_endpoints, probes, view_endpoints
from specklegen.paths.layout import materials, volume_of
from specklegen.paths.phase_tables import phase_table
from specklegen.paths.slab_tracer import BLOCK
from specklegen.paths.starts import close_points, plane_sources, scene_sources
from specklegen.scene.media import Medium, Slab
from specklegen.scene.scene import Scene

PILOT_PATHS = 4096
_FIRST_PATHS = 64  # of the pilot, which tell how many more its memory allows
_PILOT_CONNECTIONS = 2**20


@dataclass(frozen=True)
class VolumeBank(PathBank):
    """Connections as in :class:`PathBank`, with the particle types at their ends.

    Attributes
    ----------
    types : int32[M, 2]
        Type of the first and of the last particle.
    """

    types: np.ndarray = field(default_factory=lambda: np.empty((0, 2), np.int32))

    def reversed(self) -> Self:
        """Return the same paths walked backwards; single scattering, its own reverse, is left out."""
        return replace(super().reversed(), types=self.multiple.types[:, ::-1])


@dataclass(frozen=True)
class Tracer:
    """What tracing needs of a scene, laid out for the kernels once.

    Attributes
    ----------
    volume, table, sources
        The medium, its particles, and where paths start.
    lights, views : Endpoints
        The two ends of every connection.
    bidirectional : bool
        Whether a path is weighed, and must be evaluated, in both directions: for coherent backscattering,
        and wherever paths may start from the sensor's side.
    threshold : float
        Contribution from which a connection is always kept; 0 keeps all.
    max_order : int
        Vertices after which a path is ended.
    room : float
        Connections a path for which a block reserves memory; a block that finds more is traced twice.
    """

    volume: Volume
    table: PhaseTable
    sources: Sources
    lights: Endpoints
    views: Endpoints
    bidirectional: bool
    threshold: float
    max_order: int
    room: float = 8.0

    def of_ends(self, lights: np.ndarray | slice, views: np.ndarray | slice) -> "Tracer":
        """The same with only the lights and views of these numbers."""
        return replace(
            self,
            lights=replace(self.lights, vectors=self.lights.vectors[lights]),
            views=replace(self.views, vectors=self.views.vectors[views]),
        )

    def probed(self) -> "Tracer":
        """The same with only a few of the lights and views, which keep their beam profile."""
        return replace(self, lights=self.lights.few(), views=self.views.few())

    def trace(
        self,
        seed: Seed,
        count: int,
        *,
        first: int = 0,
        sample: int = 0,
        stream: Stream = Stream.PATHS,
        threads: Threads = None,
    ) -> VolumeBank:
        """Trace paths ``first`` ... ``first + count - 1`` of realization ``sample``; see :func:`specklegen.trace`."""
        key = stream_key(seed, stream)
        light_kinds, lights = probes(self.lights)
        view_kinds, views = probes(self.views)

        def block(start: int) -> VolumeBank:
            size = min(BLOCK, first + count - start)
            room = int(self.room * size) + 1
            while True:
                records = np.empty((room, walk.RECORD))
                orders = np.empty(room, np.int32)
                paths = np.empty(room, np.int64)
                types = np.empty((room, 2), np.int32)
                found, events, unfinished, unfinished_weight = volume_walk.trace_volume(
                    *key, sample, start, size, self.volume, self.table, self.sources, self.bidirectional,
                    light_kinds, lights, view_kinds, views, self.threshold, self.max_order,
                    records, orders, paths, types,
                )  # fmt: skip
                if found <= room:
                    break
                room = found
            return VolumeBank(
                records[:found].copy(), orders[:found].copy(), paths[:found].copy(),
                size, events, unfinished, unfinished_weight, types[:found].copy(),
            )  # fmt: skip

        banks = map_blocks(block, range(first, first + count, BLOCK), threads)
        types = np.concatenate([bank.types for bank in banks]) if banks else np.empty((0, 2), np.int32)
        joined = concatenate(list(banks))
        return VolumeBank(**{**vars(joined), "count": count, "types": types})


@remembered(32)
def scene_tracer(scene: Scene, reverse: bool) -> Tracer:
    """Tracer of a scene, thinned by a pilot keyed by the scene in wavelengths.

    Connections are not thinned where sensor points lie close: what is bright there is not known from a few
    of them.
    """
    volume = volume_of(scene.medium, scene.dimension)
    sources = scene_sources(scene)
    views = view_endpoints(scene)
    bidirectional = reverse or bool(close_points(scene, volume))
    tracer = Tracer(
        volume=volume,
        table=phase_table(materials(scene.medium), 2 if scene.dimension == 2 else 3),
        sources=sources,
        lights=light_endpoints(scene),
        views=views,
        bidirectional=bidirectional,
        threshold=0.0,
        max_order=_max_order(scene.medium),
    )
    return _roomy(tracer if views.near else _thinned(tracer, pilot_seed(scene.unitless_fingerprint())))


def plane_tracer(medium: Slab, wavelength: float, lights: np.ndarray, views: np.ndarray, reverse: bool) -> Tracer:
    """Tracer of unlimited plane waves float64[T, 3] on a slab, paths starting along the axis.

    Weights are per unit area of the face.
    """
    tracer = Tracer(
        volume=volume_of(medium, 3),
        table=phase_table(materials(medium), 3),
        sources=plane_sources(medium),
        lights=Endpoints(False, -lights, wavelength),
        views=Endpoints(False, views, wavelength),
        bidirectional=reverse,
        threshold=0.0,
        max_order=_max_order(medium),
    )
    return _roomy(_thinned(tracer, pilot_seed(medium.fingerprint())))


def _max_order(medium: Medium) -> int:
    return int(min(max(1000.0, 10 * medium.optical_depth**2), 2e9))


def _thinned(tracer: Tracer, seed: int) -> Tracer:
    """Set the threshold from a pilot, where a path has so many connections that judging them pays."""
    if not len(tracer.views.vectors) or not len(tracer.lights.vectors):
        return tracer
    # Any positive threshold makes the walk judge connections; this one keeps them all but those of no weight.
    judging = replace(tracer, threshold=1e-300)
    bank = judging.trace(seed, _FIRST_PATHS, stream=Stream.PILOT, threads=1)
    count = min(PILOT_PATHS, _FIRST_PATHS * max(1, _PILOT_CONNECTIONS // max(len(bank), 1)))
    if count > _FIRST_PATHS:
        bank = judging.trace(seed, count, stream=Stream.PILOT, threads=1)
    if len(bank) < 4 * count:
        return tracer  # few connections a path: judging them costs more than it saves
    judged = bank.weight * _judged_power(tracer, bank)
    return replace(tracer, threshold=10 * float(judged.mean()))


def _roomy(tracer: Tracer) -> Tracer:
    """Reserve twice what a pilot's paths connect; memory that is not written to costs nothing."""
    bank = tracer.trace(0, _FIRST_PATHS, stream=Stream.PILOT, threads=1)
    return replace(tracer, room=2 * len(bank) / _FIRST_PATHS + 1)


def _judged_power(tracer: Tracer, bank: VolumeBank) -> np.ndarray:
    """float64[M], |A|^2 |B|^2 at the brightest probes: the scale on which the walk thins."""
    from specklegen.paths.endpoint_factors import endpoint_factors

    few = replace(tracer, lights=tracer.lights.probed(), views=tracer.views.probed())
    light = np.square(np.abs(endpoint_factors(few, bank, few.lights, "entry"))).max(axis=0)
    return light * np.square(np.abs(endpoint_factors(few, bank, few.views, "exit"))).max(axis=0)
