"""Tracing in any geometry: boxes, voxels and slabs, lights and sensors near and far, in space and in flatland."""

from dataclasses import dataclass

import numpy as np

from specklegen.core.parallel import Threads
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.kernels import volume_walk, walk
from specklegen.kernels.jones import Jones
from specklegen.kernels.lobes import Lobe
from specklegen.kernels.phase_table import PhaseTable
from specklegen.kernels.slab_steps import Address
from specklegen.kernels.sources import Sources
from specklegen.kernels.volume import Volume
from specklegen.kernels.volume_walk import Probes
from specklegen.paths.bank import PathBank, columns_of
from specklegen.paths.blocks import trace_blocks
from specklegen.paths.endpoints import probes
from specklegen.paths.layout import Layout
from specklegen.paths.phase_tables import closed_lobe
from specklegen.paths.volumes import collects_flow


@dataclass(frozen=True)
class VolumeTracer:
    """Random paths of any scene, whose starts are a mixture over its lights and near sensor points.

    Attributes
    ----------
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
    matrices : float64[t, n, 4] or None
        Those of polarised light (:func:`specklegen.paths.jones.type_matrices`); None of scalars.
    """

    layout: Layout
    sources: Sources
    lobe: Lobe | None
    bidirectional: bool
    threshold: float
    max_order: int
    capacity: float = 8.0
    transfer: bool = False
    matrices: np.ndarray | None = None

    def trace(
        self, seed: Seed, count: int, *, first: int = 0, sample: int = 0, stream: Stream = Stream.PATHS,
        threads: Threads = None,
    ) -> PathBank:  # fmt: skip
        """Trace paths ``first`` ... ``first + count - 1`` of realization ``sample``; a pure function of these."""
        probed = Probes(*probes(self.layout.lights), *probes(self.layout.views))
        return traced(self.layout.volume, self.layout.table, self.lobe, self.sources, probed,
                      walk.Rules(int(self.bidirectional), self.threshold, self.max_order), seed, count, first=first,
                      sample=sample, stream=stream, threads=threads, capacity=self.capacity,
                      transfer=self.transfer, matrices=self.matrices)  # fmt: skip


def traced(
    volume: Volume, table: PhaseTable, lobe: Lobe | None, sources: Sources, probed: Probes, rules: walk.Rules,
    seed: Seed, count: int, *, first: int, sample: int, stream: Stream, threads: Threads, capacity: float,
    transfer: bool = False, matrices: np.ndarray | None = None,
) -> PathBank:  # fmt: skip
    """Trace paths ``first`` ... ``first + count - 1``, block after block; a pure function of all but ``threads``.

    ``matrices`` are those of polarised light (:func:`specklegen.paths.jones.type_matrices`).
    """
    where = Address(*stream_key(seed, stream), sample)
    if transfer and not len(volume.mobility):  # at rest
        volume = volume._replace(mobility=np.zeros(len(volume.extinction)))

    def run(part: tuple[int, int], found: walk.Found, types: np.ndarray, jones: Jones | None):
        return volume_walk.trace_volume(where, part, volume, table, lobe is not None, lobe or closed_lobe(0.0), sources,
                                        probed, rules, found, types, jones)  # fmt: skip

    columns = columns_of(transfer, collects_flow(volume))
    return trace_blocks(run, first, count, capacity=capacity, columns=columns, threads=threads, matrices=matrices)
