"""The claims of [Steinberg] (*Wave Tracing*) as figures and tables, each beside an exact solution where there is one.

Writes steinberg-slit.png, steinberg-two-stages.png, steinberg-energy.png, steinberg-coverage.png,
steinberg-convergence.png and steinberg-cost.png; prints the tables of
docs/notes/wavetracing.md. Wavelength 1 unless said.
Times are processor seconds of one thread: quote ratios. ``--quick`` takes fewer beams.

Run it by itself: python scripts/figures/steinberg.py --out docs/wavetracing [--quick]
"""

import time
import tracemalloc
import warnings
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from _command import run, save
from _coverage_scenes import PLACES
from references.pattern_trials import mean_trials
from references.strip_solver import strip_solver
from scipy.stats import norm

from specklegen.core.errors import DoubtWarning
from specklegen.oracles.slit_screen import slit_screen
from specklegen.wavetracing import (
    Absorber,
    CollimatedEmitter,
    Geometry,
    Mesh,
    Plane,
    PlaneWave,
    PointEmitter,
    bilinear_intensity,
    coherent_rays,
    coverage,
    field_on_plane,
    perforated_screen,
    sample_pattern,
    sample_slits,
    trace,
    wedge_coefficients,
)
from specklegen.wavetracing.materials import LIGHT_SPEED

OUT = Path("docs/wavetracing")
K = 2 * np.pi
LIGHT = PlaneWave(wavelength=1.0)
ABSORBER = Absorber()
LONG, FAR = 3e5, 1e7  # half length of a strip, distance of a source: flatland, and a plane wave
SCREEN = [((-30, 0), (-9.5, 0)), ((-4.5, 0), (4.5, 0)), ((9.5, 0), (30, 0))]
REFLECTORS = {"A": ((16, 40), (22, 80)), "B": ((10, 40), (16, 80))}


def table(title, head, rows):
    """Print a Markdown table."""
    print(f"\n{title}\n\n| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for row in rows:
        print("| " + " | ".join(cell if isinstance(cell, str) else f"{cell:.3g}" for cell in row) + " |")


def gap(a, b):
    """Relative l2 distance."""
    return float(np.linalg.norm(np.subtract(a, b)) / np.linalg.norm(b))


def rectangle(width, height, x=0.0):
    """Loop of a rectangle, counter-clockwise."""
    return np.array([[-width, -height], [width, -height], [width, height], [-width, height]]) / 2 + [x, 0]


def hexagram():
    """Loop of a star of six tips, the first on the x axis."""
    angle, radius = np.arange(12) * np.pi / 6, np.tile([6.0, 12**0.5], 6)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def screen(*holes) -> Geometry:
    """A screen with holes, wide enough to have no border."""
    return Geometry(perforated_screen(rectangle(2e5, 2e5), holes))


def single_edges(x, z, half, polarisation):
    """Field of a slit by geometric light and one ray of each edge alone: UTD without rays across the slit."""
    u = np.where(np.abs(x) < half, np.exp(1j * K * z), 0)
    for side in (1.0, -1.0):
        s, phi = np.hypot(side * x - half, z), 2 * np.pi - np.arctan2(z, side * x - half)  # from the lit face
        pair = wedge_coefficients(2.0, phi, np.pi / 2, s, K)
        u = u + pair[polarisation == "hard"] * np.exp(1j * K * s) / np.sqrt(s)
    return u


def slit_methods(out, quick):  # noqa: ARG001
    """UTD, Fraunhofer and the exact slit of ten wavelengths."""
    rows, drawn = [], None
    for polarisation in ("hard", "soft"):
        solved = slit_screen([(-5, 5)], boundary=polarisation)
        for z in (50.0, 500.0):
            plane = Plane(center=[0.0137, 0, z], shape=(1, 241), pitch=z * 0.006)
            at = plane.points[0][:, [0, 2]]
            exact = np.abs(solved.field(at)) ** 2
            every = np.abs(field_on_plane(rectangle(10, 8e9), LIGHT, plane, "utd", polarisation=polarisation).values[0])
            once = np.abs(single_edges(*at.T, 5.0, polarisation)) ** 2
            r = np.hypot(*at.T)
            far = (at[:, 1] / r) ** 2 / r * (10 * np.sinc(10 * at[:, 0] / r)) ** 2
            rows.append([polarisation, f"{z:g}", gap(every**2, exact), gap(once, exact), gap(far, exact)])
            if polarisation == "soft" and z == 50:
                drawn = at[:, 0], exact, every**2, far
    table("Slit of 10 wavelengths: l2 of |u|² against the exact solution",
          ["screen", "Z", "utd, all orders", "utd, each edge once", "fraunhofer"], rows)  # fmt: skip
    assert drawn is not None
    figure, panel = plt.subplots(figsize=(6, 3))
    for values, style, name in zip(drawn[1:], ("k-", "C0--", "C1:"), ("exact", "utd", "fraunhofer"), strict=True):
        panel.plot(drawn[0], values, style, label=name)
    panel.set(xlabel="x / λ", ylabel="|u|²", title="soft slit of 10 λ, Z = 50 λ")
    panel.legend()
    save(figure, out / "steinberg-slit.png", dpi=72)


def strips(parts, material=ABSORBER) -> Geometry:
    """Strips of flatland as long sheets along y."""
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Geometry([
        Mesh(np.array([[a, -LONG, y], [b, -LONG, z], [b, LONG, z], [a, LONG, y]], float), faces, material)
        for (a, y), (b, z) in parts
    ])


def two_stages(out, quick):
    """Two slits, then a reflector: rays of one and of two edges, against the strip solver."""
    x = np.linspace(-60, 60, 121 if quick else 1200) + 0.0137
    points = np.stack([x, 0 * x, 0 * x + 150], axis=1)
    source, rows = PointEmitter([0, 0, -FAR], 1.0, 4 * np.pi), []
    figure, panels = plt.subplots(2, 1, figsize=(6, 4.5), sharex=True)
    for panel, (name, reflector) in zip(panels, REFLECTORS.items(), strict=True):
        exact = np.abs(strip_solver([*SCREEN, reflector]).field(points[:, [0, 2]])) ** 2
        scene, field = strips([*SCREEN, reflector]), {}
        for diffractions in (1, 2):
            field[diffractions] = coherent_rays(scene, source, points, 1, diffractions) * FAR
        # What the reflector changes, its shadow among it, as a wave of its own.
        alone = coherent_rays(strips(SCREEN), source, points, 1, 2) * FAR
        added = np.abs(alone) ** 2 + np.abs(field[2] - alone) ** 2
        wide = np.ones(max(1, round(5 / (x[1] - x[0]))))
        smooth = [np.convolve(v, wide / wide.size, "valid") for v in (added, exact)]
        rows.append([name, gap(np.abs(field[1]) ** 2, exact), gap(np.abs(field[2]) ** 2, exact), gap(added, exact),
                     gap(*smooth)])  # fmt: skip
        panel.plot(x, exact, "k-", label="wave solver")
        panel.plot(x, np.abs(field[2]) ** 2, "C0--", label="two edges")
        panel.plot(x, added, "C1:", label="the reflector's wave added as an intensity")
        panel.set(ylabel=f"|u|², scene {name}")
    panels[1].set(xlabel="x / λ")
    panels[0].legend(fontsize=7)
    save(figure, out / "steinberg-two-stages.png", dpi=72)
    head = ["scene", "one edge", "two edges", "the reflector's wave added as an intensity", "the same, over 5 λ"]
    table("Two slits and a reflector: l2 of |u|² at y = 150", head, rows)


def cost(out, quick):
    """Memory and time against the size of the scene: the wave solver, and beams."""
    rows = []
    for width in (25, 50, 100, 200):
        start = time.process_time()
        solved = strip_solver([((-width / 2, 0), (width / 2, 0))], nodes=8)
        seconds, matrix = time.process_time() - start, 16 * len(solved.charges) ** 2
        scene = Geometry(Mesh(rectangle(width, 2e4) @ np.eye(2, 3), np.array([[0, 1, 2], [0, 2, 3]])))
        source = CollimatedEmitter([width / 2 - 15, -5, -10], [width / 2 + 15, 5, -10], [0, 0, 1.0], 10.0, 1.0)
        behind, beams = Plane(center=[width / 2, 0, 150.0], shape=(1, 120), pitch=1.0), 500 if quick else 4000
        trace(scene, source, behind, 20, 0, threads=1)
        tracemalloc.start()
        start = time.process_time()
        trace(scene, source, behind, beams, 0, threads=1)
        ours, own = time.process_time() - start, tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        rows.append([f"{width}", matrix / 2**20, 1e3 * seconds, own / 2**20, 1e6 * ours / beams])
    table("A strip: the wave solver, and beams past its edge",
          ["width / λ", "solver's matrix, MiB", "ms", "beams, MiB", "µs a beam"], rows)  # fmt: skip
    figure, panels = plt.subplots(1, 2, figsize=(7, 3))
    widths = [float(row[0]) for row in rows]
    for panel, columns, label in ((panels[0], (1, 3), "MiB"), (panels[1], (2, 4), "ms (solver), µs a beam")):
        for column, name in zip(columns, ("solver", "beams"), strict=True):
            panel.loglog(widths, [row[column] for row in rows], "o-", label=name)
        panel.set_xticks(widths, labels=[f"{width:g}" for width in widths])
        panel.minorticks_off()
        panel.set(xlabel="strip / λ", ylabel=label)
    panels[0].legend()
    save(figure, out / "steinberg-cost.png", dpi=72)


def energy(out, quick):
    """Power behind a slit of 5 wavelengths over that of ray optics: mean rays alone, and rays of the ensemble."""
    rows, beams = [], 3000 if quick else 40_000
    for s in (2.0, 7.0, 20.0):
        c = np.linspace(-2.5, 2.5, 20_001)
        theory = 2 - (norm.cdf((2.5 - c) / s) - norm.cdf((-2.5 - c) / s)).mean()
        half = 2.5 + 6 * s
        source = CollimatedEmitter([-half, -half, -10], [half, half, -10], [0, 0, 1.0], 3 * s, 1.0)
        behind = Plane(center=[0, 0, 1.0], shape=(1, 1), pitch=1e6)
        share = 2.5 / half
        found = [trace(screen(rectangle(5, 4000)), source, behind, beams, 1, mode=mode, amplitude="uniform", threads=1)
                 for mode in ("ballistic", "wave")]  # fmt: skip
        passed = [found[0].ledger.received / beams, found[1].statistics.open / beams]
        rows.append([f"{s:g}", theory, *(f"{p / share:.3f} ± {np.sqrt(p / beams) / share:.3f}" for p in passed)])
    table("Power behind a slit of 5 wavelengths over that of ray optics",
          ["deviation of a beam", "2 - mean mass", "ballistic", "wave"], rows)  # fmt: skip
    figure, panel = plt.subplots(figsize=(4.5, 3))
    panel.plot([row[0] for row in rows], [row[1] for row in rows], "k-", label="2 - mean mass")
    for column, name in ((2, "ballistic"), (3, "wave")):
        panel.plot([row[0] for row in rows], [float(row[column].split()[0]) for row in rows], "o", label=name)
    panel.set(xlabel="deviation of a beam / λ", ylabel="power over that of rays")
    panel.legend()
    save(figure, out / "steinberg-energy.png", dpi=72)


def rim_values(z, plane):
    """Mean of |u|² over each pixel of a plane behind the hexagram, by the rim."""
    fine = plane.replace(shape=tuple(3 * n for n in plane.shape), pitch=plane.pitch / 3)
    values = np.abs(field_on_plane(hexagram(), LIGHT, fine, threads=1).values) ** 2
    return values.reshape(plane.shape[0], 3, plane.shape[1], 3).mean(axis=(1, 3))


def convergence(out, quick):
    """Error of traced beams to a floor that the Fresnel number sets, and of bilinear rays."""
    figure, panels = plt.subplots(1, 2, figsize=(8, 3.2))
    distances, counts = (2500.0, 500.0, 100.0, 20.0), (2**13, 2**15, 2**17) if quick else (2**14, 2**17, 2**20, 2**22)
    planes = [Plane(center=[0, 0, z], shape=(40, 40), pitch=2 * max(12, 0.3 * z) / 40) for z in distances]
    exact = [rim_values(z, plane) for z, plane in zip(distances, planes, strict=True)]
    rows = {z: [f"{z:g}", f"{36 / z:.2g}"] for z in distances}
    for beams in counts:
        source = CollimatedEmitter([-6.1, -6.1, -10], [6.1, 6.1, -10], [0, 0, 1.0], 1e4, 1.0, power=12.2**2)
        found = trace(screen(hexagram()), source, planes, beams, 0, amplitude="uniform", threads=1)
        back = 1 + found.statistics.evanescent / found.statistics.uniform  # they were drawn again
        for n, z in enumerate(distances):
            error = gap(found.irradiance[n], back * exact[n])
            noise = float(np.linalg.norm(found.standard_error[n]) / np.linalg.norm(exact[n]))
            rows[z].append(f"{error:.3g} ({noise:.2g})")
    for z, row in rows.items():
        panels[0].loglog(counts, [float(cell.split()[0]) for cell in row[2:]], "o-", label=f"Z = {z:g}")
    panels[0].set(xlabel="beams", ylabel="l2 of irradiance", title="wave")
    panels[0].legend(fontsize=7)
    table("Hexagram: l2 of traced irradiance against the rim (noise)",
          ["Z", "Fresnel number", *(f"{n} beams" for n in counts)], list(rows.values()))  # fmt: skip

    x, z, rows = np.linspace(-300, 300, 241), 500.0, []

    def rays(at):
        r = np.hypot(x[:, None] - at, z)
        return np.sqrt(1 / r) * np.exp(1j * (K * r - np.pi / 4)) * (z / r) * 10  # of slits 10 wide together

    nodes, weights = np.polynomial.legendre.leggauss(200)
    middle = np.concatenate([2.5 * nodes - 7, 2.5 * nodes + 7])
    true = np.abs(rays(middle) @ np.tile(weights, 2) / 4) ** 2
    for count in (16, 64, 256, 1024, 4096):
        errors, biased, negative = [], [], []
        for seed in range(4 if quick else 16):
            rng = np.random.default_rng((seed, count))
            at = rng.uniform(-2.5, 2.5, (count, x.size)) + rng.choice([-7.0, 7.0], (count, x.size))
            r = np.hypot(x - at, z)
            f = np.sqrt(1 / r) * np.exp(1j * (K * r - np.pi / 4)) * (z / r) * 10
            unbiased, _ = bilinear_intensity(f)
            errors.append(gap(unbiased, true))
            biased.append(gap(bilinear_intensity(f, unbiased=False)[0], true))
            negative.append(np.mean(unbiased < 0))
        rows.append([f"{count}", np.mean(errors), np.mean(biased), f"{np.mean(negative):.0%}"])
    panels[1].loglog([float(row[0]) for row in rows], [row[1] for row in rows], "o-", label="unbiased")
    panels[1].loglog([float(row[0]) for row in rows], [row[2] for row in rows], "s--", label="biased")
    panels[1].set(xlabel="rays a point", title="bilinear, two slits")
    panels[1].legend()
    save(figure, out / "steinberg-convergence.png", dpi=72)
    table("Two slits of 5, 14 apart, Z = 500: bilinear intensity, l2 over 241 points",
          ["rays a point", "unbiased", "biased", "negative"], rows)  # fmt: skip


def trials(out, quick):  # noqa: ARG001
    """Trials of the rejection samplers."""
    count, rows = 20_000 if quick else 200_000, []
    for n in (2, 4, 8, 16):
        drawn = sample_slits(np.full(n, 2.0), 10.0 * np.arange(n), np.zeros(n), count, 0, threads=1)
        rows.append([f"{n} slits apart", float(n), drawn.trials / (count + drawn.evanescent)])
    turn = np.arange(32) * np.pi / 16
    shapes = {
        "square": rectangle(10, 10), "slit 10 x 40": rectangle(10, 40), "hexagram": hexagram(),
        "triangle": np.array([[0, 0], [12, 0], [3, 9.0]]), "32-gon": 5 * np.stack([np.cos(turn), np.sin(turn)], axis=1),
    }  # fmt: skip
    for name, loop in shapes.items():
        drawn = sample_pattern(loop, count, 0, threads=1)
        rows.append([name, mean_trials(loop), drawn.trials / (count + drawn.evanescent)])
    table("Trials a draw", ["opening", "expected", "measured"], rows)


FREQUENCIES = {"street canyon": (0.9e9, 5e9), "stairwell": (5e9, 28e9), "two rooms": (2.4e9, 28e9)}


def powers(place, scene, frequency, method, **limits):
    """Power in each cell of a place's map and its error, over that of free space at 1 m; float64[h, w]."""
    found = coverage(scene, place.antenna, place.plane, frequency, method, threads=1, **limits)
    one = 20 * np.log10(LIGHT_SPEED / frequency / (4 * np.pi))
    power = np.where(found.rss_dBm.mask, 0, 10 ** ((found.rss_dBm.data - one) / 10))
    return power, power * found.error.data * np.log(10) / 10


def decibel(values, error):
    """Mean of some cells in dB, its error in brackets; "none" where it is below twice that."""
    if not values.size:
        return "-"
    mean, deviation = values.mean(), np.sqrt((error**2).sum()) / values.size
    if mean <= 2 * deviation:
        return "none"
    return f"{10 * np.log10(mean):.1f} ({10 / np.log(10) * deviation / mean:.1f})"


def draw_map(panel, place, image, what, low, high, colours="viridis"):
    """Draw one map of a place with its outlines."""
    rows, columns = place.plane.shape
    axes = (0, 2) if abs(place.plane.axes[2][1]) > 0.5 else (0, 1)
    extent = np.array([-columns, columns, -rows, rows]) * place.plane.pitch / 2
    extent += np.repeat(place.plane.center[list(axes)], 2)
    # Seen along y, x runs to the left in the plane's own columns.
    turned = image if place.plane.axes[0][0] > 0 else image[:, ::-1]
    drawn = panel.imshow(turned, origin="lower", extent=extent, vmin=low, vmax=high, cmap=colours)
    for corners in place.outlines:
        panel.plot(*corners.T, "k-", lw=0.6)
    panel.set(xlim=extent[:2], ylim=extent[2:])
    panel.set_title(what, fontsize=9)
    panel.figure.colorbar(drawn, ax=panel, shrink=0.7)


def maps(out, quick):
    """Coverage of three places by waves and by rays, and where they differ."""
    rows, beams = [], 200_000 if quick else 2_000_000
    figure, panels = plt.subplots(3, 3, figsize=(11, 9))
    for line, (name, make) in zip(panels, PLACES.items(), strict=True):
        place = make()
        limits = {"reflections": 1, "diffractions": 1 if quick or name == "stairwell" else 2}
        black = Geometry([Mesh(mesh.vertices, mesh.faces) for mesh in place.scene.meshes])
        for frequency in FREQUENCIES[name]:
            start = time.process_time()
            wave, wave_error = powers(place, place.scene, frequency, "wave", **limits)
            seconds = time.process_time() - start
            ray, ray_error = powers(place, place.scene, frequency, "ray", beams=beams)
            once, once_error = powers(place, black, frequency, "wave", **limits)
            dark, error = place.air & (ray == 0), np.hypot(wave_error, ray_error)
            both = place.air & (ray > 0) & (wave > 0)
            rows.append([
                f"{name}, {frequency / 1e9:g} GHz", f"{dark.sum() / place.air.sum():.0%}",
                f"{np.mean(wave[dark] > 0):.0%}" if dark.any() else "-", decibel(wave[dark], wave_error[dark]),
                decibel(once[dark], once_error[dark]),
                *(f"{np.mean((sign * (wave - ray) > 4 * error)[both]):.1%}" for sign in (-1, 1)),
                f"{np.median(10 / np.log(10) * (wave_error / wave)[both]):.1f}", f"{seconds:.0f}",
            ])  # fmt: skip
            if frequency == FREQUENCIES[name][0]:
                with np.errstate(divide="ignore", invalid="ignore"):
                    shown = [np.ma.masked_invalid(10 * np.log10(np.where(place.air, p, 0))) for p in (wave, ray)]
                low, high = np.ma.median(shown[1]) - 35, np.ma.median(shown[1]) + 15
                title = f"{name}, {frequency / 1e9:g} GHz: "
                draw_map(line[0], place, shown[0], title + "wave", low, high)
                draw_map(line[1], place, shown[1], title + "ray", low, high)
                draw_map(line[2], place, shown[0] - shown[1], title + "wave - ray, dB", -6, 6, "RdBu_r")
    save(figure, out / "steinberg-coverage.png", dpi=72)
    table(
        f"Coverage by paths, and by {beams} rays; means over cells in the air that no ray reaches, in dB over free "
        "space at 1 m (error); shares of lit cells in which one is above the other by 4 standard errors",
        ["place", "dark to rays", "of them lit by waves", "wave there, dB", "walls black, dB", "ray above",
         "wave above", "error of a lit cell, dB", "CPU s"], rows,
    )  # fmt: skip


def main(out: Path, quick: bool) -> None:
    """Draw all figures into ``out`` and print all tables."""
    out.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore", DoubtWarning)  # slits of flatland are longer than any Fresnel zone
    for part in (slit_methods, two_stages, cost, energy, convergence, trials, maps):
        part(out, quick)


if __name__ == "__main__":
    run(main, OUT, __doc__)
