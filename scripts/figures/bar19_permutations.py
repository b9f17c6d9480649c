"""Figures 14 and 15 of [Bar19]: every order in which a wave can visit three nodes.

Draws bar19-figure-14.png and prints row A16 of docs/notes/validation.md: a box of 20 x 20 wavelengths in flatland, of
optical depth 2, isotropic scatterers, light along the axis.

Run it by itself: python scripts/figures/bar19_permutations.py --out docs/images [--quick]
"""

from itertools import permutations
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _bar19 import OUT, Row, clock, report, save
from _command import run
from references.path_permutations import permutation_covariance

from specklegen.oracles.box_media import box, henyey_greenstein

AXIS = np.array([0.0, 1.0])
VIEWS = np.concatenate([np.arange(0.0, 166.0, 15.0), np.arange(170.0, 180.1)])
NAMES = ["→".join(str(n + 1) for n in order) for order in permutations(range(3))]
SQUARE = box((-10.0, -10.0), (10.0, 10.0), extinction=0.1, particles=(henyey_greenstein(0.0, 2),))
BATCHES = 64


def shares(paths: int, apart: float) -> tuple[np.ndarray, np.ndarray]:
    """Contributions of the six orders over the forward one's, float64[6, V], and their errors."""
    angles = np.deg2rad(VIEWS)
    views = np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    found = np.array([
        permutation_covariance(SQUARE, 1.0, (AXIS, AXIS), (views, views), paths // BATCHES,
                               np.random.default_rng(seed), apart=apart).real
        for seed in np.random.SeedSequence(1).spawn(BATCHES)
    ])  # fmt: skip
    found = found / found[:, 0].mean(axis=0)
    return found.mean(axis=0), found.std(axis=0, ddof=1) / np.sqrt(BATCHES)


def main(out: Path, quick: bool) -> None:
    """Draw, and print rows; ``quick`` takes few sets of nodes."""
    figure, axes = plt.subplots(1, 3, figsize=(15, 4.2), layout="constrained")
    rows = []
    chosen = {0.0: "nodes anywhere in the box", 2.0: "nodes at least 2 λ apart"}
    for n, (apart, name) in enumerate(chosen.items()):
        with clock() as spent:
            share, error = shares(32_000 if quick else 384_000, apart)
        for order, label in enumerate(NAMES):
            style = {"lw": 2, "color": "k"} if order == 0 else {"lw": 2, "color": "C3"} if order == 5 else {"lw": 1}
            axes[n].plot(VIEWS, share[order], label=label, **style)
            if apart == 0:
                close = VIEWS >= 170
                axes[2].plot(VIEWS[close], share[order][close], label=label, **style)
        axes[n].set(title=f"{name}, {spent.seconds:.0f} s CPU", xlabel="view (°)", ylabel="over the forward path's")
        axes[n].axvline(180, color="0.8", lw=1)
        others = share[1:5]
        side = np.isin(VIEWS, (0.0, 90.0))
        largest = np.unravel_index(np.abs(others[:, side]).argmax(), others[:, side].shape)
        rows += [
            Row("A16", f"{name}: reverse path at v = −i", f"{share[5, -1]:.6f}", "1 (equals the forward one)",
                "rounding", spent.seconds),
            Row("A16", f"{name}: reverse path at 0°, 90°", " ".join(f"{v:+.4f} ± {e:.4f}" for v, e in
                zip(share[5, side], error[5, side], strict=True)), "≤ 1e-2", "", spent.seconds),
            Row("A16", f"{name}: largest of the other four at 0°, 90°",
                f"{others[:, side][largest]:+.4f} ± {error[1:5][:, side][largest]:.4f}",
                "≤ 1e-2" if apart else "≤ 1e-2 (**missed**)", "", spent.seconds),
            Row("A16", f"{name}: largest of the other four at 180°", f"{np.abs(others[:, -1]).max():.4f} ± "
                f"{error[1:5, -1].max():.4f}", "—", "", spent.seconds),
        ]  # fmt: skip
    axes[2].set(title="the same, near backscattering, nodes anywhere", xlabel="view (°)")
    axes[0].legend(fontsize=8, title="order of nodes")
    save(figure, out / "bar19-figure-14.png", 66)
    report(rows, "bar19_permutations")


if __name__ == "__main__":
    run(main, OUT, __doc__)
