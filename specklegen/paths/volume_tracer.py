"""Tracing in any geometry: boxes, voxels and slabs, lights and sensors near and far, in space and in flatland."""

from dataclasses import dataclass

import numpy as np

from specklegen.core.parallel import Threads, map_blocks
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.kernels import volume_walk, walk
from specklegen.kernels.jones import CARRIED, ENTRIES, STEP, Jones
from specklegen.kernels.lobes import Lobe
from specklegen.kernels.phase_table import PhaseTable
from specklegen.kernels.slab_steps import Address
from specklegen.kernels.sources import Sources
from specklegen.kernels.volume import Volume
from specklegen.kernels.volume_walk import Probes
from specklegen.paths.bank import BLOCK, PathBank, columns_of, concatenate, empty_bank
from specklegen.paths.endpoints import probes
from specklegen.paths.layout import Layout
from specklegen.paths.phase_tables import closed_lobe
from specklegen.paths.volumes import collects_flow


@dataclass(frozen=True)
class VolumeTracer:
    """Random paths of any scene, whose starts are a mixture over its lights and near sensor points.

    Attributes
    ----------
    layout : Layout
    sources
        Where paths start.
    lobe : Lobe or None
        The phase function, where all of a medium of three dimensions has one; else particles are drawn by type.
    bidirectional : bool
        Whether a path is weighed, and must be evaluated, in both directions: for coherent backscattering,
        and wherever paths may start from the sensor's side.
    threshold : float
        Contribution from which a connection is always kept; 0 keeps all.
    max_order : int
        Vertices after which a path is ended.
    capacity : float
        Connections a path for which a block reserves memory; a block that finds more is traced twice.
    transfer : bool
        Whether paths collect their momentum transfer.
    """

    layout: Layout
    sources: Sources
    lobe: Lobe | None
    bidirectional: bool
    threshold: float
    max_order: int
    capacity: float = 8.0
    transfer: bool = False

    def trace(
        self,
        seed: Seed,
        count: int,
        *,
        first: int = 0,
        sample: int = 0,
        stream: Stream = Stream.PATHS,
        threads: Threads = None,
    ) -> PathBank:
        """Trace paths ``first`` ... ``first + count - 1`` of realization ``sample``; a pure function of these."""
        probed = Probes(*probes(self.layout.lights), *probes(self.layout.views))
        return traced(
            self.layout.volume, self.layout.table, self.lobe, self.sources, probed,
            walk.Rules(int(self.bidirectional), self.threshold, self.max_order),
            seed, count, first=first, sample=sample, stream=stream, threads=threads, capacity=self.capacity,
            transfer=self.transfer,
        )  # fmt: skip


def traced(
    volume: Volume,
    table: PhaseTable,
    lobe: Lobe | None,
    sources: Sources,
    probed: Probes,
    rules: walk.Rules,
    seed: Seed,
    count: int,
    *,
    first: int,
    sample: int,
    stream: Stream,
    threads: Threads,
    capacity: float,
    transfer: bool = False,
    matrices: np.ndarray | None = None,
) -> PathBank:
    """Trace paths ``first`` ... ``first + count - 1``, block after block; a pure function of all but ``threads``.

    ``matrices`` are those of polarised light through layers (:func:`specklegen.paths.jones.type_matrices`).
    """
    where = Address(*stream_key(seed, stream), sample)
    if transfer and not len(volume.mobility):  # at rest
        volume = volume._replace(mobility=np.zeros(len(volume.extinction)))

    columns = columns_of(transfer, collects_flow(volume))

    def block(start: int) -> PathBank:
        size = min(BLOCK, first + count - start)
        room = int(capacity * size) + 1
        while True:
            records, bounces = np.empty((room, columns)), np.zeros((room, 2), np.int8)
            orders, types = np.empty(room, np.int32), np.empty((room, 2), np.int32)
            paths, ranks = np.empty(room, np.int64), np.empty(room, np.int64)
            jones = None
            if matrices is not None:
                jones = Jones(matrices, np.empty((2, CARRIED)), np.empty(STEP), np.zeros((room, ENTRIES)))
            connections, events, unfinished, unfinished_weight = volume_walk.trace_volume(
                where, (start, size), volume, table, lobe is not None, lobe or closed_lobe(0.0), sources, probed, rules,
                walk.Found(records, orders, paths, bounces, ranks), types, jones,
            )  # fmt: skip
            if connections <= room:
                break
            room = connections
        records, orders, paths, types = (a.take(ranks[:connections], axis=0) for a in (records, orders, paths, types))
        turned = jones and jones.found.take(ranks[:connections], axis=0).view(np.complex128).reshape(-1, 2, 2)
        return PathBank(
            records, orders, paths, types, bounces[:connections], size, events, unfinished, unfinished_weight, turned
        )  # fmt: skip

    banks = map_blocks(block, range(first, first + count, BLOCK), threads)
    return concatenate(banks, threads) if banks else empty_bank(count, columns)
