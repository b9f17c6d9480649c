"""Recipes: what a data set is made of, and its samples as pure functions of (seed, split, index).

A recipe is a frozen value, read from a packaged preset or a TOML file. ``inherits`` names another recipe to
start from; tables are merged, everything else is replaced. The physics of each kind is in a file of its own:
:mod:`tilt_stack`, :mod:`hidden_object`, :mod:`partially_coherent`, :mod:`masked_light`.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Discriminator, PrivateAttr, Tag, WithJsonSchema, model_validator

from specklegen.core.arguments import whole_number
from specklegen.core.devices import checked_device
from specklegen.core.errors import reject
from specklegen.core.picturing import Pictured
from specklegen.core.values import PositiveInt, Value
from specklegen.datasets.recipes.medium_realization import MediumRealization
from specklegen.datasets.recipes.parts.diffuser import Diffuser, KnownDiffuser
from specklegen.datasets.recipes.parts.distributions import ends
from specklegen.datasets.recipes.parts.light import Light
from specklegen.datasets.recipes.parts.material import Estimator, KnownMaterial, Material, known_light
from specklegen.datasets.recipes.parts.preset import PresetMaterial
from specklegen.datasets.recipes.parts.viewing import CameraGrid, Lab, Viewing, Window
from specklegen.datasets.recipes.rendering import Planned, RenderedBy, Rendering, medium_plan, rendering_of
from specklegen.datasets.sample_schema import ArraySpec, require_finite
from specklegen.datasets.split import SPLITS, Purpose, Split, generator, medium_of, split_number, substream
from specklegen.instrument.camera import Camera, NoiseStreams, expose
from specklegen.planning.plan import Plan
from specklegen.samplers.screens.objects import ScreenObjects, screen_objects
from specklegen.samplers.stationary.atlas import atlas_digest
from specklegen.samplers.stationary.objects import ObjectSampler, ObjectSpeckle, object_sampler, object_speckle
from specklegen.scene.illumination import Profile
from specklegen.scene.media import Slab
from specklegen.scene.sensors import FarFieldGrid

DATA_VERSION = 4
"""Raised by hand whenever pixels change; a golden test guards it."""

PARAMETERS = ArraySpec(
    dtype="float64",
    description="parameters drawn for the sample and what follows from them; lengths in the recipe's unit, angles in "
    "radians, pitches in direction sines inside the medium; expected_contrast is that of the light at one pixel, "
    "before the camera's noise; estimator: " + ", ".join(f"{e.value} kernel from {e.name.lower()}" for e in Estimator)
    + "; sampler: " + ", ".join(f"{s.value} {s.name.lower()}" for s in RenderedBy)
    + "; expected_error: relative error that its number of paths leaves, as planned",
    unbounded=("memory_effect_range", "coherence_length", "correlation_time"),
)
"""Layout of the parameters of every kind."""

NOISES = (Purpose.SHOT_NOISE, Purpose.BACKGROUND, Purpose.DARK_CURRENT, Purpose.READ_NOISE)

COSMETIC = {"name", "description", "samples", "strict"}
"""Fields that decide no pixel and so stay out of the fingerprint."""


class Samples(Value):
    """Samples an epoch, split by split."""

    train: PositiveInt = 4096
    validation: PositiveInt = 512
    test: PositiveInt = 512


Media = Annotated[
    PositiveInt | None,
    BeforeValidator(lambda media: None if media == "new" else media),
    WithJsonSchema({"anyOf": [{"type": "integer", "minimum": 1}, {"const": "new"}, {"type": "null"}]}),
]
"""A number of media, or "new" for one that is never seen again (TOML has no null to override a number with)."""


def _kind_of_material(value: Any) -> str:
    given = value if isinstance(value, Mapping) else getattr(type(value), "model_fields", ())
    return next((f"@{kind}" for kind in ("screens", "preset") if kind in given), "@slab")


AnyMaterial = Annotated[
    Annotated[Material, Tag("@slab")]
    | Annotated[Diffuser, Tag("@screens")]
    | Annotated[PresetMaterial, Tag("@preset")],
    Discriminator(_kind_of_material),
]
"""A slab, or thin screens where the table holds ``screens``, or a named material where it holds ``preset``."""


class Recipe(Value, Pictured):
    """What every kind of recipe has.

    Parameters
    ----------
    name, description
        For people; not part of the fingerprint.
    samples
        Samples an epoch.
    media
        Media a split; sample n is seen through medium n mod ``media``. "new" (None) never repeats one.
    media_group
        Neighbouring samples that share a medium, where media never repeat.
    material, window, camera
        The scene, in the engine's terms.
    lab
        Or in those of a laboratory, instead of wavelength, window, camera and field.
    light
        Bandwidth and polarisation.
    exposure
        Camera and its noises; where given, images are counts, and pixels average over their area.
    sampler
        "auto" renders with the sampler that the planner chooses: the stationary one where its error over all the
        recipe's media is within 0.02, path sums elsewhere, which are slower. Or the name of either.
    strict
        Refuse, instead of warning of it, a sampler that is asked for and that the planner finds unfit.

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> recipe = load_recipe("through-slab", {"material": {"optical_depth": 5.0, "kernel_paths": 1000}})
    >>> recipe.camera_shape
    (128, 128)
    >>> recipe.sample(0, "train", 7)["image"].shape
    (128, 128)
    """

    name: str
    description: str = ""
    samples: Samples = Samples()
    media: Media = None
    media_group: PositiveInt = 1
    material: AnyMaterial
    window: Window | None = None
    camera: CameraGrid | None = None
    lab: Lab | None = None
    light: Light = Light()
    exposure: Camera | None = None
    sampler: Literal["auto", "paths", "stationary"] = "auto"
    strict: bool = False
    _device: str = PrivateAttr("cpu")  # not written down: a file says what is rendered, not where

    @model_validator(mode="after")
    def _check(self) -> Self:
        stated = {"material.wavelength": self.material.wavelength, "window": self.window, "camera": self.camera}
        given = [name for name, value in stated.items() if value is not None]
        if self.lab is not None and given:
            reject("Recipe.lab", "left out where the engine's terms are given", given, "Write one or the other.")
        if self.lab is None and len(given) < len(stated):
            reject("Recipe", f"given {', '.join(stated)}, or else a table lab", given)
        if self.lab is not None:
            self._take_faces(self.lab)
        if self.lab is not None and (self.light.bandwidth or self.light.refractive_index != 1):
            reject("Recipe.light", "without bandwidth and refractive_index, which the lab gives", self.light)
        if self.media is not None and self.media_group != 1:
            reject("Recipe.media_group", "1 where media are numbered", self.media_group, "Leave out media.")
        if self.lab is None:
            self._check_smear()
        if isinstance(self.material, Diffuser):
            self._check_screens(self.material)
        if self.window is not None and (self.window.width == "fitted") != self.fits_window:
            reject("Window.width", '"fitted" where field.pixels is given, a length elsewhere', self.window.width,
                   "Give one of window.width and field.pixels.")  # fmt: skip
        if self.exposure is not None and self.exposure.oversampling != 1:
            reject("Recipe.exposure.oversampling", "1: pixels are integrated exactly", self.exposure.oversampling)
        if self.exposure is not None:
            self.exposure.require_light(int(np.prod(self.camera_shape)))
        return self

    def _check_screens(self, material: Diffuser) -> None:
        if self.light.bandwidth or (self.lab is not None and self.lab.wavenumber_bandwidth):
            reject("Recipe.light.bandwidth", "0 behind thin screens", self.light.bandwidth, "It is not modelled there.")
        if self.lab is not None:
            material.seen_at(self.lab.medium_wavelength)

    def _take_faces(self, lab: Lab) -> None:
        """The material's faces are those of the laboratory, where there is one."""
        if not isinstance(self.material, Material):
            return
        if self.material.faces.matched:
            self.__dict__["material"] = self.material.replace(faces=lab.layer_faces)
        elif self.material.faces != lab.layer_faces:
            reject("Material.faces", f"those of the lab, {lab.layer_faces}", self.material.faces, "Leave them out.")

    def _check_smear(self) -> None:
        """Speckle scales with the wavelength: over the band it must not move by more than its own size."""
        assert self.material.wavelength is not None
        assert self.camera is not None
        grains = max(self.camera.shape) / self.camera.pixels_per_grain
        largest = self.light.refractive_index * self.material.wavelength / grains
        if self.light.bandwidth > largest:
            reject("Light.bandwidth", f"at most {largest:.4g}, which moves the pattern by one speckle",
                   self.light.bandwidth, "Use a narrower filter, or a smaller camera.")  # fmt: skip

    def _facts(self) -> Mapping[str, object]:
        """What a file of the recipe says, one row a table; fields that are left out say nothing."""
        said = self.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)
        return {name: _row(value) for name, value in said.items()}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Draw the scene of its first medium."""
        self.extremes()[0].probe.plot(axes, label)

    @property
    def device(self) -> str:
        """Torch device that samples are rendered on."""
        return self._device

    def on(self, device: str) -> Self:
        """Return this recipe rendering on another torch device: the same random numbers, other rounding.

        Raises
        ------
        RuleError
            If there is no such device here.
        """
        if str(device) != "cpu":
            checked_device(f"{type(self).__name__}.on device", device)
        copy = self.model_copy()
        copy._device = str(device)
        return copy

    def __eq__(self, other: object) -> bool:
        # What is kept for a recipe lies on its device.
        return super().__eq__(other) and self._device == other._device  # type: ignore[attr-defined]

    __hash__ = Value.__hash__

    @property
    def data_version(self) -> int:
        """Version of the pixels."""
        return DATA_VERSION

    @property
    def fits_window(self) -> bool:
        """Whether each medium has a window of its own."""
        return False

    @property
    def wavelength(self) -> float:
        """Wavelength inside the medium."""
        if self.lab is not None:
            return self.lab.medium_wavelength
        assert self.material.wavelength is not None
        return self.material.wavelength

    @property
    def profile(self) -> Profile:
        """Shape of the window."""
        outline = self.lab or self.window
        assert outline is not None
        return outline.profile

    @property
    def camera_shape(self) -> tuple[int, int]:
        """(rows, columns) of an image."""
        if self.lab is not None:
            return self.lab.pixels
        assert self.camera is not None
        return self.camera.shape

    @cached_property
    def geometry(self) -> Viewing:
        """Window and camera as the engine sees them; of a recipe whose window is the same for every medium."""
        lab = self.lab
        if lab is not None:
            pitch = lab.view_pitch * lab.oversampling  # whole pixels: their area is integrated exactly
            grid = FarFieldGrid(shape=lab.pixels, pitch=pitch)
            return Viewing(self.wavelength, lab.aperture, lab.profile, grid, lab.wavenumber_bandwidth, True)
        assert self.window is not None
        if self.window.width == "fitted":
            reject("Recipe.geometry", "asked of a medium where the window is fitted", self.window.width)
        return self.seen_through(self.window.width)

    def seen_through(self, width: float) -> Viewing:
        """Camera behind a window of some width, its grains always of the same number of pixels."""
        assert self.camera is not None
        wavelength, light = self.wavelength, self.light
        grid = FarFieldGrid(shape=self.camera.shape, pitch=wavelength / (width * self.camera.pixels_per_grain))
        # d k = 2 pi n d(lambda_0) / lambda_0^2, and lambda_0 = n wavelength
        bandwidth = 2 * np.pi * light.bandwidth / (light.refractive_index * wavelength**2)
        return Viewing(wavelength, width, self.profile, grid, bandwidth, self.exposure is not None)

    def physics(self) -> dict[str, Any]:
        """Everything that decides a pixel."""
        decided = self.model_dump(mode="json", exclude=COSMETIC) | {"data_version": DATA_VERSION}
        return decided | ({"atlas": atlas_digest(self.material.extremes())} if self.material.kernel == "atlas" else {})

    @cached_property
    def _canonical_json(self) -> str:
        return json.dumps(self.physics(), sort_keys=True, separators=(",", ":"))

    def fingerprint(self) -> str:
        """SHA-256 of everything that decides a pixel, in hexadecimal."""
        return hashlib.sha256(self.canonical_json().encode()).hexdigest()

    def length(self, split: str) -> int:
        """Samples in an epoch of a split."""
        split_number(split)
        return int(getattr(self.samples, split))

    def medium_number(self, index: int) -> int:
        """Number of the medium of sample ``index``."""
        return index // self.media_group if self.media is None else medium_of(index, self.media)

    def media_of(self, samples: int) -> int:
        """Media behind the first ``samples`` samples of a split."""
        return -(-samples // self.media_group) if self.media is None else min(samples, self.media)

    def material_of(self, seed: int, split: Split, medium: int) -> KnownMaterial | KnownDiffuser:
        """Material of one medium, with its kernel."""
        return self.material.realized(generator(substream(seed, split, Purpose.MATERIAL, medium)), split)

    @cached_property
    def rendering(self) -> Rendering | None:
        """What renders all media of the recipe; None if that is for each of them to decide. Carried to the workers.

        Raises
        ------
        RuleError
            If no sampler serves, or, where ``strict``, the one that is asked for is unfit.
        """
        return rendering_of(self, self.plans())

    @property
    def rendering_note(self) -> str:
        """What renders the samples, in a sentence."""
        chosen = self.rendering
        if chosen is None:
            return "Rendered by the sampler that the planner chooses for each medium; every sample says which."
        sampler = {
            RenderedBy.PATHS: "path sums", RenderedBy.STATIONARY: "the stationary sampler",
            RenderedBy.SCREENS: "the screens sampler",
        }[chosen.sampler]  # fmt: skip
        return f"Rendered by {sampler}; relative error that the paths leave, as planned: {chosen.expected_error:.2g}."

    @property
    def path_sum_obstacle(self) -> str | None:
        """What the recipe asks for that path sums have no model of; None where they serve."""
        band = self.light.bandwidth or (self.lab is not None and self.lab.wavenumber_bandwidth)
        return "a bandwidth" if band else None

    def object_sampler(
        self, material: KnownMaterial | KnownDiffuser, seen: Viewing, shape: tuple[int, int], pitch: float,
        base: np.ndarray, tolerance: float = 0.01, moved: np.ndarray | None = None,
    ) -> ObjectSampler | ScreenObjects:  # fmt: skip
        """Sampler of the engine for objects of a shape and pitch under base tilts float64[T, 2] (sines).

        Behind screens ``moved`` float64[T, M, 2] is how far each has moved at every base tilt.
        """
        if isinstance(material, KnownDiffuser):
            return screen_objects(
                material.slab.stack, wavelength=seen.wavelength, object_shape=shape, object_pitch=pitch, grid=seen.grid,
                base=base, width=seen.width, profile=seen.profile, pixel_integration=seen.pixel_integration,
                tolerance=tolerance, device=self.device, moved=moved,
            )  # fmt: skip
        light = None
        if seen.bandwidth:
            light = known_light(material.slab, self.material.kernel_paths, seen.bandwidth, self.light.spectrum)
        return object_sampler(
            material.kernel, wavelength=seen.wavelength, object_shape=shape, object_pitch=pitch, width=seen.width,
            profile=seen.profile, grid=seen.grid, base=base, light=light, pixel_integration=seen.pixel_integration,
            tolerance=tolerance, device=self.device,
        )  # fmt: skip

    def object_speckle(
        self, slab: Slab, seen: Viewing, shape: tuple[int, int], pitch: float, base: np.ndarray
    ) -> ObjectSpeckle:
        """What is known of images behind a slab before any is drawn, for objects as in :meth:`object_sampler`."""
        return object_speckle(
            self.material.known(slab).kernel, wavelength=seen.wavelength, object_shape=shape, object_pitch=pitch,
            width=seen.width, profile=seen.profile, grid=seen.grid, base=base, pixel_integration=seen.pixel_integration,
        )  # fmt: skip

    def prepare(self, seed: int, split: Split, medium: int) -> MediumRealization:
        """Make one medium ready, with all that is drawn for it."""
        raise NotImplementedError

    def observed(self, images: np.ndarray, seed: int, split: Split, index: int) -> np.ndarray:
        """What the camera makes of expected intensities float[..., H, W]: float32, or counts if it is exposed."""
        if self.exposure is None:
            return images.astype(np.float32)
        streams = NoiseStreams(*(substream(seed, split, purpose, index) for purpose in NOISES))
        # Rounding may leave a dark pixel a little below 0.
        return expose(self.exposure, np.maximum(images, 0), streams)

    def observation(self, shape: tuple[int, ...], dims: tuple[str, ...], what: str) -> ArraySpec:
        """Layout of an array of camera images."""
        if self.exposure is None:
            return ArraySpec(shape=shape, dims=dims, description=f"{what}, intensity over its expected value")
        counts = self.exposure.bit_depth is not None
        return ArraySpec(
            shape=shape, dims=dims, dtype="uint16" if counts else "float32", counts=counts, units="counts",
            description=f"{what}, counts",
        )  # fmt: skip

    def split_notes(self) -> str:
        """What the splits share and what they do not, in Markdown sentences for the data card."""
        notes = ["No medium of one split appears in another: each has random streams of its own."]
        ranges = self.material.by_split
        if ranges is not None:
            spans = "; ".join("{} {:g} to {:g}".format(split, *ends(getattr(ranges, split))) for split in SPLITS)
            notes.append(f"The splits differ in the material: {ranges.parameter} is drawn from {spans}.")
        elif self.material.varies:
            notes.append("Materials of all splits are drawn from the same ranges, independently.")
        else:
            notes.append("All media are of one material.")
        return " ".join(notes)

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        raise NotImplementedError

    def sample(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One sample: arrays, "index" and "parameters" (a flat dict of float64). Pure.

        Raises
        ------
        RuleError
            If the split is unknown, the seed or the index is not a whole number of at least 0, or the sample would
            hold a number that is not finite.
        """
        index = whole_number(f"{type(self).__name__}.sample index", index, 0, 2**64 - 1)
        self.rendering  # noqa: B018 - a strict recipe is refused here, whatever is kept of others
        sample = self.rendered(seed, split, index)
        require_finite(sample, self, seed, split)
        return sample

    def rendered(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One sample, before it is checked; what each kind says."""
        raise NotImplementedError

    def extremes(self) -> Sequence[Planned]:
        """Media at the ends of every range, looked at by the widest object and the most tilted beams."""
        raise NotImplementedError

    def plans(self) -> list[Plan]:
        """Plans of the media at the ends of every range: what ``specklegen plan`` prints, and what runs."""
        return [medium_plan(self, view) for view in self.extremes()]

    def batch(self, seed: int, split: str, indices: Sequence[int]) -> dict[str, Any]:
        """Samples stacked along a new first axis, parameters as a dict of float64[B]; the same bits as alone."""
        samples = [self.sample(seed, split, index) for index in indices]
        if not samples:
            reject("batch indices", "at least one index", list(indices))
        batch = {key: np.stack([s[key] for s in samples]) for key in samples[0] if key != "parameters"}
        names = samples[0]["parameters"]
        return batch | {"parameters": {n: np.array([s["parameters"][n] for s in samples]) for n in names}}


def _row(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_row(inner)}" for name, inner in value.items())
    return ", ".join(map(_row, value)) if isinstance(value, list) else str(value)
