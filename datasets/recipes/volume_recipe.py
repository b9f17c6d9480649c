"""What recipes of volumes have in common: a box, voxels, or a slab that a camera near by looks at.

Path sums render them: they need neither a wide window nor a wide slab. What images are divided by has no closed form
here. It is the expected intensity, the mean over the beams and over the camera, estimated from as many paths as render
a medium and keyed by the medium's scene; its relative standard error is among the parameters, as ``mean_error``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self, cast

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.values import remembered
from specklegen.datasets.recipes.medium_realization import Contrast, Fields, MediumRealization, planned_sums
from specklegen.datasets.recipes.parts.distributions import drawn, ends
from specklegen.datasets.recipes.parts.light import medium_seeds
from specklegen.datasets.recipes.parts.material import Material
from specklegen.datasets.recipes.parts.volume import Outline, PlacedCamera
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.recipes.rendering import chosen_rendering
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.paths.pilot import mean_intensity
from specklegen.planning.plan import Plan
from specklegen.scene.illumination import CollimatedBeams, directions_of_sines
from specklegen.scene.media import Slab
from specklegen.scene.scene import Scene

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
            ("exposure", self.exposure is not None, "Expose the images by specklegen.expose."),
            ("light.bandwidth", bool(self.light.bandwidth), "Path sums are of one wavelength."),
            ("material.faces", not self.material.faces.matched, "Boxes and voxels have no step of the index."),
            ("mode_tolerance", "mode_tolerance" in self.model_fields_set, "Path sums have no modes."),
        ):
            if given:
                reject(f"Recipe.{name}", f"left out where the kind is {kind}", "given", remedy)
        if self.outline is None and self.camera is not None and self.camera.distance is None:
            reject("Recipe.outline", f"given where the kind is {kind} and the camera has no distance", None,
                   "Slabs seen from afar are what tilt-stack and hidden-object render.")  # fmt: skip
        return self

    def beams(self, seed: int, split: Split, medium: int) -> Beams:
        """The beams of one medium."""
        raise NotImplementedError

    def widest_beams(self) -> Beams:
        """Those that reach farthest."""
        raise NotImplementedError

    def speckle(self, view: VolumeView, unit: float, seeds: tuple[Seed, ...]) -> tuple[Fields, Contrast]:
        """The fields of one medium in units of an expected intensity, and what tells their contrast."""
        raise NotImplementedError

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

    def prepare(self, seed: int, split: Split, medium: int) -> MediumRealization:
        """Make one medium ready, with all that is drawn for it."""
        slab = self.material.draw(generator(substream(seed, split, Purpose.MATERIAL, medium)), split)
        beams = self.beams(seed, split, medium)
        rng = generator(substream(seed, split, Purpose.OUTLINE, medium))
        width, contrast = self._outlines(lambda number: drawn(number, rng))
        view = self.volume_view(slab, width, contrast, beams, rng)
        unit, error = expected_intensity(view.probe, self.material.kernel_paths)
        chosen = chosen_rendering(self, view)
        fields, speckle = self.speckle(view, unit, tuple(medium_seeds(self.light, seed, split, medium)))
        assert self.window is not None
        told = {
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
            "sampler": float(chosen.sampler),
            "expected_error": chosen.expected_error,
        }
        return MediumRealization(fields, speckle, told, beams.tilts, self.light.halves**-0.5)


@remembered(64)
def expected_intensity(scene: Scene, paths: int) -> tuple[float, float]:
    """Expected intensity, mean over the lights and over views spread over the camera; its relative standard error."""
    made: Plan = planned_sums(scene, paths)
    rows, columns = scene.sensor.shape
    number = np.arange(_SPREAD_VIEWS)
    row = ((number + 0.5) / _SPREAD_VIEWS * rows).astype(int)
    column = (number * ((np.sqrt(5) - 1) / 2) % 1 * columns).astype(int)  # a lattice of Fibonacci's
    views = np.unique(row * columns + column)
    seed = pilot_seed(scene.unitless_fingerprint())
    value, error = mean_intensity(made.chosen.pilot.tracer, made.reverse, views, seed, paths)
    if not value > 0:
        reject("Material.kernel_paths", "enough for some light to reach the camera", paths, "None does.")
    return value, error / value
