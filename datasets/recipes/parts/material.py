"""The material of a recipe: a slab whose parameters may be drawn anew for every medium."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.arguments import positive_number
from specklegen.core.errors import reject
from specklegen.core.random_streams import pilot_seed
from specklegen.core.units import LENGTH, WAVELENGTH
from specklegen.core.values import Positive, Value
from specklegen.datasets.distributions import Draw, drawn, ends, is_draw
from specklegen.datasets.recipes.parts.particles import (
    Particles,
    drawn_numbers,
    drawn_scatterer,
    extreme_scatterers,
    scatterer_with,
)
from specklegen.datasets.split import SPLITS, Split
from specklegen.fdtd.layers import RandomLayer
from specklegen.fdtd.mean_field import equivalent_slab
from specklegen.mean.field import straight_through
from specklegen.memory_effects.atlas import correlation_for
from specklegen.memory_effects.correlation import MemoryEffectCorrelation, estimate_correlation
from specklegen.memory_effects.moving import MovingCorrelation, estimate_moving_correlation
from specklegen.scene.faces import Faces
from specklegen.scene.media import Slab
from specklegen.scene.motion import Brownian
from specklegen.scene.scatterers import HenyeyGreenstein, Scatterer
from specklegen.synthesis.spectrum import LightModes, Spectrum, estimate_spectral_correlation, light_modes

KernelSource = Literal["estimate", "atlas"]
_PARAMETERS = ("thickness", "optical_depth", "g", "albedo")
MOVING = Brownian(diffusion=1.0)
"""Motion of materials that move; what their diffusion is, the recipe's dynamics say."""


class Estimator(IntEnum):
    """Source of a material's memory-effect correlation; the number is stored with every sample."""

    PATHS = 1
    ATLAS = 2
    CLOSED_FORM = 3


class SplitRanges(Value):
    """One parameter of the material, drawn from a range of its own in each split: a test of extrapolation.

    Parameters
    ----------
    parameter
        Which.
    train, validation, test
        What it is drawn from; no two ranges meet.
    """

    parameter: Literal["thickness", "optical_depth", "g", "albedo"]
    train: Draw
    validation: Draw
    test: Draw

    @model_validator(mode="after")
    def _check(self) -> Self:
        ranges = sorted(ends(getattr(self, split)) for split in SPLITS)
        for (_, high), (low, _) in zip(ranges[:-1], ranges[1:], strict=True):
            if not high < low:
                reject("SplitRanges", "given by ranges that do not overlap", ranges, "Leave a gap between the splits.")
        return self


class Material(Value):
    """A slab; every number may be a constant, a range or a choice.

    Parameters
    ----------
    wavelength
        Inside the medium; fixes the unit of every length. Left out where a ``[lab]`` table gives it.
    thickness
        Of the slab, same unit.
    optical_depth
        Thickness over mean free path.
    g
        Anisotropy of Henyey-Greenstein scatterers; stands for ``scatterer = {type = "HenyeyGreenstein", g = ...}``.
    scatterer
        The particles, of any type, their numbers constants or drawn; where given, ``g`` is not looked at. The
        memory-effect ranges of two scatterers of one g differ: 4.5 times at 0.9, 10 times at 0.98 (docs/atlas.md).
    albedo
        Share of collisions that scatter.
    faces
        The step of the refractive index at the slab's faces, as in ``faces = {inside = 1.33, outside = 1.0}``; by
        default there is none, and in a recipe with a ``[lab]`` table that of the laboratory.
    layer
        A layer of random index (:class:`specklegen.fdtd.RandomLayer`), in the unit of the wavelength: thickness and
        optical depth are then those of the slab with its coherent transmission
        (:func:`specklegen.fdtd.equivalent_slab`), and are left out. It varies along one axis, so it has no phase
        function: give ``g`` or ``scatterer``.
    kernel_paths
        Paths from which the memory-effect correlation of each material is estimated; the relative error of C_I at
        half range is about sqrt(60 / kernel_paths).
    kernel
        "estimate" traces those paths for every material; "atlas" takes the correlation from the table of
        materials where its error of C_I is at most ``kernel_tolerance``, and traces (and keeps on disk) only the
        others. The table holds slabs of matched faces: with a step, ask for "estimate". Left out, it is "estimate"; in
        recipes of hidden objects and of tilts "atlas" where drawn Henyey-Greenstein slabs can be looked up.
    kernel_tolerance
        Stated error of C_I (two sigma) up to which the lookup table will do. At the default it serves all but a few of
        a thousand materials of its range; a fresh estimate that good takes some 1e5 paths.
    by_split
        One parameter that each split draws from a range of its own, within the range given here.
    """

    wavelength: Annotated[Positive, WAVELENGTH] | None = None
    thickness: Annotated[Draw, LENGTH]
    optical_depth: Draw
    g: Draw | None = None
    scatterer: Particles | None = None
    albedo: Draw = 1.0
    faces: Faces = Faces()
    layer: RandomLayer | None = None
    kernel_paths: Annotated[int, Field(ge=64, le=10**9)] = 100_000
    kernel: KernelSource = "estimate"
    kernel_tolerance: Positive = 0.02
    by_split: SplitRanges | None = None

    @model_validator(mode="before")
    @classmethod
    def _of_layer(cls, table: Any) -> Any:
        """Take thickness and optical depth from the layer, where there is one."""
        if not isinstance(table, Mapping) or table.get("layer") is None:
            return table
        layer = RandomLayer.model_validate(table["layer"])
        wavelength = positive_number("Material.wavelength, where layer is given,", table.get("wavelength"))
        bulk = equivalent_slab(layer, layer.n_background * wavelength)
        if not bulk.valid:
            reject("Material.layer", "one that a slab describes", bulk.reason, "See docs/fdtd.md.")
        stated = {"thickness": bulk.thickness, "optical_depth": bulk.optical_depth}
        for name, value in stated.items():
            if name in table and table[name] != value:
                reject(f"Material.{name}", "left out, since it follows from layer", table[name])
        return {**table, "layer": layer, **stated}

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.g is None and self.scatterer is None:
            reject("Material", "given g or scatterer", "neither")
        if self.scatterer is not None and self.by_split is not None and self.by_split.parameter == "g":
            reject("Material.by_split.parameter", "other than g, since a scatterer is given", "g")
        rules = [("thickness", 1e-60, 1e60), ("optical_depth", 1e-60, 1e60)]
        for name, low, high in rules if self.scatterer is not None else [*rules, ("g", -1, 1)]:
            smallest, largest = ends(getattr(self, name))
            if not low < smallest <= largest < high:
                reject(f"Material.{name}", f"between {low} and {high}, both excluded", getattr(self, name))
        if self.kernel == "atlas" and not self.faces.matched:
            reject("Material.kernel", '"estimate", since the lookup table has index-matched faces only',
                   self.kernel,
                   'Set kernel = "estimate"; kernel_paths is the number of paths for each material.')  # fmt: skip
        if not 0 < ends(self.albedo)[0] <= ends(self.albedo)[1] <= 1:
            reject("Material.albedo", "above 0 and at most 1", self.albedo)
        if self.by_split is not None:
            low, high = ends(getattr(self, self.by_split.parameter))
            for split in SPLITS:
                smallest, largest = ends(getattr(self.by_split, split))
                if not low <= smallest <= largest <= high:
                    reject(f"Material.by_split.{split}", f"within {self.by_split.parameter}, {low:g} to {high:g}",
                           (smallest, largest))  # fmt: skip
        return self

    @property
    def varies(self) -> bool:
        """True if two media may have different parameters."""
        numbers = [self.thickness, self.optical_depth, self.albedo]
        particles = self.scatterer.values() if self.scatterer is not None else [self.g]
        return any(low < high for low, high in map(ends, [*numbers, *filter(is_draw, particles)]))

    def draw(self, rng: np.random.Generator, split: Split) -> Slab:
        """One slab of a split."""
        numbers = {name: drawn(self.source(name, split), rng) for name in _PARAMETERS}
        g = numbers.pop("g")
        return self.slab(**numbers, scatterer=self._scatterer(g, rng), faces=self.faces)

    def drawn_medium(self, rng: np.random.Generator, split: Split) -> tuple[Slab, dict[str, float]]:
        """One slab of a split, and the numbers that samples tell of it."""
        slab = self.draw(rng, split)
        names = ("thickness", "mean_free_path", "optical_depth", "albedo")
        numbers = {name: float(getattr(slab, name)) for name in names} | {"g": slab.scatterer.mean_cosine()}
        return slab, numbers | self.labels(slab)

    def _scatterer(self, g: float, rng: np.random.Generator) -> Scatterer:
        return HenyeyGreenstein(g=g) if self.scatterer is None else drawn_scatterer(self.scatterer, rng)

    def source(self, name: str, split: Split) -> Draw:
        """Return the distribution of a parameter in a split."""
        own = self.by_split is not None and self.by_split.parameter == name
        draw = getattr(self.by_split, split) if own else getattr(self, name)
        return 0.0 if draw is None else draw

    def realized(self, rng: np.random.Generator, split: Split) -> "CharacterizedMaterial":
        """One slab of a split with its correlation."""
        return self.known(self.draw(rng, split))

    def known(self, slab: Slab) -> "CharacterizedMaterial":
        """Return a slab of this material with its correlation, found as the recipe says."""
        return known(slab, self.kernel_paths, self.kernel, self.kernel_tolerance, not self.varies)

    def labels(self, slab: Slab) -> dict[str, float]:
        """The numbers drawn for the particles of a slab, by "scatterer_" and their names."""
        names = drawn_numbers(self.scatterer) if self.scatterer is not None else []
        return {f"scatterer_{name}": float(getattr(slab.scatterer, name)) for name in names}

    def slab_of(self, parameters: Mapping[str, float]) -> Slab:
        """Slab of a sample, from its stored parameters."""
        shape = [parameters[name] for name in ("thickness", "optical_depth", "albedo")]
        if self.scatterer is None:
            return self.slab(*shape, HenyeyGreenstein(g=parameters["g"]), self.faces)
        drawn_here = {n.removeprefix("scatterer_"): v for n, v in parameters.items() if n.startswith("scatterer_")}
        return self.slab(*shape, scatterer_with(self.scatterer, drawn_here), self.faces)

    def extremes(self) -> list[Slab]:
        """Slabs at the ends of every range: where a claim about all media is tested."""
        thicknesses, depths = (sorted(set(ends(n))) for n in (self.thickness, self.optical_depth))
        albedo = ends(self.albedo)[1]
        if self.scatterer is None:
            assert self.g is not None
            particles: list[Scatterer] = [HenyeyGreenstein(g=g) for g in sorted(set(ends(self.g)))]
        else:
            particles = extreme_scatterers(self.scatterer)
        return [self.slab(t, d, albedo, s, self.faces) for t in thicknesses for d in depths for s in particles]

    def in_motion(self, slab: Slab) -> Slab:
        """Return a slab of this material whose particles move."""
        return slab.replace(motion=MOVING)

    @staticmethod
    def slab(
        thickness: float,
        optical_depth: float,
        albedo: float,
        scatterer: Scatterer,
        faces: Faces = Faces(),  # noqa: B008
    ) -> Slab:
        """Slab of the engine."""
        return Slab(thickness=thickness, mean_free_path=thickness / optical_depth, albedo=albedo, scatterer=scatterer,
                    faces=faces)  # fmt: skip


@dataclass(frozen=True)
class CharacterizedMaterial:
    """A slab with its memory-effect correlation and what follows from it.

    Attributes
    ----------
    half_range : float
        Lateral wavevector difference at which C_I is half way to its floor, per unit length; inf where there is none.
    estimator : Estimator
        Where the correlation comes from.
    drawn : Mapping[str, float]
        What was drawn for it besides, by name.
    """

    slab: Slab
    correlation: MemoryEffectCorrelation
    half_range: float
    estimator: Estimator = Estimator.PATHS
    drawn: Mapping[str, float] = field(default_factory=dict)

    def range_sine(self, wavelength: float) -> float:
        """Sine of the memory-effect range; inf where there is none."""
        return self.half_range * wavelength / (2 * np.pi)

    @property
    def forward_radiance(self) -> float:
        """Mean radiance that leaves straight ahead over the irradiance that comes in, 1/sr: a power meter tells it."""
        return float(self.correlation.weights.sum() / self.correlation.paths)

    def parameters(self, wavelength: float) -> dict[str, float]:
        """Parameters stored with every sample: the material, and its effect on light."""
        slab = self.slab
        sine = self.range_sine(wavelength)
        return {
            "wavelength": wavelength,
            "thickness": slab.thickness,
            "mean_free_path": slab.mean_free_path,
            "optical_depth": slab.optical_depth,
            "g": slab.scatterer.mean_cosine(),
            "albedo": slab.albedo,
            "ballistic_fraction": straight_through(slab),
            "single_share": self.correlation.single_share,
            "forward_radiance": self.forward_radiance,
            "memory_effect_range": float(np.arcsin(min(sine, 1.0))) if np.isfinite(sine) else np.inf,
            "estimator": float(self.estimator),
            **self.drawn,
        }


@lru_cache(maxsize=256)
def known(
    slab: Slab, paths: int, source: KernelSource = "estimate", tolerance: float = 0.02, kept: bool = False
) -> CharacterizedMaterial:
    """Find a slab's correlation. It is a property of the material: its paths are keyed by the slab, not by a seed.

    An estimate is ``kept`` on disk where it is that of all media, and not of one among many.
    """
    if source == "atlas" or kept:
        correlation = correlation_for(slab, paths=paths, tolerance=tolerance if source == "atlas" else 0.0)
    else:
        correlation = estimate_correlation(slab, paths, pilot_seed(slab.unitless_fingerprint()))
    if not correlation.weights.any():
        reject("Material.kernel_paths", "enough that some light passes the slab", paths,
               f"None does at optical depth {slab.optical_depth:.4g} and albedo {slab.albedo:g}.")  # fmt: skip
    estimator = Estimator.ATLAS if correlation.source == "atlas" else Estimator.PATHS
    return CharacterizedMaterial(slab, correlation, correlation.half_range(), estimator)


@lru_cache(maxsize=64)
def known_light(slab: Slab, paths: int, bandwidth: float, spectrum: Spectrum) -> LightModes:
    """Modes of light of a band behind a slab, from the same paths as its correlation.

    Raise a `RuleError` if the band makes too many modes.
    """
    correlation = estimate_spectral_correlation(slab, paths, pilot_seed(slab.unitless_fingerprint()))
    return light_modes(correlation, bandwidth, spectrum)


@lru_cache(maxsize=64)
def known_motion(slab: Slab, paths: int) -> MovingCorrelation:
    """Memory effect in time of a slab that moves, from the same paths as its correlation."""
    return estimate_moving_correlation(slab, paths, pilot_seed(slab.unitless_fingerprint()))
