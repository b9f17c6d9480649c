"""Paths of beams and plane waves through layers that refract, connected along all legs of the views."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.parallel import Threads
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.kernels import refracting_walk, walk
from specklegen.kernels.legs import AMOUNT, DECAY, Starts
from specklegen.kernels.refracting_walk import Particles
from specklegen.kernels.refraction import Stack
from specklegen.kernels.slab_steps import Address, Light
from specklegen.paths.bank import PathBank
from specklegen.paths.blocks import trace_blocks
from specklegen.paths.phase_tables import phase_table
from specklegen.paths.steps import optics
from specklegen.paths.volumes import materials, volume_of
from specklegen.scene.layers import merged
from specklegen.scene.media import PlaneMedium

if TYPE_CHECKING:
    from specklegen.paths.legs import Ways
    from specklegen.paths.proposal import Proposal

MOST_ORDERS = 2**20
"""Vertices of a path, at most: the random numbers of each have an address of their own."""


def trace_layers_that_refract(
    medium: PlaneMedium, proposal: Proposal, ways: Ways, seed: Seed, count: int, *, first: int, sample: int,
    stream: Stream, threads: Threads,
) -> PathBank:  # fmt: skip
    """Trace paths ``first`` ... ``first + count - 1`` as a proposal says (`specklegen.paths.slab_tracer`)."""
    if proposal.transfer:
        reject(
            f"{medium.type}.motion", "left out if paths through layers that refract are aimed at views", medium.motions,
            "Leave out the motion or the index mismatch: both together are supported only along the axis, "
            "without aiming.",
        )  # fmt: skip
    known, volume, inside = optics(medium), volume_of(medium, 3), medium.faces.inside
    stack = Stack(known.indices, volume.extinction, known.edges, *known.walls, known.outside)
    particles = Particles(
        volume.albedo, volume.material,
        np.array([np.clip(layer.scatterer.mean_cosine(), -0.99, 0.99) for layer in merged(medium.layers)]),
        np.square(known.indices / inside),
    )  # fmt: skip
    where, table = Address(*stream_key(seed, stream), sample), phase_table(materials(medium), 3)
    starts = starts_along(ways, proposal.reference)
    views = ways.views.towards(proposal.probes, lights=False)
    ix, iy, iz = map(float, proposal.reference)
    beam = Light(ix, iy, iz, proposal.footprint, proposal.extent, proposal.radius)
    rules = walk.Rules(int(proposal.bidirectional), proposal.threshold, min(proposal.max_order, MOST_ORDERS))

    def run(part: tuple[int, int], found: walk.Found, types: np.ndarray, jones: None):
        return refracting_walk.trace_refracting(
            where, part, stack, particles, table, starts, beam, views, rules, found, types
        )

    return trace_blocks(run, first, count, capacity=8, columns=walk.RECORD, threads=threads, bounces=np.int16)


def starts_along(ways: Ways, reference: np.ndarray) -> Starts:
    """First vertices along the legs of a light float64[3], each by how much of it collides there."""
    legs = ways.lights.towards(-reference[None], lights=True)
    known, layers = optics(ways.lights.medium), ways.lights.layers
    rate = 2 * legs.rows[0, :, DECAY]  # of power, per depth
    depth = np.empty(len(known.indices))
    depth[layers] = rate * np.diff(known.edges)[layers]
    power = np.square(legs.rows[0, :, AMOUNT]) * -np.expm1(-depth[layers])
    share = power / power.sum() if power.any() else np.full(len(power), 1 / len(power))
    return Starts(legs, share, np.cumsum(share), depth)
