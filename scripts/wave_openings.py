"""Tables and pictures of docs/wavetracing.md: fields behind openings, patterns, and masked light in the engine.

Run it by itself: python scripts/wave_openings.py --out docs/wavetracing
Times are of one thread; quote ratios.
"""

import argparse
import time
import warnings
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from scipy.special import hankel1

import specklegen as sg
from specklegen.oracles.slit_screen import slit_screen
from specklegen.oracles.wedge_series import wedge_series
from specklegen.wavetracing import (
    Plane,
    PlaneWave,
    field_on_plane,
    illumination_of,
    sample_pattern,
    wedge_field,
    window_losses,
)
from specklegen.wavetracing.envelope import edge_envelope
from specklegen.wavetracing.opening import rim_of

LIGHT = PlaneWave(wavelength=1.0)
K = 2 * np.pi


def box(width, height, at=(0.0, 0.0)):
    """Loop of a rectangle."""
    return np.array([[-width, -height], [width, -height], [width, height], [-width, height]]) / 2 + at


def star(tips, outer, inner):
    """Loop of a star with a tip on the x axis."""
    angle, radius = np.arange(2 * tips) * np.pi / tips, np.tile([outer, inner], tips)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


HEXAGRAM = star(6, 6.0, 12**0.5)


def table(title, head, rows):
    """Print a Markdown table."""
    print(f"\n{title}\n\n| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for row in rows:
        print("| " + " | ".join(cell if isinstance(cell, str) else f"{cell:.2g}" for cell in row) + " |")


def gap(a, b):
    """Relative l2 distance."""
    return float(np.linalg.norm(np.subtract(a, b)) / np.linalg.norm(b))


def wedges():
    """Error of UTD against the series."""
    rng, rows = np.random.default_rng(0), []
    for n in (1.25, 1.5, 1.75, 2.0):
        phi, incidence = rng.uniform(0, n * np.pi, (2, 2000))
        row = [f"{n:g}"]
        for r in (1.0, 10.0, 100.0):
            gaps = [
                wedge_field(n, phi, incidence, r, K, b) - wedge_series(n, phi, incidence, r, K, b)
                for b in ("soft", "hard")
            ]
            row.append(np.sqrt(np.mean(np.square(np.abs(gaps)))))
        rows.append(row)
    table("UTD against the exact series, rms over angles", ["n", "r = 1", "10", "100"], rows)


def slits():
    """Methods against the exact slit of 10 wavelengths, l2 of |u|^2."""
    x0, w0 = np.polynomial.legendre.leggauss(400)
    rows = []
    for polarisation in ("hard", "soft", "mean"):
        for z in (10.0, 50.0, 500.0):
            plane = Plane(center=[0.0137, 0, z], shape=(1, 241), pitch=max(z, 50) * 0.006)
            at = plane.points[0][:, [0, 2]]
            kinds = ("soft", "hard") if polarisation == "mean" else (polarisation,)
            exact = np.mean([np.abs(slit_screen([(-5, 5)], boundary=b).field(at)) ** 2 for b in kinds], axis=0)
            long = box(10, 8e9)
            fields = [field_on_plane(long, LIGHT, plane, "utd", polarisation=b).values[0] for b in kinds]
            rays = np.mean(np.square(np.abs(fields)), axis=0)
            r = np.hypot(*at.T)
            distance = np.hypot(at[:, :1] - 5 * x0, at[:, 1:])
            kirchhoff = (0.5j * K * hankel1(1, K * distance) * at[:, 1:] / distance) @ (5 * w0)
            far = (at[:, 1] / r) ** 2 / r * (10 * np.sinc(10 * at[:, 0] / r)) ** 2
            rows.append([polarisation, f"{z:g}", gap(rays, exact), gap(np.abs(kirchhoff) ** 2, exact), gap(far, exact)])
    table(
        "Slit of 10 wavelengths: l2 of |u|^2 against the exact solution",
        ["screen", "Z", "utd", "Rayleigh-Sommerfeld I", "fraunhofer"], rows,
    )  # fmt: skip


def squares():
    """Methods against the rim, for a square."""
    rows = []
    for z in (10.0, 50.0, 200.0, 1000.0, 10000.0):
        plane = Plane(center=[0.013, 0.017, z], shape=(96, 96), pitch=max(0.25, z / 400))
        exact = field_on_plane(box(10, 10), LIGHT, plane, threads=1).values
        row = [f"{z:g}", f"{100 / z:g}"]
        for padding in (2.0, 4.0):
            try:
                found = field_on_plane(box(10, 10), LIGHT, plane, "spectrum", padding=padding).values
                row.append(gap(found, exact))
            except sg.RuleError:
                row.append("too large")
        rays = [field_on_plane(box(10, 10), LIGHT, plane, "utd", polarisation=p).values for p in ("soft", "hard")]
        row.append(gap(np.mean(rays, axis=0), exact))
        row.append(gap(field_on_plane(box(10, 10), LIGHT, plane, "fraunhofer").values, exact))
        rows.append(row)
    head = ["Z", "size²/λZ", "spectrum, padding 2", "padding 4", "utd, mean of soft and hard", "fraunhofer"]
    table("Square of 10 wavelengths: l2 of u against the rim", head, rows)


def times():
    """Seconds for 256 x 256 points, one thread."""
    plane, rows = Plane(center=[0.01, 0.02, 100.0], shape=(256, 256), pitch=0.25), []
    for name, opening in (("square", box(10, 10)), ("hexagram", HEXAGRAM)):
        row = [name]
        for method in ("boundary", "spectrum", "utd", "fraunhofer"):
            field_on_plane(opening, LIGHT, plane.replace(shape=(2, 2)), method, threads=1)
            start = time.perf_counter()
            field_on_plane(opening, LIGHT, plane, method, threads=1)
            row.append(time.perf_counter() - start)
        rows.append(row)
    table("Seconds for 256 x 256 points at Z = 100", ["opening", "boundary", "spectrum", "utd", "fraunhofer"], rows)


def samplers():
    """Trials and times of the polygon sampler."""
    turn, rows = np.arange(32) * np.pi / 16, []
    disc = 5 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    triangle = np.array([[0, 0], [12, 0], [3, 9.0]])
    shapes = {
        "square 10": box(10, 10), "slit 10 x 40": box(10, 40), "triangle": triangle, "hexagram": HEXAGRAM,
        "five-pointed star": star(5, 6, 2.5), "32-gon": disc,
    }  # fmt: skip
    for name, loop in shapes.items():
        sample_pattern(loop, 10, 0, threads=1)
        start = time.perf_counter()
        drawn = sample_pattern(loop, 200_000, 0, threads=1)
        spent = (time.perf_counter() - start) / 200_000 * 1e6
        share = drawn.evanescent / (200_000 + drawn.evanescent)
        trials = drawn.trials / (200_000 + drawn.evanescent)
        expected = edge_envelope(rim_of("opening", loop)).trials
        rows.append([name, f"{expected:.3f}", f"{trials:.3f}", spent, spent / len(loop), share])
    head = ["opening", "expected trials", "measured", "µs a draw", "µs a draw and edge", "evanescent"]
    table("Draws from |Psi|^2, 200 000 each", head, rows)


def coupling(out):
    """Beams and losses of a double slit, and its speckle."""
    wavelength, width = 0.5, 32.0
    light = PlaneWave(wavelength=wavelength)
    loops, rows = [box(4, 12, (-5, 0)), box(4, 12, (5, 0))], []
    for pixels in (32, 64, 86):
        plane = Plane(center=[0, 0, 20.0], shape=(pixels, pixels), pitch=width / pixels)
        field = field_on_plane(loops, light, plane)
        lost = window_losses(field)
        counts = [str(len(illumination_of(field, power)[1])) for power in (0.8, 0.9, 0.99)]
        shares = [f"{share:.1e}" for share in (lost.rim, lost.seam, lost.evanescent, lost.unresolved)]
        rows.append([f"{pixels}²", *counts, *shares])
    head = ["pixels", "beams for 80 %", "90 %", "99 %", "rim", "seam", "evanescent", "unresolved"]
    table("Two slits of 8 x 24 wavelengths, 20 apart, 40 behind them, on a window of 64 wavelengths", head, rows)

    beams, modes = illumination_of(field, 0.9)
    fog = sg.Slab(thickness=4.0, mean_free_path=2.0, scatterer=sg.HenyeyGreenstein(g=0.9))
    sensor = sg.FarField.grid((65, 65), wavelength / width / 2)
    scene = sg.Scene(wavelength=wavelength, medium=fog, illumination=beams, sensor=sensor)
    speckle = np.abs(sg.transmission_matrix(scene, modes, paths=2000, seed=1).value[:, 0].reshape(65, 65)) ** 2
    figure, axes = plt.subplots(1, 5, figsize=(15, 3.2), layout="constrained")
    for axis, z in zip(axes, (20.0, 100.0, 500.0), strict=False):
        half = max(12.0, 0.3 * z)
        plane = Plane(center=[0, 0, z], shape=(160, 160), pitch=half / 80)
        values = field_on_plane(HEXAGRAM, LIGHT, plane).values
        axis.imshow(np.abs(values), cmap="inferno", origin="lower", extent=(-half, half, -half, half))
        axis.set_title(f"|u|, hexagram, Z = {z:g} λ")
    axes[3].imshow(np.abs(field.values), cmap="inferno", origin="lower", extent=(-16, 16, -16, 16))
    axes[3].set_title("|u|, two slits, on the window")
    axes[4].imshow(speckle, cmap="inferno", origin="lower")
    axes[4].set_title("their speckle behind a slab")
    for axis in axes:
        axis.set_xticks([])
        axis.set_yticks([])
    figure.savefig(out / "openings.png", dpi=80)


def main():
    """Print every table and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the picture")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore", sg.DoubtWarning)  # the tables show what they warn of
    wedges()
    slits()
    squares()
    times()
    samplers()
    coupling(out)


if __name__ == "__main__":
    main()
