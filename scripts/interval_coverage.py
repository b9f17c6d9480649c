"""How often 1.96 standard errors of a memory-effect curve hold the truth: many seeds a slab, the hard ones among them.

    python scripts/interval_coverage.py --seeds 400 --paths 20000
    python scripts/interval_coverage.py --only "OD 20, g 0.9, albedo 0.9"

The truth is the mean over all seeds, whose own error is one in the root of their number; light that is singly scattered
is no random number and out of it. Wilson's interval of 95 % stands beside the least coverage over the tilts.
"""

import argparse
import time
import warnings

import numpy as np
from scipy.stats import binomtest

import specklegen as sg

FACES = sg.Faces(inside=1.4)
WAVELENGTH, THICKNESS = 0.01, 100.0
SLABS = {
    "OD 10, g 0.9": (10.0, 0.9, 1.0, None),
    "OD 20, g 0.9, albedo 0.95": (20.0, 0.9, 0.95, None),
    "OD 20, g 0.9, albedo 0.9": (20.0, 0.9, 0.9, None),
    "OD 20, g 0.9, albedo 0.5": (20.0, 0.9, 0.5, None),
    "OD 40, g 0, albedo 0.9": (40.0, 0.0, 0.9, None),
    "OD 30, g 0.9, albedo 0.99, faces": (30.0, 0.9, 0.99, FACES),
    "OD 30, g 0.9, albedo 0.98, faces": (30.0, 0.9, 0.98, FACES),
    "OD 30, g 0.9, albedo 0.95, faces": (30.0, 0.9, 0.95, FACES),
}
"""Optical depth, g, albedo and faces."""
TILTS = np.arcsin(np.array([0.3, 1.0, 2.0, 4.0, 8.0, 16.0]) * WAVELENGTH / (2 * np.pi * THICKNESS))
"""Of q = k sin(tilt) L from where all is correlated to where next to nothing is."""


def slab_of(depth: float, g: float, albedo: float, faces: sg.Faces | None) -> sg.Slab:
    """Make one of the slabs."""
    scatterer = sg.HenyeyGreenstein(g) if g else sg.Isotropic()
    return sg.Slab(thickness=THICKNESS, mean_free_path=THICKNESS / depth, albedo=albedo, scatterer=scatterer,
                   faces=faces or sg.Faces())  # fmt: skip


def curves(slab: sg.Slab, paths: int, seeds: int) -> tuple[np.ndarray, np.ndarray]:
    """C_I and standard errors float64[seeds, tilts]."""
    found = [sg.memory_effect(slab, wavelength=WAVELENGTH, tilts=TILTS, paths=paths, seed=s) for s in range(seeds)]
    return np.array([curve.intensity for curve in found]), np.array([curve.standard_error for curve in found])


def held(values: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Seeds float64[tilts] whose 1.96 standard errors hold the mean of all."""
    return (np.abs(values - values.mean(axis=0)) <= 1.96 * errors).sum(axis=0)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=400)
    parser.add_argument("--paths", type=int, default=20_000)
    parser.add_argument("--only", choices=SLABS)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", sg.DoubtWarning)
    print("| slab | coverage at each tilt | least, Wilson's 95 % | stated over true error, median | CPU seconds |")
    print("|---|---|---|---|---|")
    for name in [arguments.only] if arguments.only else SLABS:
        started = time.process_time()
        values, errors = curves(slab_of(*SLABS[name]), arguments.paths, arguments.seeds)
        counts, stated = held(values, errors), np.median(errors, axis=0) / values.std(axis=0)
        low, high = binomtest(int(counts.min()), arguments.seeds).proportion_ci(method="wilson")
        took = time.process_time() - started
        shares, ratios = (" ".join(format(x, form) for x in row)
                          for row, form in ((counts / arguments.seeds, ".3f"), (stated, ".2f")))  # fmt: skip
        least = f"{counts.min() / arguments.seeds:.3f} ({low:.3f} to {high:.3f})"
        print(f"| {name} | {shares} | {least} | {ratios} | {took:.1f} |", flush=True)


if __name__ == "__main__":
    main()
