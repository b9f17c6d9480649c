"""Pilots: a few paths of a scene, keyed by its fingerprint, from which everything is planned.

A pilot is a function of the scene alone, never of the run that it plans, so that what it decides (thresholds,
view factors, samplers) biases no result. No unit of length sways it.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from specklegen.core.cached_results import cached_result
from specklegen.core.decision import Decision
from specklegen.core.random_streams import Seed, Stream, pilot_seed
from specklegen.core.values import remembered
from specklegen.kernels.volume import VOXELS
from specklegen.paths.bank import PathBank, concatenate
from specklegen.paths.deep_absorption import crossing_variances, dark_views
from specklegen.paths.endpoint_factors import contributions_of_pairs, multiple_amplitudes, single_amplitudes
from specklegen.paths.gaussianity import PathMoments, relative_variance
from specklegen.paths.rare_paths import ENOUGH, rare_paths_decision
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.paths.tracer import Tracer, slab_tracer, volume_tracer
from specklegen.scene.scene import Scene

FEW_PATHS, PILOT_PATHS = 2048, 6144
"""Of the first paths: all that are traced where the fewer leave no doubt, and else."""
_SURE = 2 * ENOUGH  # of the fewer that have to carry the variance
_MOST_EVENTS = {True: 3e7, False: 5e6}  # of a pilot that grows, in lock step or not: about half a second
_MOST_CONNECTIONS = 2**18
_MEAN_PATHS = 256  # at a time

_Powers = list[tuple[np.ndarray, np.ndarray]]
"""Paths int64[n], and |amplitude|^2 float64[pairs, n] at a few lights and views; single scattering, then more of it."""


@dataclass(frozen=True)
class PilotNumbers:
    """Estimates of a pilot's paths, in numbers and words, cached between processes.

    Attributes
    ----------
    paths : int
        The first paths.
    events : int
        Scattering events of these.
    connections : int
        Connections of them that were kept.
    moments : PathMoments
        Of a path's weights, at the worst of a few lights and views. Where rare paths carry the variance, more are
        traced for it (:func:`specklegen.paths.rare_paths`). It is at least what absorption makes it where too few paths
        cross a slab for a pilot to know.
    intensity : float
        Largest mean intensity among these.
    multiple_share : float
        Largest share of multiple scattering in the intensity among these, three standard errors included.
    missed_variance : float
        What absorption makes of the relative variance where too few paths cross the medium for a pilot to know; else 0.
    decisions : tuple of Decision
        What the rules of pilots say: rare paths, dark views.
    """

    paths: int
    events: int
    connections: int
    moments: PathMoments
    intensity: float
    multiple_share: float
    missed_variance: float
    decisions: tuple[Decision, ...]


@dataclass(frozen=True)
class FirstPaths:
    """The first paths of a pilot, traced where they are looked at.

    Attributes
    ----------
    reverse : bool
        Whether paths count backwards too.
    seed : int
        Of the scene.
    """

    tracer: Tracer
    reverse: bool
    seed: int

    @cached_property
    def bank(self) -> PathBank:
        """Their connections."""
        return self.judged()[0]

    def judged(self) -> tuple[PathBank, _Powers]:
        """Connections of few paths, or of more where these do not tell; and what they send.

        They do not where fewer than fifty of them carry the variance, nor where none has found its way from a light to
        a view: between these it may be that one of a thousand does.
        """
        bank = self.trace(0, min(FEW_PATHS, PILOT_PATHS))
        powers = self.powers(bank)
        if bank.count < PILOT_PATHS and not (_lit(powers) and _worst(powers, bank.count).effective_paths >= _SURE):
            bank = concatenate([bank, self.trace(bank.count, PILOT_PATHS - bank.count)])
            powers = self.powers(bank)
        return bank, powers

    def trace(self, first: int, count: int) -> PathBank:
        """Connections of the pilot's paths ``first`` ... ``first + count - 1``."""
        return self.tracer.trace(self.seed, count, first=first, stream=Stream.PILOT, threads=1)

    def powers(self, bank: PathBank) -> _Powers:
        """Light of connections from a few lights to a few views."""
        return _powers(self.tracer, self.reverse, bank)


@dataclass(frozen=True)
class Pilot(PilotNumbers):
    """Estimates of a pilot for a scene, and the tracer of its paths.

    Attributes
    ----------
    first : FirstPaths
        Of a film those of its rest.
    """

    tracer: Tracer
    first: FirstPaths

    @property
    def event(self) -> str:
        """Name of the operation that a scattering event of these paths is."""
        layout = self.tracer.layout
        alike = layout.ways is None and int(layout.volume.cells[VOXELS].prod()) == 1
        return "event" if alike and isinstance(self.tracer, SlabTracer) else "volume event"

    @property
    def bank(self) -> PathBank:
        """Connections of the first paths."""
        return self.first.bank

    @property
    def events_per_path(self) -> float:
        """Scattering events a path."""
        return self.events / self.paths

    @property
    def connections_per_path(self) -> float:
        """Connections kept a path."""
        return self.connections / self.paths


def scene_pilot(scene: Scene, reverse: bool) -> Pilot:
    """Pilot of a scene, with or without reversed paths, by the tracer that serves it."""
    return pilot_by_walk(scene, reverse, scene.lock_step_obstacle is not None)


def volume_pilot(scene: Scene, reverse: bool) -> Pilot:
    """Trace the pilot by the walk of any geometry."""
    return pilot_by_walk(scene, reverse, True)


@remembered(64)
def pilot_by_walk(scene: Scene, reverse: bool, any_geometry: bool) -> Pilot:
    """Pilot of a scene by the walk of any geometry, or by that of beams through a slab; of a film that of its rest."""
    tracer: Tracer = volume_tracer(scene, reverse) if any_geometry else slab_tracer(scene, reverse)
    if scene.film:
        return replace(pilot_by_walk(scene.at_rest, reverse, any_geometry), tracer=tracer)
    first = FirstPaths(tracer, reverse, pilot_seed(scene.unitless_fingerprint()))
    about = ("pilot", scene, reverse, any_geometry)
    numbers = cached_result(PilotNumbers, about, lambda: _numbers(scene, first))
    return Pilot(**vars(numbers), tracer=tracer, first=first)


def _numbers(scene: Scene, first: FirstPaths) -> PilotNumbers:
    """Return the estimates of the first paths, and of as many more as are needed."""
    bank, powers = first.judged()
    vars(first)["bank"] = bank  # as if it had been asked for: powers, which are larger, are not held
    count = bank.count
    means, share = [], 0.0
    for single, multiple in zip(*(weights for _, weights in powers), strict=True):
        mean = (single.sum() + multiple.sum()) / count
        means.append(mean)
        rest = np.bincount(powers[1][0], multiple, count)
        if mean > 0:
            share = max(share, (rest.mean() + 3 * rest.std() / np.sqrt(count)) / mean)
    drawn = isinstance(first.tracer, SlabTracer) and first.tracer.across
    variances = () if drawn else crossing_variances(scene)
    missed_variance = min(variances, default=0.0)
    moments = _sure(first, bank, powers).stated()
    moments = replace(moments, relative_variance=max(moments.relative_variance, missed_variance))
    dark = dark_views(variances, np.array(means))
    shadow = Decision("dark views", True, dark, doubt=True) if dark else None
    rules = rare_paths_decision(moments.effective_paths), shadow
    decisions = tuple(decision for decision in rules if decision)
    return PilotNumbers(
        count, bank.events, len(bank), moments, float(max(means, default=0.0)), float(share), missed_variance, decisions
    )  # fmt: skip


def _powers(tracer: Tracer, reverse: bool, bank: PathBank) -> _Powers:
    few, once, more = tracer.layout.probed(), bank.single, bank.multiple
    if not (tracer.bidirectional or reverse) and few.middle is None:  # no amplitudes are added up
        pairs = len(few.lights) * len(few.views)
        return [(each.paths, contributions_of_pairs(few, each).reshape(pairs, len(each))) for each in (once, more)]
    often = multiple_amplitudes(few, more, bidirectional=tracer.bidirectional, reverse=reverse)
    return [_columns(once, np.square(np.abs(single_amplitudes(few, once)))), _columns(more, np.square(np.abs(often)))]


def _lit(found: _Powers) -> bool:
    """Return whether something reaches every view from every light."""
    return all(bool(single.any() or multiple.any()) for single, multiple in zip(*(w for _, w in found), strict=True))


def _worst(found: _Powers, count: int) -> PathMoments:
    """Moments at the light and view where the weights of ``count`` paths vary most."""
    paths = np.concatenate([owner for owner, _ in found])
    each = (np.concatenate(weights) for weights in zip(*(weights for _, weights in found), strict=True))
    worst = max(each, key=lambda weights: relative_variance(weights, paths, count), default=np.zeros(len(paths)))
    return PathMoments.of(worst, paths, count)


def _sure(first: FirstPaths, bank: PathBank, found: _Powers) -> PathMoments:
    """Moments at the worst light and view from as many paths as it takes to know their variance, or as may be traced.

    The first of them, ``bank`` and what it ``found``, are there.
    """
    lock_step, count = isinstance(first.tracer, SlabTracer), bank.count
    rate = max(bank.events / _MOST_EVENTS[lock_step], len(bank) / _MOST_CONNECTIONS)  # of the first paths
    most = int(count / rate) if rate > 0 else count
    moments = _worst(found, count)
    while moments.effective_paths < ENOUGH and 2 * count <= most:
        found, count = found + first.powers(first.trace(count, count)), 2 * count
        moments = _worst(found, count)
    return moments


def _columns(bank: PathBank, powers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Path int64[n] that each column of ``powers`` float64[pairs, n] belongs to, and the powers."""
    return np.tile(bank.paths, powers.shape[1] // max(len(bank), 1)), powers


def mean_intensity(tracer: Tracer, reverse: bool, views: np.ndarray, seed: Seed, paths: int) -> tuple[float, float]:
    """Expected intensity and its standard error, from so many paths.

    The mean over all lights and over the views of the numbers int64[n].
    """
    layout = tracer.layout.of_ends(slice(None), views)
    intensities = np.zeros(paths)
    for start in range(0, paths, _MEAN_PATHS):
        count = min(_MEAN_PATHS, paths - start)
        bank = tracer.trace(seed, count, first=start, stream=Stream.PILOT, threads=1)
        once, more = bank.single, bank.multiple
        often = multiple_amplitudes(layout, more, bidirectional=tracer.bidirectional, reverse=reverse)
        for some, amplitudes in ((once, single_amplitudes(layout, once)), (more, often)):
            owner, powers = _columns(some, np.square(np.abs(amplitudes)))
            intensities[start : start + count] += np.bincount(owner - start, powers.mean(axis=0), count)
    return float(intensities.mean()), float(intensities.std() / np.sqrt(paths))
