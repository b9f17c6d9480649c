"""Recipe kind "hidden-object": an incoherent object seen through a slab, one camera image a sample."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Literal, Self, cast

import numpy as np
import torch
from pydantic import model_validator

from specklegen.datasets.material import KnownMaterial, known
from specklegen.datasets.objects import HiddenObjects
from specklegen.datasets.protocol import ArraySpec
from specklegen.datasets.recipe import Recipe
from specklegen.datasets.split import Purpose, Split, substream
from specklegen.illumination import IncoherentObject
from specklegen.media import Slab
from specklegen.planning import Plan, plan
from specklegen.scene import Scene
from specklegen.stationary.objects import ObjectSampler, object_sampler
from specklegen.values import Positive, Value, reject


class ObjectField(Value):
    """How large the object appears: by one of two fields.

    Parameters
    ----------
    pitch
        Direction sine between object pixels, inside the medium.
    extent_over_range
        Full side of the object over the memory-effect range of the material, in direction sines.
    """

    pitch: Positive | None = None
    extent_over_range: Positive | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.pitch is None) == (self.extent_over_range is None):
            reject("ObjectField", "given by one of pitch and extent_over_range", self.model_dump())
        return self


class HiddenObject(Recipe):
    """Camera images of hidden incoherent objects; mean 1 over the expected intensity of the whole image.

    Samples: ``image`` float32[H, W], ``object`` float32[h, w] (brightness 0 to 1).
    """

    kind: Literal["hidden-object"] = "hidden-object"
    objects: HiddenObjects
    field: ObjectField
    mode_tolerance: Positive = 0.01

    def physics(self) -> dict[str, Any]:
        """Everything that decides a pixel; a folder of pictures counts by its contents, not by its path."""
        return super().physics() | {"objects": self.objects.identity()}

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        return {
            "image": ArraySpec(
                shape=self.camera.shape, dtype="float32", dims=("y", "x"),
                description="camera image over its expected intensity",
            ),
            "object": ArraySpec(
                shape=self.objects.shape, dtype="float32", dims=("object_y", "object_x"),
                description="hidden object, brightness 0 to 1; its image appears turned by 180 degrees",
            ),
        }  # fmt: skip

    def pitch(self, material: KnownMaterial) -> float:
        """Direction sine between object pixels in front of a material.

        Raises
        ------
        RuleError
            If the pitch follows from a range that the material does not have.
        """
        if self.field.pitch is not None:
            return self.field.pitch
        assert self.field.extent_over_range is not None
        if not np.isfinite(material.half_range):
            reject("ObjectField.extent_over_range", "left out for a material without a memory-effect range",
                   self.field.extent_over_range, "Give the pitch instead.")  # fmt: skip
        return self.field.extent_over_range * material.range_sine(self.material.wavelength) / max(self.objects.shape)

    def plans(self) -> list[Plan]:
        """Plans for a full object at the ends of every range of the material."""
        return [plan(self.scene(slab), paths=self.material.kernel_paths) for slab in self.material.extremes()]

    def scene(self, slab: Slab) -> Scene:
        """Scene of a slab with an object whose corners shine."""
        brightness = np.zeros(self.objects.shape)
        brightness[:: max(brightness.shape[0] - 1, 1), :: max(brightness.shape[1] - 1, 1)] = 1.0
        lights = IncoherentObject(
            brightness=brightness,
            pitch=self.pitch(known(slab, self.material.kernel_paths)),
            width=self.window.width,
            profile=self.window.profile,
        )
        return Scene(wavelength=self.material.wavelength, medium=slab, illumination=lights, sensor=self.grid)

    def sample(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One image with its object and parameters; see :class:`Recipe`."""
        which = cast(Split, split)
        brightness = self.objects.image(seed, which, index)
        medium = self.medium_number(index)
        material = self.material_of(seed, which, medium)
        sampler = _sampler(self, material.slab)
        image = sampler.image(_medium(self, seed, which, medium), brightness)
        total = float(brightness.sum(dtype=np.float64))
        wavelength = self.material.wavelength
        return {
            "image": (image / (sampler.mean * total)).cpu().numpy().astype(np.float32),
            "object": brightness,
            "index": np.int64(index),
            "parameters": material.parameters(wavelength)
            | {
                "width": self.window.width,
                "camera_pitch": self.grid.pitch,
                "object_pitch": self.pitch(material),
                "extent_over_range": self.pitch(material) * max(self.objects.shape) / material.range_sine(wavelength),
                "expected_contrast": sampler.expected_contrast(brightness),
                "medium": float(medium),
            },
        }


@lru_cache(maxsize=64)
def _sampler(recipe: HiddenObject, slab: Slab) -> ObjectSampler:
    material = known(slab, recipe.material.kernel_paths)
    return object_sampler(
        material.kernel,
        wavelength=recipe.material.wavelength,
        object_shape=recipe.objects.shape,
        object_pitch=recipe.pitch(material),
        width=recipe.window.width,
        profile=recipe.window.profile,
        grid=recipe.grid,
        tolerance=recipe.mode_tolerance,
        device=recipe.device,
    )


@lru_cache(maxsize=64)
def _medium(recipe: HiddenObject, seed: int, split: Split, medium: int) -> torch.Tensor:
    """A medium's speckle, in the form that its objects share; a split's media stay in memory."""
    material = recipe.material_of(seed, split, medium)
    sampler = _sampler(recipe, material.slab)
    fields = sampler.medium(substream(seed, split, Purpose.MEDIUM, medium))
    return fields if recipe.media is None else sampler.spectra(fields)
