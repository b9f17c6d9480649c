"""Path sums: fresh paths and phases for every realization, summed by NUFFT or directly. Algorithms 2 and 4 of [Bar19].

Serves every scene. Paths are cut into chunks that the plan fixes; chunks are traced and summed side by side and added
in their order, so that a field does not depend on threads, nor on whether it comes whole or piece by piece.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial, reduce
from itertools import islice
from typing import TYPE_CHECKING, Self

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.nanoseconds import Cost
from specklegen.core.parallel import Threads, in_turn, one_blas_thread, slices, thread_count
from specklegen.core.random_streams import Seed
from specklegen.paths.bank import PathBank
from specklegen.paths.displacements import film_roots, frames
from specklegen.paths.far_field import far_field_decision
from specklegen.paths.flows import lit_elsewhere
from specklegen.paths.gaussianity import Gaussianity
from specklegen.paths.pilot import Pilot, scene_pilot
from specklegen.paths.tracer import Tracer
from specklegen.samplers.path_sums.cost import (
    CONNECTIONS_KEPT,
    Work,
    direct_operations,
    memory_bytes,
    operations,
    tracing_operations,
)
from specklegen.samplers.path_sums.direct import Phases, direct_field, is_plain_slab, path_phases
from specklegen.samplers.path_sums.nufft import TILTS_AT_ONCE, NufftPlan, nufft_field, nufft_frame, nufft_tile
from specklegen.samplers.path_sums.summation import summation_decision
from specklegen.samplers.path_sums.tiling import Tile, coarsest
from specklegen.samplers.sampler import (
    TILTS_STREAMED,
    Abilities,
    MediaRequest,
    MediaSampler,
    Realization,
    Request,
    Where,
    image_of,
)
from specklegen.scene.illumination import directions_of_sines
from specklegen.scene.scene import Scene

if TYPE_CHECKING:
    from specklegen.samplers.sampler import Imager

assert TILTS_STREAMED % TILTS_AT_ONCE == 0, "transforms must group the tilts of a part as those of the whole"

Bank = Callable[[int, Threads], tuple[PathBank, Phases]]
"""(number of a chunk, threads) -> its connections and their random phases."""


@dataclass(frozen=True)
class PathSums(MediaSampler, name="paths"):
    """Path sums of a scene, dimensioned; see :class:`specklegen.samplers.sampler.Sampler`."""

    scene: Scene
    work: Work
    pilot: Pilot
    reverse: bool

    error_of = "false intensity correlation"
    abilities = Abilities(media="volumes", medium_by_medium=True, lens="origin")

    @classmethod
    def propose(cls, scene: Scene, request: Request) -> tuple[Self, list[Decision]]:
        """Path sums for a scene; they serve any."""
        pilot = scene_pilot(scene, request.reverse)
        obstacle = scene.lock_step_obstacle
        if obstacle is None:
            nufft, decision = summation_decision(scene, pilot, request.field_tolerance, request.reverse)
        else:
            nufft, decision = None, Decision("paths in lock step and NUFFT", False, obstacle)
        work = Work(
            scene=scene,
            paths=request.paths_by(pilot.moments, within_image=True),
            events_per_path=pilot.events_per_path,
            connections_per_path=pilot.connections_per_path,
            lock_step=obstacle is None,
            nufft=nufft,
            ways=2 if pilot.tracer.bidirectional else 1,
            plain=is_plain_slab(pilot.tracer.layout),
            streamed=request.streamed,
            one_by_one=pilot.tracer.layout.middle is not None,
            event=pilot.event,
        )
        doubt = far_field_decision(scene)
        decisions = [decision, *([doubt] if doubt else []), *(lit_elsewhere(scene, pilot.bank) if scene.film else [])]
        return cls(scene, work, pilot, request.reverse), decisions

    @property
    def summation(self) -> str:
        """Summation: "nufft", or "direct"."""
        return "nufft" if self.work.nufft else "direct"

    @property
    def paths(self) -> int:
        """Paths a realization."""
        return self.work.paths

    @property
    def nufft(self) -> NufftPlan | None:
        """The view factors, where the NUFFT is used."""
        return self.work.nufft

    @property
    def tracer(self) -> Tracer:
        """Tracer of the paths."""
        return self.pilot.tracer

    @property
    def expected_error(self) -> float:
        """Root of the excess correlation of intensities from a finite number of paths, at the worst view."""
        return float(np.sqrt(self.pilot.moments.relative_variance / self.paths))

    @property
    def image_error(self) -> float:
        """Error between views of one image, whose connections of one path share their entrance."""
        return float(np.sqrt(self.pilot.moments.image_variance / self.paths))

    @property
    def intensity(self) -> float:
        """Largest mean intensity among the pilot's lights and views."""
        return self.pilot.intensity

    @property
    def gaussianity(self) -> Gaussianity:
        """True if so many paths make Gaussian speckle."""
        return self.pilot.moments.gaussianity(self.paths)

    @property
    def field_dtype(self) -> type:
        """Precision in which fields are summed."""
        return self.nufft.dtype if self.nufft else np.complex128

    def cost(self) -> Cost:
        """Count the operations of one realization; of the direct sum instead of the NUFFT, and with reversed paths."""
        work, others = self.work, {}
        if work.lock_step:
            tracing = tracing_operations(work)
            ways = {"the direct sum": 1} if work.nufft else {}
            ways |= {} if self.reverse else {"adding reversed paths (reverse=True)": 2}
            others = {
                name: tracing | direct_operations(work.lights, work.connections * count, work.views, work.plain)
                for name, count in ways.items()
            }
        return Cost(operations(work), alternatives=others)

    def memory(self, threads: int) -> int:
        """Bytes by which the process grows at most."""
        return memory_bytes(self.work, threads)

    def prepare_media(self, request: MediaRequest) -> "list[tuple[list[int], Imager]]":
        """Make the one medium ready that this sampler was planned for."""
        if request.imager is not None:
            return [([0], request.imager)]
        from specklegen.samplers.path_sums.media import PathImaging
        from specklegen.synthesis.contrast import ExpectedContrast

        sight = request.sight
        assert len(sight) == 1, "paths are planned medium by medium"
        known = request.contrast or ExpectedContrast.of(sight, request.correlations)
        divisions = 1 if request.planes else self.scene.sensor.shape[0] // sight.camera[0]
        unit, tilts = float(request.units[0]), sight.base.shape[1]
        return [([0], PathImaging(self, unit, tilts, sight.shape, divisions, request.shared, known, request.planes))]

    def prepare(self, seed: Seed, threads: int | None) -> "PathRenderer":
        """Make ready to draw: there is nothing to be found once."""
        return PathRenderer(self, seed, threads)


@dataclass(frozen=True)
class PathRenderer:
    """Media of path sums under a seed."""

    sampler: PathSums
    seed: Seed
    threads: int | None

    @cached_property
    def _chunks(self) -> list[slice]:
        return self.sampler.work.chunks.slices

    def media(self, count: int) -> Iterator[Realization]:
        """Fresh paths and phases for every realization, summed chunk by chunk in a fixed order."""
        scene, work = self.sampler.scene, self.sampler.work
        shape = (work.lights, *scene.sensor.shape)
        jobs = ((number, chunk) for number in range(count) for chunk in range(len(self._chunks)))
        members = thread_count(self.threads)
        beside = work.chunks.side_by_side(members, float(np.prod(shape)), count)
        parts = in_turn(lambda job, crew: self._field(*job, crew), jobs, members, beside)
        for _ in range(count):
            field, connections, unfinished = np.zeros(shape, self.sampler.field_dtype), 0, 0
            with one_blas_thread():
                for part, bank in islice(parts, len(self._chunks)):
                    field += part.reshape(shape)
                    connections += len(bank)
                    unfinished += bank.unfinished
            yield Realization(image_of(scene, field), connections, unfinished)

    def _traced(self, realization: int, n: int, threads: Threads) -> tuple[PathBank, Phases]:
        """Connections of chunk ``n`` and their phases."""
        chunk, tracer = self._chunks[n], self.sampler.tracer
        count = chunk.stop - chunk.start
        bank = tracer.trace(self.seed, count, first=chunk.start, sample=realization, threads=threads)
        return bank, path_phases(tracer, bank, self.seed, realization, self.sampler.reverse, threads)

    def _field(self, realization: int, n: int, threads: Threads) -> tuple[np.ndarray, PathBank]:
        """Contribution of a chunk of paths to the field, and its connections."""
        bank, phases = self._traced(realization, n, threads)
        layout, nufft = self.sampler.tracer.layout, self.sampler.nufft
        if self.sampler.scene.film:
            part = self._film(realization, bank, phases, threads)
        elif nufft:
            part = nufft_field(layout, bank, phases[0], nufft, threads=threads)
        else:
            part = direct_field(layout, bank, phases, threads=threads)
        return part * math.sqrt(bank.count / self.sampler.paths), bank

    def _film(self, realization: int, bank: PathBank, phases: Phases, threads: Threads) -> np.ndarray:
        """Fields of a bank in all frames, complex[T, *sensor.shape] or complex[T, V]: particles have moved in each."""
        scene, nufft = self.sampler.scene, self.sampler.nufft
        field = np.empty((len(scene.lights), *scene.sensor.shape), self.sampler.field_dtype)
        tiles = nufft.tiling.tiles if nufft else [None]
        for tile in tiles:
            place = (slice(None), tile.rows, tile.columns) if tile else ...
            field[place] = self._frames(realization, bank, phases, tile, slice(0, len(field)), threads).reshape(
                field[place].shape
            )
        return field

    def _frames(
        self, realization: int, bank: PathBank, phases: Phases, tile: Tile | None, chosen: slice, threads: Threads
    ) -> np.ndarray:
        """Fields of some frames of a film on one tile, or at all views."""
        sampler, layout = self.sampler, self.sampler.tracer.layout
        times = np.asarray(sampler.scene.beams.times)
        moving = frames(layout, bank, film_roots(sampler.scene), times, self.seed, realization, threads)
        fields = []
        for t, moved in enumerate(islice(moving, chosen.stop)):
            if t < chosen.start:
                continue
            light = layout.of_lights(slice(t, t + 1))
            if sampler.nufft and tile:
                fields.append(nufft_frame(light, bank, phases[0], sampler.nufft, tile, moved, threads=threads))
            else:
                light = light.of_views(_views(sampler.scene, tile)) if tile else light
                fields.append(direct_field(light, bank, phases, moved=moved, threads=threads))
        return np.concatenate(fields)

    def fields(self, number: int) -> Iterator[tuple[Where, np.ndarray]]:
        """Sums in the same order over parts of the tilts and views, complex64: tiles of at most 512 x 512 views."""
        sampler, grid = self.sampler, self.sampler.scene.grid
        work = sampler.work
        tiling = work.nufft.tiling if work.nufft else coarsest(grid)
        groups = slices(work.lights, TILTS_STREAMED)
        piece = float(np.prod(tiling.shape)) * min(work.lights, TILTS_STREAMED)
        members = thread_count(self.threads)
        beside = work.chunks.side_by_side(members, piece)
        bank: Bank = partial(self._traced, number)
        bank = _kept(bank) if work.connections <= CONNECTIONS_KEPT else bank
        for tile in tiling.tiles:
            for tilts in groups:
                part = partial(self._piece, bank, tile, tilts, number)
                with one_blas_thread():
                    field = reduce(np.add, in_turn(part, range(len(self._chunks)), members, beside))
                yield (tilts, tile.rows, tile.columns), field.astype(np.complex64)

    def _piece(self, bank: Bank, tile: Tile, tilts: slice, realization: int, n: int, threads: Threads) -> np.ndarray:
        """Contribution of chunk ``n`` of the paths to the field of some tilts on one tile."""
        some, phases = bank(n, threads)
        sampler = self.sampler
        layout = sampler.tracer.layout.of_lights(tilts)
        if sampler.scene.film:
            field = self._frames(realization, some, phases, tile, tilts, threads)
        elif sampler.nufft:
            field = nufft_tile(layout, some, phases[0], sampler.nufft, tile, threads=threads)
        else:
            field = direct_field(layout.of_views(_views(sampler.scene, tile)), some, phases, threads=threads)
        shape = (tilts.stop - tilts.start, tile.rows.stop - tile.rows.start, tile.columns.stop - tile.columns.start)
        return (field * math.sqrt(some.count / sampler.paths)).reshape(shape)


def _kept(bank: Bank) -> Bank:
    """Sampler that caches every chunk."""
    chunks = {}

    def kept(n: int, threads: Threads) -> tuple[PathBank, Phases]:
        if n not in chunks:
            chunks[n] = bank(n, threads)
        return chunks[n]

    return kept


def _views(scene: Scene, tile: Tile) -> np.ndarray:
    """float64[n, 3], the views of a tile."""
    grid = scene.grid
    x, y = grid.sines
    y, x = np.meshgrid(y[tile.rows], x[tile.columns], indexing="ij")
    return directions_of_sines("tile", np.stack([x.ravel(), y.ravel()], -1), grid.sign)
