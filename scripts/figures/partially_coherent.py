"""Figure of partially coherent light on a scattering slab: contrast and grains against theory.

Draws contrast.png and prints the tables of docs/notes/coherence.md.

Run it by itself: python scripts/figures/partially_coherent.py --out docs/coherence [--quick]
"""

import time
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from _command import run

import specklegen as sg
from specklegen.coherence.partially_coherent import (
    effective_source_modes,
    finite_path_excess,
    gaussian_schell_object,
    render_partially_coherent,
)
from specklegen.core.statistics import jackknife
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.samplers.sampler import Sampler

OUT = Path("docs/coherence")
WAVELENGTH, PIXELS = 0.5, 48
SLAB = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(g=0.9))
MILK = sg.Slab(thickness=1000.0, mean_free_path=200.0, scatterer=sg.media.Isotropic())
RATIOS = (2, 1, 0.6, 0.4, 0.2, 0.1, 0.05)  # coherence length over half the window
PATHS: dict[Sampler, int] = {"paths": 2000, "stationary": 100_000}


def images(slab, width, length, sampler, realizations):
    """Intensities float64[R, H, W], their scene, and the CPU seconds they took."""
    scene = sg.Scene(
        wavelength=WAVELENGTH,
        medium=slab,
        illumination=sg.light.CollimatedBeams.tilts([0.0], width=width),
        sensor=sg.sensors.FarField.grid((PIXELS, PIXELS), WAVELENGTH / width / 2),
    )
    begin = time.process_time()
    stack = render_partially_coherent(
        scene, length, sampler=sampler, paths=PATHS[sampler], realizations=realizations, threads=1
    )
    source = gaussian_schell_object(WAVELENGTH, length, width)
    return stack.intensity[:, 0].astype(float), scene.replace(illumination=source), time.process_time() - begin


def autocovariance(stack, shifts):
    """Intensity covariance over the squared mean at shifts of columns, and its error."""
    products = [(stack[:, :, : PIXELS - n] * stack[:, :, n:]).mean((1, 2)) for n in shifts]
    sums = np.stack([np.ones(len(stack)), stack.mean((1, 2)), *products], axis=1)
    return jackknife(sums, lambda total: total[0] * total[2:] / total[1] ** 2 - 1)


def contrast_law(ratio, width=1000.0):
    """1 / sqrt(N_eff) of a square window; it does not depend on the width."""
    source = gaussian_schell_object(WAVELENGTH, ratio * width / 2, width)
    return effective_source_modes(source.brightness, source.pitch, WAVELENGTH, width) ** -0.5


def autocovariance_law(slab, width, length, shifts):
    """K(k d)^2 sum_jl p_j p_l W^(d - s_j + s_l)^2."""
    source = gaussian_schell_object(WAVELENGTH, length, width)
    power, s = source.brightness[source.brightness > 0], source.beams.directions[:, :2]
    correlation = estimate_correlation(slab, 100_000, 1)
    grains = (s[:, None] - s) * width / WAVELENGTH
    pairs = power[:, None] * power * np.sinc(grains[..., 1]) ** 2
    blurred = np.array([(pairs * np.sinc(n / 2 - grains[..., 0]) ** 2).sum() for n in shifts])
    return correlation(2 * np.pi / width / 2 * np.asarray(shifts)) ** 2 * blurred


def draw_contrast(panel, quick):
    """Contrast against coherence length, a window of 50 thicknesses."""
    width = 50 * SLAB.thickness
    line = np.geomspace(0.03, 4, 40)
    panel.loglog(line, [contrast_law(r) for r in line], "k", lw=1, label=r"$1/\sqrt{N_\mathrm{eff}}$")
    rows = []
    for sampler, marker in (("stationary", "o"), ("paths", "x")):
        for ratio in RATIOS if sampler == "stationary" else [r for r in RATIOS if r >= (0.4 if quick else 0.2)]:
            stack, scene, seconds = images(SLAB, width, ratio * width / 2, sampler, 16 if quick else 128)
            square, error = autocovariance(stack, [0])
            square = square[0] - (finite_path_excess(scene, PATHS[sampler], threads=1) if sampler == "paths" else 0)
            contrast, error = square**0.5, error[0] / 2 / square**0.5
            law = contrast_law(ratio)
            first = ratio == RATIOS[0]
            panel.errorbar(
                ratio, contrast, error, fmt=marker, color={"stationary": "C0", "paths": "C3"}[sampler],
                fillstyle="none", capsize=3, label=sampler if first else None,
            )  # fmt: skip
            rows.append((sampler, ratio, law, contrast, error, (contrast - law) / error, seconds / len(stack)))
    panel.set(xlabel=r"coherence length over half the window, $\sigma_g/a$", ylabel="contrast")
    panel.legend(fontsize=7)
    return rows


def draw_grains(panel, quick):
    """Autocovariance: the memory effect decides the size of the grains."""
    width, length, shifts = 10 * SLAB.thickness, SLAB.thickness, np.arange(9)
    rows = []
    for slab, name, colour in ((SLAB, "g = 0.9, OD 10", "C0"), (MILK, "g = 0, OD 5", "C3")):
        stack, scene, _ = images(slab, width, length, "paths", 16 if quick else 128)
        value, error = autocovariance(stack, shifts)
        steps = shifts * WAVELENGTH / width / 2
        value = value - [finite_path_excess(scene, PATHS["paths"], shift=d, threads=1) for d in steps]
        law = autocovariance_law(slab, width, length, shifts)
        panel.plot(shifts / 2, law, color=colour, lw=1)
        panel.errorbar(shifts / 2, value, error, fmt="x", color=colour, capsize=3, label=name)
        rows.append((name, *[f"{v:.4f} ± {e:.4f} ({w:.4f})" for v, e, w in zip(value, error, law, strict=True)][::2]))
    panel.set(xlabel="shift of view, speckle grains", ylabel="intensity covariance / mean²")
    panel.legend(fontsize=7)
    return rows


def table(head, rows):
    """Print a table in Markdown."""
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(f"{cell:.3g}" if isinstance(cell, float) else f"{cell}" for cell in row) + " |")
    print()


def main(out: Path, quick: bool) -> None:
    """Draw contrast.png into ``out`` and print the tables; ``quick`` takes fewer media."""
    out.mkdir(parents=True, exist_ok=True)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6))
    head = "sampler", "sigma_g/a", "1/sqrt(N_eff)", "contrast", "error", "z", "CPU s a medium"
    table(head, draw_contrast(left, quick))
    table(("slab", *[f"{n} grains" for n in range(5)]), draw_grains(right, quick))
    figure.tight_layout()
    figure.savefig(out / "contrast.png", dpi=120)


if __name__ == "__main__":
    run(main, OUT, __doc__)
