"""Recipes: what a data set is made of, and its samples as pure functions of (seed, split, index).

A recipe is a frozen value, read from a packaged preset or a TOML file. ``inherits`` names another recipe to
start from; tables are merged, everything else is replaced. The physics of each kind is in a file of its own:
:mod:`tilt_stack`, :mod:`hidden_object`.
"""

import hashlib
import json
import tomllib
from collections.abc import Mapping, Sequence
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import PrivateAttr, model_validator

from specklegen.datasets.material import KnownMaterial, Material, known
from specklegen.datasets.protocol import ArraySpec
from specklegen.datasets.split import SPLITS, Purpose, Split, generator, medium_of, split_number, substream
from specklegen.illumination import Profile
from specklegen.planning import Plan
from specklegen.sensors import FarFieldGrid
from specklegen.values import Positive, PositiveInt, Value, reject

DATA_VERSION = 1
"""Raised by hand whenever pixels change; a golden test guards it."""

COSMETIC = {"name", "description", "samples"}
"""Fields that decide no pixel and so stay out of the fingerprint."""


class Samples(Value):
    """Samples an epoch, split by split."""

    train: PositiveInt = 4096
    validation: PositiveInt = 512
    test: PositiveInt = 512


class Window(Value):
    """The illuminated window on the entrance face.

    Parameters
    ----------
    width
        Full side ("square"), diameter ("disc") or 1/e^2 intensity diameter ("gaussian").
    profile
        Its shape.
    """

    width: Positive
    profile: Profile = "square"


class CameraGrid(Value):
    """The camera's pixels in the far field.

    Parameters
    ----------
    shape
        (rows, columns).
    pixels_per_grain
        Pixels per speckle grain (wavelength / width); at least 2, below which intensities are undersampled.
    """

    shape: tuple[PositiveInt, PositiveInt]
    pixels_per_grain: Positive = 3.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pixels_per_grain < 2:
            reject("CameraGrid.pixels_per_grain", "at least 2", self.pixels_per_grain, "Fewer undersample the speckle.")
        return self


class Recipe(Value):
    """What every kind of recipe has.

    Parameters
    ----------
    name, description
        For people; not part of the fingerprint.
    samples
        Samples an epoch.
    media
        Media a split; sample n is seen through medium n mod ``media``. None draws a new one for every sample.
    material, window, camera
        The scene.
    """

    name: str
    description: str = ""
    samples: Samples = Samples()
    media: PositiveInt | None = None
    material: Material
    window: Window
    camera: CameraGrid
    _device: str = PrivateAttr("cpu")  # not written down: a file says what is rendered, not where

    @property
    def device(self) -> str:
        """Torch device that samples are rendered on."""
        return self._device

    def on(self, device: str) -> Self:
        """Return this recipe rendering on another torch device: the same random numbers, other rounding."""
        copy = self.model_copy()
        copy._device = device
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
    def grid(self) -> FarFieldGrid:
        """The camera as a sensor of the engine."""
        pitch = self.material.wavelength / (self.window.width * self.camera.pixels_per_grain)
        return FarFieldGrid(shape=self.camera.shape, pitch=pitch)

    def physics(self) -> dict[str, Any]:
        """Everything that decides a pixel."""
        return self.model_dump(mode="json", exclude=COSMETIC) | {"data_version": DATA_VERSION}

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
        return index if self.media is None else medium_of(index, self.media)

    def material_of(self, seed: int, split: Split, medium: int) -> KnownMaterial:
        """Material of one medium, with its kernel."""
        rng = generator(substream(seed, split, Purpose.MATERIAL, medium))
        return known(self.material.draw(rng), self.material.kernel_paths)

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        raise NotImplementedError

    def sample(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One sample: arrays, "index" and "parameters" (a flat dict of float64). Pure.

        Raises
        ------
        RuleError
            If the split is unknown, or the seed or the index is not a whole number of at least 0.
        """
        raise NotImplementedError

    def plans(self) -> list[Plan]:
        """Plans of the engine for the scene at the ends of every range of the material."""
        raise NotImplementedError

    def batch(self, seed: int, split: str, indices: Sequence[int]) -> dict[str, Any]:
        """Samples stacked along a new first axis, parameters as a dict of float64[B]; the same bits as alone."""
        samples = [self.sample(seed, split, index) for index in indices]
        if not samples:
            reject("batch indices", "at least one index", list(indices))
        batch = {key: np.stack([s[key] for s in samples]) for key in samples[0] if key != "parameters"}
        names = samples[0]["parameters"]
        return batch | {"parameters": {n: np.array([s["parameters"][n] for s in samples]) for n in names}}


def recipe_names() -> list[str]:
    """Names of the packaged recipes."""
    folder = files("specklegen.datasets") / "recipes"
    return sorted(p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml"))


def recipe_table(source: str | Path) -> dict[str, Any]:
    """Table of a packaged recipe (by name) or of a TOML file (by path), what it inherits merged in.

    Raises
    ------
    RuleError
        If there is no such recipe, the file is not TOML, or recipes inherit one another in a circle.
    """
    return _table(str(source), ())


def _table(source: str, heirs: tuple[str, ...]) -> dict[str, Any]:
    if source in heirs:
        reject("recipe.inherits", "free of circles", " -> ".join([*heirs, source]))
    table = _parse(source)
    parent = table.pop("inherits", None)
    if parent is None:
        return table
    if parent not in recipe_names() and not Path(parent).is_absolute():
        parent = str(Path(source).parent / parent)
    return merged(_table(parent, (*heirs, source)), table)


def _parse(source: str) -> dict[str, Any]:
    if source in recipe_names():
        text = (files("specklegen.datasets") / "recipes" / f"{source}.toml").read_text()
    elif Path(source).is_file():
        text = Path(source).read_text()
    else:
        reject(
            "recipe", f"one of {', '.join(recipe_names())}, or the path of a TOML file", source,
            "`specklegen recipes` lists the packaged ones.",
        )  # fmt: skip
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        reject("recipe", "valid TOML", source, str(error))


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Merge tables: tables go into tables, everything else is replaced.

    A table with another ``type`` replaces the old one whole, since their fields have nothing in common; so
    does a distribution (``{uniform = ...}``).
    """
    result = dict(base)
    for key, value in changes.items():
        old = result.get(key)
        both = isinstance(old, Mapping) and isinstance(value, Mapping)
        if both and value.get("type", old.get("type")) == old.get("type") and not _is_draw(old):  # type: ignore[union-attr]
            result[key] = merged(old, value)  # type: ignore[arg-type]
        else:
            result[key] = value
    return result


def _is_draw(table: Mapping[str, Any]) -> bool:
    return bool({"uniform", "log_uniform", "choice"} & table.keys())


__all__ = ["SPLITS", "Recipe", "merged", "recipe_names", "recipe_table"]
