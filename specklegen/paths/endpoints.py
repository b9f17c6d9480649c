"""What the ends of a path are connected to: lights on one side, views on the other.

Both are seen from the medium: a far target is a direction away from it, so a plane wave travelling along i is
the target -i, and by reciprocity one function evaluates either end.
"""

from dataclasses import dataclass, replace

import numpy as np

from specklegen.kernels import volume_walk
from specklegen.kernels.walk import UNLIMITED
from specklegen.paths.layout import footprint_code, spatial
from specklegen.scene.illumination import CollimatedBeams, IncoherentObject, PointSources
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import NearField

_PROBES = 5


@dataclass(frozen=True)
class Endpoints:
    """Lights or views.

    Attributes
    ----------
    near : bool
        Whether ``vectors`` are points; else unit vectors away from the medium.
    vectors : float64[n, 3]
    wavelength : float
    footprint, radius :
        Beam profile on the entrance plane; radius 0 is none.
    """

    near: bool
    vectors: np.ndarray
    wavelength: float
    footprint: int = UNLIMITED
    radius: float = 0.0

    def few(self) -> "Endpoints":
        """A few of them, which stand for all."""
        chosen = np.unique(np.linspace(0, max(len(self.vectors) - 1, 0), _PROBES).astype(int))
        return replace(self, vectors=self.vectors[chosen]) if len(self.vectors) else self

    def probed(self) -> "Endpoints":
        """A few of them without their profile: what only other beams light must be judged as if these did."""
        return replace(self.few(), footprint=UNLIMITED, radius=0.0)


def light_endpoints(scene: Scene) -> Endpoints:
    """The lights of a scene."""
    lights = spatial(scene.lights)
    if isinstance(scene.illumination, PointSources):
        return Endpoints(True, lights, scene.wavelength)
    if isinstance(scene.illumination, CollimatedBeams | IncoherentObject):
        beams = scene.beams
        return Endpoints(False, -lights, scene.wavelength, footprint_code(beams.profile), beams.width / 2)
    return Endpoints(False, -lights, scene.wavelength)


def view_endpoints(scene: Scene) -> Endpoints:
    """The views of a scene, in C order."""
    return Endpoints(isinstance(scene.sensor, NearField), spatial(scene.views), scene.wavelength)


def probes(target: Endpoints) -> tuple[np.ndarray, np.ndarray]:
    """Kinds int64[n] and vectors float64[n, 3] of the probes, as the walk reads them."""
    few = target.probed().vectors
    kind = volume_walk.NEAR if target.near else volume_walk.FAR
    return np.full(len(few), kind, np.int64), np.ascontiguousarray(few)
