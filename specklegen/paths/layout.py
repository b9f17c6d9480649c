"""A scene as the arrays that kernels read, laid out once: its medium, its particles, both ends of every connection."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from specklegen.kernels.phase_table import PhaseTable
from specklegen.kernels.volume import Volume
from specklegen.paths.endpoints import Endpoints, light_endpoints, plane_endpoints, view_endpoints
from specklegen.paths.far_field import middle_light
from specklegen.paths.jones import Analysed, ends_of
from specklegen.paths.legs import Ways
from specklegen.paths.phase_tables import phase_table
from specklegen.paths.steps import refracting_layers
from specklegen.paths.volumes import materials, volume_of
from specklegen.scene.faces import Faces
from specklegen.scene.media import PlaneMedium
from specklegen.scene.scene import Scene


@dataclass(frozen=True)
class Layout:
    """Data of a scene for the ends of connections.

    Attributes
    ----------
    volume, table
        The medium and its particles.
    lights, views : Endpoints
        The two ends of every connection.
    faces : Faces
        Of a slab; those of other media are matched.
    middle : float64[3] or None
        The light whose angles to the particles' phase functions all lights keep (:mod:`specklegen.paths.kept_angles`);
        None where each has its own.
    polarised : Analysed or None
        Light and analyser of a polarised medium; None where light is a scalar.
    ways : Ways or None
        How light goes straight through layers that refract; None of any other medium.
    """

    volume: Volume
    table: PhaseTable
    lights: Endpoints
    views: Endpoints
    wavelength: float
    faces: Faces = field(default_factory=Faces)
    middle: np.ndarray | None = None
    polarised: Analysed | None = None
    ways: Ways | None = None

    def of_ends(self, lights: np.ndarray | slice, views: np.ndarray | slice) -> Self:
        """Copy with only the lights and views of these numbers."""
        return replace(self, lights=self.lights.of(lights), views=self.views.of(views))

    def of_lights(self, chosen: np.ndarray | slice) -> Self:
        """Copy with only the lights of these numbers; views stay as they are, unspread."""
        return replace(self, lights=self.lights.of(chosen))

    def of_views(self, vectors: np.ndarray) -> Self:
        """Copy with other views: unit vectors float64[V, 3]."""
        return replace(self, views=self.views.at(vectors))

    def at(self, light: np.ndarray, view: np.ndarray) -> Self:
        """Copy with one light float64[3] and one view or several, unit vectors of travel."""
        return replace(self, lights=self.lights.at(-light), views=self.views.at(view))

    def tilting(self, other: "Layout") -> Self:
        """Copy with only the phases of another layout's lights and views."""
        return replace(self, lights=replace(self.lights, tilted=other.lights.vectors),
                       views=replace(self.views, tilted=other.views.vectors))  # fmt: skip

    def probed(self) -> Self:
        """Copy with only a few of the lights and views, which keep their beam profile."""
        return replace(self, lights=self.lights.few(), views=self.views.few())

    @property
    def exit_face(self) -> float:
        """Depth of the face of a slab where light comes out to the views."""
        return float(self.volume.bounds[1 if self.views.reference[2] > 0 else 0, 2])


def scene_layout(scene: Scene) -> Layout:
    """Lay out a scene."""
    return Layout(
        volume=volume_of(scene.volume, scene.dimension),
        table=phase_table(materials(scene.volume), 2 if scene.dimension == 2 else 3),
        lights=light_endpoints(scene),
        views=view_endpoints(scene),
        wavelength=scene.wavelength,
        faces=scene.medium.faces,
        middle=middle_light(scene),
        polarised=_analysed(scene),
        ways=_ways(scene),
    )


def _analysed(scene: Scene) -> Analysed | None:
    """Light and analyser of a polarised scene, and what its particles and faces do."""
    ends = None if scene.polarisers is None else ends_of(scene.volume)
    return None if scene.polarisers is None or ends is None else Analysed(ends, *scene.polarisers.fields)


def _ways(scene: Scene) -> Ways | None:
    if not scene.refracts_inside:
        return None
    return Ways.of(scene.slab, scene.lights, scene.sensor.corners)


def plane_layout(medium: PlaneMedium, wavelength: float, lights: np.ndarray, views: np.ndarray) -> Layout:
    """Lay out a slab under unlimited plane waves float64[T, 3], seen from float64[V, 3], unit vectors of travel.

    Intensities are per unit area of the face.
    """
    return Layout(volume=volume_of(medium, 3), table=phase_table(materials(medium), 3),
                  lights=plane_endpoints(-lights, wavelength, np.inf), views=plane_endpoints(views, wavelength),
                  wavelength=wavelength, faces=medium.faces,
                  ways=Ways.of(medium, lights, views) if refracting_layers(medium) else None)  # fmt: skip
