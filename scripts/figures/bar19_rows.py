"""Rows of docs/notes/validation.md without a figure of the paper: A01, A02, A17, A18, A19.

Prints them, and draws bar19-rows.png: z-scores of A01 and A18, and the spectrum of a covariance.

Run it by itself: python scripts/figures/bar19_rows.py --out docs/images [--quick]
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _bar19 import LIGHTS, OUT, Row, clock, diagonal_pairs, flatland_box, flatland_scene, report, save
from _command import run

import specklegen as sg
from specklegen.theory.single_scattering import box_covariance

FAINT = 1e-9  # an albedo at which multiple scattering is gone: C over it is single scattering alone


def single_scattering(paths: int) -> tuple[Row, np.ndarray]:
    """A01: 20 random quadruples against Eq. 41."""
    rng = np.random.default_rng(1)
    lights, views = rng.uniform(-80, 80, 4), rng.uniform(0, 360, 10)
    box = flatland_box(10.0, 10.0).replace(albedo=FAINT)
    quadruples = np.stack([rng.integers(n, size=20) for n in (4, 10, 4, 10)], axis=1)
    scene = flatland_scene(box, views, lights)
    with clock() as spent:
        found = sg.statistics.covariance(scene, paths=paths, pairs=quadruples, orders="all", reverse=False, threads=1)

    def directions(degrees):
        return np.stack([np.sin(np.deg2rad(degrees)), np.cos(np.deg2rad(degrees))], axis=-1)

    def exact(one, two):
        return box_covariance(
            box.lower, box.upper, extinction=0.1, wavelength=1.0,
            amplitude=lambda cos: np.full(cos.shape, (2 * np.pi) ** -0.5),
            lights=(directions(lights[quadruples[:, one]]), directions(lights[quadruples[:, two]])),
            views=(directions(views[quadruples[:, one + 1]]), directions(views[quadruples[:, two + 1]])),
        )  # fmt: skip

    gap = np.abs(found.value / FAINT - exact(0, 2))
    z = gap / (found.standard_error / FAINT)
    assert np.isfinite(z).all(), "a figure without an error validates nothing"
    share = (gap / np.sqrt(exact(0, 0).real * exact(2, 2).real)).max()
    row = Row("A01", f"B = 1 against Eq. 41, 20 random quadruples, {paths} paths", f"largest |Δ|/√(C₁₁C₂₂) {share:.1e}",
              "< 1e-3", f"largest z {z.max():.1f}, rms {np.sqrt(np.mean(z**2)):.2f}", spent.seconds)  # fmt: skip
    return row, z


def energy(paths: int) -> Row:
    """A02: total over 2 pi against the exact anchors, forward paths, albedo 1."""
    scene = flatland_scene(flatland_box(10.0, 10.0), np.arange(0.0, 360.0, 5.0))
    pairs = diagonal_pairs(4, 72)
    with clock() as spent:
        totals = np.array([
            sg.statistics.covariance(scene, paths=paths // 64, seed=seed, pairs=pairs, reverse=False, threads=1)
            .value.real.reshape(4, 72).mean(axis=1) for seed in range(64)
        ]) * 2 * np.pi  # fmt: skip
    mean, error = totals.mean(axis=0), totals.std(axis=0, ddof=1) / 8
    anchors = np.array([17.293, 17.386, 17.643, 18.549])
    return Row("A02", f"energy in 2D, lights {LIGHTS}: ∫ I dv", " ".join(f"{m:.3f} ± {e:.3f}" for m, e in
               zip(mean, error, strict=True)), " ".join(f"{a}" for a in anchors),
               "z " + " ".join(f"{z:+.1f}" for z in (mean - anchors) / error), spent.seconds)  # fmt: skip


def mixtures(paths: int) -> list[Row]:
    """A17: a kind split into itself, and a kind without a share."""
    kind, other = sg.media.HenyeyGreenstein(g=0.5), sg.media.Isotropic()
    variants = [kind, sg.media.Mixture(types=(kind, kind), fractions=(0.3, 0.7)),
                sg.media.Mixture(types=(kind, other), fractions=(1.0, 0.0)),
                sg.media.Mixture(types=(kind,), fractions=(1.0,))]
    scenes = (flatland_scene(flatland_box(10.0, 10.0, each), np.arange(0.0, 360, 20), LIGHTS[::3]) for each in variants)
    with clock() as spent:
        whole, split, zero, alone = (
            sg.statistics.covariance(scene, paths=paths, seed=seed, reverse=True, threads=1)
            for seed, scene in zip((0, 1, 2, 2), scenes, strict=True)
        )
    z = np.abs(whole.value - split.value) / np.hypot(whole.standard_error, split.standard_error)
    same = np.array_equal(zero.value, alone.value)
    return [
        Row("A17", f"a kind split 30/70 into itself: all {z.size} entries", "against itself", "equal",
            f"largest z {z.max():.1f}, rms {np.sqrt(np.mean(z**2)):.2f}", spent.seconds),
        Row("A17", "a kind of share 0", "the same bits" if same else "**other bits**", "the same bits", "",
            spent.seconds),
    ]  # fmt: skip


def voxels(paths: int) -> tuple[Row, np.ndarray]:
    """A18: a grid of equal voxels is a box."""
    box = flatland_box(10.0, 10.0)
    grid = sg.media.VoxelGrid(lower=box.lower, upper=box.upper, extinction=np.full((5, 4), 0.1),
                              scatterers=(sg.media.Isotropic(),))
    scenes = (flatland_scene(box, np.arange(0.0, 360, 20), LIGHTS[::3]).replace(medium=m) for m in (box, grid))
    with clock() as spent:
        one, many = (sg.statistics.covariance(s, paths=paths, seed=n, reverse=True, threads=1)
                     for n, s in enumerate(scenes))
    z = np.abs(one.value - many.value) / np.hypot(one.standard_error, many.standard_error)
    row = Row("A18", f"5 x 4 equal voxels against a box, all {z.size} entries", "against the box", "equal",
              f"largest z {z.max():.1f}, rms {np.sqrt(np.mean(z**2)):.2f}", spent.seconds)  # fmt: skip
    return row, z


def properties(paths: int) -> tuple[list[Row], np.ndarray]:
    """A19: Hermitian, positive semidefinite, reciprocal, and reproduced by its eigenvectors."""
    lights, views, n = np.array([0.0, 4.0, 4.0]), np.arange(0.0, 360.0, 20.0), 2000  # one light twice
    box = flatland_box(10.0, 10.0)
    with clock() as spent:
        found = sg.statistics.covariance(flatland_scene(box, views, lights), paths=paths, reverse=True, threads=1)
        swapped = sg.statistics.covariance(
            sg.Scene(wavelength=1.0, medium=box,
                     illumination=sg.light.PlaneWaves(directions=-sg.sensors.FarField.angles(np.deg2rad(views)).directions),
                     sensor=sg.sensors.FarField.angles(np.deg2rad(lights + 180))), paths=paths, seed=1, reverse=True,
                     threads=1,
        )  # fmt: skip
        fields = found.sample(n).reshape(n, -1)
    matrix = found.value.reshape(fields.shape[1], -1)
    spectrum = np.linalg.eigvalsh(matrix)
    other, error = (np.transpose(a, (1, 0, 3, 2)) for a in (swapped.value, swapped.standard_error))
    z = np.abs(found.value - other) / np.hypot(found.standard_error, error)
    distance = np.linalg.norm(fields.T @ fields.conj() / n - matrix) / np.trace(matrix).real * n**0.5
    pairs = fields.reshape(n, 3, -1)
    twins = np.abs(pairs[:, 1] - pairs[:, 2]).max() / np.abs(fields).max()
    rows = [
        Row("A19", "Hermitian; smallest eigenvalue over the largest (one light twice)",
            f"{np.abs(matrix - matrix.conj().T).max():.0e}; {spectrum[0] / spectrum[-1]:+.1e}", "0; ≥ −1e-12", "",
            spent.seconds),
        Row("A19", f"reciprocity: lights and views exchanged, {z.size} entries", "against itself", "equal",
            f"largest z {z.max():.1f}, rms {np.sqrt(np.mean(z**2)):.2f}", spent.seconds),
        Row("A19", f"{n} eigen-sampled fields: ‖Ĉ−C‖_F √n/tr C; twin lights differ by", f"{distance:.3f}; {twins:.0e}",
            "1; 0", "", spent.seconds),
    ]  # fmt: skip
    return rows, spectrum


def main(out: Path, quick: bool) -> None:
    """Draw, and print rows; ``quick`` takes few paths."""
    paths = 3200 if quick else 64_000
    sg.statistics.covariance(flatland_scene(flatland_box(10.0, 10.0), np.zeros(1)), paths=64, threads=1)  # compiles
    first, z_single = single_scattering(20_000 if quick else 3_000_000)
    same, z_voxels = voxels(paths)
    rows, spectrum = properties(paths)
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14, 3.8), layout="constrained")
    left.plot(np.sort(z_single), "o")
    left.set(title="A01: z of 20 quadruples against Eq. 41", ylim=(0, 4))
    grid = np.linspace(0, 4)
    middle.hist(z_voxels.ravel(), np.linspace(0, 4, 40), density=True, label="voxels against a box")
    middle.plot(grid, 2 * grid * np.exp(-(grid**2)), "k", label=r"noise: $2z\,e^{-z^2}$")
    middle.set(title="A18: z of all entries", xlabel="|z|")
    middle.legend(fontsize=8)
    right.semilogy(np.abs(spectrum[::-1]) / spectrum[-1], ".")
    right.set(title="A19: eigenvalues; a third are 0, one light twice", xlabel="number")
    save(figure, out / "bar19-rows.png", 66)
    report([first, energy(paths), *mixtures(paths), same, *rows], "bar19_rows")


if __name__ == "__main__":
    run(main, OUT, __doc__)
