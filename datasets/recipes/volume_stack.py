"""Recipe kind "volume-stack": the speckle of a box or of voxels under several tilts, seen from afar or from near by.

Path sums render it: they need neither a wide window nor a wide slab. What images are divided by has no closed form
here. It is the expected intensity, the mean over the tilts and over the camera, estimated from as many paths as render
a medium and keyed by the medium's scene; its relative standard error is among the parameters, as ``mean_error``.
"""

from dataclasses import dataclass
from typing import Any, Literal, Self, cast

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.parallel import one_blas_thread
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.values import Positive, PositiveInt, Value, remembered
from specklegen.datasets.recipes.medium_realization import MediumRealization, planned_sums
from specklegen.datasets.recipes.parts.distributions import Draw, drawn, ends, require_above
from specklegen.datasets.recipes.parts.light import medium_seeds
from specklegen.datasets.recipes.parts.material import Material
from specklegen.datasets.recipes.parts.viewing import CameraGrid
from specklegen.datasets.recipes.rendering import chosen_rendering
from specklegen.datasets.recipes.tilt_stack import TiltStack
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.paths.pilot import mean_intensity
from specklegen.planning.plan import Plan
from specklegen.scene.illumination import CollimatedBeams, directions_of_sines
from specklegen.scene.media import Box, Slab, VoxelGrid
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid, NearField

_SPREAD_VIEWS = 64  # of the camera, over which the expected intensity is averaged


class Outline(Value):
    """The medium's outline: a box about the optical axis, as thick as the material says, homogeneous or of voxels.

    Parameters
    ----------
    width
        Of the box along x and y, in the recipe's unit of length; may vary from medium to medium.
    voxels
        (z, y, x) into which the box is cut; left out, it is homogeneous.
    contrast
        Standard deviation of the voxels' densities over their mean, which the material's optical depth gives; the
        densities are independent and log-normal. May vary from medium to medium.
    """

    width: Draw
    voxels: tuple[PositiveInt, PositiveInt, PositiveInt] | None = None
    contrast: Draw = 0.5

    @model_validator(mode="after")
    def _check(self) -> Self:
        require_above("Outline.width", self.width, 0)
        require_above("Outline.contrast", self.contrast, 0)
        return self


class PlacedCamera(CameraGrid):
    """The camera's pixels, in the far field or a distance behind the medium.

    Parameters
    ----------
    distance
        From the medium's exit face to a plane of pixels about the axis, at whose centers the field is found; left out,
        the camera is in the far field. A speckle is wavelength sqrt(distance^2 + width^2 / 4) / width across there.
    """

    distance: Positive | None = None


@dataclass(frozen=True)
class VolumeView:
    """A medium, the tilts that shine on it and who looks: one scene, that is planned and rendered."""

    full: Scene

    @property
    def probe(self) -> Scene:
        """The same scene."""
        return self.full


@dataclass(frozen=True)
class VolumeFields:
    """The fields of path sums under every tilt; see :class:`~specklegen.datasets.recipes.medium_realization.Fields`.

    Attributes
    ----------
    scene : Scene
    paths : int
    unit : float
        Expected intensity, in which intensities are given.
    seeds : tuple of seeds
        Of each polarisation.
    """

    scene: Scene
    paths: int
    unit: float
    seeds: tuple[Seed, ...]

    mean = 1.0

    def intensities(self, brightness: np.ndarray) -> np.ndarray:
        """Images float32[T, H, W], mean over the polarisations; ``brightness`` float32[1, 1] is the beam's."""
        sums, found = planned_sums(self.scene, self.paths).chosen, 0.0
        with one_blas_thread():
            for seed in self.seeds:
                (drawn_once,) = sums.prepare(seed, 1).images(1)
                found = found + np.square(drawn_once.image.real) + np.square(drawn_once.image.imag)
        return np.asarray(found * (float(brightness.sum()) / (len(self.seeds) * self.unit)), np.float32)

    def superposed(self, amplitudes: np.ndarray, step: float) -> tuple[np.ndarray, float]:  # noqa: ARG002
        """Of the one beam complex[1, 1], under the first tilt."""
        brightness = np.square(np.abs(amplitudes))
        return self.intensities(brightness)[0], float(brightness.sum())


class DevelopedSpeckle:
    """The contrast of one beam behind a medium that scrambles it: 1."""

    def contrast(self, brightness: np.ndarray) -> float:  # noqa: ARG002
        """Of one beam, whatever its brightness."""
        return 1.0


class VolumeStack(TiltStack):
    """Stacks of speckle images of one box, homogeneous or of voxels, one image a tilt.

    Samples: ``stack`` float32[T, H, W], intensity over its expected mean over tilts and pixels, ``tilts`` float64[T, 2]
    in radians. ``material.kernel_paths`` paths render each stack.
    """

    kind: Literal["volume-stack"] = "volume-stack"  # type: ignore[assignment]
    outline: Outline
    camera: PlacedCamera | None = None

    @model_validator(mode="after")
    def _check_volume(self) -> Self:
        if not isinstance(self.material, Material):
            reject("Recipe.material", "given by optical_depth and g or scatterer where the kind is volume-stack",
                   self.material, "Boxes and voxels are made of these.")  # fmt: skip
        for name, given, remedy in (
            ("lab", self.lab is not None, "Write material.wavelength, window and camera."),
            ("exposure", self.exposure is not None, "Expose the images by specklegen.expose."),
            ("light.bandwidth", bool(self.light.bandwidth), "Path sums are of one wavelength."),
            ("material.faces", not self.material.faces.matched, "Boxes and voxels have no step of the index."),
            ("mode_tolerance", "mode_tolerance" in self.model_fields_set, "Path sums have no modes."),
        ):
            if given:
                reject(f"Recipe.{name}", "left out where the kind is volume-stack", "given", remedy)
        return self

    def scene(self, slab: Slab, width: float, contrast: float, tilts: np.ndarray, rng: np.random.Generator) -> Scene:
        """One medium of this outline under tilts float64[T, 2] (radians), its voxels drawn from ``rng``."""
        assert self.window is not None
        assert self.camera is not None
        side = np.array([width / 2, width / 2])
        corners: dict[str, Any] = {"lower": np.append(-side, 0.0), "upper": np.append(side, slab.thickness)}
        medium: Box | VoxelGrid
        if self.outline.voxels is None:
            medium = Box(
                **corners, mean_free_path=slab.mean_free_path, albedo=slab.albedo, scatterer=slab.scatterer
            )
        else:
            spread = np.sqrt(np.log1p(contrast**2))  # of the logarithm, whose mean makes the density's 1
            density = np.exp(spread * rng.standard_normal(self.outline.voxels) - spread**2 / 2)
            medium = VoxelGrid(
                **corners, extinction=slab.extinction * density, albedo=np.array(slab.albedo),
                scatterers=(slab.scatterer,),
            )  # fmt: skip
        beam = cast(float, self.window.width)
        directions = directions_of_sines("tilts", np.sin(tilts))
        return Scene(
            wavelength=self.wavelength, medium=medium, sensor=self._sensor(slab.thickness, max(width, beam)),
            illumination=CollimatedBeams(directions=directions, width=beam, profile=self.profile),
        )  # fmt: skip

    def _sensor(self, thickness: float, lit: float) -> FarFieldGrid | NearField:
        """The camera behind an exit face of which at most ``lit`` shines."""
        assert self.camera is not None
        rows, columns = self.camera.shape
        grain = self.wavelength / lit
        if self.camera.distance is None:
            return FarFieldGrid(shape=(rows, columns), pitch=grain / self.camera.pixels_per_grain)
        distance = self.camera.distance
        pitch = grain * float(np.hypot(distance, lit / 2)) / self.camera.pixels_per_grain
        y, x = (pitch * (np.arange(count) - (count - 1) / 2) for count in (rows, columns))
        points = np.stack([*np.meshgrid(x, y), np.full((rows, columns), thickness + distance)], axis=-1)
        return NearField(points=points)

    def extremes(self) -> list[VolumeView]:  # type: ignore[override]
        """Media at the ends of every range, under the widest tilts; voxels of a realization that stands for all."""
        return [
            VolumeView(self.scene(slab, width, contrast, self.tilts.widest, np.random.default_rng(0)))
            for slab in self.material.extremes()
            for width in sorted(set(ends(self.outline.width)))
            for contrast in sorted(set(ends(self.outline.contrast) if self.outline.voxels else [0.0]))
        ]

    def prepare(self, seed: int, split: Split, medium: int) -> MediumRealization:
        """Make one medium ready, with all that is drawn for it."""
        slab = self.material.draw(generator(substream(seed, split, Purpose.MATERIAL, medium)), split)
        angles, tilted = self.tilts.drawn(generator(substream(seed, split, Purpose.TILTS, medium)))
        rng = generator(substream(seed, split, Purpose.OUTLINE, medium))
        width, contrast = drawn(self.outline.width, rng), drawn(self.outline.contrast, rng)
        scene, paths = self.scene(slab, width, contrast, angles, rng), self.material.kernel_paths
        unit, error = _unit(scene, paths)
        chosen = chosen_rendering(self, VolumeView(scene))
        seeds = tuple(medium_seeds(self.light, seed, split, medium))
        assert self.window is not None
        told = {
            "wavelength": self.wavelength,
            "thickness": slab.thickness,
            "mean_free_path": slab.mean_free_path,
            "optical_depth": slab.optical_depth,
            "g": slab.scatterer.mean_cosine(),
            "albedo": slab.albedo,
            "width": float(cast(float, self.window.width)),
            "outline_width": width,
            "mean_error": error,
            **({"voxel_contrast": contrast} if self.outline.voxels else {}),
            **tilted,
            **self.material.labels(slab),
            "sampler": float(chosen.sampler),
            "expected_error": chosen.expected_error,
        }
        fields = VolumeFields(scene, paths, unit, seeds)
        return MediumRealization(fields, DevelopedSpeckle(), told, angles, self.light.halves**-0.5)


@remembered(64)
def _unit(scene: Scene, paths: int) -> tuple[float, float]:
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
