"""Tracing: (scene, proposal, seed) -> PathBank, the connections of random paths to the sensor.

Subpath sampling of [Bar19] as corrected in docs/physics.md, section 2: first vertices exponentially along the
illumination, first directions from the medium's phase function, connections kept by Russian roulette. Phases are not
drawn here: a bank serves every tilt, every view and every realization of phases.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.parallel import Threads
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.kernels import walk
from specklegen.kernels.jones import Jones
from specklegen.kernels.reflections import Faces
from specklegen.kernels.slab_steps import Address, FlowingLayer, Light
from specklegen.paths import faces
from specklegen.paths.bank import PathBank, columns_of, empty_bank
from specklegen.paths.blocks import trace_blocks
from specklegen.paths.jones import ends_of, unfolded_matrices, walk_matrices
from specklegen.paths.layered_tracer import trace_layers
from specklegen.paths.layout import Layout
from specklegen.paths.legs import Ways
from specklegen.paths.phase_tables import walk_lobes
from specklegen.paths.proposal import Proposal
from specklegen.paths.refracting_tracer import trace_layers_that_refract
from specklegen.paths.stretching import draws_across, events_per_depth, stretch_along, unstretched
from specklegen.paths.volumes import collects_flow, volume_of
from specklegen.scene.media import Medium, PlaneMedium, as_slab

MOST_EVENTS = 1e4
"""Of a path, on average: of the 6144 paths of a pilot two or three then cross a slab that does not absorb."""


def stretches(medium: PlaneMedium, proposal: Proposal) -> bool:
    """Return whether paths are drawn towards the far face: where all views lie behind it, and few would get there."""
    behind = len(proposal.probes) > 0 and bool((proposal.probes[:, 2] > 0).all())
    return behind and medium.faces.matched and not proposal.bidirectional and draws_across(medium)


def events_per_path(medium: Medium) -> float:
    """Scattering events of a path at most, on average: 2.5 OD, fewer where they absorb, more between reflecting faces.

    Diffuse light in equilibrium is n^2 times as bright inside an index step of n, and scatters as often.
    """
    albedos = medium.albedo if medium.has_sides else [layer.albedo for layer in medium.layers]
    lost = 1 - float(np.max(albedos, initial=0.0))
    step = max(1.0, *((index / medium.faces.outside) for index in (medium.faces.inside, *medium.indices)))
    return min(1 + 2.5 * medium.optical_depth * step**2, 1 / lost if lost > 0 else math.inf)


def events_across(medium: PlaneMedium) -> float:
    """Tracer of paths that are drawn across a slab: nearly all cross it."""
    return 1 + events_per_depth(medium) * medium.optical_depth


def require_traceable(medium: Medium, events: float) -> None:
    """Refuse a medium so deep that even a pilot would not come to an end."""
    if events > MOST_EVENTS:
        reject(f"{medium.type}.optical_depth", f"at most {MOST_EVENTS / 2.5:.0e} for little absorption",
               medium.optical_depth, "Paths scatter 2.5 times as often, some of them its square: use a thinner medium, "
               "or of a slab the closed forms of specklegen.theory.slab, which are exact there.")  # fmt: skip


def trace(
    medium: PlaneMedium, proposal: Proposal, seed: Seed, count: int, *, first: int = 0, sample: int = 0,
    stream: Stream = Stream.PATHS, threads: Threads = None, ways: Ways | None = None,
) -> PathBank:  # fmt: skip
    """Trace paths ``first`` ... ``first + count - 1`` of realization ``sample``.

    The bank is a pure function of the arguments but ``threads``; splitting a range of paths over several
    calls and joining the banks gives the same bank.

    ``ways`` are those of layers that refract (:attr:`specklegen.paths.layout.Layout.ways`).
    """
    flowing = volume_of(medium, 3)
    columns = columns_of(proposal.transfer, collects_flow(flowing))
    if medium.albedo == 0 or medium.thickness == 0 or count == 0:
        return empty_bank(count, columns)
    across = stretches(medium, proposal)
    foretold = events_across(medium) if across else events_per_path(medium)
    require_traceable(medium, foretold)
    slab = as_slab(medium)
    if ways is not None:
        return trace_layers_that_refract(
            medium, proposal, ways, seed, count, first=first, sample=sample, stream=stream, threads=threads
        )  # fmt: skip
    if slab is None:
        return trace_layers(medium, proposal, seed, count, first=first, sample=sample, stream=stream, threads=threads)
    key = stream_key(seed, stream)
    images = faces.images(slab, np.concatenate([proposal.reference[None], proposal.probes]))
    probes = faces.seen_through(slab, proposal.probes, images)
    upwards = bool(len(proposal.probes) and proposal.probes[0, 2] > 0)
    stretch = stretch_along(slab, float(proposal.reference[2])) if across else unstretched(slab)
    shares = np.array([share for _, share in slab.scatterer.components])
    ends = ends_of(slab)

    where, layer = Address(*key, sample), FlowingLayer(slab.thickness, slab.extinction, slab.albedo, flowing.flow)
    mirrors = None if slab.faces.matched else Faces(*slab.faces.indices, images, int(upwards))
    ix, iy, iz = map(float, proposal.reference)
    light = Light(ix, iy, iz, proposal.footprint, proposal.extent, proposal.radius)
    rules = walk.Rules(int(proposal.bidirectional), proposal.threshold, proposal.max_order)

    def run(part: tuple[int, int], found: walk.Found, types: np.ndarray, jones: Jones | None):
        return walk.trace_slab(
            where, part, layer, *walk_lobes(slab.scatterer), stretch, mirrors, light, probes, rules, found, jones
        )

    def finish(bank: PathBank) -> PathBank:
        turned = bank.jones
        if turned is not None and mirrors is not None:
            turned = unfolded_matrices(turned, bank.bounces)
        return replace(bank, types=_types(shares, seed, sample, bank.orders, bank.paths), jones=turned)

    return trace_blocks(
        run, first, count, capacity=8 if proposal.threshold else 4 + 2 * foretold, columns=columns, threads=threads,
        matrices=None if ends is None else walk_matrices(ends), finish=finish,
    )  # fmt: skip


def _types(shares: np.ndarray, seed: Seed, sample: int, orders: np.ndarray, paths: np.ndarray) -> np.ndarray:
    """Types int32[M, 2] of the particles at both ends, each by its share: addressed by the path, and by its order."""
    types = np.zeros((len(paths), 2), np.int32)
    if len(shares) > 1:
        walk.draw_types(*stream_key(seed, Stream.TYPES), sample, orders, paths, np.cumsum(shares) / shares.sum(), types)
    return types


@dataclass(frozen=True)
class SlabTracer:
    """Beams or plane waves through a slab: paths in lock step, all starting along one direction."""

    layout: Layout
    medium: PlaneMedium
    proposal: Proposal

    @property
    def bidirectional(self) -> bool:
        """True if a path is weighed, and must be evaluated, in both directions."""
        return self.proposal.bidirectional

    @property
    def across(self) -> bool:
        """True if paths are drawn towards the far face."""
        return stretches(self.medium, self.proposal)

    @property
    def events_per_path(self) -> float:
        """Scattering events of a path at most, on average."""
        return events_across(self.medium) if self.across else events_per_path(self.medium)

    def trace(
        self, seed: Seed, count: int, *, first: int = 0, sample: int = 0, stream: Stream = Stream.PATHS,
        threads: Threads = None,
    ) -> PathBank:  # fmt: skip
        """Trace paths ``first`` ... ``first + count - 1`` of realization ``sample``; see :func:`trace`."""
        return trace(self.medium, self.proposal, seed, count, first=first, sample=sample, stream=stream,
                     threads=threads, ways=self.layout.ways)  # fmt: skip
