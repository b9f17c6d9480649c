"""Which parts of the physics a scene of any geometry needs."""

import numpy as np

from specklegen.gates import Reverse, Verdict, reversal_verdict
from specklegen.illumination import CollimatedBeams, IncoherentObject, PointSources
from specklegen.media import Slab
from specklegen.scatterers import HenyeyGreenstein, Isotropic
from specklegen.scene import Scene
from specklegen.sensors import FarFieldGrid, NearField
from specklegen.values import reject


def slab_engine_obstacle(scene: Scene) -> str | None:
    """Why the fast engine for beams through a slab does not serve a scene; None where it does."""
    if not isinstance(scene.medium, Slab):
        return f"the medium is a {type(scene.medium).__name__}"
    if scene.dimension == 2:
        return "the scene is in flatland"
    if not isinstance(scene.illumination, CollimatedBeams | IncoherentObject):
        return f"the light is {type(scene.illumination).__name__}"
    if isinstance(scene.sensor, NearField):
        return "the sensor is in the near field"
    if not isinstance(scene.medium.scatterer, HenyeyGreenstein | Isotropic):
        return f"the scatterer is {type(scene.medium.scatterer).__name__}"
    return None


def scene_reversal(scene: Scene, reverse: Reverse, tolerance: float) -> Verdict:
    """Whether reversed paths take part in a scene.

    Between directions the rule of physics.md 2 decides. Between points no rule bounds them, so they are kept.
    """
    near = isinstance(scene.sensor, NearField) or isinstance(scene.illumination, PointSources)
    if reverse == "auto" and near:
        return Verdict("reversed paths", True, "kept: between points nothing bounds what they add")
    if np.isinf(scene.medium.mean_free_path):
        return Verdict("reversed paths", False, "nothing scatters")
    if reverse != "auto" and not isinstance(reverse, bool):
        reject("reverse", 'True, False or "auto"', reverse)
    return reversal_verdict(
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
