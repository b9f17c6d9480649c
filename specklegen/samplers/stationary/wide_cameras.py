"""Media of recipes before a wide camera: brightness by direction, and K averaged over the camera's directions.

    I(v) = T(v) sum_j O_j |F_j(v)|^2,     T(v) = sum_j O_j A^2(i_j, v) / sum_j O_j

A is the envelope that pilot paths of the medium find (:mod:`specklegen.samplers.stationary.envelope`). One image is
drawn, under the mean envelope of the object: under that of each pixel a picture would take an image for every product.
K is that of :mod:`specklegen.memory_effects.camera`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.lazy import torch
from specklegen.core.values import remembered
from specklegen.memory_effects.cached import camera_correlation
from specklegen.paths.tracer import slab_tracer
from specklegen.samplers.stationary.envelope import Envelope
from specklegen.samplers.stationary.stationarity import half_sides, pilot_envelope
from specklegen.scene.illumination import CollimatedBeams, directions_of_sines, object_sines
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid
from specklegen.synthesis.correlations import Tabulated
from specklegen.synthesis.object_envelope import MOST_DEGREE, degree_of, gains_of, over_object

if TYPE_CHECKING:
    from specklegen.samplers.sampler import MediaRequest
    from specklegen.synthesis.imaging import Imaging
    from specklegen.synthesis.sight import Sight


def wide_imagings(request: MediaRequest, paths: int, *, complete: bool) -> list[tuple[list[int], Imaging]]:
    """Prepare to draw media and image objects through them; see :func:`specklegen.synthesis.imaging.imagings`.

    Parameters
    ----------
    request
        Its light has the K of each of its modes, and a film that of its medium: these are left as they are.
    paths
        That estimate the K of each medium.
    complete
        Whether the memory effect is taken as complete.
    """
    from specklegen.synthesis.imaging import imagings

    scenes = [_scene(request.sight, n, make()) for n, make in enumerate(request.media)]  # type: ignore[arg-type]
    correlations = request.correlations
    if not complete and request.light is None and request.film is None:
        correlations = Tabulated([camera_correlation(scene.slab, half_sides(scene), paths) for scene in scenes])
    maps = [_maps(request.sight, n, scene) for n, scene in enumerate(scenes)]
    by_degree: dict[int, list[int]] = {}
    for n, (degree, _) in enumerate(maps):
        by_degree.setdefault(degree, []).append(n)
    prepared = []
    for degree, places in by_degree.items():
        grouped = imagings(
            request.sight.at(places), correlations.at(places), request.light and request.light.at(places),
            tolerance=request.tolerance, film=request.film and request.film.at(places),
        )  # fmt: skip
        for some, imaging in grouped:
            at = [places[n] for n in some]
            gains, polynomials = (
                torch.from_numpy(each).to(imaging.envelope)
                for each in (np.stack([maps[n][1] for n in at]), over_object(request.sight.shape, degree))
            )
            prepared.append((at, replace(imaging, gains=gains, polynomials=polynomials, merged=True)))
    return prepared


def _scene(sight: Sight, n: int, slab: object) -> Scene:
    """One medium under the beams of its object's corners and middle, under every base tilt."""
    pitch, base = float(sight.object_pitch[n]), sight.base[n].cpu().numpy()
    corners = np.unique([[r, c] for r in (0, sight.shape[0] - 1) for c in (0, sight.shape[1] - 1)], axis=0)
    sines = object_sines("object", sight.shape, pitch, corners @ (sight.shape[1], 1))
    beams = (base[:, None] + np.concatenate([sines, np.zeros((1, 2))])).reshape(-1, 2)
    light = CollimatedBeams(directions=directions_of_sines("object", beams), width=float(sight.width[n]),
                            profile=sight.profile)  # fmt: skip
    grid = FarFieldGrid(shape=sight.camera, pitch=float(sight.camera_pitch[n]), center=sight.center)
    return Scene(wavelength=sight.wavelength, medium=slab, illumination=light, sensor=grid)  # type: ignore[arg-type]


@remembered(64)
def _envelope(scene: Scene) -> Envelope | None:
    return pilot_envelope(scene, slab_tracer(scene, False, aside=False))


def _maps(sight: Sight, n: int, scene: Scene) -> tuple[int, np.ndarray]:
    """Degree of the polynomials of one medium's object, and their maps of the camera float64[T, P, H, W]."""
    half = 0.5 * float(sight.object_pitch[n]) * (np.array(sight.shape[::-1]) - 1)
    envelope, base = _envelope(scene), sight.base[n].cpu().numpy()
    if envelope is None:
        return 0, np.ones((len(base), 1, *sight.camera))

    def squared(x: np.ndarray, y: np.ndarray, points: np.ndarray) -> np.ndarray:
        at = np.stack(np.meshgrid(points, points), axis=-1).reshape(-1, 2)
        lights = base[:, None] + half * at
        return envelope.intensity(lights[:, :, None, None], np.stack(np.meshgrid(x, y), axis=-1))

    x, y = scene.grid.sines
    degree = degree_of(squared, x, y, point=not half.any())
    degree = MOST_DEGREE if degree is None else degree
    return degree, gains_of(squared, x, y, degree)
