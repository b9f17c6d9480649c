"""Recipe kind "hidden-object": an incoherent object seen through a slab, one camera image a sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.display.plot import draw_images
from specklegen.core.errors import reject, warn_user
from specklegen.core.lazy import LazyModule, torch
from specklegen.core.shielded import shielded
from specklegen.core.units import SINE
from specklegen.core.values import Value
from specklegen.datasets.distributions import Draw, ends, require_above
from specklegen.datasets.recipes.media import DrawnMedia, MediumView
from specklegen.datasets.recipes.parts.light import Lit
from specklegen.datasets.recipes.parts.viewing import LEAST_PIXELS, Viewing
from specklegen.datasets.recipes.shown_objects import ShownObjects
from specklegen.datasets.recipes.specification import PARAMETERS
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose
from specklegen.scene.validity import implausible

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes import materials as _materials
    from specklegen.datasets.recipes.materials import Materials
else:
    _materials = LazyModule("specklegen.datasets.recipes.materials")

CENTRE = ("object_row", "object_column")
"""Parameters that say where an object lies in its frame."""


def centre_of(brightness: np.ndarray) -> tuple[float, float]:
    """Centre of brightness (row, column) of an object real[h, w], pixels from the first."""
    light = np.asarray(brightness, np.float64)
    rows, columns = light.sum(1), light.sum(0)
    total = rows.sum()
    return float(rows @ np.arange(len(rows)) / total), float(columns @ np.arange(len(columns)) / total)


def centres_of(light: "torch.Tensor") -> "tuple[torch.Tensor, ...]":
    """Centres of brightness float64[B], rows and columns, of objects real[B, h, w]."""
    if light.device.type == "cpu":  # one by one: sums over several have other last bits
        return torch.tensor([centre_of(each) for each in light.numpy()], dtype=torch.float64).unbind(-1)
    bright = light.double()
    along = [torch.arange(n, dtype=torch.float64, device=light.device) for n in bright.shape[1:]]
    return tuple(bright.sum(axis) @ place / bright.sum((1, 2)) for axis, place in zip((2, 1), along, strict=True))


class ObjectField(Value):
    """Angular size of the object: by one of its first two fields. All may vary from medium to medium.

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

    pitch: Annotated[Draw, SINE] | None = None
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


class HiddenObject(ShownObjects):
    """Camera images of hidden incoherent objects; mean 1 over the expected intensity of the whole image.

    Samples: ``image`` float32[H, W] (or uint16 counts), ``object`` float32[h, w] (brightness 0 to 1). Among the
    parameters are the material, what the object is (``label``; in mixtures ``family`` too, of a folder ``file``) and
    where its centre of brightness lies in its frame (``object_row``, ``object_column``).

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

    on_benches: ClassVar[bool] = True
    looked_up: ClassVar[bool] = True
    fewest_pixels: ClassVar[float] = LEAST_PIXELS
    kind: Literal["hidden-object"] = "hidden-object"
    field: ObjectField | None = None
    mode_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.01

    @model_validator(mode="after")
    def _check_field(self) -> Self:
        if (self.field is None) == (self.lab is None):
            reject("HiddenObject.field", "given if there is no table lab, else left out", self.field)
        if self.fits_window and ends(self._pixels)[1] > min(self.camera_shape):
            reject("ObjectField.pixels", f"at most the camera's {min(self.camera_shape)}", ends(self._pixels)[1])
        return self

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Draw the first hidden objects of the training split, seed 0."""
        draw_images(axes, np.stack([self.objects.image(0, "train", n) for n in range(6)]), high=1.0)

    @property
    def fits_window(self) -> bool:
        """True if each medium has a window of its own."""
        return self.field is not None and self.field.pixels is not None

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
        """Layout of what :meth:`named` names."""
        return {"image": self.observation(self.camera_shape, ("y", "x"), "camera image")}

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """One image."""
        return {"image": images[:, 0]}

    def host_work(self) -> list[str]:
        """Parts made on the host, pictures of objects among it where the family draws them one by one."""
        pictures = [] if self.objects.drawn_together else [f"pictures of {self.objects.class_name()}"]
        return [*super().host_work(), *pictures, *([] if self.bench is None else self.bench.host_work)]

    def pitches(self, materials: "Materials", share: "torch.Tensor") -> "torch.Tensor":
        """Direction sines float64[M] between object pixels in front of materials; ``share`` the field's drawn numbers.

        Raise a `RuleError` if the pitch follows from a range that a material does not have.
        """
        if self.lab is not None:
            return torch.full_like(share, self.lab.object_pitch(self.objects.shape))
        assert self.field is not None
        if self.field.pitch is not None:
            return share
        if share.device.type == "cpu" and not torch.isfinite(materials.half_range).all():
            reject("ObjectField.extent_over_range", "left out, since this material has no finite memory-effect range",
                   float(share[0]), "Give the pitch instead.")  # fmt: skip
        return share * materials.range_sine(self.wavelength) / max(self.objects.shape)

    def geometry_of(self, pitch: float, pixels: float) -> Viewing:
        """Window and camera for objects of a pitch; ``pixels`` across, where the window is fitted."""
        if not self.fits_window:
            return self.geometry
        assert self.camera is not None
        grains = pixels / self.camera.pixels_per_grain
        return self.seen_through(self.wavelength * grains / (pitch * max(self.objects.shape)))

    def polarisation_shares(self, parameters: Mapping[str, Any]) -> "torch.Tensor | None":
        """Shares float64[M, 2] of the light of media in either polarisation, of a setup that depolarises."""
        if self.bench is None or not self.bench.polarises:
            return None
        degree = parameters["bench_polarisation"]
        return torch.stack([1 + degree, 1 - degree], -1) / 2

    def contrast_left(self, parameters: Mapping[str, Any]) -> Any:
        """Share of the contrast that partly polarised light leaves."""
        left = super().contrast_left(parameters)
        if self.bench is None or not self.bench.polarises:
            return left
        return left * ((1 + parameters["bench_polarisation"] ** 2) / 2) ** 0.5

    @property
    def path_sum_obstacle(self) -> str | None:
        """Light that a setup depolarises."""
        depolarised = self.bench is not None and self.bench.polarises
        return super().path_sum_obstacle or ("a table bench that depolarises light" if depolarised else None)

    @property
    def _field_number(self) -> Draw:
        return (self.field.pitch or self.field.extent_over_range or 0.0) if self.field is not None else 0.0

    @property
    def _pixels(self) -> Draw:
        return (self.field.pixels or 0.0) if self.field is not None else 0.0

    @property
    def media_alike(self) -> bool:
        """True if neither the material nor the extent of objects is drawn."""
        aperture = 1.0 if self.bench is None else self.bench.aperture
        fixed = (low == high for low, high in map(ends, (self._field_number, self._pixels, aperture)))
        return super().media_alike and all(fixed)

    @shielded()
    def extremes(self) -> list[MediumView]:
        """Media at the ends of every range, looked at by the largest object, where the window is fitted behind the
        widest window and behind the narrowest, whose camera sees furthest from the axis.
        """
        share, across = ends(self._field_number)[1], sorted(set(ends(self._pixels)))
        slabs = self.material.extremes()
        known = _materials.characterized_materials(
            self.material, [self.material.known(slab) for slab in slabs], self.wavelength, torch.device("cpu")
        )  # fmt: skip
        pitches = self.pitches(known, torch.full_like(known.half_range, share)).tolist()
        apertures = (1.0,) if self.bench is None else sorted(set(ends(self.bench.aperture)))
        return [
            MediumView(slab, self._opened(self.geometry_of(pitch, pixels), wider), self.objects.shape, pitch,
                       self.widest_tilts)
            for wider in apertures for pixels in across for slab, pitch in zip(slabs, pitches, strict=True)
        ]

    def warn_of_implausible(self) -> None:
        """Warn of numbers that are seldom meant, since most come of a length in another unit."""
        pitch = np.inf if self.field is None or self.field.pitch is None else ends(self.field.pitch)[0]
        pitch = pitch if self.lab is None else self.lab.object_pitch(self.objects.shape)
        width = np.inf if self.fits_window else self.geometry.width
        slabs, size = self.material.extremes(), pitch * max(self.objects.shape)
        texts = [text for slab in slabs for text in implausible(slab, self.wavelength, width, size)]
        for text in dict.fromkeys(texts):
            warn_user(f"Check units: {text}.")

    @staticmethod
    def _opened(seen: Viewing, wider: float) -> Viewing:
        """Viewing behind a window so many times as wide as is said."""
        return seen if wider == 1 else replace(seen, width=seen.width * wider)  # fmt: skip

    @property
    def widest_tilts(self) -> np.ndarray:
        """The tilts that reach farthest, radians float64[T, 2]."""
        return np.zeros((1, 2))

    def tilts_of(
        self, drawn: "Addresses", numbers: Sequence[int]
    ) -> "tuple[torch.Tensor, dict[str, torch.Tensor]]":
        """Tilts float64[M, T, 2] of the illumination of media, radians, and what was drawn for them."""
        return torch.zeros((len(numbers), 1, 2), dtype=torch.float64, device=drawn.device), {}

    def moved_media(self, drawn: "Addresses", numbers: Sequence[int], media: DrawnMedia) -> DrawnMedia:  # noqa: ARG002
        """Draw how media move, where they do."""
        return media

    def seen_media(self, drawn: "Addresses", numbers: Sequence[int], materials: "Materials") -> DrawnMedia:
        """Draw what is seen of media: extent of the object, window, tilts, motion."""
        share, pixels = drawn.numbers(Purpose.FIELD, (self._field_number, self._pixels), numbers)
        angles, tilted = self.tilts_of(drawn, numbers)
        pitch, side, width = self.pitches(materials, share), max(self.objects.shape), None
        if self.fits_window:
            assert self.camera is not None
            width = self.wavelength * (pixels / self.camera.pixels_per_grain) / (pitch * side)
        sight = self.sight(drawn, self.objects.shape, pitch, torch.sin(angles), width)
        stated, bench = sight.width, {}
        if self.bench is not None:
            aperture, degree = self.bench.of_media(drawn, numbers)
            bench = {"bench_aperture": aperture, "bench_polarisation": degree}
            sight = replace(sight, width=sight.width * aperture)
        parameters = materials.parameters | {
            "width": stated,
            "camera_pitch": sight.camera_pitch,
            "object_pitch": pitch,
            "extent_over_range": pitch * side / materials.range_sine(self.wavelength),
            **tilted,
            **bench,
        }
        media = DrawnMedia(
            materials, sight, self.wavenumber_bandwidth, angles, parameters, torch.ones_like(pitch)
        )
        return self.moved_media(drawn, numbers, media)

    def lit(self, drawn: "Addresses", numbers: Sequence[int]) -> Lit:
        """Objects, their labels, and their positions."""
        light = self.objects.images(drawn, numbers)
        settings = {} if self.bench is None else self.bench.of_samples(drawn, numbers)
        if self.bench is not None:
            light = self.bench.moved(light, settings)
        parameters = self.labels(drawn, numbers)
        if self.bench is not None:
            parameters |= self.bench.told(settings)
        return Lit(light, None, parameters | dict(zip(CENTRE, centres_of(light), strict=True)), {"object": light})
