"""Recipe kind "lens-stack": the near field of a slab through an objective, focused on one plane or on several.

Path sums render the far field over the pupil, once for all planes of a sample; :mod:`specklegen.instrument.lens`
images each plane of it. Images are over the power that the lens takes, were all of it spread evenly over the window;
the mean over the pupil is estimated from as many paths as render a medium, keyed by the medium's scene, and its
relative standard error is among the parameters, as ``mean_error``. Light beside the window leaves images darker than 1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, cast

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.lazy import torch
from specklegen.core.random_streams import pilot_seed
from specklegen.core.units import LENGTH, SINE
from specklegen.core.values import Finite, PositiveInt, Value, remembered
from specklegen.datasets.distributions import Draw, drawn, ends
from specklegen.datasets.recipes.media import planned_whole
from specklegen.datasets.recipes.parts.layered_material import LayeredMaterial
from specklegen.datasets.recipes.parts.light import Lit
from specklegen.datasets.recipes.parts.material import Material
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.recipes.specification import PARAMETERS
from specklegen.datasets.recipes.volume_recipe import VolumeMedia, VolumeView
from specklegen.datasets.recipes.volume_stack import DevelopedSpeckle
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.instrument.lens import Lens
from specklegen.paths.lit_plane import lens_of
from specklegen.paths.pilot import mean_intensity
from specklegen.samplers.path_sums.sampler import PathSums
from specklegen.samplers.sampler import MediaRequest
from specklegen.scene.illumination import CollimatedBeams
from specklegen.scene.imaging import Imaging, Pupil
from specklegen.scene.media import PlaneMedium
from specklegen.scene.scene import Scene
from specklegen.synthesis.correlations import Tabulated
from specklegen.synthesis.sight import Sight

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.media import DrawnMedia

_VIEWS = 64  # over the pupil, by which the power that the lens takes is averaged


class Objective(Value):
    """The lens of a recipe, and the planes that it is focused on.

    Parameters
    ----------
    aperture
        Largest direction sine inside the medium, as of :class:`~specklegen.scene.imaging.Imaging`.
    focus
        How far behind the exit face the first plane lies; negative: inside. May vary from medium to medium.
    planes, step
        Number of planes, and from each to the next.
    pupil
        What the lens lets through.
    """

    aperture: Annotated[float, Field(gt=0, lt=1), SINE]
    focus: Annotated[Draw, LENGTH]
    planes: PositiveInt = 1
    step: Annotated[Finite, LENGTH] = 0.0
    pupil: Pupil = Pupil()

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.planes > 1 and self.step == 0:
            reject("Objective.step", "other than 0 for several planes", self.step)
        return self

    def foci(self, first: float) -> np.ndarray:
        """float64[planes], how far each plane lies behind the face."""
        return first + self.step * np.arange(self.planes)


class LensStack(Recipe):
    """Images of the light of one beam behind a slab or layers, through an objective, one image a plane in focus.

    Samples: ``stack`` float32[F, H, W], irradiance over that of all light that the lens takes, spread over the window;
    ``focus`` float64[F], how far each plane lies behind the face. ``material.kernel_paths`` paths render each medium.

    Parameters
    ----------
    lens
        The objective.
    camera
        Pixels, by their number in a grain, wavelength / (2 aperture); points of the plane in focus.
    """

    kind: Literal["lens-stack"] = "lens-stack"
    lens: Objective
    sampler: Literal["paths"] = "paths"  # type: ignore[assignment]

    @model_validator(mode="after")
    def _check_lens(self) -> Self:
        if not isinstance(self.material, Material | LayeredMaterial):
            reject("Recipe.material", "a slab or layers where the kind is lens-stack", type(self.material).__name__)
        for name, given, remedy in (
            ("lab", self.lab is not None, "Write material.wavelength, window and camera."),
            ("exposure", self.exposure is not None, "Expose the images with specklegen.instrument.expose."),
            ("light.bandwidth", bool(self.light.bandwidth), "Path sums have one wavelength."),
        ):
            if given:
                reject(f"Recipe.{name}", "left out where the kind is lens-stack", "given", remedy)
        self._scenes(self.material.extremes()[0], self._end_foci)  # its lens is refused here
        return self

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        shape = (self.lens.planes, *self.camera_shape)
        focus = ArraySpec(shape=(self.lens.planes,), dtype="float64", dims=("plane",), units="length",
                          description="distance of the plane in focus behind the exit face")  # fmt: skip
        return {
            "stack": self.observation(shape, ("plane", "y", "x"), "one image a plane in focus"),
            "focus": focus, "parameters": PARAMETERS,
        }  # fmt: skip

    @property
    def pictures(self) -> int:
        """One a plane."""
        return self.lens.planes

    @property
    def media_alike(self) -> bool:
        """Never: media are planned one by one."""
        return False

    def _scenes(self, medium: PlaneMedium, foci: np.ndarray) -> list[Scene]:
        """Images of a medium, plane by plane."""
        assert self.window is not None
        assert self.camera is not None
        width = cast(float, self.window.width)
        light = CollimatedBeams(directions=np.array([[0.0, 0.0, 1.0]]), width=width, profile=self.profile)
        pitch = self.wavelength / (2 * self.lens.aperture * self.camera.pixels_per_grain)
        camera = Imaging(shape=self.camera.shape, pitch=pitch, aperture=self.lens.aperture, pupil=self.lens.pupil)
        return [
            Scene(wavelength=self.wavelength, medium=medium, illumination=light,
                  sensor=camera.replace(focus=float(focus)))
            for focus in foci
        ]  # fmt: skip

    @property
    def _end_foci(self) -> np.ndarray:
        """float64[2], the planes that lie farthest inside and farthest behind, over the range of the focus."""
        planes = np.concatenate([self.lens.foci(first) for first in ends(self.lens.focus)])
        return np.array([planes.min(), planes.max()])

    def lenses(self, medium: PlaneMedium, foci: np.ndarray) -> tuple[Lens, ...]:
        """Lenses of all planes, over one grid of directions for whatever focus is drawn.

        It is as fine as the planes at the ends of the range and the window need.
        """
        assert self.window is not None
        width = cast(float, self.window.width)
        resolved = int(np.ceil(4 * self.lens.aperture * width / self.wavelength * (1 - 1e-9)))  # half a far-field grain
        needed = (lens_of(scene).grid.shape[0] for scene in self._scenes(medium, self._end_foci))
        views = max(resolved, *needed)
        scenes = self._scenes(medium, foci)
        cameras = [cast(Imaging, scene.sensor) for scene in scenes]
        return tuple(
            Lens(scene, camera, camera.pupil_grid(views)) for scene, camera in zip(scenes, cameras, strict=True)
        )

    def extremes(self) -> list[VolumeView]:  # type: ignore[override]
        """Media at the ends of every range, by the directions that any of their planes takes."""
        views = []
        for medium in self.material.extremes():
            seen = self.lenses(medium, self._end_foci)[0].pupil_scene  # type: ignore[arg-type]
            views.append(VolumeView(seen, seen))
        return views

    def drawn_media(self, drawn: "Addresses", numbers: Sequence[int]) -> "list[tuple[list[int], DrawnMedia]]":
        """Draw media one by one: the medium, the planes, and the power that the lens takes."""
        return [([n], self._drawn(drawn, number)) for n, number in enumerate(numbers)]  # type: ignore[misc]

    def _drawn(self, drawn: "Addresses", number: int) -> "LensMedia":
        where = drawn.seed, drawn.split
        material = cast(Material | LayeredMaterial, self.material)
        medium, values = material.drawn_medium(generator(substream(*where, Purpose.MATERIAL, number)), drawn.split)
        first = drawn_focus(self.lens.focus, drawn.seed, drawn.split, number)  # type: ignore[arg-type]
        foci = self.lens.foci(first)
        lenses = self.lenses(medium, foci)
        unit, error = taken_power(lenses[0].pupil_scene, self.lens.pupil, material.kernel_paths)
        seen = VolumeView(lenses[0].pupil_scene, lenses[0].pupil_scene)
        width = lenses[0].scene.beams.width
        values = values | {"wavelength": self.wavelength, "width": width, "focus": first, "mean_error": error}
        put = lambda rows: torch.tensor(np.asarray(rows), dtype=torch.float64)[None].to(drawn.device)  # noqa: E731
        one = put(1.0)
        sight = Sight(
            wavelength=self.wavelength, profile=self.profile, shape=(1, 1), camera=self.camera_shape,
            center=(0.0, 0.0), integrated=False, width=one, object_pitch=one, camera_pitch=one, base=put([[0.0, 0.0]]),
        )  # fmt: skip
        parameters = {name: put(value) for name, value in values.items()}
        planes = put(np.stack([foci, 0 * foci], axis=-1))
        return LensMedia(seen, unit, DevelopedSpeckle(), sight, planes, parameters, one, lenses)

    def requests(self, media: "LensMedia") -> list[tuple[list[int], MediaRequest]]:  # type: ignore[override]
        """Request to path sums for one medium."""
        request = MediaRequest(sight=media.sight, correlations=Tabulated([]), light=None, tolerance=0.0, media=(),
                               units=torch.tensor([media.unit], dtype=torch.float64), shared=False,
                               contrast=media.contrast, planes=media.lenses)  # fmt: skip
        return [([0], request)]

    def path_scene(self, media: "LensMedia", place: int) -> Scene:  # type: ignore[override]  # noqa: ARG002
        """The far field over the pupil."""
        return media.scenes.full

    def lit(self, drawn: "Addresses", numbers: Sequence[int]) -> Lit:
        """A beam of brightness 1."""
        return Lit(torch.ones((len(numbers), 1, 1), device=drawn.device), None, {}, {})

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """Images and their planes, which stand where others have tilts."""
        return {"stack": images, "focus": tilts[..., 0]}


@dataclass(frozen=True)
class LensMedia(VolumeMedia):
    """One medium as it was drawn, and the lenses that image its planes."""

    lenses: tuple[Lens, ...]


def drawn_focus(focus: Any, seed: Any, split: Split, number: int) -> float:
    """Return the place of the first plane of a medium."""
    return drawn(focus, generator(substream(seed, split, Purpose.FOCUS, number)))


@remembered(64)
def taken_power(scene: Scene, pupil: Pupil, paths: int) -> tuple[float, float]:
    """Power that a lens takes of a beam, over the area of its window; its relative standard error.

    ``scene`` is seen from afar over the lens' ``pupil``: a square grid of views as wide as that.
    """
    plan = planned_whole(scene, paths, PathSums)
    side = scene.grid.shape[0]
    power = np.square(np.abs(pupil.cells(side, 2 / side))).ravel()
    views = np.unique(np.searchsorted(power.cumsum() / power.sum(), (np.arange(_VIEWS) + 0.5) / _VIEWS))
    seed = pilot_seed(scene.unitless_fingerprint())
    value, error = mean_intensity(plan.chosen.pilot.tracer, plan.reverse, views, seed,
                                  paths)  # type: ignore[attr-defined]
    if not value > 0:
        reject("Material.kernel_paths", "enough that some light reaches the lens", paths, "None of these paths does.")
    return value * float(power.sum()) * scene.grid.pitch**2 / scene.beams.window.area, error / value
