"""Compare the engine with the wave equation: a box of cylinders, 20 x 20 wavelengths, optical depth 2.

    python tests/validate_wave_solver.py --placements 20000 --out validation

solves the scene placement by placement, runs the engine on it, prints how well they agree and draws
covariance.png, intensity.png, near-field.png and mean-inside.png. The placements are kept in wave-solver.npz;
``--wave FILE`` takes them from there (or from tests/data/wave_solver_2d_od2.npz), ``--against FILE`` compares
with such a file in place of the engine.
"""

import argparse
import os
import time
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import matplotlib  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from references.mean_wave import coherent_field  # noqa: E402

import specklegen as sg  # noqa: E402
from specklegen.oracles.cylinder import Cylinder  # noqa: E402
from specklegen.oracles.wave_ensemble import CylinderGas, ensemble  # noqa: E402
from specklegen.oracles.wave_solver import PlaneLights, directions_of  # noqa: E402

HALF, MEAN_FREE_PATH = 10.0, 10.0
CYLINDER = Cylinder.resonant(0.02)
LIGHT_DEG = np.array([0.0, 1.0, 4.0, 20.0])
VIEW_DEG = np.arange(0.0, 360.0, 5.0)
LINE = np.stack([np.linspace(-15, 15, 61), np.full(61, 15.0)], axis=1)
NEIGHBOURS = (160.0, 165.0, 195.0, 200.0)  # of the backscattering peak of light 0
CLEAR = 5.0  # degrees about the light, left out of single views: the mean's spike

Result = dict[str, np.ndarray]
"""C complex[V, V, L], mean complex[V, L], I_var float[V, L], near_C and near_I_var: the oracle's names."""


def solve_waves(placements: int, seed: int, workers: int | None) -> Result:
    """Solve the wave equation in random placements."""
    gas = CylinderGas.with_mean_free_path(CYLINDER, (-HALF, -HALF), (HALF, HALF), MEAN_FREE_PATH)
    views = directions_of(np.deg2rad(VIEW_DEG))
    sensors = {"": lambda s: s.far_field(views), "near_": lambda s: s.near_field(LINE)}
    lights = PlaneLights(directions_of(np.deg2rad(LIGHT_DEG)))
    found = ensemble(gas, lights, sensors, placements=placements, seed=seed, workers=workers, progress=True)
    result: Result = {"placements": np.array(found[""].placements), "light_deg": LIGHT_DEG, "view_deg": VIEW_DEG}
    for prefix, moments in found.items():
        result |= {f"{prefix}C": moments.covariance, f"{prefix}C_se_re": moments.covariance_error.real,
                   f"{prefix}C_se_im": moments.covariance_error.imag, f"{prefix}I_var": moments.intensity,
                   f"{prefix}I_var_se": moments.intensity_error,
                   f"{prefix}I_var_batches": np.moveaxis(moments.intensity_batches, 0, -1)}  # fmt: skip
    return result | {"mean": found[""].mean, "near_mean_scattered": found["near_"].mean}


def run_engine(paths: int, seed: int) -> Result:
    """Covariance, reversed paths included, and mean of the same scene by the engine."""
    theta = np.linspace(0, np.pi, 721)
    scatterer = sg.Tabulated(theta=theta, amplitude=CYLINDER.amplitude(theta))
    corner = (HALF, HALF)
    medium = sg.Box(lower=(-HALF, -HALF), upper=corner, mean_free_path=MEAN_FREE_PATH, albedo=1.0, scatterer=scatterer)
    light = sg.PlaneWaves(directions=directions_of(np.deg2rad(LIGHT_DEG)))
    far = sg.FarField(directions=directions_of(np.deg2rad(VIEW_DEG)))
    result: Result = {"light_deg": LIGHT_DEG, "view_deg": VIEW_DEG}
    for prefix, sensor in (("", far), ("near_", sg.NearField(points=LINE))):
        scene = sg.Scene(wavelength=CYLINDER.wavelength, medium=medium, illumination=light, sensor=sensor)
        covariance = sg.covariance(scene, paths=paths, seed=seed, reverse=True)
        result |= in_oracle_order(prefix, covariance.value, covariance.standard_error)
        if not prefix:
            result["mean"] = sg.mean_field(scene).T
    return result


def in_oracle_order(prefix: str, value: np.ndarray, error: np.ndarray) -> Result:
    """C[v1, v2, j] = value[0, v1, j, v2] and I[v, j] = value[j, v, j, v], from arrays [T, V, T, V]."""
    return {f"{prefix}C": np.transpose(value[0], (0, 2, 1)), f"{prefix}I_var": np.einsum("tvtv->vt", value).real,
            f"{prefix}I_var_se": np.einsum("tvtv->vt", error).real}  # fmt: skip


def report(wave: Result, other: Result) -> dict[str, np.ndarray]:
    """Agreement of ``other`` with the wave solver, one figure per light unless said."""
    step = 2 * np.pi / len(VIEW_DEG)
    off = np.abs((VIEW_DEG[:, None] - LIGHT_DEG + 180) % 360 - 180) > CLEAR
    error = np.hypot(wave["I_var_se"], other["I_var_se"])
    single = np.where(off, other["I_var"] / wave["I_var"] - 1, 0)
    batches = wave["I_var_batches"].sum(axis=0)
    near = other["near_I_var"] / wave["near_I_var"] - 1
    return {
        "total intensity": other["I_var"].sum(axis=0) * step,
        "wave solver's": wave["I_var"].sum(axis=0) * step,
        "its standard error": batches.std(axis=1, ddof=1) / np.sqrt(batches.shape[1]) * step,
        "single views, worst relative error": np.abs(single).max(axis=0),
        "largest standard error of one": (error / wave["I_var"]).max(axis=0),
        "single views, rms z": rms(np.where(off, (other["I_var"] - wave["I_var"]) / error, np.nan)),
        "covariance, correlation": np.array([overlap(wave["C"][..., j], other["C"][..., j]) for j in range(4)]),
        "mean, relative error": np.linalg.norm(other["mean"] - wave["mean"], axis=0)
        / np.linalg.norm(wave["mean"], axis=0),
        "near field, relative error": near.mean(axis=0),
        "near field, rms z": rms(
            (other["near_I_var"] - wave["near_I_var"]) / np.hypot(wave["near_I_var_se"], other["near_I_var_se"])
        ),
        "backscattering peak of light 0; wave solver's": np.array([peak(other), peak(wave)]),
    }


def rms(z: np.ndarray) -> np.ndarray:
    """Root mean square over the first axis, NaN left out."""
    return np.sqrt(np.nanmean(z**2, axis=0))


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Correlation |<a, b>| / (|a| |b|) of two matrices."""
    a, b = (x.astype(np.complex128) for x in (a, b))  # stored ones are complex64
    return float(np.abs(np.vdot(a, b)) / (np.linalg.norm(a) * np.linalg.norm(b)))


def peak(result: Result) -> float:
    """Intensity at v = -i over the mean of its neighbours, light 0."""
    intensity = result["I_var"][:, 0]
    return float(intensity[VIEW_DEG == 180.0][0] / intensity[np.isin(VIEW_DEG, NEIGHBOURS)].mean())


def draw_covariance(wave: Result, other: Result, name: str, out: Path) -> None:
    """|C| for the four pairs of lights, the wave solver above."""
    figure, axes = plt.subplots(2, 4, figsize=(13, 6.5), sharex=True, sharey=True, layout="constrained")
    for j, column in enumerate(axes.T):
        top = np.abs(wave["C"][..., j]).max()
        for axis, result, label in zip(column, (wave, other), ("wave solver", name), strict=True):
            picture = axis.imshow(np.abs(result["C"][..., j]), vmin=0, vmax=top, extent=(0, 360, 360, 0))
            axis.set_title(f"{label}: 0° and {LIGHT_DEG[j]:g}°", fontsize=9)
        figure.colorbar(picture, ax=column, location="bottom")
    save(figure, out / "covariance.png")


def draw_intensity(wave: Result, other: Result, name: str, out: Path) -> None:
    """Intensity, its ratio, and the mean over the views."""
    figure, axes = plt.subplots(3, 4, figsize=(13, 8), sharex=True, layout="constrained")
    for j, (high, middle, low) in enumerate(axes.T):
        high.errorbar(VIEW_DEG, wave["I_var"][:, j], wave["I_var_se"][:, j], fmt=".", label="wave solver")
        high.plot(VIEW_DEG, other["I_var"][:, j], label=name)
        ratio = other["I_var"][:, j] / wave["I_var"][:, j]
        error = np.hypot(wave["I_var_se"][:, j], other["I_var_se"][:, j]) / wave["I_var"][:, j]
        middle.errorbar(VIEW_DEG, ratio, error, fmt=".")
        middle.axhline(1, color="0.6")
        low.semilogy(VIEW_DEG, np.abs(wave["mean"][:, j]), ".")
        low.semilogy(VIEW_DEG, np.abs(other["mean"][:, j]))
        high.set_title(f"light {LIGHT_DEG[j]:g}°", fontsize=9)
        low.set_xlabel("view (°)")
    for axis, label in zip(axes[:, 0], ("intensity", f"{name} / wave solver", "|mean|"), strict=True):
        axis.set_ylabel(label)
    axes[0, 0].legend(fontsize=8)
    save(figure, out / "intensity.png")


def draw_near_field(wave: Result, other: Result, name: str, out: Path) -> None:
    """Intensity along the line behind the box."""
    figure, axes = plt.subplots(1, 4, figsize=(13, 3.2), sharey=True, layout="constrained")
    for j, axis in enumerate(axes):
        axis.errorbar(LINE[:, 0], wave["near_I_var"][:, j], wave["near_I_var_se"][:, j], fmt=".", label="wave solver")
        axis.plot(LINE[:, 0], other["near_I_var"][:, j], label=name)
        axis.set_title(f"light {LIGHT_DEG[j]:g}°", fontsize=9)
        axis.set_xlabel("x (wavelengths)")
    axes[0].set_ylabel("intensity at z = 15")
    axes[0].legend(fontsize=8)
    save(figure, out / "near-field.png")


def draw_mean_inside(placements: int, seed: int, workers: int | None, out: Path) -> dict[str, np.ndarray]:
    """Mean field of a line source inside the medium against distance, [Bar19] Fig. 4b; cylinders of order 0."""
    half = 24.0
    monopole = Cylinder.resonant(CYLINDER.radius, order=0)
    gas = CylinderGas.with_mean_free_path(monopole, (-half, -half), (half, half), MEAN_FREE_PATH)
    field = coherent_field(gas, np.arange(1.0, 20.0), placements=placements, seed=seed, workers=workers, progress=True)
    (size, size_error), (phase, phase_error) = field.magnitude(), field.phase()
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    left.errorbar(field.radii, size, size_error, fmt=".", label="wave solver")
    left.semilogy(field.radii, np.exp(-field.radii / (2 * MEAN_FREE_PATH)), label=r"$e^{-\sigma_t r/2}$")
    left.set_ylabel(r"|mean| $\sqrt{r}$")
    left.legend(fontsize=8)
    right.errorbar(field.radii, phase, phase_error, fmt=".")
    right.axhline(0, color="0.6")
    right.set_ylabel("phase beyond Re K r (rad)")
    for axis in (left, right):
        axis.set_xlabel("distance (wavelengths)")
    save(figure, out / "mean-inside.png")
    slope = np.array(field.decay()) * 2 * MEAN_FREE_PATH
    return {"mean inside: decay over sigma_t / 2, and its error": slope,
            "mean inside: largest phase error (rad)": np.abs(phase).max(keepdims=True),
            "mean inside: largest standard error of the phase": phase_error.max(keepdims=True)}  # fmt: skip


def save(figure: plt.Figure, path: Path) -> None:
    """Write and close a figure."""
    figure.savefig(path, dpi=80)
    plt.close(figure)


def main(arguments: list[str] | None = None) -> None:
    """Read the command line, compute, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--placements", type=int, default=4096, help="of the box; at least 128")
    parser.add_argument("--inside", type=int, default=1024, help="placements for the mean inside a medium, 0: none")
    parser.add_argument("--paths", type=int, default=50_000, help="of the engine")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, help="threads; by default one per core")
    parser.add_argument("--wave", type=Path, help="a stored result of the wave solver, in place of a new one")
    parser.add_argument("--against", type=Path, help="a stored result to compare with, in place of the engine")
    parser.add_argument("--out", type=Path, default=Path("validation"))
    chosen = parser.parse_args(arguments)
    chosen.out.mkdir(parents=True, exist_ok=True)

    begin = time.perf_counter()
    if chosen.wave:
        wave = dict(np.load(chosen.wave))
    else:
        wave = solve_waves(chosen.placements, chosen.seed, chosen.workers)
        np.savez_compressed(chosen.out / "wave-solver.npz", **wave)
    solved = time.perf_counter()
    other = dict(np.load(chosen.against)) if chosen.against else run_engine(chosen.paths, chosen.seed)
    name = chosen.against.stem if chosen.against else "engine"
    print(f"wave solver {solved - begin:.1f} s, {name} {time.perf_counter() - solved:.1f} s")

    table = report(wave, other)
    for draw in (draw_covariance, draw_intensity, draw_near_field):
        draw(wave, other, name, chosen.out)
    if chosen.inside:
        table |= draw_mean_inside(chosen.inside, chosen.seed, chosen.workers, chosen.out)
    for row, values in table.items():
        print(f"{row:50s}", *(f"{value:10.4g}" for value in values))


if __name__ == "__main__":
    main()
