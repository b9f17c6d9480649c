"""Tracing in any geometry: boxes, voxels and slabs, lights and sensors near and far, in space and in flatland."""

from dataclasses import dataclass

import numpy as np

from specklegen.core.parallel import Threads, map_blocks
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.kernels import volume_walk, walk
from specklegen.kernels.lobes import Lobe
from specklegen.kernels.sources import Sources
from specklegen.paths.bank import PathBank, concatenate, empty_bank
from specklegen.paths.endpoints import probes
from specklegen.paths.layout import Layout
from specklegen.paths.phase_tables import closed_lobe
from specklegen.paths.slab_tracer import BLOCK


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
    """

    layout: Layout
    sources: Sources
    lobe: Lobe | None
    bidirectional: bool
    threshold: float
    max_order: int
    capacity: float = 8.0

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
        key = stream_key(seed, stream)
        layout = self.layout
        light_kinds, lights = probes(layout.lights)
        view_kinds, views = probes(layout.views)
        lobe = self.lobe or closed_lobe(0.0)

        def block(start: int) -> PathBank:
            size = min(BLOCK, first + count - start)
            capacity = int(self.capacity * size) + 1
            while True:
                records = np.empty((capacity, walk.RECORD))
                orders = np.empty(capacity, np.int32)
                paths, ranks = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
                types = np.empty((capacity, 2), np.int32)
                found, events, unfinished, unfinished_weight = volume_walk.trace_volume(
                    *key, sample, start, size, layout.volume, layout.table, self.lobe is not None, lobe, self.sources,
                    self.bidirectional, light_kinds, lights, view_kinds, views, self.threshold, self.max_order,
                    records, orders, paths, types, ranks,
                )  # fmt: skip
                if found <= capacity:
                    break
                capacity = found
            records, orders, paths, types = (a.take(ranks[:found], axis=0) for a in (records, orders, paths, types))
            bounces = np.zeros((found, 2), np.int8)
            return PathBank(records, orders, paths, types, bounces, size, events, unfinished, unfinished_weight)

        banks = map_blocks(block, range(first, first + count, BLOCK), threads)
        return concatenate(banks, threads) if banks else empty_bank(count)
