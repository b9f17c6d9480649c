"""A pilot of a scene of any geometry: how much work a path is, and how much its weight varies."""

from dataclasses import dataclass

import numpy as np

from specklegen.pathspace.amplitudes import multiple_amplitudes, single_amplitudes
from specklegen.pathspace.tracing import scene_tracer
from specklegen.scene import Scene
from specklegen.streams import Stream, pilot_seed
from specklegen.values import remembered

PILOT_PATHS = 4096


@dataclass(frozen=True)
class VolumePilot:
    """What a pilot says of a scene.

    Attributes
    ----------
    events_per_path, connections_per_path : float
    relative_variance : float
        Var w / (E w)^2 of the full weight of a path, at the worst of a few lights and views.
    intensity : float
        Largest mean intensity among these.
    """

    events_per_path: float
    connections_per_path: float
    relative_variance: float
    intensity: float


@remembered(64)
def volume_pilot(scene: Scene, reverse: bool) -> VolumePilot:
    """Pilot of a scene, with or without reversed paths; keyed by the scene's fingerprint."""
    tracer = scene_tracer(scene, reverse)
    bank = tracer.trace(pilot_seed(scene.fingerprint()), PILOT_PATHS, stream=Stream.PILOT, threads=1)
    few = tracer.probed()
    power = np.zeros((len(few.lights.vectors) * len(few.views.vectors), PILOT_PATHS))
    once, more = bank.single, bank.multiple
    for part, amplitudes in ((once, single_amplitudes(few, once)), (more, multiple_amplitudes(few, more, reverse))):
        ways = amplitudes.shape[1] // max(len(part), 1)
        each = np.square(np.abs(amplitudes)).reshape(len(power), ways, len(part)).sum(axis=1)
        for row, weights in zip(power, each, strict=True):
            row += np.bincount(part.paths, weights, PILOT_PATHS)
    mean = power.mean(axis=1)
    lit = mean > 0
    variance = power[lit].var(axis=1) / mean[lit] ** 2
    return VolumePilot(
        events_per_path=bank.events / PILOT_PATHS,
        connections_per_path=len(bank) / PILOT_PATHS,
        relative_variance=float(variance.max(initial=0.0)),
        intensity=float(mean.max(initial=0.0)),
    )
