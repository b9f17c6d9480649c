"""Figure 7 of [Bar19]: coherent backscattering of a box in flatland, in the far field and on a circle around it.

Draws bar19-figure-7.png and prints row A08 of docs/notes/validation.md. The box is 100 x 100 wavelengths, its mean free
path 50; the circle has a diameter of 200 wavelengths and carries the source as well.

Run it by itself: python scripts/figures/bar19_backscattering.py --out docs/images [--quick]
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _bar19 import OUT, Row, clock, diagonal_pairs, flatland_box, flatland_scene, report, save
from _command import run

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.oracles import box_algorithms
from specklegen.oracles.box_media import box, henyey_greenstein

BOX = flatland_box(50.0, 50.0)
KL = 2 * np.pi * 50.0  # wavenumber times mean free path
WING = 0.43  # excess times kl|i + v|, physics.md 2
WINGS = (5, 10), (10, 20), (20, 39)
OFFSETS = np.concatenate([np.linspace(0, 0.6, 9), np.linspace(0.8, 8, 19), np.arange(20.0, 181.0, 20)])  # degrees
X = KL * 2 * np.sin(np.deg2rad(OFFSETS) / 2)
BATCHES = 16
RADIUS = 100.0


def far_scene() -> sg.Scene:
    """A plane wave, seen at angles from exact backscattering."""
    return flatland_scene(BOX, 180 - OFFSETS, (0.0,))


def ring(offsets: np.ndarray) -> np.ndarray:
    """Points of the circle at angles from the source, degrees."""
    angles = np.deg2rad(offsets)
    return RADIUS * np.stack([np.sin(angles), -np.cos(angles)], axis=-1)


def near_scene(offsets: np.ndarray) -> sg.Scene:
    """A point source on the circle, seen from points of the circle."""
    return sg.Scene(
        wavelength=1.0,
        medium=BOX,
        illumination=sg.light.PointSources(points=ring(np.zeros(1))),
        sensor=sg.sensors.NearField(points=ring(offsets)),
    )


def two_ways(scene: sg.Scene, paths: int) -> np.ndarray:
    """Single and multiple intensities without and with reversed paths, batches float64[B, 2, 2, V]."""
    pairs = diagonal_pairs(1, len(scene.views))
    batches = []
    for seed in range(BATCHES):
        found = [
            sg.statistics.covariance(scene, paths=paths // BATCHES, seed=seed, reverse=reverse, pairs=pairs, threads=1)
            for reverse in (False, True)
        ]
        batches.append([(f.single.real, f.multiple.real) for f in found])
    return np.array(batches)


def ratio(sums: np.ndarray) -> np.ndarray:
    """Intensity with reversed paths over that without."""
    return sums[1].sum(axis=0) / sums[0].sum(axis=0)


def law(sums: np.ndarray) -> np.ndarray:
    """(S + 2M) / (S + M) where v = -i, the first view."""
    s, m = sums[0, :, 0]
    return (s + 2 * m) / (s + m)


def wing(sums: np.ndarray) -> np.ndarray:
    """Excess times kl|i + v|, averaged over each of the ranges ``WINGS``."""
    excess = (ratio(sums) - 1) * X
    return np.array([excess[(X >= low) & (X < high)].mean() for low, high in WINGS])


def literal(offsets: np.ndarray, paths: int) -> tuple[np.ndarray, np.ndarray]:
    """Intensities on the circle with reversed paths by the transcribed algorithm, and their errors."""
    matter = box((-50, -50), (50, 50), extinction=1 / 50, particles=(henyey_greenstein(0.0, 2),))
    setup = box_algorithms.Setup(
        matter, 1.0, box_algorithms.Near(ring(np.zeros(1))), box_algorithms.Near(ring(offsets))
    )
    rng = np.random.default_rng(0)
    batches = [box_algorithms.intensity(setup, paths // 64, rng, reverse=True).sum(axis=0) for _ in range(64)]
    return np.mean(batches, axis=0), np.std(batches, axis=0, ddof=1) / 8


def main(out: Path, quick: bool) -> None:
    """Draw, and print rows; ``quick`` takes few paths."""
    far_paths, near_paths, slow_paths = (6_400, 3_200, 6_400) if quick else (160_000, 48_000, 96_000)
    with clock() as far_time:
        far = two_ways(far_scene(), far_paths)
    value, error = jackknife(far, ratio)
    coefficient, coefficient_error = jackknife(far, wing)

    offsets = np.concatenate([np.linspace(0, 1.2, 13), np.linspace(2, 8, 7), np.arange(20.0, 181.0, 20)])
    with clock() as near_time:
        around = two_ways(near_scene(offsets), near_paths)
    near, near_error = jackknife(around, ratio)
    near_law, near_law_error = jackknife(around, law)
    few = [0, 2, 4, 12, 16, 20, 24]
    with clock() as literal_time:
        slow, slow_error = literal(offsets[few], slow_paths)
    samples = around[:, 1].sum(axis=1)[:, few]
    fast, fast_error = samples.mean(axis=0), samples.std(axis=0, ddof=1) / np.sqrt(BATCHES)
    z = (fast - slow) / np.hypot(fast_error, slow_error)

    figure, axes = plt.subplots(2, 2, figsize=(12, 7.6), layout="constrained")
    for axis, angle, sums in ((axes[0, 0], OFFSETS, far), (axes[1, 0], offsets, around)):
        for intensity, colour, name in zip(
            sums.mean(axis=0).sum(axis=1), ("C0", "C3"), ("forward paths only", "with reversed paths"), strict=True
        ):
            axis.semilogy(angle, intensity, f"{colour}.-", lw=1, ms=4, label=name)
        axis.set(xlabel="angle from backscattering (°), linear below 1°")
        axis.set_xscale("symlog", linthresh=1)
        axis.set_xlim(0, 180)
    axes[0, 0].set(title=f"far field, plane wave: intensity, {far_time.seconds:.0f} s CPU", ylabel="length per radian")
    axes[1, 0].set(title=f"circle of diameter 200 λ with the source, {near_time.seconds:.0f} s CPU")
    axes[1, 0].errorbar(offsets[few], slow, slow_error, fmt="ok", ms=5, mfc="none",
                        label=f"literal Algorithm 3, {literal_time.seconds:.0f} s CPU")  # fmt: skip
    axes[0, 1].errorbar(X, value, error, fmt=".", label="with over without reversed paths, ± se")
    axes[0, 1].axhline(1.502, color="k", lw=1, ls="--", label="(S+2M)/(S+M) = 1.502")
    beyond = np.geomspace(4, 60)
    axes[0, 1].plot(beyond, 1 + WING / beyond, "C3", lw=1, label=r"$1 + 0.43/(k\ell|i+v|)$")
    axes[0, 1].set(xscale="symlog", xlim=(0, 630), xlabel=r"$k\ell\,|i+v|$, linear below 2", title="far field: ratio")
    axes[1, 1].errorbar(offsets, near, near_error, fmt=".", label="with over without reversed paths, ± se")
    axes[1, 1].axhline(near_law, color="k", lw=1, ls="--", label=f"(S+2M)/(S+M) = {near_law:.3f}")
    axes[1, 1].set(xlabel="angle of the sensor from the source (°)", xlim=(0, 8), title="circle: ratio")
    for axis in axes.flat:
        axis.legend(fontsize=8)
        if axis in axes[:, 1]:
            axis.axhline(1, color="0.7", lw=1)
    save(figure, out / "bar19-figure-7.png", 72)

    off = OFFSETS > 5
    worst = np.abs(value - 1)[off]
    report([
        Row("A08", "far field, v = −i: ratio", f"{value[0]:.4f} ± {error[0]:.4f}", "1.502 ± .003",
            f"z {(value[0] - 1.502) / error[0]:+.1f}", far_time.seconds),
        Row("A08", "wing: excess × kℓ|i+v| over 5 … 10, 10 … 20, 20 … 39",
            " ".join(f"{c:.3f} ± {e:.3f}" for c, e in zip(coefficient, coefficient_error, strict=True)), "0.43",
            "z " + " ".join(f"{z:+.1f}" for z in (coefficient - WING) / coefficient_error), far_time.seconds),
        Row("A08", "far from it (beyond 5°): largest |ratio − 1|", f"{worst.max():.4f}",
            f"wing ≤ {WING / X[off].min():.4f}", f"noise {error[off].max():.4f}", far_time.seconds),
        Row("A08", "circle, sensor at the source: ratio", f"{near[0]:.4f} ± {near_error[0]:.4f}",
            f"(S+2M)/(S+M) = {near_law:.4f} ± {near_law_error:.4f}", "5 %", near_time.seconds),
        Row("A08", "circle, 7 sensors: engine over the literal Algorithm 3", " ".join(f"{v:.3f}" for v in fast / slow),
            "1 ± 5 %", "z " + " ".join(f"{v:+.1f}" for v in z), near_time.seconds + literal_time.seconds),
    ], "bar19_backscattering")  # fmt: skip


if __name__ == "__main__":
    run(main, OUT, __doc__)
