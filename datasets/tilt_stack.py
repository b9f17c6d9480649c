"""Recipe kind "tilt-stack": the speckle of one medium under several tilts, materials drawn from ranges."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Literal, cast

import numpy as np

from specklegen.datasets.draws import Draw, drawn, ends
from specklegen.datasets.protocol import ArraySpec
from specklegen.datasets.recipe import Recipe
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.illumination import CollimatedBeams, illuminated_area
from specklegen.media import Slab
from specklegen.planning import Plan, plan
from specklegen.scene import Scene
from specklegen.stationary.sampler import StackSampler, mean_intensity, stack_sampler
from specklegen.values import PositiveInt, Value


class Tilts(Value):
    """Equally spaced tilts from the axis.

    Parameters
    ----------
    count
        Number of tilts, the first along the axis.
    step
        Angle between neighbours, radians; may vary from medium to medium.
    azimuth
        Direction of tilting from the x axis, radians; may vary from medium to medium.
    """

    count: PositiveInt = 5
    step: Draw
    azimuth: Draw = 0.0

    def angles(self, step: float, azimuth: float) -> np.ndarray:
        """Tilts float64[T, 2] = (x, y), radians."""
        along = np.array([np.cos(azimuth), np.sin(azimuth)])
        return np.arange(self.count)[:, None] * (step * along)


class TiltStack(Recipe):
    """Stacks of speckle images of one medium, one image a tilt, mean intensity 1.

    Samples: ``stack`` float32[T, H, W], ``tilts`` float64[T, 2] in radians.
    """

    kind: Literal["tilt-stack"] = "tilt-stack"
    tilts: Tilts

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        count, (rows, columns) = self.tilts.count, self.camera.shape
        return {
            "stack": ArraySpec(
                shape=(count, rows, columns), dtype="float32", dims=("tilt", "y", "x"),
                description="intensity over its expected value",
            ),
            "tilts": ArraySpec(
                shape=(count, 2), dtype="float64", dims=("tilt", "axis"), units="rad",
                description="tilt of the illumination from the axis along x and y",
            ),
        }  # fmt: skip

    def scene(self, slab: Slab, angles: np.ndarray) -> Scene:
        """Scene of one medium."""
        beams = CollimatedBeams.tilts(angles, width=self.window.width, profile=self.window.profile)
        return Scene(wavelength=self.material.wavelength, medium=slab, illumination=beams, sensor=self.grid)

    def plans(self) -> list[Plan]:
        """Plans for the thickest tilts at the ends of every range of the material."""
        angles = self.tilts.angles(ends(self.tilts.step)[1], ends(self.tilts.azimuth)[0])
        return [plan(self.scene(slab, angles), paths=self.material.kernel_paths) for slab in self.material.extremes()]

    def sample(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One stack with its tilts and parameters; see :class:`Recipe`."""
        which = cast(Split, split)
        medium = self.medium_number(index)
        sampler, angles, mean, parameters = _prepared(self, seed, which, medium)
        field = sampler.sample(substream(seed, which, Purpose.MEDIUM, medium)).cpu().numpy()
        intensity = np.square(field.real) + np.square(field.imag)
        return {
            "stack": (intensity / mean).astype(np.float32),
            "tilts": angles,
            "index": np.int64(index),
            "parameters": parameters | {"medium": float(medium)},
        }


@lru_cache(maxsize=64)
def _prepared(
    recipe: TiltStack, seed: int, split: Split, medium: int
) -> tuple[StackSampler, np.ndarray, float, dict[str, float]]:
    material = recipe.material_of(seed, split, medium)
    rng = generator(substream(seed, split, Purpose.TILTS, medium))
    step, azimuth = drawn(recipe.tilts.step, rng), drawn(recipe.tilts.azimuth, rng)
    angles = recipe.tilts.angles(step, azimuth)
    sampler = stack_sampler(recipe.scene(material.slab, angles), material.kernel, device=recipe.device)
    area = illuminated_area(recipe.window.width, recipe.window.profile)
    parameters = material.parameters(recipe.material.wavelength) | {
        "width": recipe.window.width,
        "camera_pitch": recipe.grid.pitch,
        "tilt_step": step,
        "tilt_azimuth": azimuth,
    }
    return sampler, angles, mean_intensity(material.kernel, area), parameters
