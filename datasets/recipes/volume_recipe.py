"""Common part of recipes of volumes: a box, voxels, or a slab that a camera near by looks at.

Path sums render them: they need neither a wide window nor a wide slab. What images are divided by has no closed form
here. It is the expected intensity, the mean over the beams and over the camera, estimated from as many paths as render
a medium and keyed by the medium's scene; its relative standard error is among the parameters, as ``mean_error``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, cast

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.lazy import torch
from specklegen.core.random_streams import pilot_seed
from specklegen.core.values import remembered
from specklegen.datasets import distributions
from specklegen.datasets.distributions import ends
from specklegen.datasets.recipes.media import planned_whole
from specklegen.datasets.recipes.parts.material import Material
from specklegen.datasets.recipes.parts.volume import Outline, PlacedCamera
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.paths.pilot import mean_intensity
from specklegen.planning.plan import Plan
from specklegen.samplers.path_sums.sampler import PathSums
from specklegen.samplers.sampler import MediaRequest
from specklegen.scene.illumination import CollimatedBeams, directions_of_sines
from specklegen.scene.media import Slab
from specklegen.scene.scene import Scene
from specklegen.synthesis.correlations import Tabulated
from specklegen.synthesis.sight import Sight

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.media import DrawnMedia
    from specklegen.samplers.sampler import Contrast
    from specklegen.synthesis.correlations import Places

_SPREAD_VIEWS = 64  # of the camera, over which the expected intensity is averaged


@dataclass(frozen=True)
class Beams:
    """The beams that shine on one medium.

    Attributes
    ----------
    sines : float64[n, 2]
        Their direction sines.
    judged : int64[k]
        Numbers of those that the planner judges, and over which the expected intensity is averaged.
    tilts : float64[T, 2]
        Tilts that samples tell, radians.
    parameters : dict
        What was drawn for them.
    """

    sines: np.ndarray
    judged: np.ndarray
    tilts: np.ndarray
    parameters: dict[str, float]


@dataclass(frozen=True)
class VolumeView:
    """A medium, what shines on it and who looks.

    Attributes
    ----------
    probe : Scene
        With the beams that the planner judges.
    full : Scene
        With every beam.
    """

    probe: Scene
    full: Scene


class VolumeRecipe(Recipe):
    """A recipe of volumes.

    Parameters
    ----------
    outline
        The box; left out, the medium is the slab itself, for a camera at a distance.
    camera
        The pixels, from afar or near by.
    """

    outline: Outline | None = None
    camera: PlacedCamera | None = None  # type: ignore[assignment]

    @model_validator(mode="after")
    def _check_volume(self) -> Self:
        kind = cast(str, getattr(self, "kind", "volume"))
        if not isinstance(self.material, Material):
            reject("Recipe.material", f"given by optical_depth and g or scatterer where the kind is {kind}",
                   self.material, "Boxes and voxels are made of these.")  # fmt: skip
        for name, given, remedy in (
            ("lab", self.lab is not None, "Write material.wavelength, window and camera."),
            ("exposure", self.exposure is not None, "Expose the images with specklegen.instrument.expose."),
            ("light.bandwidth", bool(self.light.bandwidth), "Path sums have one wavelength."),
            ("material.faces", not self.material.faces.matched, "Boxes and voxels are index-matched."),
            ("mode_tolerance", "mode_tolerance" in self.model_fields_set, "Path sums have no modes."),
        ):
            if given:
                reject(f"Recipe.{name}", f"left out where the kind is {kind}", "given", remedy)
        if self.outline is None and self.camera is not None and self.camera.distance is None:
            reject("Recipe.outline", f"given where the kind is {kind} and the camera has no distance", None,
                   "Slabs in the far field are rendered by kinds tilt-stack and hidden-object.")  # fmt: skip
        return self

    def beams(self, seed: int, split: Split, medium: int) -> Beams:
        """The beams of one medium."""
        raise NotImplementedError

    def widest_beams(self) -> Beams:
        """Beams that reach farthest."""
        raise NotImplementedError

    @property
    def object_shape(self) -> tuple[int, int]:
        """Pixels of the object, each a beam under every tilt."""
        raise NotImplementedError

    def contrast_of(self, view: VolumeView) -> "Contrast":
        """Predictor of the contrast of images of one medium."""
        raise NotImplementedError

    @property
    def media_alike(self) -> bool:
        """Never: media are planned one by one."""
        return False

    def volume_view(
        self, slab: Slab, width: float, contrast: float, beams: Beams, rng: np.random.Generator
    ) -> VolumeView:
        """One medium of the outline under its beams, its voxels drawn from ``rng``."""
        assert self.window is not None
        assert self.camera is not None
        window = cast(float, self.window.width)
        if self.outline is None:
            medium, lit = slab, window + 2 * slab.thickness  # as far as most light spreads sideways
        else:
            medium, lit = self.outline.medium(slab, width, contrast, rng), max(width, window)
        sensor = self.camera.sensor(self.wavelength, slab.thickness, lit)

        def scene(sines: np.ndarray) -> Scene:
            light = CollimatedBeams(
                directions=directions_of_sines("beams", sines), width=window, profile=self.profile
            )
            return Scene(wavelength=self.wavelength, medium=medium, sensor=sensor, illumination=light)

        return VolumeView(scene(beams.sines[beams.judged]), scene(beams.sines))

    def _outlines(self, of: Callable) -> tuple:
        """``of`` the width and of the contrast of the outline, 0 for what it does not have."""
        outline = self.outline
        return of(outline.width if outline else 0.0), of(outline.contrast if outline and outline.voxels else 0.0)

    def extremes(self) -> list[VolumeView]:  # type: ignore[override]
        """Media at the ends of every range under the widest beams; voxels of a realization that stands for all."""
        beams = self.widest_beams()
        widths, contrasts = self._outlines(lambda number: sorted(set(ends(number))))
        return [
            self.volume_view(slab, width, contrast, beams, np.random.default_rng(0))
            for slab in self.material.extremes()
            for width in widths
            for contrast in contrasts
        ]

    def drawn_media(self, drawn: "Addresses", numbers: Sequence[int]) -> "list[tuple[list[int], DrawnMedia]]":
        """Draw media one by one: slabs, outlines, beams, and the intensity that is expected."""
        return [([n], self._drawn(drawn, number)) for n, number in enumerate(numbers)]

    def _drawn(self, drawn: "Addresses", number: int) -> "VolumeMedia":
        where = drawn.seed, drawn.split
        slab = self.material.draw(generator(substream(*where, Purpose.MATERIAL, number)), drawn.split)
        beams = self.beams(drawn.seed, drawn.split, number)  # type: ignore[arg-type]
        rng = generator(substream(*where, Purpose.OUTLINE, number))
        width, contrast = self._outlines(lambda each: distributions.drawn(each, rng))
        view = self.volume_view(slab, width, contrast, beams, rng)
        unit, error = expected_intensity(view.probe, self.material.kernel_paths)
        assert self.window is not None
        assert self.camera is not None
        values = {
            "wavelength": self.wavelength,
            "thickness": slab.thickness,
            "mean_free_path": slab.mean_free_path,
            "optical_depth": slab.optical_depth,
            "g": slab.scatterer.mean_cosine(),
            "albedo": slab.albedo,
            "width": float(cast(float, self.window.width)),
            **({"outline_width": width} if self.outline else {}),
            "mean_error": error,
            **({"voxel_contrast": contrast} if self.outline and self.outline.voxels else {}),
            **beams.parameters,
            **self.material.labels(slab),
        }
        put = lambda rows: torch.tensor(np.asarray(rows), dtype=torch.float64)[None].to(drawn.device)  # noqa: E731
        one, tilts = put(1.0), put(beams.tilts)
        sight = Sight(
            wavelength=self.wavelength, profile=self.profile, shape=self.object_shape, camera=self.camera.shape,
            center=(0.0, 0.0), integrated=False, width=one, object_pitch=one, camera_pitch=one, base=tilts,
        )  # fmt: skip
        parameters = {name: put(value) for name, value in values.items()}
        return VolumeMedia(view, unit, self.contrast_of(view), sight, tilts, parameters, one)

    def requests(self, media: "VolumeMedia") -> list[tuple[list[int], MediaRequest]]:  # type: ignore[override]
        """Request to path sums for one medium."""
        request = MediaRequest(
            sight=media.sight, correlations=Tabulated([]), light=None, tolerance=0.0, media=(),
            units=torch.tensor([media.unit], dtype=torch.float64), shared=self.shares_media, contrast=media.contrast,
        )  # fmt: skip
        return [([0], request)]

    def path_scene(self, media: "VolumeMedia", place: int) -> Scene:  # type: ignore[override]  # noqa: ARG002
        """The scene with every beam."""
        return media.scenes.full


@dataclass(frozen=True)
class VolumeMedia:
    """One medium as it was drawn: as :class:`~specklegen.datasets.recipes.media.DrawnMedia`, of path sums alone.

    Attributes
    ----------
    unit : float
        Expected intensity of a beam of brightness 1.
    contrast : Contrast
        What tells the contrast of images.
    sight : Sight
        Shapes of object and camera; its numbers mean nothing.
    tilts : float64[1, T, 2]
    parameters : dict of float64[1]
    still : float64[1]
    """

    scenes: VolumeView
    unit: float
    contrast: "Contrast"
    sight: Sight
    tilts: "torch.Tensor"
    parameters: "dict[str, torch.Tensor]"
    still: "torch.Tensor"

    def __len__(self) -> int:
        return 1

    def at(self, places: "Places") -> "VolumeMedia":  # noqa: ARG002 - there is one
        """The medium."""
        return self

    def view(self, place: int) -> VolumeView:  # noqa: ARG002
        """View as it is planned."""
        return self.scenes


@remembered(64)
def expected_intensity(scene: Scene, paths: int) -> tuple[float, float]:
    """Expected intensity, mean over the lights and over views spread over the camera; its relative standard error."""
    plan: Plan = planned_whole(scene, paths, PathSums)
    rows, columns = scene.sensor.shape
    number = np.arange(_SPREAD_VIEWS)
    row = ((number + 0.5) / _SPREAD_VIEWS * rows).astype(int)
    column = (number * ((np.sqrt(5) - 1) / 2) % 1 * columns).astype(int)  # a lattice of Fibonacci's
    views = np.unique(row * columns + column)
    seed = pilot_seed(scene.unitless_fingerprint())
    value, error = mean_intensity(plan.chosen.pilot.tracer, plan.reverse, views, seed, paths)
    if not value > 0:
        reject("Material.kernel_paths", "enough that some light reaches the camera", paths, "None does.")
    return value, error / value
