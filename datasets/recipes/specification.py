"""Specification of a recipe: its checked fields; its geometry; its identity; the arrays of its samples.

A recipe is a frozen value, read from a packaged preset or a TOML file. ``inherits`` names another recipe to
start from, or several, each of which changes those before it; tables are merged, all else is replaced.
What is made of it: :mod:`recipe`.
"""

import hashlib
import json
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import BeforeValidator, Discriminator, PrivateAttr, Tag, WithJsonSchema, model_validator

from specklegen.core.content import is_own
from specklegen.core.devices import checked_device
from specklegen.core.display.plot import Pictured
from specklegen.core.errors import reject
from specklegen.core.registered import Registered, own_classes
from specklegen.core.values import IDENTITY, PositiveInt, Value
from specklegen.datasets.distributions import ends
from specklegen.datasets.recipes.parts.bench import Bench
from specklegen.datasets.recipes.parts.diffuser import Diffuser
from specklegen.datasets.recipes.parts.layered_material import LayeredMaterial
from specklegen.datasets.recipes.parts.light import MEDIUM_PURPOSES, Light
from specklegen.datasets.recipes.parts.material import Estimator, Material
from specklegen.datasets.recipes.parts.preset import PresetMaterial
from specklegen.datasets.recipes.parts.sampler import NUMBERS, RecipeSampler
from specklegen.datasets.recipes.parts.viewing import LEAST_POINTS, CameraGrid, Lab, Viewing, Window
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import SPLITS, Purpose, medium_of, split_number
from specklegen.instrument.camera import AnyCamera
from specklegen.memory_effects.atlas import atlas_digest
from specklegen.scene.illumination import Profile
from specklegen.scene.sensors import FarFieldGrid

DATA_VERSION = 8
"""Raised by hand whenever pixels change; a golden test guards it."""

PARAMETERS = ArraySpec(
    dtype="float64",
    description="parameters drawn for the sample and what follows from them; lengths in the recipe's unit, angles in "
    "radians, pitches in direction sines inside the medium; expected_contrast is that of the light at one pixel, "
    "before the camera's noise; estimator: " + ", ".join(f"{e.value} kernel from {e.name.lower()}" for e in Estimator)
    + "; sampler: " + ", ".join(f"{number} {name}" for name, number in NUMBERS.items())
    + "; expected_error: relative error that its number of paths leaves, as planned",
    unbounded=("memory_effect_range", "coherence_length", "correlation_time"),
)
"""Layout of the parameters of every kind."""

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
    return next((f"@{kind}" for kind in ("screens", "preset", "layers") if kind in given), "@slab")


AnyMaterial = Annotated[
    Annotated[Material, Tag("@slab")]
    | Annotated[Diffuser, Tag("@screens")]
    | Annotated[PresetMaterial, Tag("@preset")]
    | Annotated[LayeredMaterial, Tag("@layers")],
    Discriminator(_kind_of_material),
]
"""A slab, or thin screens where the table holds ``screens``, a named material where it holds ``preset``, layers where
it holds ``layers``."""


class Specification(Registered, Pictured):
    """Fields of every kind of recipe; :class:`~specklegen.datasets.Recipe` describes each."""

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
    exposure: AnyCamera | None = None
    bench: Bench | None = None
    sampler: RecipeSampler = "auto"
    strict: bool = False
    kind: Any = None
    fewest_pixels: ClassVar[float] = LEAST_POINTS  # in a grain
    engine_terms: ClassVar[tuple[str, ...]] = ("material.wavelength", "window", "camera")
    """What takes the place of a lab."""
    polarises: ClassVar[bool] = False
    """Whether light may be polarised inside the medium."""
    looked_up: ClassVar[bool] = False
    """Whether drawn slabs are looked up in the atlas where the material has no ``kernel``."""
    on_benches: ClassVar[bool] = False
    """Whether a ``bench`` is modelled."""
    _device: str = PrivateAttr("cpu")  # not written down: a file says what is rendered, not where

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.lab is not None and isinstance(self.material, Diffuser | PresetMaterial):
            self._take_laboratory(self.lab)
        if self.lab is None and isinstance(self.material, PresetMaterial) and self.material.wavelength is None:
            reject("Material.preset",
                   'a table with a wavelength, such as {name = "intralipid", wavelength = 0.633}, if there is no lab',
                   self.material.preset)  # fmt: skip
        by_name = self.lab is not None and isinstance(self.material, PresetMaterial)  # whose wavelength is the lab's
        wavelength = None if by_name else self.material.wavelength
        terms = {"material.wavelength": wavelength, "window": self.window, "camera": self.camera}
        stated = {name: terms[name] for name in self.engine_terms}
        given = [name for name, value in stated.items() if value is not None]
        if self.lab is not None and given:
            reject("Recipe.lab", "left out if the setup is given by other tables", given,
                   "Write a table lab, or these fields, not both.")
        if self.lab is None and len(given) < len(stated):
            reject("Recipe", f"given by {', '.join(stated)}, or by a table lab", given)
        self._look_up()
        if self.lab is not None:
            self._take_faces(self.lab)
        if self.lab is not None and (self.light.bandwidth or self.light.refractive_index != 1):
            reject("Recipe.light", "without bandwidth and refractive_index, since the table lab gives them", self.light)
        if self.light.polarisation != "scalar" and not self.polarises:
            reject("Light.polarisation", '"scalar" in recipes of this kind', self.light.polarisation,
                   'For polarised light use kind = "analysed-object".')  # fmt: skip
        if self.media is not None and self.media_group != 1:
            reject("Recipe.media_group", "1 if the number of media is given", self.media_group,
                   "Leave out media or media_group.")
        if self.lab is None:
            self._check_smear()
        if isinstance(self.material, Diffuser | LayeredMaterial):
            self._check_light("thin screens" if isinstance(self.material, Diffuser) else "layers")
        if self.window is not None and (self.window.width == "fitted") != self.fits_window:
            reject("Window.width", '"fitted" with field.pixels, and a length without it', self.window.width,
                   "Give one of window.width and field.pixels.")  # fmt: skip
        if self.bench is not None:
            self._check_bench(self.bench)
        if self.camera is not None and self.camera.pixels_per_grain < self.fewest_pixels:
            reject("CameraGrid.pixels_per_grain", f"at least {self.fewest_pixels:g} in recipes of this kind",
                   self.camera.pixels_per_grain, "Finer speckle is undersampled.")  # fmt: skip
        if self.exposure is not None and self.exposure.oversampling != 1:
            reject("Recipe.exposure.oversampling", "1, since pixels are integrated exactly", self.exposure.oversampling)
        if self.exposure is not None:
            self.exposure.require_light(int(np.prod(self.camera_shape)))
            for camera in (self.exposure, *(self.bench.cameras if self.bench else ())):
                camera.noise_map(self.camera_shape)
        for name in type(self).model_fields:
            part = getattr(self, name)
            if isinstance(part, Value) and is_own(type(part)) and not isinstance(part, Registered):
                reject(f"Recipe.{name}", "of a class of this library, since the fingerprint covers its fields",
                       type(part),
                       "Your own classes may be objects, cameras and kinds of recipe.")  # fmt: skip
        return self

    def _check_bench(self, bench: Bench) -> None:
        """Refuse a setup that is not modelled, or whose cameras make counts of another kind."""
        if not self.on_benches:
            reject("Recipe.bench", "left out of recipes of this kind", self.kind,
                   "Only recipes with hidden objects behind slabs and screens, in scalar light, have it.")  # fmt: skip
        if bench.cameras and self.exposure is None:
            reject("Bench.cameras", "left out if there is no table exposure", len(bench.cameras),
                   "Add a table exposure, which sets the type of the stored counts.")  # fmt: skip
        if self.exposure is not None and any(
            (camera.bit_depth is None) != (self.exposure.bit_depth is None) for camera in bench.cameras
        ):
            reject("Bench.cameras", "all with bit_depth or all without, like the exposure",
                   [camera.bit_depth for camera in bench.cameras])  # fmt: skip
        if bench.polarises and not self.light.polarised:
            reject("Bench.polarisation", "1 if light.polarised = false", bench.polarisation,
                   "Depolarised light already has polarisation 0: leave out light.polarised.")  # fmt: skip

    def _check_light(self, what: str) -> None:
        """Refuse what is not modelled behind thin screens and layers."""
        field, bandwidth = ("light", self.light.bandwidth) if self.lab is None else ("lab", self.lab.bandwidth)
        if bandwidth:
            reject(f"Recipe.{field}.bandwidth", f"0 behind {what}", bandwidth, "A bandwidth is not modelled there.")
        if self.lab is None or not isinstance(self.material, LayeredMaterial):
            return
        if not self.lab.layer_faces.matched:
            reject("Lab.faces", '"matched" for a material of layers, since reflection at its faces is not modelled',
                   self.lab.faces)  # fmt: skip
        if any(layer.index is not None for layer in self.material.layers):
            reject("Material.layers.index", "left out if there is a table lab, whose refractive_index all layers have",
                   "given",
                   "Or leave out lab, and give wavelength, window and camera.")  # fmt: skip

    def _take_laboratory(self, lab: Lab) -> None:
        """Material by its name: wavelength and unit are those of the laboratory, whose layer has its index."""
        self.__dict__["material"] = material = self.material.in_laboratory(lab)  # type: ignore[union-attr]
        if not isinstance(material, PresetMaterial):
            return
        index = material.refractive_index
        if "refractive_index" in lab.model_fields_set and not np.isclose(lab.refractive_index, index, rtol=1e-3):
            reject("Lab.refractive_index", f"that of {material.preset['name']}, {index:.4g}", lab.refractive_index,
                   "Leave it out.")  # fmt: skip
        self.__dict__["lab"] = lab.replace(refractive_index=index)

    def _look_up(self) -> None:
        """Drawn slabs are looked up by default: paths for each take several times the time of a sample."""
        slab, lab = self.material, self.lab
        if type(slab) is not Material or "kernel" in slab.model_fields_set or slab.scatterer is not None:
            return
        matched = slab.faces.matched and (lab is None or lab.layer_faces.matched)
        if self.looked_up and slab.varies and matched and not self.wavenumber_bandwidth:
            self.__dict__["material"] = slab.replace(kernel="atlas")

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
            reject("Light.bandwidth", f"at most {largest:.4g}, which shifts the pattern by one speckle size",
                   self.light.bandwidth, "Use a narrower filter, or a smaller camera.")  # fmt: skip

    def _facts(self) -> Mapping[str, object]:
        """Tables of a file of the recipe, one row each; without the fields that are left out."""
        tables = self.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)
        return {name: _row(value) for name, value in tables.items()}

    @property
    def device(self) -> str:
        """Torch device that samples are rendered on."""
        return self._device

    def on(self, device: str) -> Self:
        """Return this recipe rendering on another torch device: the same random numbers, other rounding.

        Raise a `RuleError` if there is no such device here.
        """
        if str(device) != "cpu":
            checked_device(f"{type(self).__name__}.on device", device)
        copy = self.model_copy()
        copy._device = str(device)
        return copy

    def own_classes(self) -> list[type]:
        """Classes of a user's own that the recipe is made of: what other processes must import."""
        drawn_by = [] if isinstance(self.sampler, str) else [self.sampler]
        return list(dict.fromkeys([*own_classes(self), *own_classes(self.material.extremes()), *drawn_by]))

    def __eq__(self, other: object) -> bool:
        # What is kept for a recipe lies on its device.
        return super().__eq__(other) and self._device == other._device  # type: ignore[attr-defined]

    __hash__ = Value.__hash__

    def __getstate__(self) -> dict[Any, Any]:
        return super().__getstate__() | {"fingerprint": self.fingerprint()}

    def __setstate__(self, state: dict[Any, Any]) -> None:
        super().__setstate__({name: each for name, each in state.items() if name != "fingerprint"})
        self.__dict__.pop("_canonical_json", None)  # the sender's
        if self.fingerprint() != state["fingerprint"]:
            reject("Recipe", f"of the fingerprint with which it was sent, {state['fingerprint'][:12]}",
                   self.fingerprint()[:12],
                   "This process has another version of the package or of your classes: use the same in "
                   "all processes.")  # fmt: skip

    @property
    def data_version(self) -> int:
        """Version of the pixels."""
        return DATA_VERSION

    @property
    def fits_window(self) -> bool:
        """True if each medium has a window of its own."""
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
            reject("Recipe.geometry", "read from a medium, since the illuminated area is fitted", self.window.width)
        return self.seen_through(self.window.width)

    def seen_through(self, width: float) -> Viewing:
        """Camera behind a window of some width, its grains always of the same number of pixels."""
        assert self.camera is not None
        wavelength = self.wavelength
        grid = FarFieldGrid(shape=self.camera.shape, pitch=wavelength / (width * self.camera.pixels_per_grain))
        return Viewing(wavelength, width, self.profile, grid, self.wavenumber_bandwidth, self.pixel_integration)

    @property
    def pixel_integration(self) -> bool:
        """True if pixels average over their area: in a laboratory, with an exposure, where points would be too few."""
        few = self.camera is not None and self.camera.pixels_per_grain < LEAST_POINTS
        return self.lab is not None or self.exposure is not None or few

    @property
    def wavenumber_bandwidth(self) -> float:
        """Full width of the light's spectrum in wavenumber inside the medium."""
        if self.lab is not None:
            return self.lab.wavenumber_bandwidth
        # d k = 2 pi n d(lambda_0) / lambda_0^2, and lambda_0 = n wavelength
        return 2 * np.pi * self.light.bandwidth / (self.light.refractive_index * self.wavelength**2)

    def physics(self, context: dict[str, bool] | None = IDENTITY) -> dict[str, Any]:
        """Everything that decides a pixel; with ``context=None`` also the fields that equal their defaults."""
        decided = self.model_dump(mode="json", exclude=COSMETIC, context=context) | {"data_version": DATA_VERSION}
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

    def medium_numbers(self, indices: Sequence[int]) -> list[int]:
        """Numbers of the media of samples: :meth:`medium_number` of each."""
        group, media = self.media_group, self.media
        return [index // group for index in indices] if media is None else [index % media for index in indices]

    def media_of(self, samples: int) -> int:
        """Media behind the first ``samples`` samples of a split."""
        return -(-samples // self.media_group) if self.media is None else min(samples, self.media)

    @property
    def medium_purposes(self) -> tuple[Purpose, ...]:
        """Substreams of a medium's fields, one for each polarisation."""
        both = self.bench is not None and self.bench.polarises
        return MEDIUM_PURPOSES[: 2 if both else self.light.halves]

    @property
    def shares_media(self) -> bool:
        """True if a medium comes again, so that many objects look through it."""
        return self.media is not None or self.media_group > 1

    @abstractmethod
    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""

    def observation(self, shape: tuple[int, ...], dims: tuple[str, ...], what: str) -> ArraySpec:
        """Layout of an array of camera images."""
        if self.exposure is None:
            return ArraySpec(shape=shape, dims=dims, description=f"{what}, intensity over its expected value")
        counts = self.exposure.bit_depth is not None
        return ArraySpec(shape=shape, dims=dims, dtype="uint16" if counts else "float32", counts=counts, units="counts",
                         description=f"{what}, counts")  # fmt: skip

    def split_notes(self) -> str:
        """Say what the splits share, in Markdown sentences for the data card."""
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


def _row(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_row(inner)}" for name, inner in value.items())
    return ", ".join(map(_row, value)) if isinstance(value, list) else str(value)
