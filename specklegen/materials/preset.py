"""A preset: its fields, and the media made of it."""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

import numpy as np

from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH, MICROMETRES, NUMBER, WAVELENGTH, Dimension, quantity
from specklegen.core.values import Positive, UnitInterval, Value
from specklegen.scene.faces import Faces
from specklegen.scene.layers import Layer
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import AnyScatterer, Scatterer
from specklegen.scene.screens import GroundGlass


class Checked(StrEnum):
    """Source of a number: how far it was followed back in the literature."""

    SOURCE = "read in the source"
    SECOND_HAND = "read in another work that cites the source"
    NOT = "not checked against the source text"
    ASSUMED = "assumed: no source gives it"


@dataclass(frozen=True)
class Number:
    """One number of a material.

    Attributes
    ----------
    default, low, high : float
        What is taken, and the ends of the range from which :func:`specklegen.materials.draw` draws evenly. A default of
        None: it follows from ``computed_from`` where it is not given.
    unit, meaning, source : str
    checked : Checked
    choices : tuple of float
        Of a number that takes a few values alone, from which one is drawn.
    band : (float, float)
        Vacuum wavelengths, micrometres, at which it is known: elsewhere it has neither default nor range, and must be
        given.
    computed_from : tuple of str
        Other numbers of the material, which must be left out where this one is given.
    """

    default: float | None
    low: float
    high: float
    unit: str
    meaning: str
    source: str
    checked: Checked
    choices: tuple[float, ...] = ()
    band: tuple[float, float] = (0.0, math.inf)
    computed_from: tuple[str, ...] = ()

    @property
    def dimension(self) -> Dimension:
        """Its dimension, in its unit."""
        read = quantity("1 " + self.unit.replace("micrometres", "um").replace("micrometre", "um"))
        return NUMBER if read is None else Dimension(read.length, metres=read.value ** (1 / read.length))

    @with_units
    def holds(self, wavelength: Annotated[float, MICROMETRES]) -> bool:
        """Return whether it is known at a vacuum wavelength, micrometres."""
        return self.band[0] <= wavelength <= self.band[1]

    def drawn(self, rng: np.random.Generator) -> float:
        """One of the choices, or a number evenly from the range."""
        return float(rng.choice(self.choices) if self.choices else rng.uniform(self.low, self.high))

    def __str__(self) -> str:
        spread = f" ({self.low:g} to {self.high:g})" if self.low < self.high else ""
        unit = f" {self.unit}" if self.unit else ""
        low, high = self.band
        where = f", {low:g} to {high:g} micrometres alone" if math.isfinite(high) else ""
        value = "computed, in" if self.default is None else f"{self.default:g}{spread}"
        return f"{value}{unit}{where}: {self.meaning}. {self.source}; {self.checked}."


@dataclass(frozen=True)
class Optics:
    """Optical properties of a material, per micrometre.

    Attributes
    ----------
    scatterer : Scatterer
        Of its lengths (those of a sphere) in the unit that was asked for.
    scattering, absorption : float
        Coefficients, 1 / micrometre.
    refractive_index : float
    """

    scatterer: Scatterer
    scattering: float
    absorption: float
    refractive_index: float


@dataclass(frozen=True)
class Preset:
    """A named material.

    Attributes
    ----------
    name, summary : str
    wavelengths : (float, float)
        Vacuum wavelengths that its formulas hold for, micrometres.
    numbers : Mapping[str, Number]
        What may be given or drawn, by name.
    references : tuple of str
    doubts : str
        What the model leaves out.
    lobes : tuple of str
        Families of phase functions that it may have, the first by default; none where its particles leave no choice.
    make : Callable
        Maps (vacuum wavelength in micrometres, units of length in a micrometre, **numbers) to :class:`Optics`, or to a
        thin medium.
    """

    name: str
    summary: str
    wavelengths: tuple[float, float]
    numbers: Mapping[str, Number]
    references: tuple[str, ...]
    make: Callable[..., Optics | GroundGlass] = field(repr=False)
    doubts: str = ""
    lobes: tuple[str, ...] = ()

    def left_open(self, given: Collection[str]) -> dict[str, Number]:
        """Numbers that have a default, and a range, where those of some names are given."""
        idle = {each for field in given if field in self.numbers for each in self.numbers[field].computed_from}
        return {field: number for field, number in self.numbers.items()
                if number.default is not None and field not in idle and field not in given}  # fmt: skip

    def __str__(self) -> str:
        low, high = self.wavelengths
        lines = [f"{self.name}: {self.summary}", f"  wavelength: {low:g} to {high:g} micrometres, in vacuum"]
        lines += [f"  {name} = {number}" for name, number in self.numbers.items()]
        lines += [f"  lobe = {self.lobes[0]} (or {', '.join(self.lobes[1:])})"] if self.lobes else []
        lines += [f"  {self.doubts}"] if self.doubts else []
        return "\n".join(lines + [f"  [{n}] {text}" for n, text in enumerate(self.references, start=1)])


class BulkMaterial(Value):
    """A scattering material without a shape; :meth:`slab` gives it one.

    Parameters
    ----------
    name
        Of the preset.
    scatterer
        What one particle does with the light that it scatters.
    mean_free_path
        1 / sigma_t, the mean distance between collisions, in the unit of length of the scene.
    albedo
        Share of collisions that scatter; the rest absorb.
    refractive_index
        Of what lies between the scatterers.
    wavelength
        Inside the material, in the unit of the mean free path: that of a scene.
    """

    name: str
    scatterer: AnyScatterer
    mean_free_path: Annotated[Positive, LENGTH]
    albedo: UnitInterval
    refractive_index: Positive
    wavelength: Annotated[Positive, WAVELENGTH]

    @property
    def transport_length(self) -> float:
        """l* = mean_free_path / (1 - g)."""
        return self.mean_free_path / (1 - self.scatterer.mean_cosine())

    @with_units
    def layer(self, thickness: Annotated[float, LENGTH]) -> Layer:
        """One of the layers of :class:`specklegen.Layers`, of a thickness in the unit of the mean free path."""
        return Layer(
            thickness=thickness, mean_free_path=self.mean_free_path, albedo=self.albedo, scatterer=self.scatterer
        )  # fmt: skip

    @with_units
    def slab(self, thickness: Annotated[float, LENGTH], outside: float | None = 1.0, wall: float | None = None) -> Slab:
        """A layer of it.

        Parameters
        ----------
        thickness
            Same unit as the mean free path.
        outside
            Refractive index before and behind it, whose step reflects light; None for matched faces.
        wall
            Refractive index of a thin plate over each face; by default there is none.
        """
        faces = Faces() if outside is None else Faces(inside=self.refractive_index, outside=outside, wall=wall)
        return Slab(thickness=thickness, mean_free_path=self.mean_free_path, albedo=self.albedo,
                    scatterer=self.scatterer, faces=faces)  # fmt: skip
