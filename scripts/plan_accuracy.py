"""What `plan` predicts against what a render takes: CPU seconds on one thread, and memory.

Each scene is planned and rendered in a process of its own; the growth of memory is counted from the import on, the
seconds from a first small render on (which loads compiled kernels), the best of three. The yardstick of
`specklegen.core.pace` is run beside every render, and seconds are given at its reference, so that a busy or slower
machine does not pass for a wrong prediction. `--fit` then fits the nanoseconds of
`specklegen.core.nanoseconds.NANOSECONDS` to the table and prints them. One thread, about three minutes.

    python scripts/plan_accuracy.py [--only WORD] [--fit] [--json PATH]
    python scripts/plan_accuracy.py --picks                   the sampler that is chosen, against the quickest

`--picks` renders 60 scenes by every sampler within the tolerance, and extrapolates from 1 and as many realizations
as take 0.3 s (3 to 100) to 1000.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"
os.environ["SPECKLEGEN_CACHE"] = "kernels:"  # results of another run would be read, not computed

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

import specklegen as sg
from specklegen.core.memory import resident_memory
from specklegen.core.nanoseconds import NANOSECONDS
from specklegen.core.pace import measured_pace
from specklegen.memory_effects.cached import estimated_anew
from specklegen.scene.illumination import directions_of_sines

REPEATS = 3


def slab(g: float = 0.9, optical_depth: float = 10.0) -> sg.Slab:
    """A slab of 2000 wavelengths."""
    scatterer = sg.media.HenyeyGreenstein(g=g) if g else sg.media.Isotropic()
    return sg.Slab(thickness=2000.0, mean_free_path=2000.0 / optical_depth, scatterer=scatterer)


def beams(tilts: int = 5, width: float = 1e5) -> sg.light.CollimatedBeams:
    """Tilts a twentieth of a mrad apart."""
    return sg.light.CollimatedBeams.tilts(4e-5 * np.arange(tilts), width=width)


def scene(medium: Any, light: Any, sensor: Any) -> sg.Scene:
    """A scene of wavelength 1."""
    return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor)


def grid(views: int = 101, **where: Any) -> Any:
    """Views at 0.22 of a grain of the widest beam."""
    return sg.sensors.FarField.grid(shape=(views, views), pitch=2.2e-6, **where)


def fan(count: int, reach: float = 0.7) -> sg.sensors.FarField:
    """Directions up to ``reach`` along a diagonal."""
    sines = np.linspace(-reach, reach, count)[:, None] * [0.8, 0.6]
    return sg.sensors.FarField(directions=directions_of_sines("fan", sines))


def box(size: float, dimension: int, depth: float = 3.0, **changes: Any) -> sg.media.Box:
    """A box of ``size`` wavelengths along every axis."""
    corner = np.full(dimension, size / 2)
    fields: dict[str, Any] = {"mean_free_path": size / depth, "scatterer": sg.media.HenyeyGreenstein(g=0.5)}
    return sg.media.Box(lower=-corner, upper=corner, **(fields | changes))


def voxels() -> sg.media.VoxelGrid:
    """16 x 16 x 16 voxels."""
    density = np.random.default_rng(0).random((16, 16, 16)) / 20
    return sg.media.VoxelGrid(
        lower=[-50.0] * 3, upper=[50.0] * 3, extinction=density, scatterers=(sg.media.Isotropic(),)
    )


GLASS = sg.GroundGlass(angle=0.05)


def _camera(aperture: float, pitch: float = 1.0) -> sg.sensors.Imaging:
    return sg.sensors.Imaging(shape=(64, 64), pitch=pitch, aperture=aperture, focus=-10.0)


def _modulator() -> sg.light.CoherentObject:
    letter = np.zeros((28, 28))
    letter[6:22, 8:11] = letter[19:22, 8:20] = 1.0
    return sg.light.CoherentObject(np.exp(1j * np.pi * letter), pitch=40.0, distance=1e4)


MOVING = slab().replace(motion=sg.media.Brownian(diffusion=1e-3))


def _layer(g: float) -> sg.media.Layer:
    return sg.media.Layer(thickness=1000.0, mean_free_path=300.0, scatterer=sg.media.HenyeyGreenstein(g=g))


def _film(frames: int) -> sg.light.CollimatedBeams:
    return sg.light.CollimatedBeams.tilts(np.zeros(frames), width=1e5, times=np.arange(float(frames)))


Case = tuple[Callable[[], sg.Scene], dict[str, Any]]
PATHS: dict[str, Any] = {"sampler": "paths"}
STATIONARY: dict[str, Any] = {"sampler": "stationary", "paths": 100_000}
CASES: dict[str, Case] = {
    "NUFFT, 5 x 101 x 101": (lambda: scene(slab(), beams(), grid()), PATHS | {"paths": 300_000}),
    "NUFFT, isotropic": (lambda: scene(slab(0.0), beams(3), grid(64)), PATHS | {"paths": 100_000}),
    "NUFFT, 16 x 512 x 512": (lambda: scene(slab(), beams(16), grid(512)), PATHS | {"paths": 20_000}),
    "NUFFT to 1e-6": (lambda: scene(slab(), beams(2), grid()), PATHS | {"paths": 100_000, "field_tolerance": 1e-6}),
    "NUFFT, thin slab": (lambda: scene(slab(0.9, 1.0), beams(3), grid(64)), PATHS | {"paths": 300_000}),
    "direct, wide field": (
        lambda: scene(slab(), beams(3, 100.0), sg.sensors.FarField.grid(shape=(81, 81), pitch=5e-3)),
        PATHS | {"paths": 4000},
    ),
    "direct, 40 tilts": (lambda: scene(slab(), beams(40), fan(100)), PATHS | {"paths": 40_000}),
    "direct, backscattering": (
        lambda: scene(slab(), beams(), grid(33, side="reflection")),
        PATHS | {"paths": 5000, "reverse": True},
    ),
    "stationary, 5 x 101 x 101": (lambda: scene(slab(), beams(), grid()), STATIONARY),
    "stationary, 16 x 512 x 512": (lambda: scene(slab(), beams(16), grid(512)), STATIONARY),
    "stationary, isotropic": (lambda: scene(slab(0.0), beams(3), grid(256)), STATIONARY),
    "stationary, view at 20 degrees": (
        lambda: scene(slab(), beams(), grid(center=(float(np.sin(np.deg2rad(20))), 0.0))),
        STATIONARY,
    ),
    "box in flatland": (
        lambda: scene(box(20, 2), sg.light.PlaneWaves.tilts([0, 0.02, 0.1], dimensions=2),
                      sg.sensors.FarField.angles(_circle(360))),
        {"paths": 10_000},
    ),
    "box in space, reversed off": (
        lambda: scene(box(100, 3), sg.light.PlaneWaves.tilts([0, 0.02]), fan(200)), {"paths": 30_000, "reverse": False}
    ),
    "voxels": (lambda: scene(voxels(), sg.light.PlaneWaves.tilts([0, 0.02]), fan(50)), {"paths": 20_000}),
    "near field": (
        lambda: scene(box(50, 3), sg.light.PointSources(points=[[0, 0, -60.0]]),
                      sg.sensors.NearField(points=_line(40))),
        {"paths": 5000},
    ),
    "mixture in a slab": (
        lambda: scene(
            slab().replace(
                scatterer=sg.media.Mixture(types=(sg.media.Isotropic(), sg.media.HenyeyGreenstein(g=0.9)),
                                           fractions=(0.3, 0.7))
            ),
            beams(3), grid(17),
        ),
        {"paths": 4000},
    ),
    "covariance": (
        lambda: scene(box(20, 2), sg.light.PlaneWaves.tilts([0, 0.02], dimensions=2),
                      sg.sensors.FarField.angles(_circle(120))),
        {"paths": 10_000, "sampler": "covariance"},
    ),
    "lens, path sums": (
        lambda: scene(sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(g=0.9)),
                      beams(2, 40.0), _camera(0.2)),
        {"paths": 10_000},
    ),
    "lens before a modulator and glass": (lambda: scene(GLASS, _modulator(), _camera(0.05, 5.0)), {}),
    "modulator and glass": (lambda: scene(GLASS, _modulator(), grid(256)), {}),
    "two glasses, 5 x 256 x 256": (
        lambda: scene(sg.media.ScreenStack(screens=(GLASS, GLASS), gaps=(1000.0,)), beams(), grid(256)), {}
    ),
    "hidden object": (
        lambda: scene(slab(), sg.light.IncoherentObject(brightness=np.eye(28), pitch=1e-5, width=2e4),
                      sg.sensors.FarField.grid(shape=(128, 128), pitch=2e-5)),
        STATIONARY,
    ),
    "film, stationary": (
        lambda: scene(MOVING, _film(8), grid()), STATIONARY
    ),
    "film, path sums": (
        lambda: scene(MOVING, _film(4), grid(64)), PATHS | {"paths": 50_000}
    ),
    "covariance of few": (
        lambda: scene(box(50, 3), sg.light.PlaneWaves.tilts([0, 0.02]), fan(10)), {"paths": 60_000, "sampler":
        "covariance"}
    ),
    "one glass, 3 x 128 x 128": (lambda: scene(GLASS, beams(3), grid(128)), {}),
    "three glasses, 40 x 64 x 64": (
        lambda: scene(sg.media.ScreenStack(screens=(GLASS,) * 3, gaps=(500.0, 500.0)), beams(40), grid(64)), {}
    ),
    "film of 12, path sums": (lambda: scene(MOVING, _film(12), grid()), PATHS | {"paths": 20_000}),
    "film, direct sum": (lambda: scene(MOVING, _film(3), fan(60)), PATHS | {"paths": 10_000}),
    "lens, 9 tilts": (
        lambda: scene(sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(g=0.8)),
                      beams(9, 60.0), _camera(0.1, 2.0)),
        {"paths": 10_000, "sampler": "paths"},
    ),
    "two layers, NUFFT": (
        lambda: scene(sg.Layers(layers=[_layer(0.5), _layer(0.9)]), beams(3), grid(64)),
        PATHS | {"paths": 30_000},
    ),
    "NUFFT, reflection": (
        lambda: scene(slab(0.5, 5.0), beams(3), grid(64, side="reflection")),
        PATHS | {"paths": 50_000, "reverse": False},
    ),
    "box, 20 x 300": (
        lambda: scene(box(60, 3, 4.0), sg.light.PlaneWaves.tilts(np.linspace(0, 0.1, 20)), fan(300)), {"paths": 5000}
    ),
}  # fmt: skip


def _circle(count: int) -> np.ndarray:
    return np.linspace(0, 2 * np.pi, count, endpoint=False)


def _line(count: int) -> np.ndarray:
    return np.stack([np.linspace(-20, 20, count), np.zeros(count), np.full(count, 80.0)], axis=-1)


def measured(name: str) -> dict[str, Any]:
    """Plan and render one case in this process, which should be young."""
    build, arguments = CASES[name]
    this = build()
    before, _ = resident_memory()
    made = sg.plan(this, threads=1, **arguments)
    sg.render(this, threads=1, **(arguments | {"paths": 64}))
    found = []
    for seed in range(REPEATS):
        pace = measured_pace()
        start = time.process_time()
        with estimated_anew(seed):  # what a medium is like is found again, as the plan counts it
            sg.render(this, threads=1, seed=seed, **arguments)
        found.append((time.process_time() - start) / np.mean([pace, measured_pace()]))
        if seed == 0:
            _, most = resident_memory()
    fresh = build().replace(wavelength=1 + 1e-9)
    start = time.process_time()
    sg.plan(fresh, threads=1, **arguments)
    return {
        "name": name, "way": f"{made.sampler}, {made.summation}", "operations": made.operations, "seconds": min(found),
        "planning": (time.process_time() - start) / measured_pace(), "bytes": most - before,
        "predicted_bytes": made.memory_bytes,
    }  # fmt: skip


def pick_scenes() -> dict[str, sg.Scene]:
    """60 scenes on either side of where another sampler is the quickest."""
    slabs = {f"g {g}, OD {depth}": slab(g, depth) for g, depth in ((0.0, 2), (0.0, 10), (0.9, 3), (0.9, 10), (0.9, 40))}
    made = {f"{name}, {tilts} tilts, {views}^2": scene(medium, beams(tilts), grid(views))
            for name, medium in slabs.items() for tilts in (1, 5, 20) for views in (16, 64, 128)}  # fmt: skip
    for depth in (0.5, 2.0, 6.0):
        for views in (30, 120, 480):
            light = sg.light.PlaneWaves.tilts([0, 0.02], dimensions=2)
            made[f"flatland box, OD {depth:g}, {views}"] = scene(
                box(20, 2, depth), light, sg.sensors.FarField.angles(_circle(views))
            )
        for views in (5, 50):
            made[f"box, OD {depth:g}, {views}"] = scene(
                box(50, 3, depth), sg.light.PlaneWaves.tilts([0, 0.02]), fan(views)
            )
    return made


REALIZATIONS = (1, 10, 60, 100, 1000)


def picked(name: str) -> dict[str, Any]:
    """How much slower than the quickest the chosen sampler is, by number of realizations."""
    this, clocks = pick_scenes()[name], {}
    for sampler in ("paths", "stationary", "covariance"):
        try:
            made = sg.plan(this, threads=1, paths=20_000, sampler=sampler)
        except ValueError:
            continue
        if made.doubts or made.seconds > 10:
            continue
        sg.render(this, threads=1, paths=64, sampler=sampler)
        spent = []
        many = 2 + int(np.clip(0.3 / max(made.seconds - made.setup_seconds, 1e-6), 1, 98))
        for count in (1, many, 1, many):
            start = time.process_time()
            with estimated_anew(len(spent)):
                sg.render(this, threads=1, paths=20_000, sampler=sampler, realizations=count, seed=len(spent))
            spent.append(time.process_time() - start)
        once, all_drawn = min(spent[::2]), min(spent[1::2])
        clocks[sampler] = (once, max(all_drawn - once, 0.0) / (many - 1))
    total = {sampler: [once + (n - 1) * each for n in REALIZATIONS] for sampler, (once, each) in clocks.items()}
    chosen = [sg.plan(this, threads=1, paths=20_000, realizations=n).sampler for n in REALIZATIONS]
    best = [min(total, key=lambda sampler, at=at: total[sampler][at]) for at in range(len(chosen))]
    ratio = [total[own][at] / total[best[at]][at] if own in total else None for at, own in enumerate(chosen)]
    return {"name": name, "chosen": chosen, "best": best, "ratio": ratio}


def print_picks() -> None:
    """Print a line for each scene where a pick is not the quickest, and the count of those more than 15 % slower."""
    slow = seen = 0
    for name in pick_scenes():
        command = [sys.executable, __file__, "--pick", name]
        row = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)
        for count, own, best, ratio in zip(REALIZATIONS, row["chosen"], row["best"], row["ratio"], strict=True):
            seen += ratio is not None
            if ratio is not None and ratio > 1.15:
                slow += 1
                print(f"{name:<40}{count:>6} {own} takes {ratio:.2f} times {best}", flush=True)
    print(f"{slow} of {seen} picks are more than 15 % slower than the quickest sampler")


def fitted(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Nanoseconds of least squared relative error; an operation that no case tells apart stays as it is."""
    names = list(NANOSECONDS)
    now = np.array([NANOSECONDS[name] for name in names])
    matrix = np.array([[1e-9 * row["operations"].get(name, 0.0) / row["seconds"] for name in names] for row in rows])
    held = 0.05 * np.eye(len(names))  # in units of what they are now
    solution = lsq_linear(
        np.vstack([matrix * now, held]), np.concatenate([np.ones(len(rows)), held.diagonal()]), (0.05, np.inf)
    )
    return {name: float(f"{value:.2g}") for name, value in zip(names, solution.x * now, strict=True)}


def table(rows: list[dict[str, Any]], nanoseconds: dict[str, float]) -> str:
    """Lines of the table, ratios of found to predicted."""
    lines = [f"{'case':<34}{'CPU s':>8}{'found/plan':>11}{'MiB':>7}{'found/plan':>11}{'planning s':>11}"]
    for row in rows:
        predicted = 1e-9 * sum(count * nanoseconds[name] for name, count in row["operations"].items())
        lines.append(
            f"{row['name']:<34}{row['seconds']:>8.3f}{row['seconds'] / predicted:>11.2f}{row['bytes'] / 2**20:>7.0f}"
            f"{row['bytes'] / row['predicted_bytes']:>11.2f}{row['planning']:>11.3f}"
        )
    return "\n".join(lines)


def main() -> None:
    """Measure, print, fit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="WORD", help="cases with this word in their name")
    parser.add_argument("--fit", action="store_true", help="fit the nanoseconds and print the table they would give")
    parser.add_argument("--json", type=Path, metavar="PATH", help="write the measurements there")
    parser.add_argument("--from", dest="source", type=Path, metavar="PATH", help="take them from there instead")
    parser.add_argument("--picks", action="store_true", help="compare the chosen sampler with the quickest instead")
    parser.add_argument("--pick", metavar="NAME", help="one scene of these in this process, and print JSON")
    parser.add_argument("--case", choices=CASES, help="measure one case in this process, and print JSON")
    options = parser.parse_args()
    if options.case:
        print(json.dumps(measured(options.case)))
        return
    if options.pick:
        print(json.dumps(picked(options.pick)))
        return
    if options.picks:
        print_picks()
        return
    if options.source:
        rows = json.loads(options.source.read_text())
    else:
        rows = []
        for name in (name for name in CASES if options.only in name):
            command = [sys.executable, __file__, "--case", name]
            rows.append(json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout))
            print(rows[-1]["name"], rows[-1]["way"], f"{rows[-1]['seconds']:.3f} s", file=sys.stderr, flush=True)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n")
    print(table(rows, NANOSECONDS))
    if options.fit:
        found = fitted(rows)
        print(json.dumps(found, indent=4), table(rows, found), sep="\n")


if __name__ == "__main__":
    main()
