"""The material of a recipe: a slab whose parameters may be drawn anew for every medium."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, Self

import numpy as np
from pydantic import model_validator

from specklegen.datasets.draws import Draw, drawn, ends
from specklegen.media import Slab
from specklegen.scatterers import HenyeyGreenstein
from specklegen.stationary.atlas import kernel_for
from specklegen.stationary.kernel import MemoryKernel, estimate_kernel
from specklegen.streams import pilot_seed
from specklegen.values import Positive, PositiveInt, Value, reject

KernelSource = Literal["estimate", "atlas"]


class Material(Value):
    """A Henyey-Greenstein slab; every number may be a constant, a range or a choice.

    Parameters
    ----------
    wavelength
        Inside the medium; fixes the unit of every length.
    thickness
        Of the slab, same unit.
    optical_depth
        Thickness over mean free path.
    g
        Anisotropy.
    albedo
        Share of collisions that scatter.
    kernel_paths
        Paths from which the memory-effect kernel of each material is estimated; the relative error of C_I at
        half range is about sqrt(60 / kernel_paths).
    kernel
        "estimate" traces those paths for every material; "atlas" takes the kernel from the table of materials
        where its error of C_I is at most 0.01, and traces (and keeps on disk) only the others.
    """

    wavelength: Positive
    thickness: Draw
    optical_depth: Draw
    g: Draw
    albedo: Draw = 1.0
    kernel_paths: PositiveInt = 100_000
    kernel: KernelSource = "estimate"

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name, low, high in (("thickness", 0, np.inf), ("optical_depth", 0, np.inf), ("g", -1, 1)):
            smallest, largest = ends(getattr(self, name))
            if not low < smallest <= largest < high:
                reject(f"Material.{name}", f"between {low} and {high}, both excluded", getattr(self, name))
        if not 0 < ends(self.albedo)[0] <= ends(self.albedo)[1] <= 1:
            reject("Material.albedo", "above 0 and at most 1", self.albedo)
        return self

    @property
    def varies(self) -> bool:
        """Whether two media may have different parameters."""
        return any(low < high for low, high in map(ends, (self.thickness, self.optical_depth, self.g, self.albedo)))

    def draw(self, rng: np.random.Generator) -> Slab:
        """One slab."""
        thickness, depth, g, albedo = (drawn(n, rng) for n in (self.thickness, self.optical_depth, self.g, self.albedo))
        return self.slab(thickness, depth, g, albedo)

    def extremes(self) -> list[Slab]:
        """Slabs at the ends of every range: where a claim about all media is tested."""
        ranges = [sorted(set(ends(n))) for n in (self.thickness, self.optical_depth, self.g)]
        albedo = ends(self.albedo)[1]
        return [self.slab(t, d, g, albedo) for t in ranges[0] for d in ranges[1] for g in ranges[2]]

    @staticmethod
    def slab(thickness: float, optical_depth: float, g: float, albedo: float) -> Slab:
        """Slab of the engine."""
        return Slab(
            thickness=thickness,
            mean_free_path=thickness / optical_depth,
            albedo=albedo,
            scatterer=HenyeyGreenstein(g=g),
        )


@dataclass(frozen=True)
class KnownMaterial:
    """A slab with its memory-effect kernel and what follows from it.

    Attributes
    ----------
    slab : Slab
    kernel : MemoryKernel
    half_range : float
        Lateral wavevector difference at which C_I is half way to its floor, per unit length; inf where there is none.
    """

    slab: Slab
    kernel: MemoryKernel
    half_range: float

    def range_sine(self, wavelength: float) -> float:
        """Sine of the memory-effect range; inf where there is none."""
        return self.half_range * wavelength / (2 * np.pi)

    def parameters(self, wavelength: float) -> dict[str, float]:
        """What is stored with every sample: the material, and what it does to light."""
        slab = self.slab
        sine = self.range_sine(wavelength)
        return {
            "wavelength": wavelength,
            "thickness": slab.thickness,
            "mean_free_path": slab.mean_free_path,
            "optical_depth": slab.optical_depth,
            "g": slab.scatterer.g,
            "albedo": slab.albedo,
            "ballistic_fraction": float(np.exp(-slab.optical_depth)),
            "single_share": self.kernel.single_share,
            "memory_effect_range": float(np.arcsin(min(sine, 1.0))) if np.isfinite(sine) else np.inf,
        }


@lru_cache(maxsize=256)
def known(slab: Slab, paths: int, source: KernelSource = "estimate") -> KnownMaterial:
    """Find a slab's kernel. It is a property of the material: its paths are keyed by the slab, not by a seed."""
    if source == "atlas":
        kernel = kernel_for(slab, paths=paths)
    else:
        kernel = estimate_kernel(slab, paths, pilot_seed(slab.fingerprint()))
    return KnownMaterial(slab, kernel, kernel.half_range())
