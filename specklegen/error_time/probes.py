"""Which entries of the covariance stand for a scene: intensities at a few points, and correlations between them.

A point is a (light, view). Correlations are taken between points whose views have moved with their lights, where
the memory effect lives; everywhere else a wide beam has none.
"""

from dataclasses import dataclass

import numpy as np

from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarField, NearField


@dataclass(frozen=True)
class Probes:
    """Points of a scene, and pairs of them.

    Attributes
    ----------
    points : int64[n, 2]
        Rows (light, view).
    crossings : int64[m, 2]
        Rows (point, point): the correlations asked for beside the n intensities.
    """

    points: np.ndarray
    crossings: np.ndarray

    @classmethod
    def among(cls, points) -> "Probes":
        """All intensities of some points, and all correlations between two of them."""
        points = np.asarray(points, dtype=np.int64).reshape(-1, 2)
        return cls(points, np.stack(np.triu_indices(len(points), 1), axis=-1))

    @property
    def ends(self) -> np.ndarray:
        """int64[n + m, 2], the two points of every entry, the n intensities first."""
        alone = np.arange(len(self.points))
        return np.concatenate([np.stack([alone, alone], axis=-1), self.crossings])

    @property
    def quadruples(self) -> np.ndarray:
        """int64[n + m, 4], rows (light, view, light, view) as :func:`specklegen.statistics.covariance` takes them."""
        return self.points[self.ends].reshape(-1, 4)

    def scale(self, value: np.ndarray) -> np.ndarray:
        """sqrt(C_pp C_qq) float64[n + m] of entries complex128[n + m]: what relative errors are relative to."""
        power = np.sqrt(np.clip(value[: len(self.points)].real, 0, None))
        return power[self.ends].prod(axis=-1)


def only(scene: Scene, probes: Probes) -> tuple[Scene, Probes]:
    """The scene with the lights and views of the points alone, and the probes numbered anew."""
    lights, first = np.unique(probes.points[:, 0], return_inverse=True)
    views, second = np.unique(probes.points[:, 1], return_inverse=True)
    illumination = (scene.illumination if scene.illumination.coherent else scene.beams).of(lights)
    chosen = scene.views[views]
    sensor = NearField(points=chosen) if scene.sensor.near else FarField(directions=chosen)
    points = np.stack([first.ravel(), second.ravel()], axis=-1)
    return scene.replace(illumination=illumination, sensor=sensor), Probes(points, probes.crossings)


def probes_of(scene: Scene) -> Probes:
    """Points for a scene of any kind: the first, the middle and the last light, each at the view moved with it.

    Point sources and sensors of points do not move together: there all are looked at from the middle view.
    """
    lights, views = scene.lights, scene.views
    middle = views.mean(axis=0)
    still = scene.sensor.near or scene.illumination.near
    chosen = np.unique([0, len(lights) // 2, len(lights) - 1]) if len(lights) else np.empty(0, np.int64)
    points = []
    for light in chosen:
        moved = middle if still else middle + lights[light] - lights[len(lights) // 2]
        points.append((light, int(np.linalg.norm(views - moved, axis=-1).argmin())))
    return Probes.among(points)
