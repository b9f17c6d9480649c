"""Images of hidden objects behind thin screens: the stationary sampler's, under the envelope that each beam carries.

    I(v) = sum_j O_j E^2(v - i_j) |F_j(v)|^2

E^2 is a sum of products of maps of camera and object (:mod:`specklegen.synthesis.object_envelope`).
"""

from dataclasses import replace

import numpy as np
import torch

from specklegen.core.errors import reject
from specklegen.samplers.sampler import MediaRequest
from specklegen.samplers.screens.film import film_error, film_of
from specklegen.scene.screens import ScreenStack
from specklegen.scene.window import Window
from specklegen.synthesis.imaging import Imaging, imagings
from specklegen.synthesis.object_envelope import degree_of, gains_of, over_object
from specklegen.synthesis.sight import Sight
from specklegen.theory.phase_screens import index_correlation, lobes

_LOST = 0.02  # correlation that may be lost to what objects have no model of


def screen_imagings(request: MediaRequest) -> list[tuple[list[int], Imaging]]:
    """Prepare to draw and image objects behind screens; see :func:`specklegen.synthesis.imaging.imagings`."""
    sight, moved = request.sight, request.moved
    stacks = [make() for make in request.media]
    assert all(isinstance(stack, ScreenStack) for stack in stacks)
    if moved is not None:
        films = [_film(sight, n, stack.stack, moved[n].cpu().numpy()) for n, stack in enumerate(stacks)]  # type: ignore
        like, kept = (torch.from_numpy(np.stack(part)).to(sight.device) for part in zip(*films, strict=True))
        sight = replace(sight, like=like, kept=kept)
    envelopes = [_envelope(sight, n, stack.stack) for n, stack in enumerate(stacks)]  # type: ignore[union-attr]
    by_degree: dict[int, list[int]] = {}
    for n, (degree, _) in enumerate(envelopes):
        by_degree.setdefault(degree, []).append(n)
    prepared = []
    for degree, places in by_degree.items():
        polynomials = torch.from_numpy(over_object(sight.shape, degree)).to(sight.device)
        grouped = imagings(sight.at(places), request.correlations.at(places), tolerance=request.tolerance)
        for some, imaging in grouped:
            at = [places[n] for n in some]
            gains = torch.from_numpy(np.stack([envelopes[n][1] for n in at])).to(imaging.envelope)
            prepared.append((at, replace(imaging, gains=gains, polynomials=polynomials.to(imaging.envelope))))
    return prepared


def _film(sight: Sight, n: int, stack: ScreenStack, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tilts that the frames of one medium are like, float64[T, 2], and what is left of K besides, float64[T, T]."""
    window, wavelength = Window(sight.profile, float(sight.width[n])), sight.wavelength
    reach = float(sight.object_pitch[n]) * max(side - 1 for side in sight.shape)
    film = film_of(stack, wavelength, moved, window)
    error = film_error(film, stack, wavelength, moved, window, reach)
    if error > _LOST:
        reject("Dynamics.velocities", f"small enough that frames equal tilts within {_LOST:g} in C_I",
               float(f"{error:.2g}"),
               "Move the screens less, or use two screens, for which it is exact.")  # fmt: skip
    return film.tilts, film.kept


def _envelope(sight: Sight, n: int, stack: ScreenStack) -> tuple[int, np.ndarray]:
    """Degree of the polynomials of one medium, and their gains float64[T, P, H, W] over the mean of an even object."""
    wavelength, base = sight.wavelength, sight.base[n].cpu().numpy()
    terms = lobes(stack, wavelength)
    mirrored = terms.mirrored
    if mirrored > _LOST:
        reject("Diffuser.screens", f"strong enough that image and mirror image have a correlation of at most {_LOST:g}",
               float(f"{mirrored:.2g}"),
               "Raise the rms phase to 2 or more; render() draws single weak screens.")  # fmt: skip
    half = 0.5 * float(sight.object_pitch[n]) * (np.array(sight.shape[::-1]) - 1)
    farthest = np.hypot(*(np.abs(base) + half).T).max(initial=0.0)
    kept = index_correlation(stack, wavelength, np.array([0.0, farthest]))[0, 1] ** 2
    if kept < 1 - _LOST:
        reject("Diffuser.screens",
               f"of an index that keeps the correlation across object and tilts above {1 - _LOST:g}",
               float(f"{kept:.3g}"), "Use a smaller object, smaller tilts, or a lower rms height.")  # fmt: skip

    def squared(x: np.ndarray, y: np.ndarray, points: np.ndarray) -> np.ndarray:
        """E^2 [T, B, len(y), len(x)] of the beams at points x points of the object, rows first, over its half sides."""
        light_x, light_y = (base[:, axis, None] + half[axis] * points for axis in (0, 1))
        lobe = terms.over_grid((x - light_x[..., None])[:, None], (y - light_y[..., None])[:, :, None])
        forward = np.sqrt(1 - np.square(light_x)[:, None] - np.square(light_y)[:, :, None])
        intensity = lobe * (1 - np.square(x) - np.square(y)[:, None]) / forward[..., None, None]
        return intensity.reshape(len(base), -1, len(y), len(x))

    pitch = float(sight.camera_pitch[n])
    y, x = (
        sight.center[1 - axis] + (np.arange(count) - (count - 1) / 2) * pitch for axis, count in enumerate(sight.camera)
    )
    degree = degree_of(squared, x, y, point=not half.any())
    if degree is None:
        reject("ObjectField", "at most a few widths of the correlation", sight.shape, "Use a smaller object.")
    gains = gains_of(squared, x, y, degree)
    return degree, gains / gains[:, 0].mean()
