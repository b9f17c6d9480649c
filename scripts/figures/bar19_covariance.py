"""Figures 2, 8 and 9 of [Bar19]: covariance of the far field of a box in flatland, from every side.

Draws bar19-figure-8.png (optical depth 2 beside the wave equation), bar19-figure-2.png (optical depth 0.5),
bar19-near-field.png (points of a line) and bar19-figure-9.png (covariance of sampled fields), and prints rows A03,
A04, A05, A07 of docs/notes/validation.md.

Run it by itself: python scripts/figures/bar19_covariance.py --out docs/images [--quick]
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _bar19 import LIGHTS, OUT, REFERENCE, Row, clock, flatland_box, flatland_scene, report, save
from _command import run
from references.electric_field import electric_field
from scipy.stats import kstest

import specklegen as sg
from specklegen.oracles import box_algorithms
from specklegen.oracles.box_media import box, henyey_greenstein
from specklegen.oracles.cylinder import Cylinder
from specklegen.oracles.wave_ensemble import CylinderGas, ensemble
from specklegen.oracles.wave_solver import PlaneLights, directions_of

VIEWS = np.arange(0.0, 360.0)
COARSE = VIEWS[::5]  # of the stored wave solution
CYLINDER = Cylinder.resonant(0.02)
NEIGHBOURS = (160, 165, 195, 200)  # of the backscattering peak
LEAST = {2.0: (0.995, 0.995, 0.980, 0.935)}  # correlation of covariance matrices that the oracle promises


def cylinder_scene(mean_free_path: float, views: np.ndarray) -> sg.Scene:
    """The box with the wave solver's cylinders."""
    theta = np.linspace(0, np.pi, 721)
    cylinders = sg.media.Tabulated(theta=theta, amplitude=CYLINDER.amplitude(theta))
    return flatland_scene(flatland_box(10.0, mean_free_path, cylinders), views)


def waves(mean_free_path: float, placements: int) -> dict[str, np.ndarray]:
    """C, I_var and I_var_se of the wave equation, in the order of the stored solution."""
    gas = CylinderGas.with_mean_free_path(CYLINDER, (-10.0, -10.0), (10.0, 10.0), mean_free_path)
    views = directions_of(np.deg2rad(COARSE))
    lights = PlaneLights(directions_of(np.deg2rad(LIGHTS)))
    found = ensemble(gas, lights, {"": lambda s: s.far_field(views)}, placements=placements, seed=0, workers=1)[""]
    return {"C": found.covariance, "I_var": found.intensity, "I_var_se": found.intensity_error,
            "I_var_batches": np.moveaxis(found.intensity_batches, 0, -1)}  # fmt: skip


def draw_box(mean_free_path: float, wave: dict, paths: int, path: Path, wave_name: str) -> list[Row]:
    """Covariance matrices and intensities, the engine's below the wave equation's."""
    fine, coarse = (cylinder_scene(mean_free_path, views) for views in (VIEWS, COARSE))
    sg.statistics.covariance(coarse, paths=64, reverse=True, pairs=[(0, 0, 0, 0)], threads=1)  # compiles
    with clock() as spent:
        _, block = next(sg.statistics.covariance_blocks(fine, rows=len(VIEWS), paths=paths, reverse=True, threads=1))
    with clock() as longer:
        many = sg.statistics.covariance(coarse, paths=8 * paths, seed=1, reverse=True, threads=1)
    ours, intensity, error = block.value, many.intensity.T, np.einsum("tvtv->vt", many.standard_error)
    depth = 20 / mean_free_path
    figure, axes = plt.subplots(3, 4, figsize=(13, 10), layout="constrained")
    agreements, z, totals = [], [], []
    for j, (top, middle, bottom) in enumerate(axes.T):
        pictures = np.abs(wave["C"][..., j]), np.abs(ours[::5, j, ::5])
        highest = np.quantile(pictures[0], 0.995)
        names = wave_name, f"specklegen, {paths} paths, {spent.seconds:.0f} s CPU"
        for axis, picture, name in zip((top, middle), pictures, names, strict=True):
            shown = axis.imshow(picture, vmin=0, vmax=highest, extent=(0, 360, 360, 0), interpolation="nearest")
            axis.set_title(f"{name}\n|C|, lights 0° and {LIGHTS[j]:g}°", fontsize=8)
            axis.set(xticks=range(0, 361, 90), yticks=range(0, 361, 90))
        figure.colorbar(shown, ax=[top, middle], location="right", shrink=0.6)
        bottom.errorbar(COARSE, wave["I_var"][:, j], 2 * wave["I_var_se"][:, j], fmt=".k", ms=4, label=wave_name)
        bottom.plot(COARSE, intensity[:, j], "C3", lw=1, label="specklegen")
        bottom.set(xlabel="view (°)", title=f"intensity, light {LIGHTS[j]:g}°, ± 2 se", xticks=range(0, 361, 90))
        a, b = wave["C"][..., j].astype(complex), many.value[0, :, j]
        agreements.append(abs(np.vdot(a, b)) / np.linalg.norm(a) / np.linalg.norm(b))
        clear = np.abs((COARSE - LIGHTS[j] + 180) % 360 - 180) > 5
        gap = intensity[:, j] - wave["I_var"][:, j]
        z.append((gap / np.hypot(error[:, j], wave["I_var_se"][:, j]))[clear])
        sums = wave["I_var_batches"][:, j].sum(axis=0)
        totals.append((intensity[:, j].mean() / wave["I_var"][:, j].mean() - 1,
                       sums.std(ddof=1) / np.sqrt(len(sums)) / sums.mean(),
                       np.abs(gap / wave["I_var"][:, j])[clear].max(),
                       _beyond(gap, wave["I_var"][:, j], np.hypot(error[:, j], wave["I_var_se"][:, j]))[clear].max()))
    axes[0, 0].set_ylabel("view (°)")
    axes[2, 0].set_ylabel("length per radian")
    axes[2, 0].legend(fontsize=8, loc="lower center")
    save(figure, path, 66)
    ratio, ratio_error, single, beyond = np.array(totals).T
    rms = [float(np.sqrt(np.mean(np.square(each)))) for each in z]
    limit = LEAST.get(depth)
    return [
        Row("A07", f"OD {depth:g}, {8 * paths} paths: correlation of C, 4 pairs of lights", _list(agreements, 4),
            f"≥ {_list(limit, 3)}" if limit else "none given (new waves)", "", longer.seconds),
        Row("A07", f"OD {depth:g}: total intensity against the wave equation, 4 lights",
            " ".join(f"{100 * r:+.2f} %" for r in ratio), "± 2 %",
            "wave solver's error " + " ".join(f"{100 * e:.2f} %" for e in ratio_error), longer.seconds),
        Row("A07", f"OD {depth:g}: worst single view, 5° off the light", " ".join(f"{100 * s:.1f} %" for s in single),
            "≤ 4 % and noise", f"beyond 4 %: z ≤ {_list(beyond, 1)}; from 0: rms z {_list(rms, 2)}", longer.seconds),
        Row("A07", f"OD {depth:g}: backscattering peak over its neighbours",
            f"{_peak(COARSE, intensity[:, 0]):.3f}", f"{_peak(COARSE, wave['I_var'][:, 0]):.3f} (waves)",
            "limit ± 0.03 at OD 2", longer.seconds),
    ]  # fmt: skip


def _beyond(gap: np.ndarray, intensity: np.ndarray, error: np.ndarray) -> np.ndarray:
    """By how many standard errors a view is more than 4 % off."""
    return np.clip(np.abs(gap) - 0.04 * intensity, 0, None) / error


def _list(values, digits: int) -> str:
    return " ".join(f"{v:.{digits}f}" for v in values)


def _peak(views: np.ndarray, intensity: np.ndarray) -> float:
    return float(intensity[views == 180][0] / intensity[np.isin(views, NEIGHBOURS)].mean())


def draw_fields(out: Path, quick: bool) -> list[Row]:
    """Figure 9: covariance of n fields of Algorithm 2, and of electric-field Monte Carlo, against Algorithm 1."""
    scene = flatland_scene(flatland_box(10.0, 10.0), COARSE, (0.0, 4.0))
    n, paths = (200, 100) if quick else (1000, 250)
    with clock() as direct:
        truth = sg.statistics.covariance(scene, paths=30 * n, seed=1, reverse=False, threads=1)
    trace = np.einsum("tvtv->t", truth.value).real
    noise = np.sqrt(np.square(truth.standard_error[0]).sum(axis=(0, 2)) / (trace[0] * trace))
    with clock() as drawn:
        stack = sg.render(scene, paths=paths, realizations=n, sampler="paths", reverse=False, seed=2, threads=1)
    u = stack.field.astype(complex)
    counts = [c for c in (50, 100, 200, 500, 1000) if c <= n]
    errors = np.array([_distance(u[:c], truth.value, trace) for c in counts])
    matter = box((-10, -10), (10, 10), extinction=0.1, particles=(henyey_greenstein(0.0, 2),))
    setup = box_algorithms.Setup(matter, 1.0, *(box_algorithms.Far(directions_of(np.deg2rad(a)))
                                                for a in (np.zeros(1), COARSE)))  # fmt: skip
    rng = np.random.default_rng(3)
    with clock() as lone:
        e = np.concatenate([electric_field(setup, 100, 50, rng) for _ in range(n // 100)])
    figure, axes = plt.subplots(2, 4, figsize=(13, 6.4), layout="constrained")
    highest = np.abs(truth.value).max()
    pictures = {
        "Algorithm 1": truth.value[0],
        f"{n} fields of Algorithm 2": np.einsum("nv,nsw->vsw", u[:, 0], u.conj()) / n,
    }
    for axes_of, (name, c) in zip(axes[:, :2].T, pictures.items(), strict=True):
        for axis, part, light in zip(axes_of, np.moveaxis(np.abs(c), 1, 0), (0, 4), strict=True):
            axis.imshow(part, vmin=0, vmax=highest, extent=(0, 360, 360, 0), interpolation="nearest")
            axis.set_title(f"{name}\n|C|, lights 0° and {light}°", fontsize=8)
    c = e.T @ e.conj() / len(e)
    axes[0, 2].imshow(np.abs(c), vmin=0, vmax=highest, extent=(0, 360, 360, 0), interpolation="nearest")
    axes[0, 2].set_title(f"{len(e)} fields of electric-field MC\n|C|, light 0°: diagonal only", fontsize=8)
    axes[1, 2].plot(COARSE, truth.intensity[0], "k", label="Algorithm 1")
    axes[1, 2].plot(COARSE, c.diagonal().real, ".C1", ms=4, label="electric-field MC")
    axes[1, 2].plot(COARSE, np.square(np.abs(u[:, 0])).mean(axis=0), ".C0", ms=4, label="Algorithm 2")
    axes[1, 2].set(title="intensity, light 0°: all three agree", xlabel="view (°)")
    axes[1, 2].legend(fontsize=8)
    axes[0, 3].loglog(counts, errors, "o", label=["lights 0°, 0°", "lights 0°, 4°"])
    axes[0, 3].loglog(counts, np.array(counts) ** -0.5, "k", lw=1, label=r"$n^{-1/2}$")
    axes[0, 3].set(xlabel="fields n", title=r"$\|\hat C-C\|_F/\sqrt{\mathrm{tr}\,C_{11}\,\mathrm{tr}\,C_{22}}$")
    axes[0, 3].legend(fontsize=8)
    intensity = (np.square(np.abs(u)) / truth.intensity).ravel()
    axes[1, 3].hist(intensity, np.linspace(0, 8, 50), density=True, log=True, color="C0", label="Algorithm 2")
    axes[1, 3].semilogy(np.linspace(0, 8), np.exp(-np.linspace(0, 8)), "k", lw=1, label=r"$e^{-I/\langle I\rangle}$")
    axes[1, 3].set(title="intensity over its mean", ylim=(1e-4, 2))
    axes[1, 3].legend(fontsize=8)
    save(figure, out / "bar19-figure-9.png", 62)

    bound = 1.1 * n**-0.5 + noise
    seconds = direct.seconds + drawn.seconds
    diagonal = (np.square(np.abs(e)).mean(axis=0) - truth.intensity[0]) / np.hypot(
        np.square(np.abs(e)).std(axis=0) / np.sqrt(len(e)), truth.standard_error[0].diagonal(axis1=0, axis2=2)[0]
    )
    alone, forced = (len(e) * _neighbours(matrix) for matrix in (c, truth.value[0, :, 0]))
    entries = np.einsum("nv,nsw->nvsw", u[:, 0, ::6], u[:, :, ::6].conj())
    gap = np.abs(entries.mean(axis=0) - truth.value[0, ::6, :, ::6])
    z = gap / np.hypot(np.sqrt(entries.var(axis=0) / n), truth.standard_error[0, ::6, :, ::6])
    square = (u**2).mean(axis=0) / truth.intensity
    fourth = np.square(np.square(np.abs(u))).mean(axis=0) / np.square(np.square(np.abs(u)).mean(axis=0))
    view = np.square(np.abs(u[:, 0, ::6])) / truth.intensity[0, ::6]
    return [
        Row("A03", f"{n} fields of Algorithm 2 against Algorithm 1, lights (0°, 0°), (0°, 4°)", _list(errors[-1], 4),
            f"≤ {_list(bound, 4)}", f"entries: largest z {z.max():.1f} of {z.size}, rms "
            f"{np.sqrt(np.mean(z**2)):.2f}", seconds),
        Row("A04", f"electric-field Monte Carlo, {len(e)} fields: diagonal", "against Algorithm 1", "equal",
            f"largest z {np.abs(diagonal).max():.1f} of {diagonal.size} (limit 5.9), rms "
            f"{np.sqrt(np.mean(diagonal**2)):.2f}",
            lone.seconds),
        Row("A04", "the same, neighbouring views: n |C|² over both intensities", f"{alone:.2f}", "1 (only noise)",
            f"± {len(COARSE) ** -0.5:.2f}; with Algorithm 1's C it were {1 + forced:.0f}", lone.seconds),
        Row("A05", f"Gaussianity, {n} fields of {paths} paths", f"⟨u²⟩/I rms {np.sqrt(np.mean(np.abs(square)**2)):.4f}"
            f"; ⟨I²⟩/⟨I⟩² {fourth.mean():.3f}; contrast {np.sqrt(fourth.mean() - 1):.3f}",
            f"{(2 / n) ** 0.5:.4f} (noise); 2 + O(1/paths); 1", "Kolmogorov-Smirnov, 12 views: smallest p "
            f"{min(kstest(i, 'expon').pvalue for i in view.T):.2f}", drawn.seconds),
    ]  # fmt: skip


def _distance(u: np.ndarray, truth: np.ndarray, trace: np.ndarray) -> np.ndarray:
    """Of the sample covariance from the true one, Frobenius over traces, float64[L]."""
    gap = np.einsum("nv,nsw->vsw", u[:, 0], u.conj()) / len(u) - truth[0]
    return np.sqrt(np.square(np.abs(gap)).sum(axis=(0, 2)) / (trace[0] * trace))


def _neighbours(c: np.ndarray) -> float:
    """Squared correlation of views 5 degrees apart, averaged over all of them."""
    power = c.diagonal().real
    return float(np.mean(np.abs(np.roll(c, -1, axis=1).diagonal()) ** 2 / (power * np.roll(power, -1))))


def draw_near_field(wave: dict, paths: int, path: Path) -> list[Row]:
    """Covariance between points of a line behind the box, light 0 against each: the ridge where they lie collinear."""
    theta, points = np.linspace(0, np.pi, 721), wave["near_pos"]
    box_of = flatland_box(10.0, 10.0, sg.media.Tabulated(theta=theta, amplitude=CYLINDER.amplitude(theta)))
    scene = flatland_scene(box_of, COARSE).replace(sensor=sg.sensors.NearField(points=points))
    with clock() as spent:
        found = sg.statistics.covariance(scene, paths=paths, seed=3, reverse=True, threads=1)
    x, (pitch, distance) = points[:, 0], (points[1, 0] - points[0, 0], points[0, 1])
    steps = np.round(np.subtract.outer(x, x).T / pitch).astype(int)
    figure, axes = plt.subplots(2, 4, figsize=(13, 6.5), layout="constrained", sharex=True, sharey=True)
    agreements, shifts = [], []
    for j, light in enumerate(LIGHTS):
        pair = wave["near_C"][..., j], found.value[0, :, j]
        power = [np.square(np.abs(each)).sum() for each in pair]
        power[1] -= np.square(found.standard_error[0, :, j]).sum()
        agreements.append(abs(np.vdot(*pair)) / np.sqrt(power[0] * power[1]))
        for row, each in enumerate(pair):
            along = [np.abs(each)[steps == n].mean() for n in range(30)]
            shifts.append(pitch * int(np.argmax(along)))
            axes[row, j].imshow(np.abs(each), origin="lower", extent=[x[0], x[-1], x[0], x[-1]])
            axes[row, j].plot(x, x - distance * np.tan(np.deg2rad(light)), "w:", lw=0.8)
            title = f"{('waves', 'paths')[row]}, {light:g}°"
            axes[row, j].set(xlim=(x[0], x[-1]), ylim=(x[0], x[-1]), title=title)
    save(figure, path)
    return [Row("A07", f"near-field line, {paths} paths, light 0 against (0, 1, 4, 20)°: correlation of C",
                " ".join(f"{each:.4f}" for each in agreements), "none given (as far views: 0.995 to 0.935)", "",
                spent.seconds),
            Row("A07", "the same: ridge at the shift, in wavelengths", " ".join(f"{each:g}" for each in shifts[1::2]),
                " ".join(f"{each:g}" for each in shifts[::2]) + " (waves)", f"± {pitch:g}, the pitch of the points",
                spent.seconds)]  # fmt: skip


def main(out: Path, quick: bool) -> None:
    """Draw, and print rows; ``quick`` takes few paths and placements."""
    stored = dict(np.load(REFERENCE / "wave_solver_2d_od2.npz"))
    paths = 400 if quick else 12_000
    rows = draw_box(10.0, stored, paths, out / "bar19-figure-8.png", "wave equation, 20 000 placements")
    rows += draw_near_field(stored, 2 * paths, out / "bar19-near-field.png")
    placements = 256 if quick else 4096
    with clock() as solved:
        thin = waves(40.0, placements)
    name = f"wave equation, {placements} placements, {solved.seconds:.0f} s CPU"
    rows += draw_box(40.0, thin, paths, out / "bar19-figure-2.png", name)
    report(rows + draw_fields(out, quick), "bar19_covariance")


if __name__ == "__main__":
    run(main, OUT, __doc__)
