"""Figure 4 of [Bar19]: the mean field inside a random medium, and rows of the far-field mean.

Draws bar19-figure-4.png and prints rows A06 and A20 of docs/notes/validation.md.

Run it by itself: python scripts/figures/bar19_mean.py --out docs/images [--quick]
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _bar19 import LIGHTS, OUT, REFERENCE, Row, clock, flatland_box, flatland_scene, report, save
from _command import run
from references.mean_wave import coherent_field

import specklegen as sg
from specklegen.oracles.cylinder import Cylinder
from specklegen.oracles.wave_ensemble import CylinderGas

MEAN_FREE_PATH = 10.0


def draw_inside(left: plt.Axes, right: plt.Axes, placements: int) -> list[Row]:
    """Mean field of a line source against distance, from the wave equation; cylinders of order 0."""
    monopole = Cylinder.resonant(0.02, order=0)
    gas = CylinderGas.with_mean_free_path(monopole, (-24.0, -24.0), (24.0, 24.0), MEAN_FREE_PATH)
    with clock() as spent:
        field = coherent_field(gas, np.arange(1.0, 20.0, 2.0), placements=placements, seed=3, workers=1)
    (size, size_error), (phase, phase_error), (decay, decay_error) = field.magnitude(), field.phase(), field.decay()
    attenuation = np.exp(-field.radii / (2 * MEAN_FREE_PATH))
    left.errorbar(field.radii, size, size_error, fmt="ok", ms=4, label=f"wave equation, {placements} placements")
    left.semilogy(field.radii, attenuation, "C3", lw=1, label=r"Eq. 20: $e^{-\sigma_t r/2}$")
    left.set(ylabel=r"|mean| $\sqrt{r}$", title=f"mean inside the medium, {spent.seconds:.0f} s CPU")
    right.errorbar(field.radii, phase, phase_error, fmt="ok", ms=4)
    right.axhspan(-0.05, 0.05, color="0.9")
    right.axhline(0, color="C3", lw=1)
    right.set(ylabel="phase beyond k r (rad)", title="its phase; grey: ± 0.05", ylim=(-0.1, 0.1))
    for axis in (left, right):
        axis.set(xlabel="distance from the source (λ)")
    left.legend(fontsize=8)
    slope, error = decay * 2 * MEAN_FREE_PATH, decay_error * 2 * MEAN_FREE_PATH
    worst = int(np.abs(phase).argmax())
    return [
        Row("A06", "decay of the mean over σ_t/2, r = 1 … 19 λ", f"{slope:.4f} ± {error:.4f}", "1 ± .02",
            f"z {(slope - 1) / error:+.1f}", spent.seconds),
        Row("A06", "phase beyond kr, largest of 10 distances", f"{phase[worst]:+.4f} ± {phase_error[worst]:.4f} rad",
            "± .05 rad", f"largest z {np.abs(phase / phase_error).max():.1f}", spent.seconds),
    ]  # fmt: skip


def draw_box(axis: plt.Axes) -> list[Row]:
    """Far-field mean of the box against the stored wave solution."""
    wave = np.load(REFERENCE / "wave_solver_2d_od2.npz")
    theta = np.linspace(0, np.pi, 721)
    cylinders = sg.media.Tabulated(theta=theta, amplitude=Cylinder.resonant(0.02).amplitude(theta))
    box = flatland_box(10.0, MEAN_FREE_PATH, cylinders)
    fine = np.arange(-180.0, 180.0, 0.25)
    with clock() as spent:
        found = sg.statistics.mean_field(flatland_scene(box, wave["view_deg"])).T
        lines = sg.statistics.mean_field(flatland_scene(box, fine)).T
    for j, colour in ((0, "C0"), (3, "C1")):
        axis.semilogy(fine, np.abs(lines[:, j]), colour, lw=0.6, label=f"Eq. 48, light {LIGHTS[j]:g}°")
        view = (wave["view_deg"] + 180) % 360 - 180
        axis.semilogy(view, np.abs(wave["mean"][:, j]), "o", color=colour, mec="k", ms=4,
                      label="wave equation" if j else None)  # fmt: skip
    axis.set(xlabel="view (°)", xlim=(-60, 60), ylim=(3e-3, 30), ylabel=r"|mean|, length$^{1/2}$",
             title="far field of the 20 λ box, OD 2")  # fmt: skip
    axis.legend(fontsize=8)
    errors = np.linalg.norm(found - wave["mean"], axis=0) / np.linalg.norm(wave["mean"], axis=0)
    # At v = i the closed form has the amplitude (k / 2 pi)^(1/2) A (1 - e^(-OD/2)); the first zero is lambda / W away.
    forward = sg.statistics.mean_field(flatland_scene(flatland_box(10.0, 10.0),
                                                      np.array([0.0, np.rad2deg(np.arcsin(1 / 20))])))
    law = 20 * (1 - np.exp(-1))
    return [
        Row("A20", "box against the wave equation, 4 lights, 72 views: relative error of the mean",
            " ".join(f"{100 * e:.1f} %" for e in errors), "≤ 3 %", "", spent.seconds),
        Row("A20", "box, v = i over (k/2π)^½ A (1 − e^(−OD/2)) − 1", f"{abs(forward[0, 0]) / law - 1:.1e}", "0",
            "rounding", spent.seconds),
        Row("A20", "box, |mean| at λ/W over that at 0", f"{abs(forward[0, 1] / forward[0, 0]):.4f}",
            "first zero of the sinc, filled a little: τ(x, v) varies", "", spent.seconds),
    ]  # fmt: skip


def draw_slab(axis: plt.Axes) -> list[Row]:
    """Mean of a square beam behind a slab: the window's diffraction pattern."""
    width, sines = 100.0, np.linspace(-0.04, 0.04, 401)
    views = np.stack([sines, 0 * sines, np.sqrt(1 - sines**2)], axis=-1)
    slab = sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.media.Isotropic())
    scene = sg.Scene(wavelength=1.0, medium=slab, illumination=sg.light.CollimatedBeams.tilts([0.0], width=width),
                     sensor=sg.sensors.FarField(directions=views))  # fmt: skip
    with clock() as spent:
        found = np.abs(sg.statistics.mean_field(scene)[0])
    law = np.exp(-1) * width**2 * np.abs(np.sinc(width * sines))
    axis.plot(sines * width, found, "C0", lw=3, alpha=0.5, label="specklegen")
    axis.plot(sines * width, law, "k--", lw=1, label=r"$e^{-OD/2}\,(W^2/\lambda)\,|\mathrm{sinc}|$")
    axis.set(xlabel="view × W/λ", ylabel="|mean|, length", title="square beam behind a slab, OD 2")
    axis.legend(fontsize=8)
    gap = np.abs(found - law).max() / law.max()
    return [Row("A20", "slab, square beam: largest gap from e^(−OD/2) sinc over the peak; zero at λ/W",
                f"{gap:.1e}", "0", "rounding", spent.seconds)]  # fmt: skip


def main(out: Path, quick: bool) -> None:
    """Draw, and print rows; ``quick`` takes few placements."""
    figure, axes = plt.subplots(1, 4, figsize=(16, 4), layout="constrained")
    rows = draw_inside(axes[0], axes[1], 128 if quick else 256)
    rows += draw_box(axes[2]) + draw_slab(axes[3])
    save(figure, out / "bar19-figure-4.png", 66)
    report(rows, "bar19_mean")


if __name__ == "__main__":
    run(main, OUT, __doc__)
