"""Figures and tables of single-realization stochastic FDTD [Tan13].

Draws the figures of docs/fdtd.md and prints its numbers as JSON. Times are CPU seconds of one process on one thread;
quote ratios.

Run it by itself: python scripts/figures/tan13.py --out docs/fdtd [--quick]
"""

import json
import math
import os
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import matplotlib  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from _command import run  # noqa: E402

from specklegen.fdtd import (  # noqa: E402
    MeanField,
    Pulse,
    RandomLayer,
    ScatteredField,
    coherent_transmission,
    courant_limit,
    equivalent_slab,
    illuminate,
    monte_carlo_mean,
    out_of_phase,
    phase_variance,
    sample_moments,
    single_delay,
    single_realization,
    slab_fresnel,
    transfer_matrix,
)

CLAIMS = {  # name: (correlation length in um, modulated)
    "short correlation length": (0.02, True),
    "long correlation length": (3.0, True),
    "long, unmodulated pulse": (3.0, False),
}
OUT = Path("docs/fdtd")
SIDES = ("back", "forward")
K0 = 2 * math.pi / 0.6


def main(out: Path, quick: bool) -> None:
    """Draw every figure into ``out`` and print the numbers of the tables; ``quick`` takes a tenth of the media."""
    out.mkdir(parents=True, exist_ok=True)
    media = 400 if quick else 4000
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*order not valid|.*white from cell to cell")
        numbers = {
            "claims": claims(out, media),
            "sweep": sweep(out, media),
            "run times": run_times(out, media, quick),
            "slab": slab(out),
            "single delay": delays(),
            "coherent": coherent(out, quick),
            "courant": limits(),
        }
    print(json.dumps(numbers, indent=1))


def difference(a: ScatteredField, b: ScatteredField, side: str) -> float:
    """Relative l2 over time."""
    return float(np.linalg.norm(getattr(a, side) - getattr(b, side)) / np.linalg.norm(getattr(b, side)))


def error_bar(mean: MeanField, side: str) -> float:
    """Standard error of a mean, relative l2 over time."""
    return float(np.linalg.norm(getattr(mean, f"{side}_error")) / np.linalg.norm(getattr(mean, side)))


def claims(out: Path, media: int) -> dict[str, Any]:
    """Mean scattered fields of the paper's three claims: brute force with its error band, both orders."""
    figure, axes = plt.subplots(2, len(CLAIMS), figsize=(13, 6), sharex="col")
    table = {}
    for column, (name, (lc, modulated)) in zip(axes.T, CLAIMS.items(), strict=True):
        layer, pulse = RandomLayer(correlation_length=lc), Pulse(modulated=modulated)
        brute = monte_carlo_mean(layer, media, pulse=pulse, threads=1)
        kappa = layer.sample(media, 0)
        orders = {
            order: single_realization(layer, order, covariance="sample", kappa=kappa, pulse=pulse)
            for order in (1, 2)
        }
        population = single_realization(layer, pulse=pulse)
        peak = np.abs(brute.incident).max()
        for axis, side in zip(column, SIDES, strict=True):
            mean, error = getattr(brute, side) / peak, getattr(brute, f"{side}_error") / peak
            axis.fill_between(brute.time, mean - error, mean + error, color="0.8", label="standard error")
            axis.plot(brute.time, mean, "k", lw=1.6, label=f"brute force, {media} media")
            axis.plot(brute.time, getattr(orders[1], side) / peak, ":", label="first order")
            axis.plot(brute.time, getattr(orders[2], side) / peak, "--", label="second order")
            axis.set_ylabel(f"mean {side} field / incident peak")
        column[0].set_title(f"{name}: $L_c$ = {lc} µm")
        column[1].set_xlabel("$c_0 t$ (µm)")
        centre = 2 * pulse.duration if modulated else 3 * pulse.duration
        start = pulse.delay * pulse.duration
        column[1].set_xlim(start - centre, start + centre + 11)
        verdict = orders[2].validity
        assert verdict is not None
        predicted = {"back": verdict["back_error"], "forward": verdict["forward_error"]}
        table[name] = {
            f"{side}": {
                "first": difference(orders[1], brute, side),
                "second": difference(orders[2], brute, side),
                "second, exact moments": difference(population, brute, side),
                "standard error": error_bar(brute, side),
                "predicted": predicted[side],
                "valid": verdict[side],
            }
            for side in SIDES
        } | {"phase variance": verdict["phase_variance"]}
    figure.legend(*axes[0, 0].get_legend_handles_labels(), ncols=4, loc="lower center", fontsize=9)
    figure.tight_layout(rect=(0, 0.05, 1, 1))
    figure.savefig(out / "claims.png", dpi=70)
    plt.close(figure)
    return table


def sweep(out: Path, media: int) -> list[dict[str, float]]:
    """Error of second order against the correlation length, with what the phase variance predicts."""
    rows = []
    for lc in (0.002, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 3.0, 10.0, 1000.0):
        layer = RandomLayer(correlation_length=lc)
        brute = monte_carlo_mean(layer, media, threads=1)
        kappa = layer.sample(media, 0)
        fields = [single_realization(layer, order, "frequency", "sample", kappa=kappa) for order in (1, 2)]
        v = phase_variance(layer, K0)
        row: dict[str, float] = {"L_c": lc, "V": v, "V/4": v / 4, "3V": 3 * v}
        for side in SIDES:
            row |= {
                f"{side} {order}": difference(field, brute, side) for order, field in enumerate(fields, 1)
            }
            row[f"{side} se"] = error_bar(brute, side)
        rows.append(row)
    figure, axis = plt.subplots(figsize=(6.5, 4.5))
    v = [row["V"] for row in rows]
    for side, color, law in (("back", "C0", "3V"), ("forward", "C1", "V/4")):
        axis.loglog(v, [row[f"{side} 2"] for row in rows], "o-", color=color, label=f"{side}, second order")
        axis.loglog(v, [row[law] for row in rows], "--", color=color, label=law)
        axis.loglog(v, [row[f"{side} se"] for row in rows], ":", color=color, label=f"{side}, standard error")
    axis.set_xlabel("phase variance V (rad²)")
    axis.set_ylabel("relative error of the mean field")
    axis.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(out / "validity.png", dpi=80)
    plt.close(figure)
    return rows


def cpu(function: Callable[[], Any], repeats: int = 3, warm: bool = True) -> tuple[float, Any]:
    """Shortest CPU time of a few calls, after one that compiles if ``warm``, and the result."""
    result, best = function() if warm else None, math.inf
    for _ in range(repeats):
        start = time.process_time()
        result = function()
        best = min(best, time.process_time() - start)
    return best, result


def run_times(out: Path, media: int, quick: bool) -> dict[str, Any]:
    """CPU time of every method, and forward error against run time at a short correlation length."""
    layer = RandomLayer(correlation_length=0.02)
    truth = monte_carlo_mean(layer, 20_000 if quick else 400_000, seed=77, threads=1)
    few = 40 if quick else 400
    kappa = layer.sample(media, 0)
    seconds = {
        "brute force, marches": cpu(lambda: monte_carlo_mean(layer, few, "fdtd", threads=1), 1)[0]
        * media
        / few,
        "brute force, transfer matrix": cpu(lambda: monte_carlo_mean(layer, media, threads=1))[0],
        "single realization, march": cpu(lambda: single_realization(layer))[0],
        "single realization, frequency": cpu(lambda: single_realization(layer, method="frequency"))[0],
        "single realization, march, sample covariance (media drawn)": cpu(
            lambda: single_realization(layer, covariance="sample", kappa=layer.sample(media, 0))
        )[0],
        "single delay, frequency": cpu(
            lambda: single_realization(layer, method="frequency", delays="single")
        )[0],
        "draw the media": cpu(lambda: layer.sample(media, 0))[0],
        "sample covariance": cpu(lambda: sample_moments(kappa))[0],
    }
    march, closed = seconds["single realization, march"], seconds["single realization, frequency"]
    ratios = {
        "marches / one march": seconds["brute force, marches"] / march,
        "marches / one march with sample covariance": seconds["brute force, marches"]
        / seconds["single realization, march, sample covariance (media drawn)"],
        "transfer matrix / closed form": seconds["brute force, transfer matrix"] / closed,
        "transfer matrix / one march": seconds["brute force, transfer matrix"] / march,
        "marches / transfer matrix": seconds["brute force, marches"]
        / seconds["brute force, transfer matrix"],
    }
    figure, axis = plt.subplots(figsize=(6.5, 4.5))
    curves: dict[str, list[tuple[float, float]]] = {}
    plan: tuple[tuple[Literal["transfer_matrix", "fdtd"], tuple[int, ...], int], ...]
    plan = (("transfer_matrix", (16, 64, 256, 1024, 4096, 16_384), 12), ("fdtd", (16, 64, 256, 1024), 6))
    for method, counts, seeds in plan:
        curves[method] = []
        for n in counts[:-2] if quick else counts:
            runs = [
                cpu(lambda m=method, k=n, s=seed: monte_carlo_mean(layer, k, m, seed=s, threads=1), 1, False)
                for seed in range(seeds)
            ]
            error = math.sqrt(np.mean([difference(field, truth, "forward") ** 2 for _, field in runs]))
            curves[method].append((min(spent for spent, _ in runs), error))
        axis.loglog(
            *zip(*curves[method], strict=True), "o-", label=f"brute force, {method.replace('_', ' ')}"
        )
    single: tuple[tuple[Literal["fdtd", "frequency"], str], ...] = (("fdtd", "s"), ("frequency", "D"))
    for method, marker in single:
        spent, field = cpu(lambda m=method: single_realization(layer, method=m))
        curves[f"single realization, {method}"] = [(spent, difference(field, truth, "forward"))]
        axis.loglog(spent, difference(field, truth, "forward"), marker, label=f"single realization, {method}")
    floor = error_bar(truth, "forward")
    axis.axhline(floor, color="0.6", ls=":", label="standard error of the reference")
    axis.set_xlabel("CPU time (s)")
    axis.set_ylabel("relative error of the mean forward field")
    axis.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(out / "error_vs_time.png", dpi=80)
    plt.close(figure)
    return {"seconds": seconds, "ratios": ratios, "curves": curves, "reference error": floor, "media": media}


def slab(out: Path) -> list[dict[str, float]]:
    """Convergence of the grid's slab to Fresnel's."""
    k0 = 2 * np.pi / np.linspace(0.45, 0.85, 200)
    rows = []
    for dx in (0.008, 0.004, 0.002, 0.001):
        r, t = transfer_matrix(np.full(round(3 / dx), (1.6 / 1.45) ** 2 - 1), k0 * dx, 1 / 1.45)
        exact_r, exact_t = slab_fresnel(1.6, 1.45, 3.0, k0)
        exact_r = exact_r * np.exp(1j * k0 * 1.45 * dx)  # the face is half a cell before the first node
        rows.append(
            {
                "dx": dx,
                "reflected": float(np.linalg.norm(r - exact_r) / np.linalg.norm(exact_r)),
                "transmitted": float(np.linalg.norm(t - exact_t) / np.linalg.norm(exact_t)),
            }
        )
    return rows


def delays() -> list[dict[str, float]]:
    """Error of the out-of-phase current and of the mean fields when one delay replaces all."""
    rows = []
    for lc in (0.02, 0.1, 0.5, 3.0):
        layer = RandomLayer(correlation_length=lc)
        incidence = illuminate(layer)
        p = out_of_phase(layer.moments(), incidence.theta)
        fit = single_delay(p, incidence.omega, np.abs(incidence.spectrum) ** 2, 2 * 1500 / incidence.courant)
        full, one = (single_realization(layer, method="frequency", delays=d) for d in ("all", "single"))
        low, middle, high = np.quantile(fit.error[:-1], (0.05, 0.5, 0.95))
        fields = {side: difference(one, full, side) for side in SIDES}
        rows.append(
            {"L_c": lc, "P 5 %": float(low), "P median": float(middle), "P 95 %": float(high)} | fields
        )
    return rows


def coherent(out: Path, quick: bool) -> list[dict[str, float]]:
    """Effective attenuation of the mean forward wave against thickness, and its bulk equivalent."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2))
    rows = []
    media = 2_000 if quick else 20_000
    for axis, (lc, sigma, dx, cells) in zip(
        axes,
        ((0.05, 0.1, 0.01, (50, 175, 350, 700, 1400, 2100)), (3.0, 0.03, 0.02, (15, 50, 150, 300, 600))),
        strict=True,
    ):
        points = []
        for n in cells:
            layer = RandomLayer(n_points=n, dx=dx, correlation_length=lc, rms_index=sigma)
            mean = coherent_transmission(layer, 0.6, "transfer_matrix", n_realizations=media)
            bulk = equivalent_slab(layer, 0.6)
            error = math.sqrt(2) * mean.standard_error / abs(mean.amplitude)
            points.append(
                (layer.length, mean.optical_depth, error, bulk.optical_depth_of_layer, bulk.optical_depth)
            )
            rows.append(
                {
                    "L_c": lc,
                    "rms index": sigma,
                    "L": layer.length,
                    "OD brute force": mean.optical_depth,
                    "standard error": error,
                    "OD of the layer": bulk.optical_depth_of_layer,
                    "sigma L": bulk.optical_depth,
                    "valid": bulk.valid,
                }
            )
        length, depth, error, layer_depth, beer = np.transpose(points)
        axis.errorbar(length, depth, 3 * error, fmt="ko", ms=4, label="brute force, ±3 standard errors")
        axis.plot(length, layer_depth, "-", label="second cumulant")
        axis.plot(length, beer, "--", label=r"Beer: $\sigma L$")
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel("thickness L (µm)")
        axis.set_ylabel(r"$-2\,\ln|\langle t\rangle|$")
        axis.set_title(f"$L_c$ = {lc} µm, $\\sigma_n$ = {sigma}")
        axis.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(out / "coherent.png", dpi=80)
    plt.close(figure)
    return rows


def limits() -> list[dict[str, float]]:
    """Largest stable background Courant number, worst of 8 media."""
    rows = []
    for lc in (0.002, 0.02, 0.5, 3.0):
        kappa = RandomLayer(correlation_length=lc).sample(8, 0)
        rows.append({"L_c": lc, "bound": courant_limit(kappa), "eigen": courant_limit(kappa, "eigen")})
    return rows


if __name__ == "__main__":
    run(main, OUT, __doc__)
