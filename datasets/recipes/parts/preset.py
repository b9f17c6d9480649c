"""The material of a recipe by its name: a slab of :mod:`specklegen.materials`, its numbers drawn like all others.

In TOML a ``[material]`` with a preset instead of a slab's numbers:

    [material]
    preset = { name = "intralipid", wavelength = 0.633, dilution = { uniform = [0.02, 0.1] } }
    thickness = 1000.0
    outside = 1.0                  # air, as by default; or "matched", without a step

A number may be "range": it is then drawn from the range that the literature leaves. So may ``lobe``, a family of phase
functions that the material may have; the place in ``materials.about(name).lobes`` is then stored as ``preset_lobe``.
The wavelength is that in vacuum, in micrometres; lengths of the recipe are in units of ``unit`` metres.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, TypeAdapter, WithJsonSchema, model_validator

from specklegen import materials
from specklegen.core.arguments import real_number
from specklegen.core.errors import reject
from specklegen.core.quantities import Like, Node
from specklegen.core.units import LENGTH, MICROMETRES, UNIT
from specklegen.core.values import Positive, Value
from specklegen.datasets.distributions import Choice, Draw, Uniform, drawn, ends, is_draw, require_above
from specklegen.datasets.recipes.parts.material import MOVING, CharacterizedMaterial, known
from specklegen.datasets.split import Split
from specklegen.instrument.lab import LabSetup
from specklegen.materials import BulkMaterial
from specklegen.materials.registry import NUMBERS, known_lobe, require_measured
from specklegen.scene.faces import Faces
from specklegen.scene.media import Slab

_DRAW = TypeAdapter(Draw)
_FIXED = ("name", "wavelength", "unit")


def _read(table: Any) -> Any:
    if isinstance(table, str):
        table = {"name": table}
    if not isinstance(table, Mapping) or "name" not in table:
        reject("Material.preset", 'a name, or a table such as {name = "intralipid", wavelength = 0.633}', table)
    numbers = materials.about(table["name"]).numbers
    measured = [field for field, value in table.items() if value != "range" and field != "lobe"]
    if "wavelength" in table and real_number("Material.preset wavelength", table["wavelength"]) > 0:
        require_measured(table["name"], table["wavelength"], measured)
    read = {}
    for field, value in table.items():
        if field in _FIXED:
            read[field] = value
        elif field == "lobe":
            read[field] = _lobe(table["name"], value)
        elif field not in numbers:
            reject("Material.preset", f"given by numbers of {', '.join(numbers)}", field)
        elif value == "range":
            known = numbers[field]
            if known.default is None:
                reject(f"Material.preset {field}", "a number or a distribution", value,
                       f"Or give {', '.join(known.computed_from)} ranges: it is computed from them.")  # fmt: skip
            read[field] = Choice(choice=known.choices) if known.choices else Uniform(uniform=(known.low, known.high))
        else:
            read[field] = _DRAW.validate_python(value)
    return read


def _lobe(name: str, value: Any) -> Any:
    """Read a family of phase functions, or a choice of all that a material may have: their places."""
    lobes = materials.about(name).lobes
    if value == "range" and lobes:
        return Choice(choice=tuple(map(float, range(len(lobes)))))
    if isinstance(value, Mapping | Choice):
        return _DRAW.validate_python(value)  # as stores have it
    return known_lobe(name, value)


def _matched(outside: Any) -> Any:
    """Read the null of older stores."""
    return "matched" if outside is None else outside


NamedMaterial = Annotated[
    dict[str, Any],
    BeforeValidator(_read),
    Like({"wavelength": Node(MICROMETRES), "unit": Node(UNIT), **NUMBERS}),
    WithJsonSchema({"type": "object", "required": ["name", "wavelength"],
                    "properties": {"name": {"enum": materials.list()}}}),
]  # fmt: skip
"""Name, vacuum wavelength and numbers of a preset, with distributions in place of numbers."""


class PresetMaterial(Value):
    """A slab of a named material.

    Parameters
    ----------
    preset
        Name (alone, if a ``[lab]`` says the rest), wavelength (in vacuum, micrometres), ``unit`` (metres in a length
        of the recipe, 1e-6 by default), and the numbers of the preset; each may be a constant, a range, a choice, or
        "range" for that of the literature; ``lobe`` is a family of phase functions, or "range" for any that it may
        have.
    thickness
        Of the slab.
    outside
        Refractive index before and behind it, whose step reflects light: that of air by default; "matched" for none.
    kernel_paths
        As of a slab that is given by its numbers.
    """

    preset: NamedMaterial
    thickness: Annotated[Draw, LENGTH]
    outside: Annotated[Positive | Literal["matched"], BeforeValidator(_matched)] = 1.0
    kernel_paths: Annotated[int, Field(ge=64, le=10**9)] = 100_000

    kernel: ClassVar = "estimate"
    by_split: ClassVar = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        require_above("Material.thickness", self.thickness, 0)
        if "wavelength" not in self.preset:
            return self  # a laboratory gives it
        bulks = [self._bulk(numbers) for numbers in self._corners()]
        if len({bulk.refractive_index for bulk in bulks}) > 1:
            reject("Material.preset", "of one refractive index, since that fixes the wavelength inside",
                   sorted({bulk.refractive_index for bulk in bulks}),
                   "Give a constant for each number that the index depends on.")
        return self

    @property
    def wavelength(self) -> float | None:
        """Inside the material; None where it is left to a laboratory."""
        return None if "wavelength" not in self.preset else self._bulk(self._corners()[0]).wavelength

    @property
    def refractive_index(self) -> float:
        """Index of the material."""
        return self._bulk(self._corners()[0]).refractive_index

    @property
    def faces(self) -> Faces:
        """Faces of its slabs."""
        return self.extremes()[0].faces

    @property
    def varies(self) -> bool:
        """True if two media may have different parameters."""
        return any(low < high for low, high in map(ends, [self.thickness, *self._draws().values()]))

    def in_laboratory(self, lab: LabSetup) -> Self:
        """Return the material at a laboratory's wavelength, in its unit of length and between its faces.

        Raise a `RuleError` where it is given otherwise, or the laboratory has plates over the faces.
        """
        micrometres = lab.wavelength * lab.metres / 1e-6
        for field, value in (("wavelength", micrometres), ("unit", lab.metres)):
            if not math.isclose(self.preset.get(field, value), value, rel_tol=1e-9):
                reject(f"Material.preset {field}", f"{value:.6g}, as in lab, or left out", self.preset[field])
        if lab.wall is not None:
            reject("Lab.wall", "left out for a preset material", lab.wall, "Write its numbers instead.")
        outside = "matched" if lab.faces == "matched" else self.outside
        # Rounded, so that .000532 millimetres are .532 micrometres.
        preset = {"wavelength": float(f"{micrometres:.12g}"), "unit": lab.metres} | self.preset
        return self.replace(preset=preset, outside=outside)

    def realized(self, rng: np.random.Generator, split: Split) -> CharacterizedMaterial:  # noqa: ARG002 - as of a slab
        """One slab with its memory effect, and the numbers that were drawn for it."""
        thickness = drawn(self.thickness, rng)
        numbers = {name: drawn(source, rng) for name, source in self._draws().items()}
        labels = {f"preset_{name}": float(value) for name, value in numbers.items()}
        return replace(self.known(self._slab(thickness, numbers)), drawn=labels)

    def slab_of(self, parameters: Mapping[str, float]) -> Slab:
        """Slab of a sample, from its stored parameters."""
        return self._slab(parameters["thickness"], {name: parameters[f"preset_{name}"] for name in self._draws()})

    def labels(self, slab: Slab) -> dict[str, float]:  # noqa: ARG002
        """None: what was drawn is among the parameters of the realized material."""
        return {}

    def extremes(self) -> list[Slab]:
        """Slabs at the ends of every range."""
        return [self._slab(t, numbers) for t in sorted(set(ends(self.thickness))) for numbers in self._corners()]

    def known(self, slab: Slab) -> CharacterizedMaterial:
        """Return a slab with its memory effect."""
        return known(slab, self.kernel_paths)

    def in_motion(self, slab: Slab) -> Slab:
        """Return a slab of this material whose particles move."""
        return slab.replace(motion=MOVING)

    def _draws(self) -> dict[str, Any]:
        return {name: self.preset[name] for name in sorted(self.preset) if is_draw(self.preset[name])}

    def _corners(self) -> list[dict[str, float]]:
        draws = self._draws()
        corners = product(*(sorted(set(ends(source))) for source in draws.values()))
        return [dict(zip(draws, corner, strict=True)) for corner in corners]

    def _bulk(self, numbers: Mapping[str, float]) -> BulkMaterial:
        given = {**self.preset, **numbers}
        if not isinstance(given.get("lobe", ""), str):
            given["lobe"] = materials.about(self.preset["name"]).lobes[int(given["lobe"])]
        bulk = materials.get(**given)
        if not isinstance(bulk, BulkMaterial):
            reject("Material.preset", "a bulk", self.preset["name"], "Write a ground glass as screens.")
        return bulk

    def _slab(self, thickness: float, numbers: Mapping[str, float]) -> Slab:
        return self._bulk(numbers).slab(thickness, None if self.outside == "matched" else self.outside)
