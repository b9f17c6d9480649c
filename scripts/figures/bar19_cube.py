"""Figure 13 of [Bar19]: the memory effect of a cube, single and multiple scattering apart.

Draws bar19-figure-13.png and prints row A14 of docs/notes/validation.md: a cube of 100 wavelengths, optical depth 5,
isotropic scatterers, forward paths only.

Run it by itself: python scripts/figures/bar19_cube.py --out docs/images [--quick]
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _bar19 import OUT, Row, clock, report, save
from _command import run

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.theory.single_scattering import box_covariance

KM = dict(zip((1, 2, 4, 6, 8, 10, 12, 20), (0.967, 0.876, 0.606, 0.369, 0.238, 0.173, 0.132, 0.067), strict=True))
CUBE = sg.media.Box(lower=(-50.0,) * 3, upper=(50.0,) * 3, mean_free_path=20.0, scatterer=sg.media.Isotropic())
BATCHES = 16


def turned(sines: np.ndarray) -> np.ndarray:
    """Directions in the x-z plane."""
    return np.stack([sines, 0 * sines, np.sqrt(1 - sines**2)], axis=-1)


def cube_scene(lights: np.ndarray, views: np.ndarray) -> sg.Scene:
    """Plane waves on the cube."""
    return sg.Scene(wavelength=1.0, medium=CUBE, illumination=sg.light.PlaneWaves(directions=lights),
                    sensor=sg.sensors.FarField(directions=views))  # fmt: skip


def cube_batches(scene: sg.Scene, pairs: np.ndarray, paths: int) -> np.ndarray:
    """Single and multiple parts of chosen entries, complex[B, 2, P], forward paths."""
    found = [sg.statistics.covariance(scene, paths=paths // BATCHES, seed=seed, reverse=False, pairs=pairs, threads=1)
             for seed in range(BATCHES)]  # fmt: skip
    return np.array([(f.single, f.multiple) for f in found])


def draw_cube(out: Path, paths: int) -> list[Row]:
    """Figure 13: views moved along with the tilt, and views that stand still."""
    q = np.array([0, *KM, 50, 100], dtype=float)
    n = np.arange(len(q))
    rays = turned(q / (2 * np.pi * 100))
    pairs = np.concatenate([np.stack([0 * n, 0 * n, n, n], 1), np.stack([n, n, n, n], 1)])
    with clock() as spent:
        sums = cube_batches(cube_scene(rays, rays), pairs, paths)

    def correlation(total, part=1):
        value = total[part].real if part < 2 else total.sum(axis=0).real
        return value[: len(q)] / np.sqrt(value[0] * value[len(q) :])

    km, error = jackknife(sums, correlation)
    both, _ = jackknife(sums, lambda total: correlation(total, 2))
    share, share_error = jackknife(sums, lambda total: total[0, 0].real / total[:, 0].sum().real)

    sines = np.linspace(0, 0.03, 13)
    lights, views = turned(sines), turned(np.zeros(1))
    m, zero = np.arange(len(sines)), np.zeros(len(sines), int)
    with clock() as still:
        fixed = cube_batches(cube_scene(lights, views), np.stack([zero, zero, m, zero], 1), paths // 4)
    exact = box_covariance(
        CUBE.lower, CUBE.upper, extinction=1 / 20, wavelength=1.0,
        amplitude=lambda cos: np.full(cos.shape, 1 / np.sqrt(4 * np.pi)),
        lights=(lights[:1], lights), views=(views, views),
    )  # fmt: skip
    single = fixed[:, 0].mean(axis=0)
    single_error = np.sqrt(np.square(np.abs(fixed[:, 0] - single)).sum(axis=0) / (BATCHES * (BATCHES - 1)))

    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.4), layout="constrained")
    left.errorbar(q, km, error, fmt="oC0", label="multiple scattering, ± se")
    left.plot(list(KM), list(KM.values()), "_k", ms=14, label="reference")
    left.plot(q, both, "C3s", ms=4, label="single and multiple together")
    tail = np.geomspace(8, 100)
    left.plot(tail, 1.1 / tail, "k:", lw=1, label="1.1/q")
    left.set(xlabel="q", ylabel="K", xscale="symlog", ylim=(0, 1.05),
             title=f"views move with the tilt, OD 5, {spent.seconds:.0f} s CPU")  # fmt: skip
    right.plot(sines * 100, np.abs(exact) / exact[0].real, "k", lw=1, label="single: Eq. 41")
    right.errorbar(sines * 100, np.abs(single) / exact[0].real, single_error / exact[0].real, fmt="oC0", label="single")
    multiple = fixed[:, 1].mean(axis=0)
    right.plot(sines * 100, np.abs(multiple) / multiple[0].real, "sC3", ms=4, label="multiple")
    right.set(xlabel="tilt × W/λ", ylabel="|C|, normalised", title="views stand still: gone within λ/W")
    for axis in (left, right):
        axis.legend(fontsize=8)
    save(figure, out / "bar19-figure-13.png", 72)

    chosen, expected = slice(1, 1 + len(KM)), np.array(list(KM.values()))
    gap = km[chosen] - expected
    z = np.abs(single - exact) / single_error
    return [
        Row("A14", "K_M at q = 1 2 4 6 8 10 12 20", " ".join(f"{v:.3f}" for v in km[chosen]), "± .005 of the reference",
            f"largest gap {np.abs(gap).max():.4f}, se ≤ {error[chosen].max():.4f}, z ≤ "
            f"{np.abs(gap / error[chosen]).max():.1f}", spent.seconds),
        Row("A14", "q = 0: single/(single + multiple)", f"{share:.4f} ± {share_error:.4f}", ".117",
            f"z {(share - 0.117) / share_error:+.1f} (table rounded to ±.0005)", spent.seconds),
        Row("A14", "tail: q K_M at q = 20, 50, 100", " ".join(f"{q[i] * km[i]:.2f} ± {q[i] * error[i]:.2f}" for i in
            (-3, -2, -1)), "≈ 1.1", "", spent.seconds),
        Row("A14", "views stand still: single part against Eq. 41, 13 tilts", f"largest gap over C(0) "
            f"{np.abs(single - exact).max() / exact[0].real:.4f}", "0", f"largest z {z.max():.1f}", still.seconds),
    ]  # fmt: skip


def main(out: Path, quick: bool) -> None:
    """Draw, and print rows; ``quick`` takes few paths."""
    cube_batches(cube_scene(turned(np.zeros(1)), turned(np.zeros(1))), np.zeros((1, 4), int), 64)  # compiles
    report(draw_cube(out, 3_200 if quick else 640_000), "bar19_cube")


if __name__ == "__main__":
    run(main, OUT, __doc__)
