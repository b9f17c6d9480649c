"""Russian roulette of connections: faint ones are kept rarely, and count for more when they are.

A connection is judged by w, the largest contribution at a few lights and views that stand for all, of beams without
their profile. It is kept with probability min(1, w / t), its weight divided by that. Any threshold t is right; one
makes the least work for an error, as a pilot that keeps all its connections knows: where

    (cost of a path + connections kept) x variance of its light,    kept = sum min(1, w / t),
    variance = V + sum_(w < t) c^2 (t / w - 1)    for contributions c to what a light sends to a view

(means over paths), is least. What is added to V counts twice, for the views that are not looked at.

Between them a narrow phase function may make a connection R times as bright as at the nearest; kept by w / t it would
be a rare one that outshines all others there, and those few would not know. The threshold is then 2R times lower
(:func:`between_probes`).
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from specklegen.core.parallel import slices
from specklegen.core.random_streams import Seed, Stream
from specklegen.kernels.volume import Volume
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import contributions_of_pairs
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.paths.volume_tracer import VolumeTracer
from specklegen.scene.media import as_slab
from specklegen.scene.scatterers.scatterer import Dimensions, Scatterer

TIMES = 2.0  # that the added variance counts
SLAB_PATHS = VOLUME_PATHS = 4096  # of the pilots
SCENE_PATHS = 1024  # of a scene's slab: its plan may take longer than its render
_SLAB_EVENT, _VOLUME_EVENT = 0.05, 0.01  # cost of a scattering event, in connections by the NUFFT or the direct sum
_MOST_ADDED = 0.5  # of the variance without it, that the roulette may add to correlations behind unlike layers
_TRIED = 1000  # thresholds
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
    """Share of the threshold left for phase functions narrow beside gaps of probes: 1 up to R = 4, then ``1 / 2R``.

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
    return 1.0 if largest <= _BRIGHTER else 0.5 / largest


def cheapest_threshold(
    judged: np.ndarray, contributions: np.ndarray, paths: np.ndarray, count: int, event: float,
    most_added: float = math.inf,
) -> float:  # fmt: skip
    """Threshold of the least work for an error, as a pilot that kept all its connections knows it.

    Parameters
    ----------
    judged : float64[M]
        What each of the pilot's connections is judged by.
    contributions : float64[P, M]
        What it sends from lights to views; the pair whose error falls slowest decides.
    paths : int64[M]
        The paths that they belong to, below ``count``.
    count
        Paths of the pilot.
    event
        Cost of a scattering event, each of which made one connection, over that of a connection that is kept.
    most_added
        Largest variance that the roulette may add, over that without it.
    """
    largest, brightest = float(judged.max(initial=0.0)), float(contributions.max(initial=0.0))
    if largest == 0 or brightest == 0:
        return 1e-300  # where none of the pilot's light comes out connections of no weight are dropped
    rows = [None if np.array_equal(row, judged) else row for row in contributions]  # most often judged by itself
    order = np.argsort(judged) if any(row is not None for row in rows) else None
    t = (np.sort(judged) if order is None else judged[order]) / largest  # alone in a third of the time
    first = int(np.searchsorted(t, 0.0, side="right"))  # connections of no weight are left out
    t = t[first:]
    # Thresholds that are tried: at the brightest connection, the next, and so on to every hundredth.
    tried = np.unique(len(t) - np.geomspace(1, len(t), _TRIED).astype(np.int64))
    sums = np.cumsum(t)[tried]
    kept = (sums / t[tried] + len(t) - 1 - tried) / count
    relative = np.zeros(len(tried))
    for each, row in zip(contributions, rows, strict=True):
        whole = np.bincount(paths, each, count) / brightest
        if not (mean := float(whole.mean())):
            continue
        if row is None or order is None:
            below, over, scale = np.cumsum(np.square(t))[tried], sums, largest / brightest
        else:
            squares = np.square(row[order[first:]] / brightest)
            below, over, scale = np.cumsum(squares)[tried], np.cumsum(squares / t)[tried], 1.0
        added = scale**2 * np.maximum(t[tried] * over - below, 0.0) / count
        relative = np.maximum(relative, (whole.var() + TIMES * added) / mean**2)
        relative[added > most_added * max(whole.var(), 1e-300)] = math.inf
    best = np.argmin((event * len(paths) / count + kept) * relative)
    return largest * float(t[tried[best]]) or largest


def slab_roulette(tracer: SlabTracer, light: np.ndarray, seed: Seed) -> SlabTracer:
    """Set the threshold of a slab's tracer from a pilot under one light, at the views by which it judges."""
    most_added = _MOST_ADDED if as_slab(tracer.medium) is None else math.inf
    return judging(tracer, _slab_threshold(tracer, light, seed, SLAB_PATHS, most_added))


def judging(tracer: SlabTracer, threshold: float | None) -> SlabTracer:
    """A slab's tracer with a threshold; as it is where there is None."""
    if threshold is None:
        return tracer
    return replace(tracer, proposal=replace(tracer.proposal, threshold=threshold))


def scene_threshold(tracer: SlabTracer, light: np.ndarray, seed: Seed) -> float | None:
    """Threshold of a scene's slab; None where no path of the pilot has a connection."""
    return _slab_threshold(tracer, light, seed, SCENE_PATHS)


def _slab_threshold(
    tracer: SlabTracer, light: np.ndarray, seed: Seed, paths: int, most_added: float = math.inf
) -> float | None:
    fitting = int(_SLAB_CONNECTIONS / (tracer.events_per_path * max(len(tracer.proposal.probes), 1)))
    layout = tracer.layout.at(light, tracer.proposal.probes)
    at_once = max(_LEAST_AT_ONCE, int(_EVENTS_AT_ONCE / tracer.events_per_path))

    wide = as_slab(tracer.medium) is None

    def weighed(part: slice) -> tuple[np.ndarray, np.ndarray]:
        bank = tracer.trace(seed, part.stop - part.start, first=part.start, stream=Stream.PILOT, threads=1)
        found = contributions_of_pairs(layout, bank)[0]
        return np.concatenate([found, found * _how_far(bank, tracer.medium.thickness)]) if wide else found, bank.paths

    count = min(paths, max(fitting, 16))
    parts = [weighed(part) for part in slices(count, at_once)]
    found, owners = np.concatenate([w for w, _ in parts], axis=1), np.concatenate([of for _, of in parts])
    del parts
    if len(owners) == 0:
        return None
    return cheapest_threshold(found.max(axis=0), found, owners, count, _SLAB_EVENT, most_added)


def _how_far(bank: PathBank, thickness: float) -> np.ndarray:
    """Share float64[M] of connections' light in what decorrelates: the square of how far they go sideways, up to 1."""
    x, y, _ = (bank.exit - bank.entry).T
    return np.minimum((x * x + y * y) / thickness**2, 1.0)


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
    layout = tracer.layout.probed()
    bare = replace(layout, lights=tracer.layout.lights.probed())
    judged = contributions_of_pairs(bare, bank).reshape(-1, len(bank)).max(axis=0)
    found = contributions_of_pairs(layout, bank).reshape(-1, len(bank))
    return replace(tracer, threshold=cheapest_threshold(judged, found, bank.paths, count, _VOLUME_EVENT))


def with_capacity(tracer: VolumeTracer) -> VolumeTracer:
    """Reserve twice what a pilot's paths connect; memory that is not written to costs nothing."""
    bank = tracer.trace(0, _FIRST_PATHS, stream=Stream.PILOT, threads=1)
    return replace(tracer, capacity=2 * len(bank) / _FIRST_PATHS + 1)


def _events_between_faces(volume: Volume) -> float:
    """Scattering events of a path through a slab at most, on average: 2.5 OD, fewer where they absorb; 0 of a box."""
    (low, high), lost = volume.bounds[:2], 1 - float(volume.albedo.max())
    if np.isfinite(high[0]):
        return 0.0
    events = 2.5 * float(volume.extinction.max() * (high[2] - low[2]))
    return min(events, 1 / lost) if lost > 0 else events
