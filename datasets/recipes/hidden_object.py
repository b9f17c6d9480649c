"""Recipe kind "hidden-object": an incoherent object seen through a slab, one camera image a sample."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, cast

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.lazy import LazyModule
from specklegen.core.picturing import draw_images
from specklegen.core.values import Value
from specklegen.datasets.objects import HiddenObjects
from specklegen.datasets.recipes.medium_realization import MediumRealization, medium_realization
from specklegen.datasets.recipes.parts.diffuser import KnownDiffuser
from specklegen.datasets.recipes.parts.distributions import Draw, drawn, ends, require_above
from specklegen.datasets.recipes.parts.light import draw_medium
from specklegen.datasets.recipes.parts.material import KnownMaterial
from specklegen.datasets.recipes.parts.viewing import Viewing
from specklegen.datasets.recipes.recipe import PARAMETERS, Recipe
from specklegen.datasets.recipes.rendering import MediumView, realization
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.samplers.screens.objects import ScreenObjects
from specklegen.samplers.stationary.objects import ObjectSampler
from specklegen.scene.media import Slab
from specklegen.scene.screens import ScreenStack

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")

Motion = tuple[tuple[float, float], ...]
"""Velocities (x, y) of screens, lengths a frame."""
CENTRE = ("object_row", "object_column")
"""Parameters that say where an object lies in its frame."""


def centre_of(brightness: np.ndarray) -> tuple[float, float]:
    """Centre of brightness (row, column) of an object real[h, w], pixels from the first."""
    light = np.asarray(brightness, np.float64)
    rows, columns = light.sum(1), light.sum(0)
    total = rows.sum()
    return float(rows @ np.arange(len(rows)) / total), float(columns @ np.arange(len(columns)) / total)


class ObjectField(Value):
    """How large the object appears: by one of its first two fields. All may vary from medium to medium.

    Parameters
    ----------
    pitch
        Direction sine between object pixels, inside the medium.
    extent_over_range
        Full side of the object over the memory-effect range of the material, in direction sines.
    pixels
        Camera pixels across the object, for which the illuminated window is opened or closed: as one does in front of
        a slab that nobody knows, lest the object be larger than the camera, or smaller than a grain. ``window.width``
        is "fitted" then.
    """

    pitch: Draw | None = None
    extent_over_range: Draw | None = None
    pixels: Draw | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.pitch is None) == (self.extent_over_range is None):
            reject("ObjectField", "given by one of pitch and extent_over_range", self.model_dump())
        for name in ("pitch", "extent_over_range", "pixels"):
            if getattr(self, name) is not None:
                require_above(f"ObjectField.{name}", getattr(self, name), 0)
        return self


class HiddenObject(Recipe):
    """Camera images of hidden incoherent objects; mean 1 over the expected intensity of the whole image.

    Samples: ``image`` float32[H, W] (or uint16 counts), ``object`` float32[h, w] (brightness 0 to 1). Among the
    parameters are the material, what the object is (``label``; in mixtures ``family`` too) and where its centre of
    brightness lies in its frame (``object_row``, ``object_column``).

    Parameters
    ----------
    objects, field
        What is hidden, and how large it appears.
    mode_tolerance
        Share of the intensity that the stationary sampler's modes may leave out, and that is put back evenly: C_I
        between two points of an object is then too high. With 0.001 it is right within 1 % of itself for every pair of
        points of objects up to four memory-effect ranges wide; with 0.01, which takes about half the time, it is 3 %
        off in the mean over pairs a quarter of the object apart, and up to 13 % for one of them.
    """

    kind: Literal["hidden-object"] = "hidden-object"
    objects: HiddenObjects
    field: ObjectField | None = None
    mode_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.01

    @model_validator(mode="after")
    def _check_field(self) -> Self:
        if (self.field is None) == (self.lab is None):
            reject("HiddenObject.field", "given, or else a table lab, and not both", self.field)
        if self.fits_window and ends(self._pixels)[1] > min(self.camera_shape):
            reject("ObjectField.pixels", f"at most the camera's {min(self.camera_shape)}", ends(self._pixels)[1])
        return self

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Draw the first hidden objects of the training split, seed 0."""
        draw_images(axes, np.stack([self.objects.image(0, "train", n) for n in range(6)]), high=1.0)
        axes.set_title(label or "")

    @property
    def fits_window(self) -> bool:
        """Whether each medium has a window of its own."""
        return self.field is not None and self.field.pixels is not None

    def physics(self) -> dict[str, Any]:
        """Everything that decides a pixel; a folder of pictures counts by its contents, not by its path."""
        return super().physics() | {"objects": self.objects.identity()}

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        return {
            **self.images_layout(),
            "object": ArraySpec(
                shape=self.objects.shape, dtype="float32", dims=("object_y", "object_x"),
                description="hidden object, brightness 0 to 1; its image appears turned by 180 degrees",
            ),
            "parameters": PARAMETERS,
        }  # fmt: skip

    def images_layout(self) -> dict[str, ArraySpec]:
        """Layout of what :meth:`images_of` names."""
        return {"image": self.observation(self.camera_shape, ("y", "x"), "camera image")}

    def images_of(self, images: np.ndarray, tilts: np.ndarray) -> dict[str, np.ndarray]:
        """Name what the camera saw, [n, H, W], under tilts float64[T, 2]."""
        return {"image": images[0]}

    def split_notes(self) -> str:
        """What the splits share and what they do not, in Markdown sentences for the data card."""
        return (
            f"{super().split_notes()} No object of one split appears in another: "
            f"the sources of `{self.objects.type}` are dealt to the splits before any sample is drawn."
        )

    def pitch(self, material: KnownMaterial | KnownDiffuser, share: float) -> float:
        """Direction sine between object pixels in front of a material.

        Parameters
        ----------
        material
            The material.
        share
            The drawn number of the field.

        Raises
        ------
        RuleError
            If the pitch follows from a range that the material does not have.
        """
        if self.lab is not None:
            return self.lab.object_pitch(self.objects.shape)
        assert self.field is not None
        if self.field.pitch is not None:
            return share
        if not np.isfinite(material.half_range):
            reject("ObjectField.extent_over_range", "left out for a material without a memory-effect range", share,
                   "Give the pitch instead.")  # fmt: skip
        return share * material.range_sine(self.wavelength) / max(self.objects.shape)

    def geometry_of(self, pitch: float, pixels: float) -> Viewing:
        """Window and camera for objects of a pitch; ``pixels`` across, where the window is fitted."""
        if not self.fits_window:
            return self.geometry
        assert self.camera is not None
        grains = pixels / self.camera.pixels_per_grain
        return self.seen_through(self.wavelength * grains / (pitch * max(self.objects.shape)))

    @property
    def _field_number(self) -> Draw:
        return (self.field.pitch or self.field.extent_over_range or 0.0) if self.field is not None else 0.0

    @property
    def _pixels(self) -> Draw:
        return (self.field.pixels or 0.0) if self.field is not None else 0.0

    @property
    def field_varies(self) -> bool:
        """Whether two media may show objects of different extent."""
        return any(low < high for low, high in map(ends, (self._field_number, self._pixels)))

    def extremes(self) -> list[MediumView]:
        """Media at the ends of every range, looked at by the largest object, where the window is fitted behind the
        widest window and behind the narrowest, whose camera sees furthest from the axis.
        """
        share, across = ends(self._field_number)[1], sorted(set(ends(self._pixels)))
        pitches = [(slab, self.pitch(self.material.known(slab), share)) for slab in self.material.extremes()]
        return [self.view(slab, pitch, pixels, self.widest_tilts) for pixels in across for slab, pitch in pitches]

    @property
    def widest_tilts(self) -> np.ndarray:
        """The tilts that reach farthest, radians float64[T, 2]."""
        return np.zeros((1, 2))

    def view(self, slab: Slab | ScreenStack, pitch: float, pixels: float, tilts: np.ndarray) -> MediumView:
        """One medium with its object in front; where windows are fitted so many ``pixels`` across."""
        return MediumView(slab, self.geometry_of(pitch, pixels), self.objects.shape, pitch, tilts)

    def tilts_of(self, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
        """Tilts float64[T, 2] of the illumination of one medium, radians, and what was drawn for them."""
        return np.zeros((1, 2)), {}

    def motion_of(
        self, material: KnownMaterial | KnownDiffuser, seed: int, split: Split, medium: int,  # noqa: ARG002
    ) -> Motion:  # fmt: skip
        """Velocity (x, y) of each screen of one medium, lengths a frame; none of what stands still."""
        return ()

    def media_frames(
        self, seed: int, split: Split, medium: int
    ) -> tuple[dict[str, float], Callable[[ObjectSampler | ScreenObjects], list[torch.Tensor]]]:
        """What is drawn for the frames of one medium, and how a sampler draws their fields."""
        return {}, lambda made: [draw_medium(self.light, made, seed, split, medium)]

    def prepare(self, seed: int, split: Split, medium: int) -> MediumRealization:
        """Make one medium ready, with all that is drawn for it."""
        material = self.material_of(seed, split, medium)
        of_field = generator(substream(seed, split, Purpose.FIELD, medium))
        share, pixels = drawn(self._field_number, of_field), drawn(self._pixels, of_field)
        angles, tilted = self.tilts_of(generator(substream(seed, split, Purpose.TILTS, medium)))
        pitch = self.pitch(material, share)
        view = self.view(material.slab, pitch, pixels, angles)
        seen = view.seen
        motion = self.motion_of(material, seed, split, medium)
        sampler = partial(
            _sampler, self, material.slab, seen, pitch, tuple(map(tuple, np.sin(angles).tolist())), motion
        )
        moved, media = self.media_frames(seed, split, medium)
        extent = pitch * max(self.objects.shape)
        parameters = material.parameters(seen.wavelength) | {
            "width": seen.width,
            "camera_pitch": seen.grid.pitch,
            "object_pitch": pitch,
            "extent_over_range": extent / material.range_sine(seen.wavelength),
            **tilted,
            **moved,
            **self.motion_parameters(material, seen, motion),
        }
        shared = self.media is not None or self.media_group > 1
        return realization(self, view, sampler, media, parameters, (seed, split, medium), share=shared)

    def motion_parameters(
        self, material: KnownMaterial | KnownDiffuser, seen: Viewing, motion: Motion,  # noqa: ARG002
    ) -> dict[str, float]:  # fmt: skip
        """What is stored of a motion."""
        return {}

    def rendered(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One image with its object and parameters; see :class:`Recipe`."""
        which = cast(Split, split)
        brightness = self.objects.image(seed, which, index)
        medium = self.medium_number(index)
        ready = medium_realization(self, seed, which, medium)
        images = self.observed(ready.images(brightness), seed, which, index)
        return {
            **self.images_of(images, ready.tilts),
            "object": brightness,
            "index": np.int64(index),
            "parameters": {
                **ready.parameters,
                "expected_contrast": ready.expected_contrast(brightness),
                "medium": float(medium),
                **self.objects.labels(self.objects.source(seed, which, index)),
                **dict(zip(CENTRE, centre_of(brightness), strict=True)),
            },
        }


@lru_cache(maxsize=8)
def _sampler(
    recipe: HiddenObject, slab: Slab | ScreenStack, seen: Viewing, pitch: float, base: tuple, motion: Motion
) -> ObjectSampler | ScreenObjects:
    material, shape = recipe.material.known(slab), recipe.objects.shape
    moved = np.arange(len(base))[:, None, None] * np.array(motion) if motion else None
    return recipe.object_sampler(material, seen, shape, pitch, np.array(base), recipe.mode_tolerance, moved)
