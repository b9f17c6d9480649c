"""Synthetic benches of four materials, whose curves come from paths or from the tables that a fit reads."""

from typing import NamedTuple

import numpy as np

import specklegen as sg
from specklegen.measured import MemoryCurve, Transmittance
from specklegen.memory_effects.correlation import estimate_correlation

WAVELENGTH, THICKNESS = 0.5, 1000.0
FREE = ("thickness", "mean_free_path", "g")
MATERIALS = {"OD 5, g .9": (5.0, 0.9, 1.0), "OD 10, g .9": (10.0, 0.9, 1.0), "OD 3, g .6, albedo .99": (3.0, 0.6, 0.99),
             "OD 20, g .8": (20.0, 0.8, 1.0)}  # fmt: skip


class Bench(NamedTuple):
    """A slab, its tilts float64[25], and what is exact: C_I float64[25] and the transmittance."""

    slab: sg.Slab
    tilts: np.ndarray
    c_i: np.ndarray
    transmittance: float

    def measured(self, rng: np.random.Generator, sphere: bool = True, error: float = 0.01) -> list:
        """Noisy observations, with the transmittance if it was measured too."""
        curve = MemoryCurve(self.tilts, self.c_i + error * rng.normal(size=len(self.tilts)), error)
        light = self.transmittance * (1 + 0.02 * rng.normal())
        return [curve, Transmittance(light, 0.02 * self.transmittance)] if sphere else [curve]


def bench_of(slab: sg.Slab, paths: int) -> Bench:
    """A bench of a slab, by paths."""
    correlation = estimate_correlation(slab, paths, seed=11)
    tilts = np.arcsin(correlation.half_range() * np.arange(1, 26) * (3 / 25) * WAVELENGTH / (2 * np.pi))
    light = sg.reflectance_transmittance(slab, paths=paths, seed=2)
    c_i = correlation.intensity(2 * np.pi / WAVELENGTH * np.sin(tilts))[0]
    return Bench(slab, tilts, c_i, light.transmittance)


def slab_of(depth: float, g: float, albedo: float = 1.0) -> sg.Slab:
    """A slab of Henyey-Greenstein scatterers."""
    return sg.Slab(thickness=THICKNESS, mean_free_path=THICKNESS / depth, albedo=albedo,
                   scatterer=sg.HenyeyGreenstein(g))  # fmt: skip


def fitted(bench: Bench, observations: list, free: tuple[str, ...] = FREE) -> sg.MaterialFit:
    """Fit one bench; what is not free is known."""
    slab = bench.slab
    known = {"thickness": slab.thickness, "mean_free_path": slab.mean_free_path, "g": slab.scatterer.mean_cosine()}
    known = {name: value for name, value in known.items() if name not in free} | {"albedo": slab.albedo}
    return sg.fit_material(observations, wavelength=WAVELENGTH, known=known, free=free)
