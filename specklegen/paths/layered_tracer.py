"""Paths of beams and plane waves through layers, by the walk of any geometry: its flights through them are exact."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.parallel import Threads
from specklegen.core.random_streams import Seed, Stream
from specklegen.kernels import volume_walk
from specklegen.kernels.volume_walk import Probes
from specklegen.kernels.walk import Rules
from specklegen.paths.bank import PathBank
from specklegen.paths.jones import type_matrices
from specklegen.paths.phase_tables import common_lobe, phase_table
from specklegen.paths.starts import beam_sources
from specklegen.paths.volume_tracer import traced
from specklegen.paths.volumes import materials, volume_of
from specklegen.scene.media import PlaneMedium

if TYPE_CHECKING:
    from specklegen.paths.proposal import Proposal

_CAPACITY = 8.0


def trace_layers(
    medium: PlaneMedium, proposal: Proposal, seed: Seed, count: int, *, first: int, sample: int, stream: Stream,
    threads: Threads,
) -> PathBank:  # fmt: skip
    """Trace paths ``first`` ... ``first + count - 1`` as a proposal says (`specklegen.paths.slab_tracer`)."""
    particles, light = materials(medium), -proposal.reference[None]
    kinds = np.full(1 + len(proposal.probes), volume_walk.FAR, np.int64)
    return traced(volume_of(medium, 3), phase_table(particles, 3), common_lobe(particles, 3),
                  beam_sources(medium, proposal.reference, proposal.footprint, proposal.extent),
                  Probes(kinds[:1], light, kinds[1:], proposal.probes),
                  Rules(int(proposal.bidirectional), proposal.threshold, proposal.max_order), seed, count, first=first,
                  sample=sample, stream=stream, threads=threads, capacity=_CAPACITY, transfer=proposal.transfer,
                  matrices=type_matrices(medium))  # fmt: skip
