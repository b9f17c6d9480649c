"""Figures 10 and 11 of [Bar19]: the memory effect of slabs, and speckle images under tilt.

Draws bar19-figure-10.png and bar19-figure-11.png, and prints rows A10, A11, A13 of docs/notes/validation.md. L = 1 mm,
wavelength 0.5 um.

Run it by itself: python scripts/figures/bar19_memory_effect.py --out docs/images [--quick]
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _bar19 import OUT, REFERENCE, Row, clock, report, save
from _command import run
from references.correlation_transfer import field_correlation

import specklegen as sg
from specklegen.theory.slab import memory_effect_diffusion, memory_effect_thick_slab

WAVELENGTH, LENGTH = 0.5, 1000.0
Q = np.array([0.5, 1, 1.491, 2.742, 4, 8])
TABLE = {  # optical depth: C_I(Q), g = 0, two independent programs, standard error 0.0015 (0.0025 at OD 20)
    1: (0.879, 0.678, 0.531, 0.349, 0.276, 0.201),
    5: (0.908, 0.695, 0.473, 0.145, 0.048, 0.006),
    20: (0.912, 0.697, 0.463, 0.105, 0.016, 0.0),
}
LINE = np.linspace(0, 8, 15)
STEP = np.deg2rad(0.0025)


def curve(q, optical_depth, g=0.0, length=LENGTH, paths=100_000, **options):
    """Memory-effect curve of a slab at q = k L sin(tilt)."""
    slab = sg.Slab(thickness=length, mean_free_path=length / optical_depth, scatterer=sg.media.HenyeyGreenstein(g=g),
                   albedo=options.pop("albedo", 1.0))  # fmt: skip
    tilts = np.arcsin(np.asarray(q) * WAVELENGTH / (2 * np.pi * length))
    return sg.memory_effect(slab, wavelength=WAVELENGTH, tilts=tilts, paths=paths, threads=1, **options)


def draw_slabs(out: Path, paths: int) -> list[Row]:
    """Figure 10: optical depth, anisotropy, reflection, and collapse onto q."""
    figure, axes = plt.subplots(2, 2, figsize=(12, 8.4), layout="constrained")
    (depths, lobes), (reflection, lengths) = axes
    rows = []

    def plot(axis, q, found, colour, name):
        axis.errorbar(q, found.intensity, found.standard_error, fmt=f".{colour}", label=name)

    seconds = 0.0
    for n, (depth, expected) in enumerate(TABLE.items()):
        with clock() as spent:
            found = curve(Q, depth, paths=paths)
        seconds += spent.seconds
        plot(depths, Q, found, f"C{n}", f"OD {depth}")
        depths.plot(LINE, field_correlation(LINE, depth) ** 2, f"C{n}", lw=1)
        depths.plot(Q, expected, "ok", mfc="none", ms=7)
        gap = found.intensity - expected
        z = gap / np.hypot(found.standard_error, 0.0025 if depth == 20 else 0.0015)
        exact = (found.intensity - field_correlation(Q, depth) ** 2) / found.standard_error
        rows.append(Row("A10", f"transmission, g = 0, OD {depth}: C_I at six q", f"largest gap "
                        f"{np.abs(gap).max():.4f}", "table ± (3 se + .003)", f"largest z {np.abs(z).max():.1f}; against"
                        f" the transfer equation {np.abs(exact).max():.1f}", spent.seconds))  # fmt: skip
    depths.plot(LINE, memory_effect_diffusion(LINE), "k:", lw=1, label="Eq. 39, diffusion")
    depths.set_title(f"transmission, g = 0, {seconds:.0f} s CPU; lines: transfer equation, circles: table", fontsize=10)

    with clock() as spent:
        for n, (g, expected) in enumerate(((0.0, 0.107), (0.8, 0.219), (0.9, 0.610))):
            found = curve(np.append(2.742, LINE), 10, g, paths=paths)
            plot(lobes, found.q, found, f"C{n}", f"g = {g:g}")
            lobes.plot(2.742, expected, "ok", mfc="none", ms=7)
            rows.append(Row("A10", f"transmission, OD 10, g = {g:g}: C_I(2.742)",
                            f"{found.intensity[0]:.4f} ± {found.standard_error[0]:.4f}", f"{expected} ± .01",
                            f"gap {found.intensity[0] - expected:+.4f}", 0.0))  # fmt: skip
            name = REFERENCE / f"memory_effect_transmission_od10_g{10 * g:02.0f}.npz"
            if name.exists():
                _plot_reference(lobes, np.load(name), f"C{n}")
    rows[-3:] = [row._replace(seconds=spent.seconds / 3) for row in rows[-3:]]
    lobes.set_title(f"transmission, OD 10, {spent.seconds:.0f} s CPU; bands: 2019 code, ± 2 se", fontsize=10)

    back = np.array([2.742, 1, 2, 4, 6, 8])
    exact = field_correlation(back, 10, mode="reflection") ** 2
    with clock() as spent:
        for n, (albedo, forward, both) in enumerate(((1.0, 0.580, 0.728), (0.8, 0.935, 0.985))):
            for reverse, expected in ((False, forward), (True, both)):
                view = (0.0, 0.0, -1.0) if reverse else None
                found = curve(back, 10, mode="reflection", albedo=albedo, reverse=reverse, view=view, paths=paths // 2)
                name = f"albedo {albedo:g}, " + ("reversed paths, v = −i" if reverse else "forward only")
                plot(reflection, back, found, f"C{2 * n + reverse}", name)
                reflection.plot(2.742, expected, "ok", mfc="none", ms=7)
                rows.append(Row("A10", f"reflection, OD 10, {name}: C_I(2.742)",
                                f"{found.intensity[0]:.4f} ± {found.standard_error[0]:.4f}", f"{expected} ± .01",
                                f"gap {found.intensity[0] - expected:+.4f}", 0.0))  # fmt: skip
    rows[-4:] = [row._replace(seconds=spent.seconds / 4) for row in rows[-4:]]
    order = np.argsort(back)
    reflection.plot(back[order], exact[order], "C0", lw=1)
    stored = np.load(REFERENCE / "memory_effect_reflection_od5_albedo100.npz")
    _plot_reference(reflection, stored, "0.5")
    reflection.set_title(f"reflection, OD 10, {spent.seconds:.0f} s CPU; band: 2019 code, OD 5, albedo 1", fontsize=10)

    with clock() as spent:
        found = [curve(Q, 20 * n, length=n * LENGTH, paths=20 * n * paths) for n in (1, 2, 4)]
    for n, each in zip((1, 2, 4), found, strict=True):
        lengths.errorbar(Q, each.intensity, each.standard_error, fmt=".", label=f"L × {n}, OD {20 * n}")
    lengths.plot(LINE, memory_effect_diffusion(LINE), "k:", lw=1, label="Eq. 39")
    lengths.set_title(f"mean free path 50 µm, thicker and thicker: one curve, {spent.seconds:.0f} s CPU", fontsize=10)
    spread = np.ptp([each.intensity for each in found], axis=0).max()
    forms = [memory_effect_thick_slab(Q, 20 * n) for n in (1, 2, 4)]
    z = [np.abs((a.intensity - b) / a.standard_error).max() for a, b in zip(found, forms, strict=True)]
    rows.append(Row("A13", "C_I of L × 1, 2, 4 at OD 20, 40, 80 over six q: largest spread",
                    f"{spread:.4f} (se ≤ {max(each.standard_error.max() for each in found):.4f}); closed form "
                    f"{np.ptp(forms, axis=0).max():.4f}", "≤ .03", f"z from the closed form ≤ {max(z):.1f}",
                    spent.seconds))  # fmt: skip
    for axis in axes.flat:
        axis.set(xlabel="q = k L sin(tilt)", ylabel="C_I", xlim=(0, 8.2), ylim=(-0.03, 1.05))
        axis.legend(fontsize=8)
    save(figure, out / "bar19-figure-10.png", 70)
    return rows


def _plot_reference(axis, stored, colour: str) -> None:
    q = 2 * np.pi * np.sin(np.deg2rad(stored["theta_deg"])) * stored["L"]
    value, error = stored["C_jackknife_bias_corrected"], 2 * stored["C_se"]
    axis.fill_between(q, value - error, value + error, color=colour, alpha=0.25, lw=0)


def tilted_images(optical_depth: float, g: float, paths: int, media: int) -> np.ndarray:
    """Speckle float[R, 11, 120, 120] over 0.1 degree at tilts 0 ... 10 steps; a step is three pixels."""
    scene = sg.Scene(
        wavelength=WAVELENGTH,
        medium=sg.Slab(
            thickness=LENGTH, mean_free_path=LENGTH / optical_depth, scatterer=sg.media.HenyeyGreenstein(g=g)
        ),
        illumination=sg.light.CollimatedBeams.tilts(STEP * np.arange(11), width=16 * LENGTH),
        sensor=sg.sensors.FarField.grid((120, 120), np.sin(STEP) / 3),
    )
    return sg.render(scene, paths=paths, realizations=media, sampler="paths", threads=1).intensity


def registered(images: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Peak of the cross-correlation with the first image: columns moved float[T], and its height float[T]."""
    lags = np.arange(-6, 46)
    places, heights = [], []
    for n in range(images.shape[1]):
        row = []
        for lag in lags:  # pixels that move out of the picture are left out
            a, b = images[:, 0, :, max(-lag, 0) : 120 - max(lag, 0)], images[:, n, :, max(lag, 0) : 120 + min(lag, 0)]
            row.append(np.mean([np.corrcoef(x.ravel(), y.ravel())[0, 1] for x, y in zip(a, b, strict=True)]))
        row = np.array(row)
        top = int(np.clip(row.argmax(), 1, len(lags) - 2))
        low, middle, high = row[top - 1 : top + 2]
        places.append(lags[top] + (high - low) / (2 * (2 * middle - low - high)))
        heights.append(row[top])
    return np.array(places), np.array(heights)


def draw_images(out: Path, quick: bool) -> list[Row]:
    """Figure 11: the pattern moves with the tilt and fades along the curve."""
    paths, media = (2000, 1) if quick else (10_000, 6)
    figure = plt.figure(figsize=(13, 6.6), layout="constrained")
    grid = figure.add_gridspec(2, 5)
    place, height = (figure.add_subplot(grid[n, 3:]) for n in range(2))
    rows, steps = [], np.arange(11)
    for n, (depth, g) in enumerate(((10, 0.9), (5, 0.0))):
        with clock() as spent:
            images = tilted_images(depth, g, paths, media)
        q = 2 * np.pi / WAVELENGTH * LENGTH * np.sin(STEP * steps)
        law = curve(q, depth, g, paths=20_000 if quick else 100_000).intensity
        found, peak = registered(images)
        name = f"OD {depth}, g = {g:g}"
        for column, tilt in enumerate((0, 4, 8)):
            axis = figure.add_subplot(grid[n, column])
            picture = images[0, tilt]
            axis.imshow(picture, cmap="gray", vmax=np.quantile(picture, 0.995), extent=(0, 120, 120, 0))
            # a frame that moves with the tilt: the same speckle inside it, where the memory effect holds
            axis.add_patch(plt.Rectangle((30 + 3 * tilt, 30), 50, 50, fill=False, ec="C1", lw=2))
            axis.set(title=f"{name}, tilt {tilt} Δ", xticks=[], yticks=[])
        seen = law > 0.1
        place.plot(steps[seen], found[seen] - 3 * steps[seen], f"oC{n}", label=f"{name}, {spent.seconds:.0f} s CPU")
        height.plot(steps, law, f"C{n}", lw=1)
        height.plot(steps, peak, f"oC{n}", label=name)
        rows += [
            Row("A11", f"{name}: registered peak less nΔ, where C_I > .1 (n ≤ {steps[seen].max()})",
                f"largest {np.abs(found - 3 * steps)[seen].max():.2f} px", "± 0.5 px", f"Δ = 3 px, {media} media",
                spent.seconds),
            Row("A11", f"{name}: height of the peak against the curve, same n",
                f"largest gap {np.abs(peak - law)[seen].max():.3f}", "± .05", "", spent.seconds),
        ]  # fmt: skip
    place.axhspan(-0.5, 0.5, color="0.9")
    place.set(ylabel="registered peak − nΔ (px)", ylim=(-0.8, 0.8))
    height.set(xlabel="tilt n (Δ = 0.0025°)", ylabel="height of the peak; lines: C_I")
    place.legend(fontsize=8)
    save(figure, out / "bar19-figure-11.png", 60)
    return rows


def main(out: Path, quick: bool) -> None:
    """Draw, and print rows; ``quick`` takes few paths."""
    curve([1.0], 1, paths=64)  # compiles
    report(draw_slabs(out, 2_000 if quick else 100_000), "bar19_memory_effect")
    report(draw_images(out, quick), "bar19_memory_effect")


if __name__ == "__main__":
    run(main, OUT, __doc__)
