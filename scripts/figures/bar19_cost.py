"""What Figure 8 of [Bar19] costs: CPU time at the error of 12 000 paths, and memory against paths.

Prints row A09 of docs/validation.md; draws bar19-cost.png. A box of 20 x 20 wavelengths, optical depth 2, reversed
paths; four lights, 360 views, light 0 against each light at every two views; one thread.

Run it by itself: python scripts/figures/bar19_cost.py --out docs/images [--quick]
"""

import argparse
import resource
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _bar19 import LIGHTS, OUT, Row, clock, flatland_box, flatland_scene, relative, report, save

import specklegen as sg
from specklegen.oracles import box_algorithms
from specklegen.oracles.box_media import box, henyey_greenstein
from specklegen.oracles.wave_solver import directions_of

PATHS = 12_000
FEW = np.arange(0.0, 360.0, 10.0)  # views that judge errors: their norm over the trace does not depend on how many
ALL = np.arange(0.0, 360.0)


def first_rows(views: np.ndarray, paths: int, seed: int) -> sg.results.Covariance:
    """C of light 0 against all lights, [V, L, V]."""
    scene = flatland_scene(flatland_box(10.0, 10.0), views)
    blocks = sg.statistics.covariance_blocks(scene, rows=len(views), paths=paths, seed=seed, reverse=True, threads=1)
    return next(blocks)[1]


def literal(paths: int, seed: int) -> np.ndarray:
    """The same at ``FEW`` views by Algorithm 3 as printed and corrected: starts uniform in the box."""
    matter = box((-10, -10), (10, 10), extinction=0.1, particles=(henyey_greenstein(0.0, 2),))
    ends = (box_algorithms.Far(directions_of(np.deg2rad(a))) for a in (LIGHTS, FEW))
    setup = box_algorithms.Setup(matter, 1.0, *ends)
    found = box_algorithms.covariance(setup, paths, np.random.default_rng(seed), reverse=True)
    return found.reshape(len(LIGHTS), len(FEW), len(LIGHTS), -1)[0]


def trace(value: np.ndarray) -> float:
    """Sum of the intensities of light 0."""
    return float(np.einsum("vv->", value[:, 0]).real)


def peak_memory(paths: int) -> float:
    """Largest resident memory, MiB, of a fresh process that runs this file with ``--memory paths``."""
    found = subprocess.run(
        [sys.executable, __file__, "--memory", str(paths)], check=True, capture_output=True, text=True
    )
    return float(found.stdout)


def main(out: Path, quick: bool) -> None:
    """Draw, and print rows; ``quick`` takes few paths."""
    scale = 50 if quick else 1
    first_rows(FEW[:2], 64, 0)  # compiles
    with clock() as whole:
        fine = first_rows(ALL, PATHS // scale, 0)
    stated = float(np.sqrt(np.mean(relative(fine.standard_error, trace(fine.value)) ** 2)))
    with clock() as long:
        truth = first_rows(FEW, 100 * PATHS // scale, 1).value
    counts = [n // scale for n in (PATHS // 16, PATHS // 4, PATHS)]

    def error(estimate, paths: int, seeds: int) -> float:
        gaps = [relative(estimate(paths, 10 + seed) - truth, trace(truth)) for seed in range(seeds)]
        return float(np.sqrt(np.mean(np.square(gaps))))

    ours = [error(lambda n, seed: first_rows(FEW, n, seed).value, n, 4) for n in counts]
    with clock() as slow:
        theirs = [error(literal, n, 2) for n in counts]
    memory = {n: peak_memory(n) for n in (PATHS // scale, 10 * PATHS // scale)}

    figure, axis = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    seconds = whole.seconds * np.array(counts) / counts[-1]
    axis.loglog(seconds, ours, "o-", label="specklegen (time scaled from the last)")
    axis.loglog(seconds[-1], theirs[-1], "sC1", label=f"literal Algorithm 3, as many paths: {theirs[-1]:.4f}")
    axis.axvline(30, color="k", ls="--", lw=1, label="limit: 30 s")
    axis.axvline(650, color="C3", ls="--", lw=1, label="2019 code, Octave: 650 s")
    axis.axvline(2700, color="C3", ls=":", lw=1, label="paper, MATLAB: 45 min")
    axis.set(xlabel="CPU seconds, one thread, 4 lights × 360 views", ylabel=r"rms $\|\hat C-C\|_F/\mathrm{tr}\,C$",
             title=f"Figure 8: {PATHS // scale} paths in {whole.seconds:.1f} s of CPU")  # fmt: skip
    axis.legend(fontsize=8)
    save(figure, out / "bar19-cost.png", 80)
    report([
        Row("A09", f"Fig. 8, {PATHS // scale} paths: CPU time on one thread", f"{whole.seconds:.1f} s", "≤ 30 s",
            "2019 code about 650 s", whole.seconds),
        Row("A09", f"rms of ‖Ĉ−C‖_F/tr C at {counts[-1]} paths, against {100 * counts[-1]} paths", f"{ours[-1]:.5f}",
            f"literal Algorithm 3 with as many: {theirs[-1]:.5f}", f"from its own standard errors: {stated:.5f}",
            long.seconds + slow.seconds),
        Row("A09", "largest memory, MiB, at " + " and ".join(str(n) for n in memory) + " paths",
            " and ".join(f"{m:.0f}" for m in memory.values()), "equal", "fresh processes", 0.0),
    ], "bar19_cost")  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--quick", action="store_true", help="few paths: seconds")
    parser.add_argument("--memory", type=int, help="print the largest memory, MiB, that so many paths take, and stop")
    arguments = parser.parse_args()
    if arguments.memory:
        first_rows(FEW, arguments.memory, 0)
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    else:
        main(arguments.out, arguments.quick)
