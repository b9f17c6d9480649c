"""Which parts of the physics a scene of any geometry needs."""

import numpy as np

from specklegen.gates import Reverse, Verdict, reversal_verdict
from specklegen.illumination import PointSources
from specklegen.scene import Scene
from specklegen.sensors import NearField
from specklegen.values import reject


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
        scene.medium.mean_free_path, scene.wavelength, scene.lights, scene.views, reverse, tolerance
    )
