"""Make the example measurements of docs/data: four simulated benches, and what they are, in a second file.

The truth is in base 64, lest it be read by accident: ``python -m base64 -d docs/data/truth.b64``.

    python scripts/example_benches.py --out docs/data
"""

import argparse
import base64
import json
from pathlib import Path

import numpy as np

import specklegen as sg
from specklegen.memory_effects.correlation import estimate_correlation

WAVELENGTH = 0.5
SEED = 32


def main() -> None:
    """Write the files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--paths", type=int, default=400_000)
    arguments = parser.parse_args()
    rng = np.random.default_rng(SEED)
    truth, shares = {}, ["bench,transmittance,error"]
    for name in "abcd":
        depth, g = np.exp(rng.uniform(np.log(2.5), np.log(15))), 1 - np.exp(rng.uniform(np.log(0.06), np.log(0.5)))
        thickness = np.exp(rng.uniform(np.log(300), np.log(3000)))
        slab = sg.Slab(thickness=thickness, mean_free_path=thickness / depth, scatterer=sg.HenyeyGreenstein(g=g))
        curve = estimate_correlation(slab, arguments.paths, seed=SEED)
        tilts = np.arcsin(curve.half_range() * np.arange(1, 26) * (3 / 25) * WAVELENGTH / (2 * np.pi))
        c_i = curve.intensity(2 * np.pi / WAVELENGTH * np.sin(tilts))[0] + 0.01 * rng.normal(size=25)
        rows = [f"{tilt:.6g},{value:.4f},0.01" for tilt, value in zip(tilts, c_i, strict=True)]
        text = "\n".join(["tilt,C_I,error", *rows, ""])
        (arguments.out / f"bench-{name}-tilts.csv").write_text(text, encoding="utf-8")
        light = sg.reflectance_transmittance(slab, paths=100_000, seed=SEED).transmittance
        shares.append(f"{name},{light * (1 + 0.02 * rng.normal()):.4f},{0.02 * light:.4f}")
        truth[name] = {"thickness": thickness, "mean_free_path": thickness / depth, "g": g, "albedo": 1.0}
    (arguments.out / "transmittances.csv").write_text("\n".join([*shares, ""]), encoding="utf-8")
    sealed = base64.encodebytes(json.dumps(truth, indent=1).encode())
    (arguments.out / "truth.b64").write_bytes(sealed)


if __name__ == "__main__":
    main()
