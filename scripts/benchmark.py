"""Speed and memory of the engine as ratios, in one run on one thread: what `make speed` prints.

One example throughout: a slab of 2000 wavelengths, optical depth 10, g = 0.9; five
tilts 0.0025 degrees apart, 101 x 101 views 0.000125 degrees apart, a window of 1e5 wavelengths, 1e5 paths.

Times are CPU seconds of this process (the two-thread row: wall seconds). The two sides of a ratio are run in
turn, repeat by repeat, so that a change of the machine's speed meets both. Quote ratios, not times.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"
os.environ["SPECKLEGEN_CACHE"] = "kernels:"  # results of another run would be read, not computed

import argparse
import json
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import torch
from error_time.machine import circumstances
from references.naive_numba import naive_field

import specklegen as sg
from specklegen.memory_effects.correlation import MemoryEffectCorrelation, axial_tracer, estimate_correlation
from specklegen.paths.phases import random_phases
from specklegen.paths.tracer import volume_tracer
from specklegen.samplers.path_sums.direct import direct_field
from specklegen.samplers.path_sums.nufft import nufft_field
from specklegen.synthesis.objects import object_imaging, object_media
from specklegen.synthesis.stacks import stack_sampler

PATHS = 100_000
WIDTH = 1e5
BOUNDS = {"box": 100, "16^3 voxels": 300}  # nanoseconds an event of walks in one direction
MEDIUM = sg.Slab(thickness=2000.0, mean_free_path=200.0, scatterer=sg.media.HenyeyGreenstein(g=0.9))


def example(width: float = WIDTH) -> sg.Scene:
    """The example's scene."""
    return sg.Scene(
        wavelength=1.0,
        medium=MEDIUM,
        illumination=sg.light.CollimatedBeams.tilts(np.deg2rad(0.0025) * np.arange(5), width=width),
        sensor=sg.sensors.FarField.grid(shape=(101, 101), pitch=float(np.deg2rad(0.000125))),
    )


@dataclass(frozen=True)
class Row:
    """One line of the table: repeated measurements, and the bounds that the project set itself."""

    name: str
    unit: str
    values: list[float]
    must: float | None = None
    aim: float | None = None
    more_is_better: bool = False
    note: str = ""

    @property
    def median(self) -> float:
        """Median of the repeats."""
        return float(np.median(self.values))

    def meets(self, bound: float | None) -> str:
        """Say whether the median meets a bound."""
        if bound is None:
            return ""
        good = self.median >= bound if self.more_is_better else self.median <= bound
        return f"{'>=' if self.more_is_better else '<='} {bound:g} {'yes' if good else 'NO'}"

    def line(self) -> str:
        """Write the row for a terminal."""
        spread = f" [{min(self.values):.4g} - {max(self.values):.4g}]" if len(self.values) > 1 else ""
        found = f"{self.median:.4g}{spread} {self.unit}"
        return f"{self.name:<56}{found:<32}{self.meets(self.must):<14}{self.meets(self.aim):<14}{self.note}"


def seconds(*functions: Callable[[int], object], repeats: int, clock: Callable[[], float] = time.process_time):
    """Run functions of the repeat's number in turn; float64[functions, repeats] seconds, after one run unmeasured."""
    found = np.empty((len(functions), repeats))
    for function in functions:
        function(repeats)
    for repeat in range(repeats):
        for n, function in enumerate(functions):
            start = clock()
            function(repeat)
            found[n, repeat] = clock() - start
    return found


def path_rows(repeats: int, naive_paths: int) -> list[Row]:
    """Tracing, rendering with a plan at hand and with a fresh one, and the hoisted naive program."""
    scene = example()
    fresh = [example(WIDTH + 1 + n) for n in range(repeats + 1)]  # other fingerprints: nothing is cached
    made = sg.plan(scene, paths=PATHS, sampler="paths")
    events = [0] * (repeats + 1)

    def tracing(n: int) -> None:
        events[n] = made.chosen.tracer.trace(n, PATHS, threads=1).events

    def rendering(n: int) -> None:
        sg.render(scene, paths=PATHS, sampler="paths", seed=n, threads=1)

    def planning_and_rendering(n: int) -> None:
        sg.render(fresh[n], paths=PATHS, sampler="paths", seed=n, threads=1)

    def naive(n: int) -> None:
        naive_field(
            MEDIUM, wavelength=1.0, width=WIDTH, tilts=scene.beams.directions,
            views=scene.sensor.directions.reshape(-1, 3), paths=naive_paths, seed=n,
        )  # fmt: skip

    traced, rendered, planned, slow = seconds(tracing, rendering, planning_and_rendering, naive, repeats=repeats)
    slow = slow * (PATHS / naive_paths)
    error = field_error(made)
    extrapolated = f"naive from {naive_paths} paths, times {PATHS / naive_paths:g}: about {np.median(slow):.0f} s"
    return [
        Row("path tracing, per scattering event", "ns", list(1e9 * traced / events[:repeats]), 45, 25),
        Row("tracing alone, 1e5 paths", "ms", list(1e3 * traced)),
        Row("render / tracing alone, plan at hand", "", list(rendered / traced), 2, 1.3),
        Row("render / tracing alone, fresh plan included", "", list(planned / traced)),
        Row("field error of ours against the direct sum", "", [error], 1e-3, note="64 views, same paths and phases"),
        Row("hoisted naive Numba / ours, 1e5 paths", "", list(slow / rendered), 3000, 6000, True, extrapolated),
    ]


def field_error(made: sg.results.Plan) -> float:
    """Relative root mean square difference of the NUFFT's field from the direct sum, at 64 views of the grid."""
    assert made.summation == "nufft"
    tracer, nufft = made.chosen.tracer, made.chosen.nufft
    layout, views = tracer.layout, nufft.grid.directions.reshape(-1, 3)
    bank = tracer.trace(0, PATHS, threads=1)
    phases = random_phases(bank, 0)
    chosen = np.random.default_rng(0).choice(len(views), 64, replace=False)
    fast = nufft_field(layout, bank, phases, nufft, threads=1).reshape(len(layout.lights), -1)[:, chosen]
    exact = direct_field(layout.of_views(views[chosen]), bank, (phases, None), threads=1)
    return float(np.linalg.norm(fast - exact) / np.linalg.norm(exact))


def volume_rows(repeats: int) -> list[Row]:
    """Paths through a box and 16^3 voxels of Henyey-Greenstein scatterers (g = 0.9, 10 free paths deep)."""
    scatterer = sg.media.HenyeyGreenstein(g=0.9)
    corners = {"lower": np.array([-50, -50, 0]), "upper": np.array([50, 50, 100])}
    extinction = 0.1 * np.random.default_rng(0).uniform(0.5, 1.5, (16, 16, 16))
    media = {
        "box": sg.media.Box(**corners, mean_free_path=10.0, scatterer=scatterer),
        "16^3 voxels": sg.media.VoxelGrid(**corners, extinction=extinction, scatterers=(scatterer,)),
    }
    rows = []
    for name, medium in media.items():
        scene = sg.Scene(
            wavelength=1.0, medium=medium, illumination=sg.light.CollimatedBeams.tilts([0.0, 0.002], width=40.0),
            sensor=sg.sensors.FarField.grid((32, 32), 1e-3),
        )  # fmt: skip
        for reverse in (False, True):
            tracer = volume_tracer(scene, reverse)
            events = tracer.trace(0, PATHS // 10, threads=1).events  # compiles, too
            (spent,) = seconds(lambda n, of=tracer: of.trace(0, PATHS // 10, threads=1), repeats=repeats)
            words = ", both directions" if reverse else ""
            must = None if reverse else BOUNDS[name]
            rows.append(Row(f"{name}, per scattering event{words}", "ns", list(1e9 * spent / events), must))
    return rows


def stationary_rows(repeats: int) -> list[Row]:
    """Stacks and images of hidden objects by the stationary sampler, once K is known."""
    correlation = estimate_correlation(MEDIUM, PATHS, 0, threads=1)
    stacks, times = stack_sampler(example(), correlation), 20
    (stack,) = seconds(lambda n: [stacks.sample(n, r) for r in range(times)], repeats=repeats)
    fresh, shared, rank = object_seconds(correlation, repeats, times)

    def rendered(seed: int, count: int) -> None:
        sg.render(example(), paths=2000, sampler="stationary", seed=seed, realizations=count, threads=1)

    few, many = seconds(lambda n: rendered(n, times), lambda n: rendered(n, 11 * times), repeats=repeats)
    return [
        Row("stationary five-stack 101 x 101", "ms", list(1e3 * stack / times), 2, 0.7),
        Row("the same by sg.render, each further stack", "ms", list(1e3 * (many - few) / (10 * times))),
        Row("28 x 28 object on 128 x 128, fresh medium each", "images/s", list(times / fresh), note=f"{rank} modes"),
        Row("28 x 28 object on 128 x 128, one medium", "images/s", list(times / shared)),
    ]


def motion_rows(repeats: int) -> list[Row]:
    """What particles that move add: to tracing, to a curve in time, to a film of eight frames."""
    moving = MEDIUM.replace(motion=sg.media.Brownian(diffusion=1.0))
    still, turning = axial_tracer(MEDIUM), axial_tracer(MEDIUM, True)
    lags, tilts = np.linspace(0, 0.02, 25), np.linspace(0, 5e-4, 25)
    beams = {"width": WIDTH, "profile": "square"}
    pitch = float(np.deg2rad(0.000125))

    def scene(light: sg.light.CollimatedBeams) -> sg.Scene:
        return sg.Scene(wavelength=1.0, medium=moving, illumination=light,
                        sensor=sg.sensors.FarField.grid((101, 101), pitch))

    film = scene(sg.light.CollimatedBeams.tilts(np.zeros(8), times=0.01 * np.arange(8), **beams))
    one = scene(sg.light.CollimatedBeams.tilts([0.0], **beams))

    def drawn(of: sg.Scene, seed: int, count: int) -> None:
        sg.render(of, paths=2000, sampler="stationary", seed=seed, realizations=count, threads=1)

    few, many = 2, 22
    found = seconds(
        lambda n: still.trace(n, PATHS, threads=1),
        lambda n: turning.trace(n, PATHS, threads=1),
        lambda n: sg.memory_effect(MEDIUM, wavelength=1.0, tilts=tilts, paths=PATHS, seed=n, threads=1),
        lambda n: sg.statistics.temporal_correlation(moving, wavelength=1.0, lags=lags, paths=PATHS, seed=n, threads=1),
        lambda n: drawn(film, n, few), lambda n: drawn(film, n, many),
        lambda n: drawn(one, n, 8 * few), lambda n: drawn(one, n, 8 * many),
        repeats=repeats,
    )  # fmt: skip
    least = found.min(axis=1)
    frames, single = found[5] - found[4], found[7] - found[6]
    told = (f"{repeats} repeats; of the least of either: " + "{:.3f}").format
    return [
        Row("tracing with momentum transfer / without", "", list(found[1] / found[0]), 1.05,
            note=told(least[1] / least[0])),
        Row("25 lags in time / 25 tilts, 1e5 paths", "", list(found[3] / found[2]), 1.1,
            note=told(least[3] / least[2])),
        Row("a film of eight frames / eight fields", "", list(frames / single), 1.3,
            note=told((least[5] - least[4]) / (least[7] - least[6]))),
    ]  # fmt: skip


def lens_rows(repeats: int) -> list[Row]:
    """An image through a lens against the far field of as many directions, by the same paths; a fresh plan in neither.

    The lens takes a grid of n x n directions and makes n x n pixels of it; beside it stands a far field of n x n views.
    """
    medium = sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(g=0.9))
    rows, paths = [], PATHS // 5
    for aperture, tilts in ((0.2, 4), (0.4, 4), (0.2, 16)):
        light = sg.light.CollimatedBeams.tilts(1e-3 * np.arange(tilts), width=200.0)
        views = int(np.ceil(4 * aperture * light.width))  # half a grain of the far field apart, which it asks for
        camera = sg.sensors.Imaging(
            shape=(views, views), pitch=1 / (4 * aperture), aperture=aperture, focus=-10.0, views=views
        )  # fmt: skip
        seen = sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=camera)
        afar = seen.replace(sensor=camera.pupil_grid(views))

        def rendered(of: sg.Scene, seed: int) -> None:
            sg.render(of, paths=paths, sampler="paths", reverse=False, seed=seed, threads=1)

        lens, far = seconds(partial(rendered, seen), partial(rendered, afar), repeats=repeats)
        rows.append(Row(
            f"image through a lens / far field, {tilts} tilts of {views} x {views}", "",
            list(lens / far), 2, note=f"aperture {aperture:g}; of the least of either: {lens.min() / far.min():.3f}",
        ))  # fmt: skip
    return rows


def object_seconds(
    correlation: MemoryEffectCorrelation, repeats: int, times: int
) -> tuple[np.ndarray, np.ndarray, int]:
    """Seconds for ``times`` images of objects (35 % filled) over half a memory-effect range, and the modes used."""
    extent = 0.5 * correlation.half_range() / (2 * np.pi)  # direction sine of the full side, wavelength 1
    camera = sg.sensors.FarField.grid(shape=(128, 128), pitch=0.5 / WIDTH)
    imaging = object_imaging(
        correlation, wavelength=1.0, object_shape=(28, 28), object_pitch=extent / 28, width=WIDTH, grid=camera
    )
    objects = np.random.default_rng(0).random((times, 28, 28))
    lights = torch.from_numpy(np.where(objects < 0.35, objects / 0.35, 0.0)).to(torch.float32)[:, None]
    kept = object_media(imaging, 0).shared()
    fresh, shared = seconds(
        lambda n: [object_media(imaging, n, r).images(light) for r, light in enumerate(lights)],
        lambda n: [kept.images(light) for light in lights],
        repeats=repeats,
    )
    return fresh, shared, imaging.rank


def thread_rows(repeats: int) -> list[Row]:
    """Two threads against one, wall time, of tracing and of a whole render; means something only on two idle cores.

    What two cores can do at best is measured in the same repeats: two processes that do the same and share nothing.
    """
    repeats = max(repeats, 21)
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:

        def processes(function: Callable[[int, int], None], n: int, count: int) -> None:
            list(pool.map(function, [n] * count, [1] * count))

        work = {
            f"speed of two {kind} / one, {name}": partial(processes, function) if kind == "processes" else function
            for name, function in (("tracing", traced), ("a whole render", rendered))
            for kind in ("threads", "processes")
        }
        runs = [lambda n, f=f, c=cores: f(n, c) for f in work.values() for cores in (1, 2)]
        for function in (traced, rendered):
            processes(function, 0, 2)  # compiles
        found = seconds(*runs, repeats=repeats, clock=time.perf_counter).reshape(len(work), 2, repeats)
    note = f"wall time, 8e5 paths, {repeats} repeats; load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    rows = []
    for name, (one, two) in zip(work, found, strict=True):
        if "processes" in name:  # which did twice the work
            rows.append(Row(name, "", list(2 * one / two), note="the same work twice: what the machine gives"))
        else:
            rows.append(Row(name, "", list(one / two), 1.8, 1.95, True, note))
    return rows


def traced(seed: int, threads: int) -> None:
    """Trace 8e5 paths of the example, 1e5 at a time, as no render holds more."""
    made = sg.plan(example(), paths=8 * PATHS, sampler="paths")
    for n in range(8):
        made.chosen.tracer.trace(seed, PATHS, first=n * PATHS, threads=threads)


def rendered(seed: int, threads: int) -> None:
    """Render the example from 8e5 paths."""
    sg.render(example(), paths=8 * PATHS, sampler="paths", seed=seed, threads=threads)


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three repeats and a shorter naive run")
    parser.add_argument("--motion", action="store_true", help="only the rows of particles that move")
    parser.add_argument("--lens", action="store_true", help="only the rows of images through a lens")
    parser.add_argument("--threads", action="store_true", help="only the rows of two threads against one")
    parser.add_argument("--json", type=Path, metavar="PATH", help="write the rows there, for docs/notes/performance.md")
    options = parser.parse_args()
    repeats, naive_paths = (3, 100) if options.quick else (9, 400)
    rows = []
    print(f"{'':<56}{f'median [min - max] of {repeats}':<32}{'must':<14}aim")
    parts = [
        lambda: path_rows(repeats, naive_paths),
        lambda: volume_rows(repeats),
        lambda: stationary_rows(repeats),
        lambda: motion_rows(max(repeats, 10)),
        lambda: thread_rows(repeats),
        lambda: lens_rows(repeats),
    ]
    chosen = [n for n, only in ((3, options.motion), (4, options.threads), (5, options.lens)) if only]
    for part in [parts[n] for n in chosen] or parts:
        found = part()
        rows += found
        print("\n".join(row.line() for row in found), flush=True)
    if options.json:
        stored = {"about": circumstances(), "rows": [asdict(row) | {"median": row.median} for row in rows]}
        options.json.write_text(json.dumps(stored, indent=1) + "\n")


if __name__ == "__main__":
    main()
