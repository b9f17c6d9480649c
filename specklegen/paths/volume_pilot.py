"""A pilot of a scene of any geometry: how much work a path is, and how much its weight varies."""

from dataclasses import dataclass

import numpy as np

from specklegen.core.random_streams import Stream, pilot_seed
from specklegen.core.values import remembered
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.gaussianity import PathMoments
from specklegen.paths.tracer import VolumeBank, scene_tracer
from specklegen.scene.scene import Scene

PILOT_PATHS = 4096


@dataclass(frozen=True)
class VolumePilot:
    """What a pilot says of a scene.

    Attributes
    ----------
    events_per_path, connections_per_path : float
    moments : PathMoments
        Of a path's weights, at the worst of a few lights and views.
    intensity : float
        Largest mean intensity among these.
    multiple_share : float
        Largest share of multiple scattering in the intensity among these, three standard errors included.
    """

    events_per_path: float
    connections_per_path: float
    moments: PathMoments
    intensity: float
    multiple_share: float


@remembered(64)
def volume_pilot(scene: Scene, reverse: bool) -> VolumePilot:
    """Pilot of a scene, with or without reversed paths; no unit of length sways what it finds."""
    tracer = scene_tracer(scene, reverse)
    bank = tracer.trace(pilot_seed(scene.unitless_fingerprint()), PILOT_PATHS, stream=Stream.PILOT, threads=1)
    few = tracer.probed()
    once, more = bank.single, bank.multiple
    powers = [
        _columns(once, np.square(np.abs(single_amplitudes(few, once)))),
        _columns(more, np.square(np.abs(multiple_amplitudes(few, more, reverse)))),
    ]
    paths = np.concatenate([owner for owner, _ in powers])
    moments, intensity, share = PathMoments(0.0, 0.0), 0.0, 0.0
    for single, multiple in zip(*(weights for _, weights in powers), strict=True):
        found = PathMoments.of(np.concatenate([single, multiple]), paths, PILOT_PATHS)
        moments = max(moments, found, key=lambda m: m.relative_variance)
        mean = (single.sum() + multiple.sum()) / PILOT_PATHS
        intensity = max(intensity, mean)
        rest = np.bincount(powers[1][0], multiple, PILOT_PATHS)
        if mean > 0:
            share = max(share, (rest.mean() + 3 * rest.std() / np.sqrt(PILOT_PATHS)) / mean)
    return VolumePilot(
        events_per_path=bank.events / PILOT_PATHS,
        connections_per_path=len(bank) / PILOT_PATHS,
        moments=moments,
        intensity=float(intensity),
        multiple_share=float(share),
    )


def _columns(bank: VolumeBank, powers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Path int64[n] that each column of ``powers`` float64[pairs, n] belongs to, and the powers."""
    return np.tile(bank.paths, powers.shape[1] // max(len(bank), 1)), powers
