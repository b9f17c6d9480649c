"""Russian roulette of connections: faint ones are kept rarely, and count for more when they are.

A connection of contribution w is kept with probability min(1, w / threshold), its weight divided by that. Any threshold
is right; ten times the mean contribution of a pilot makes 24 times fewer connections for 1 % more variance.

w is the largest contribution at a few views that stand for all. Between them a narrow lobe may make a connection R
times as bright as at the nearest; kept by w / threshold it would be a rare one that outshines all others there, and
those few would not know. The threshold is then R times lower (:func:`between_probes`).
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from specklegen.core.parallel import slices
from specklegen.core.random_streams import Seed, Stream
from specklegen.kernels.volume import Volume
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import contributions_of_pairs, endpoint_factors
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.paths.volume_tracer import VolumeTracer
from specklegen.scene.scatterers.scatterer import Dimensions, Scatterer

ALWAYS_FROM = 10.0  # times the mean contribution (docs/physics.md 2)
SLAB_PATHS, VOLUME_PATHS = 2000, 4096  # of the pilots
_LEAST_AT_ONCE, _EVENTS_AT_ONCE = 256, 2**15  # paths of a slab's pilot, or their events; all of them are 16 MB at most
_FIRST_PATHS = 64  # of a pilot, which tell how many more its memory allows
_PILOT_CONNECTIONS = 2**20
_BRIGHTER = 4.0  # times as bright somewhere as where it is judged a connection may be, and be thinned as it is judged
_LEAST_JUDGED = 0.1  # of isotropic scattering, by which walks judge at least (kernels.lobes, kernels.volume_walk)
_GAP_ANGLES = 65
_SLAB_CONNECTIONS = 2**23  # of all together: fewer than SLAB_PATHS from an optical depth of 1700 on


def between_probes(
    scatterers: Sequence[Scatterer], dimension: Dimensions, views: np.ndarray, probes: np.ndarray
) -> float:
    """Share of the threshold that is left where lobes are narrow beside gaps between probes: 1 up to R = 4, then 1 / R.

    Parameters
    ----------
    scatterers
        Particles of a medium.
    dimension
        3 in space, 2 in flatland.
    views, probes : float64[V, 3], float64[n, 3]
        Directions that are seen, and those among them at which connections are judged.
    """
    if not len(views) or not len(probes):
        return 1.0
    nearest = float(np.clip((views @ probes.T).max(axis=1).min(), -1, 1))
    cosines = np.cos(np.linspace(0, math.acos(nearest), _GAP_ANGLES))
    least, largest = _LEAST_JUDGED / (4 * np.pi if dimension == 3 else 2 * np.pi), 0.0
    for each in scatterers:
        lobe = sum(share * np.square(np.abs(part.amplitude(cosines, dimension))) for part, share in each.components)
        largest = max(largest, float(lobe.max() / max(lobe.min(), least)))
    return 1.0 if largest <= _BRIGHTER else 1 / largest


def slab_roulette(tracer: SlabTracer, light: np.ndarray, seed: Seed) -> SlabTracer:
    """Set the threshold of a slab's tracer from a pilot under one light, at the views by which it judges."""
    fitting = int(_SLAB_CONNECTIONS / tracer.events_per_path)
    layout = tracer.layout.at(light, tracer.proposal.probes)
    at_once = max(_LEAST_AT_ONCE, int(_EVENTS_AT_ONCE / tracer.events_per_path))

    def largest(part: slice) -> np.ndarray:
        bank = tracer.trace(seed, part.stop - part.start, first=part.start, stream=Stream.PILOT, threads=1)
        return contributions_of_pairs(layout, bank)[0].max(axis=0)

    contributions = np.concatenate([*map(largest, slices(min(SLAB_PATHS, max(fitting, 16)), at_once))])
    if len(contributions) == 0:
        return tracer
    threshold = ALWAYS_FROM * float(contributions.sum() / len(contributions))
    # Where none of the pilot's light comes out, connections of no weight are dropped, not all of them kept.
    return replace(tracer, proposal=replace(tracer.proposal, threshold=threshold or 1e-300))


def volume_roulette(tracer: VolumeTracer, seed: Seed) -> VolumeTracer:
    """Set the threshold from a pilot, where a path has so many connections that judging them pays."""
    if not len(tracer.layout.views) or not len(tracer.layout.lights):
        return tracer
    # Any positive threshold makes the walk judge connections; this one keeps them all but those of no weight.
    judging = replace(tracer, threshold=1e-300)
    bank = judging.trace(seed, _FIRST_PATHS, stream=Stream.PILOT, threads=1)
    # The first paths may all be short: between the faces of a slab a few of them scatter OD^2 times.
    connections = max(len(bank), int(_FIRST_PATHS * _events_between_faces(tracer.layout.volume)), 1)
    count = min(VOLUME_PATHS, _FIRST_PATHS * max(1, _PILOT_CONNECTIONS // connections))
    if count > _FIRST_PATHS:
        bank = judging.trace(seed, count, stream=Stream.PILOT, threads=1)
    if len(bank) < 4 * count:
        return tracer  # few connections a path: judging them costs more than it saves
    return replace(tracer, threshold=ALWAYS_FROM * float((bank.weight * _judged_power(tracer, bank)).mean()))


def with_capacity(tracer: VolumeTracer) -> VolumeTracer:
    """Reserve twice what a pilot's paths connect; memory that is not written to costs nothing."""
    bank = tracer.trace(0, _FIRST_PATHS, stream=Stream.PILOT, threads=1)
    return replace(tracer, capacity=2 * len(bank) / _FIRST_PATHS + 1)


def _judged_power(tracer: VolumeTracer, bank: PathBank) -> np.ndarray:
    """float64[M], |A|^2 |B|^2 at the brightest probes: the scale on which the walk judges."""
    layout = tracer.layout
    light = np.square(np.abs(endpoint_factors(layout, bank, layout.lights.probed(), "entry"))).max(axis=0)
    return light * np.square(np.abs(endpoint_factors(layout, bank, layout.views.probed(), "exit"))).max(axis=0)


def _events_between_faces(volume: Volume) -> float:
    """Scattering events of a path through a slab at most, on average: 2.5 OD, fewer where they absorb; 0 of a box."""
    (low, high), lost = volume.bounds[:2], 1 - float(volume.albedo.max())
    if np.isfinite(high[0]):
        return 0.0
    events = 2.5 * float(volume.extinction.max() * (high[2] - low[2]))
    return min(events, 1 / lost) if lost > 0 else events
