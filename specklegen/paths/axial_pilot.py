"""Pilot of layers that refract: their light is not aimed, and known along the axis alone.

What :mod:`specklegen.paths.pilot` says of scenes whose paths are connected to lights and views.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.random_streams import pilot_seed
from specklegen.core.values import remembered
from specklegen.paths.analog_walk import AxialLight, axial_light
from specklegen.paths.gaussianity import PathMoments
from specklegen.paths.rare_paths import ENOUGH, rare_paths_decision
from specklegen.paths.slab_tracer import events_per_path
from specklegen.paths.steps import inside_share
from specklegen.paths.stretching import relative_variance
from specklegen.scene.scene import Scene

_FIRST_PATHS, _MOST_PATHS = 6000, 2**16


@dataclass(frozen=True)
class AxialPilot:
    """Estimates of a pilot for light along the axis.

    Attributes
    ----------
    moments : PathMoments
        Of a path's weights, of more paths where rare ones carry the variance.
    intensity : float
        Mean intensity of a scene's beams behind the layers.
    events_per_path : float
        Scattering events a path at most, on average.
    missed_variance : float
        As of a :class:`specklegen.paths.pilot.Pilot`.
    decisions : tuple of Decision
        What the rules of pilots say.
    """

    light: AxialLight
    moments: PathMoments
    intensity: float
    events_per_path: float
    missed_variance: float
    decisions: tuple[Decision, ...]

    event: ClassVar[str] = "volume event"
    """Name of the operation that a scattering event of these paths is."""
    connections_per_path: ClassVar[float] = 1.0


@remembered(64)
def axial_pilot(scene: Scene) -> AxialPilot:
    """Pilot of beams through layers that refract, seen along the axis."""
    medium, seed = scene.slab, pilot_seed(scene.unitless_fingerprint())
    count = _FIRST_PATHS
    while True:
        light = axial_light(medium, count, seed, threads=1)
        moments = PathMoments.of(light.weight, np.arange(count), count)
        if moments.effective_paths >= ENOUGH or 2 * count > _MOST_PATHS:
            break
        count *= 2
    rare = rare_paths_decision(moments.effective_paths)
    mean = float(light.weight.mean()) * inside_share(medium) * scene.beams.window.area
    missed, moments = relative_variance(medium), moments.stated()
    moments = replace(moments, relative_variance=max(moments.relative_variance, missed))
    return AxialPilot(light, moments, mean, events_per_path(medium), missed, (rare,) if rare else ())
