"""Pilots: a few paths of a scene, keyed by its fingerprint, from which everything is planned.

A pilot is a function of the scene alone, never of the run that it plans, so that what it decides (thresholds,
view factors, samplers) biases no result.
"""

from dataclasses import dataclass, replace

import numpy as np

from specklegen.core.random_streams import Stream, pilot_seed
from specklegen.core.values import remembered
from specklegen.paths.bank import PathBank
from specklegen.paths.gaussianity import PathMoments
from specklegen.paths.roulette import roulette_threshold
from specklegen.paths.slab_optics import Optics, contributions
from specklegen.paths.slab_tracer import Proposal, beam_proposal, trace
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid

PILOT_PATHS = 6000


@dataclass(frozen=True)
class Pilot:
    """A scene's pilot: the proposal with its threshold, a bank, and what it says of weights and cost."""

    proposal: Proposal
    bank: PathBank
    moments: PathMoments
    intensity: float


@remembered(64)
def scene_pilot(scene: Scene, reverse: bool) -> Pilot:
    """Pilot of a scene, with or without reversed paths."""
    medium = scene.slab
    views = probe_views(scene)
    proposal = beam_proposal(medium, scene.beams, views, reverse=reverse)
    optics = Optics.of_scene(scene)
    seed = pilot_seed(scene.fingerprint())
    if len(views) and len(scene.beams.directions):
        threshold = roulette_threshold(medium, proposal, optics, proposal.reference, seed)
        proposal = replace(proposal, threshold=threshold)
    bank = trace(medium, proposal, seed, PILOT_PATHS, stream=Stream.PILOT)
    moments, intensity = PathMoments(0.0, 0.0), 0.0
    for view in views:
        weights = contributions(bank, optics, proposal.reference, view)
        found = PathMoments.of(weights, bank.paths, bank.count)
        moments = max(moments, found, key=lambda m: m.relative_variance)
        intensity = max(intensity, float(weights.sum() / bank.count))
    return Pilot(proposal, bank, moments, intensity)


def probe_views(scene: Scene) -> np.ndarray:
    """Views that stand for all in weights and errors: centre and corners of a grid, at most nine others."""
    sensor = scene.sensor
    if not isinstance(sensor, FarFieldGrid):
        flat = scene.views
        return flat[np.unique(np.linspace(0, len(flat) - 1, 9).astype(int))] if len(flat) else flat
    narrow = np.ptp(sensor.corner_directions, axis=0).max() < 0.05 * (1 - abs(scene.slab.scatterer.g))
    return (
        sensor.center_direction[None]
        if narrow
        else np.concatenate([sensor.center_direction[None], sensor.corner_directions])
    )
