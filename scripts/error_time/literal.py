"""A scene as the literal oracle takes it."""

import numpy as np

import specklegen as sg
from specklegen.error_time import Probes
from specklegen.oracles import box_algorithms, box_media

from .scenes import CYLINDER


def literal_setup(scene: sg.Scene, probes: Probes) -> box_algorithms.Setup:
    """The points of the probes, pair by pair, in the same medium made of the oracle's own boxes and particles."""
    lights, views = scene.lights[probes.points[:, 0]], scene.views[probes.points[:, 1]]
    if isinstance(scene.medium, sg.Slab):
        return box_algorithms.slab_setup(
            scene.medium, wavelength=scene.wavelength, width=scene.beams.width, lights=lights, views=views, matched=True
        )
    seen = box_algorithms.Near(views) if isinstance(scene.sensor, sg.sensors.NearField) else box_algorithms.Far(views)
    return box_algorithms.Setup(_medium(scene), scene.wavelength, box_algorithms.Far(lights), seen, matched=True)


def _medium(scene: sg.Scene) -> box_media.Medium:
    medium = scene.medium
    if isinstance(medium, sg.media.Box):
        if isinstance(medium.scatterer, sg.media.HenyeyGreenstein):
            particle = box_media.henyey_greenstein(medium.scatterer.g, scene.dimension)
        else:
            def amplitude(cos: np.ndarray) -> np.ndarray:
                return CYLINDER.amplitude(np.arccos(np.clip(cos, -1, 1)))

            peak = 1.01 * float(np.square(np.abs(amplitude(np.linspace(-1, 1, 2001)))).max())
            particle = box_media.particle_by_rejection(amplitude, peak, scene.dimension)
        return box_media.box(
            medium.lower, medium.upper, extinction=medium.extinction, albedo=medium.albedo, particles=(particle,)
        )
    assert isinstance(medium, sg.media.VoxelGrid)
    shape = np.array(medium.extinction.shape)
    size = (medium.upper - medium.lower) / shape[::-1]  # array axes run against those of space
    number = np.stack(np.unravel_index(np.arange(medium.extinction.size), tuple(shape)), axis=-1)[:, ::-1]
    lower = medium.lower + number * size
    return box_media.Medium(
        lower, lower + size, medium.extinction.ravel(), np.broadcast_to(medium.albedo, shape).ravel(),
        (box_media.henyey_greenstein(medium.scatterers[0].g, scene.dimension),), np.ones((len(lower), 1)),
    )  # fmt: skip
