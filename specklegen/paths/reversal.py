"""Which parts of the physics a scene of any geometry needs."""

from typing import Literal

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.scene.illumination import PointSources
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid, NearField

Reverse = bool | Literal["auto"]
BACKSCATTER_WING = {3: 0.65, 2: 0.56}  # isotropic scatterers: the slow wing of the cone (physics.md 2)


def scene_reversal(scene: Scene, reverse: Reverse, tolerance: float) -> Decision:
    """Whether reversed paths take part in a scene.

    Between directions the rule of physics.md 2 decides. Between points no rule bounds them, so they are kept.
    """
    near = isinstance(scene.sensor, NearField) or isinstance(scene.illumination, PointSources)
    if reverse == "auto" and near:
        return Decision("reversed paths", True, "kept: between points nothing bounds what they add")
    if np.isinf(scene.medium.mean_free_path):
        return Decision("reversed paths", False, "nothing scatters")
    if reverse != "auto" and not isinstance(reverse, bool):
        reject("reverse", 'True, False or "auto"', reverse)
    return reversal_decision(
        scene.medium.mean_free_path, scene.wavelength, scene.lights, _nearest_backscattering(scene), reverse, tolerance
    )


def _nearest_backscattering(scene: Scene) -> np.ndarray:
    """Views float64[n, d] that include, for every light, the nearest to exact backscattering."""
    grid = scene.sensor
    if not isinstance(grid, FarFieldGrid):
        return scene.views
    if grid.side == "transmission" and scene.lights[:, -1].min(initial=1.0) > 0:
        return grid.corner_directions  # |i + v| >= i_z + v_z decides, and the corners are farthest from the axis
    return grid.nearest(-scene.lights)


def reversal_decision(
    mean_free_path: float, wavelength: float, light: np.ndarray, views: np.ndarray, reverse: Reverse, tolerance: float
) -> Decision:
    """Reversed paths (coherent backscattering): needed near v = -i.

    Away from -i they add about 0.65 / (k l |i + v|) of the intensity, 0.56 in flatland (physics.md 2), with the
    mean free path l and not the transport length, which is the safe side for forward scattering.

    Parameters
    ----------
    light, views
        float64[..., d], all tilts and all views; every pair counts.
    reverse
        True or False decide, "auto" judges.
    tolerance
        Relative intensity below which they are left out.
    """
    part = "reversed paths"
    if isinstance(reverse, bool):
        return Decision(part, reverse, "asked for" if reverse else "as asked")
    if reverse != "auto":
        reject("reverse", 'True, False or "auto"', reverse)
    dimension = views.shape[-1]
    nearest = _nearest_sum(light.reshape(-1, dimension), views.reshape(-1, dimension))
    wing = BACKSCATTER_WING[dimension] * wavelength / (2 * np.pi * mean_free_path * max(nearest, 1e-300))
    if wing > tolerance:
        return Decision(part, True, f"add up to {min(wing, 1):.2g} of the intensity near exact backscattering")
    return Decision(
        part, False,
        f"add at most {wing:.2g} of the intensity this far from backscattering, allowed {tolerance:g}",
    )  # fmt: skip


def _nearest_sum(light: np.ndarray, views: np.ndarray) -> float:
    """Smallest |i + v| over all pairs, from a tree (grids have a million views)."""
    if len(light) == 0 or len(views) == 0:
        return 2.0
    if views[:, -1].min() > 0 and light[:, -1].min() > 0:
        # Transmission: |i + v| >= i_z + v_z, tight enough and free.
        return float(light[:, -1].min() + views[:, -1].min())
    from scipy.spatial import KDTree

    distance, _ = KDTree(-light).query(views)
    return float(distance.min())
