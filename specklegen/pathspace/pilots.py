"""A pilot of a scene of any geometry: how much work a path is, and how much its weight varies."""

from dataclasses import dataclass

import numpy as np

from specklegen.pathspace.amplitudes import multiple_amplitudes, single_amplitudes
from specklegen.pathspace.tracing import VolumeBank, scene_tracer
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
    multiple_share : float
        Largest share of multiple scattering in the intensity among these, three standard errors included.
    """

    events_per_path: float
    connections_per_path: float
    relative_variance: float
    intensity: float
    multiple_share: float


@remembered(64)
def volume_pilot(scene: Scene, reverse: bool) -> VolumePilot:
    """Pilot of a scene, with or without reversed paths; keyed by the scene's fingerprint."""
    tracer = scene_tracer(scene, reverse)
    bank = tracer.trace(pilot_seed(scene.fingerprint()), PILOT_PATHS, stream=Stream.PILOT, threads=1)
    few = tracer.probed()
    once, more = bank.single, bank.multiple
    single = _path_powers(once, single_amplitudes(few, once))
    multiple = _path_powers(more, multiple_amplitudes(few, more, reverse))
    power = single + multiple
    mean = power.mean(axis=1)
    lit = mean > 0
    variance = power[lit].var(axis=1) / mean[lit] ** 2
    most = multiple[lit].mean(axis=1) + 3 * multiple[lit].std(axis=1) / np.sqrt(PILOT_PATHS)
    return VolumePilot(
        events_per_path=bank.events / PILOT_PATHS,
        connections_per_path=len(bank) / PILOT_PATHS,
        relative_variance=float(variance.max(initial=0.0)),
        intensity=float(mean.max(initial=0.0)),
        multiple_share=float((most / mean[lit]).max(initial=0.0)),
    )


def _path_powers(bank: VolumeBank, amplitudes: np.ndarray) -> np.ndarray:
    """float64[pairs, PILOT_PATHS], what each path adds to the intensity of each pair of light and view."""
    ways = amplitudes.shape[1] // max(len(bank), 1)
    each = np.square(np.abs(amplitudes)).reshape(len(amplitudes), ways, len(bank)).sum(axis=1)
    return np.array([np.bincount(bank.paths, weights, PILOT_PATHS) for weights in each]).reshape(-1, PILOT_PATHS)
