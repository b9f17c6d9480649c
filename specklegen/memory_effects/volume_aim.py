"""Light and views of media with sides, boxes and voxels: plane waves along the axis, views far away.

What is true of :func:`specklegen.memory_effects.curve.aimed` of slabs is true here of scenes: light is as wide as the
medium, tilts turn it in the x-z plane, and views move with it.
"""

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import choice, positive_number
from specklegen.core.budgets import Reverse
from specklegen.core.errors import reject
from specklegen.memory_effects.curve import OFF_BACKSCATTER, Aim, Mode, checked_view, require_angles
from specklegen.paths.reversal import scene_reversal
from specklegen.scene.illumination import PlaneWaves, directions_of_sines
from specklegen.scene.media import Box, VoxelGrid
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarField
from specklegen.scene.validity import warn_of_dependence


def volume_scene(
    owner: str, medium: Box | VoxelGrid, wavelength: float, tilts: np.ndarray, mode: Mode, view: ArrayLike | None,
    reverse: Reverse, tolerance: float,
) -> tuple[Aim, Scene]:  # fmt: skip
    """Pairs of light and view of a medium with sides at tilts float64[T], and the scene of no tilt and these."""
    if np.isinf(medium.mean_free_path) or not np.any(medium.albedo):
        reject(f"{owner} medium", "a medium that scatters", medium, "Without scattered light there is no speckle.")
    require_angles(owner, tilts)
    warn_of_dependence(medium.mean_free_path, positive_number(f"{owner} wavelength", wavelength))
    side = 1.0 if choice(f"{owner} mode", mode, ("transmission", "reflection")) == "transmission" else -1.0
    kept = [0, 1, 2] if medium.dimension == 3 else [0, 2]
    if view is None:
        aside = 0.0 if side > 0 else np.sin(OFF_BACKSCATTER)
        view = directions_of_sines("view", [aside, 0.0], side)[kept]
    view = checked_view(owner, view, mode, len(kept))
    turned = np.stack([np.sin(tilts), 0 * tilts], -1)
    light = directions_of_sines(f"{owner} tilts", turned)[:, kept]
    views = directions_of_sines(f"{owner} view + tilts", np.resize(view[:-1], 2) * [1, len(kept) > 2] + turned, side)
    views = views[:, kept]
    straight = np.eye(3)[2:, kept]
    scene = Scene(wavelength=wavelength, medium=medium, illumination=PlaneWaves(np.concatenate([straight, light])),
                  sensor=FarField(np.concatenate([view[None], views])))  # fmt: skip
    return Aim(light, view, views, side, scene_reversal(scene, reverse, tolerance)), scene
