"""The material of a recipe in layers, one behind the other, their numbers drawn like all others.

In TOML one table a layer, from the one that light enters first:

    [material]
    wavelength = 0.5

    [[material.layers]]
    thickness = 100.0
    mean_free_path = 25.0
    g = 0.8

    [[material.layers]]
    thickness = { uniform = [500, 1000] }
    mean_free_path = 90.0
    scatterer = { type = "VonMisesFisher", concentration = 10.0 }
    albedo = 0.99
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.units import LENGTH, WAVELENGTH
from specklegen.core.values import Positive, Value
from specklegen.datasets.distributions import Draw, drawn, ends, is_draw, require_above
from specklegen.datasets.recipes.parts.material import MOVING, CharacterizedMaterial, known
from specklegen.datasets.recipes.parts.particles import Particles, drawn_numbers, scatterer_with
from specklegen.datasets.split import Split
from specklegen.paths.deep_absorption import require_reach
from specklegen.paths.stretching import relative_variance
from specklegen.scene.faces import Faces, require_index
from specklegen.scene.layers import Layer, Layers
from specklegen.scene.scatterers import HenyeyGreenstein

_NUMBERS = ("thickness", "mean_free_path", "albedo")


class LayerDraws(Value):
    """One layer; every number may be a constant, a range or a choice.

    Parameters
    ----------
    thickness, mean_free_path, albedo
        As of :class:`specklegen.media.Layer`.
    g
        Anisotropy of Henyey-Greenstein scatterers.
    scatterer
        The particles, of any type; instead of ``g``.
    index
        Its refractive index, as of :class:`specklegen.media.Layer`; left out, that of what is around, in which the
        recipe's wavelength and angles are.
    at_rest
        Whether its particles stand still where the recipe's dynamics move those of the others: bone over blood.
    """

    thickness: Annotated[Draw, LENGTH]
    mean_free_path: Annotated[Draw, LENGTH]
    albedo: Draw = 1.0
    g: Draw | None = None
    scatterer: Particles | None = None
    index: Draw | None = None
    at_rest: bool = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.g is None) == (self.scatterer is None):
            reject("Material.layers", "given g or scatterer, one of them", "both" if self.scatterer else "neither")
        for name in ("thickness", "mean_free_path"):
            require_above(f"Material.layers.{name}", getattr(self, name), 0)
        if not 0 < ends(self.albedo)[0] <= ends(self.albedo)[1] <= 1:
            reject("Material.layers.albedo", "above 0 and at most 1", self.albedo)
        if self.g is not None and not -1 < ends(self.g)[0] <= ends(self.g)[1] < 1:
            reject("Material.layers.g", "between -1 and 1, both excluded", self.g)
        if self.index is not None:
            for end in ends(self.index):
                require_index("Material.layers.index", end)
        return self

    @property
    def draws(self) -> dict[str, Any]:
        """Numbers drawn for the layer, by name; those of particles by "scatterer_" and their names."""
        particles = self.scatterer or {}
        own = {name: getattr(self, name) for name in (*_NUMBERS, "g", "index") if is_draw(getattr(self, name))}
        return own | {f"scatterer_{name}": particles[name] for name in drawn_numbers(particles)}

    def layer(self, numbers: Mapping[str, float]) -> Layer:
        """Layer with these numbers for what is drawn."""
        own = {name: numbers.get(name, getattr(self, name)) for name in (*_NUMBERS, "index")}
        if self.scatterer is None:
            return Layer(**own, scatterer=HenyeyGreenstein(g=numbers.get("g", self.g)))
        particles = {n.removeprefix("scatterer_"): v for n, v in numbers.items() if n.startswith("scatterer_")}
        return Layer(**own, scatterer=scatterer_with(self.scatterer, particles))


class LayeredMaterial(Value):
    """Layers, the same in every medium or drawn anew.

    Parameters
    ----------
    wavelength
        Inside the material; fixes the unit of every length. Left out where a ``[lab]`` table gives it.
    layers
        From the one that light enters first.
    kernel_paths
        As of a slab that is given by its numbers.
    """

    wavelength: Annotated[Positive, WAVELENGTH] | None = None
    layers: tuple[LayerDraws, ...] = Field(min_length=1)
    kernel_paths: Annotated[int, Field(ge=64, le=10**9)] = 100_000

    kernel: ClassVar = "estimate"
    by_split: ClassVar = None
    scatterer: ClassVar = None
    faces: ClassVar = Faces()

    @property
    def varies(self) -> bool:
        """True if two media may have different parameters."""
        return any(low < high for low, high in map(ends, self._draws().values()))

    def realized(self, rng: np.random.Generator, split: Split) -> CharacterizedMaterial:  # noqa: ARG002 - as of a slab
        """Layers with their memory effect, and the numbers that were drawn for them."""
        numbers = self._numbers(rng)
        return replace(self.known(self.slab_of(numbers)), drawn=numbers)

    def drawn_medium(self, rng: np.random.Generator, split: Split) -> tuple[Layers, dict[str, float]]:  # noqa: ARG002
        """Layers, and the numbers that samples tell of them."""
        numbers = self._numbers(rng)
        layers = self.slab_of(numbers)
        return layers, numbers | {"thickness": layers.thickness, "optical_depth": layers.optical_depth}

    def _numbers(self, rng: np.random.Generator) -> dict[str, float]:
        return {name: float(drawn(source, rng)) for name, source in self._draws().items()}

    def slab_of(self, parameters: Mapping[str, float]) -> Layers:
        """Layers of a sample, from its stored parameters."""
        layers = []
        for n, layer in enumerate(self.layers):
            layers.append(layer.layer({name: parameters[f"layer_{n}_{name}"] for name in layer.draws}))
        return Layers(layers=tuple(layers))

    def labels(self, slab: Layers) -> dict[str, float]:  # noqa: ARG002
        """None: what was drawn is among the parameters of the realized material."""
        return {}

    def extremes(self) -> list[Layers]:
        """Layers at the ends of every range."""
        return [self.slab_of(corner) for corner in self._corners()]

    def known(self, slab: Layers) -> CharacterizedMaterial:
        """Return layers with their memory effect."""
        require_reach("Material.kernel_paths", relative_variance(slab), self.kernel_paths)
        return known(slab, self.kernel_paths)  # type: ignore[arg-type]

    def in_motion(self, slab: Layers) -> Layers:
        """Return layers whose particles move, but for those at rest."""
        moving = [layer if own.at_rest else layer.replace(motion=MOVING)
                  for layer, own in zip(slab.layers, self.layers, strict=True)]  # fmt: skip
        return slab.replace(layers=tuple(moving))

    def _draws(self) -> dict[str, Any]:
        return {f"layer_{n}_{name}": source for n, layer in enumerate(self.layers)
                for name, source in layer.draws.items()}  # fmt: skip

    def _corners(self) -> Iterator[dict[str, float]]:
        draws = self._draws()
        for corner in product(*(sorted(set(ends(source))) for source in draws.values())):
            yield dict(zip(draws, corner, strict=True))
