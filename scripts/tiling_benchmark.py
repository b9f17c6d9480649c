"""Wide fields of view: CPU time a connection of the NUFFT in tiles beside the direct sum; memory of a streamed stack.

    python scripts/tiling_benchmark.py              about three minutes on one idle core
    python scripts/tiling_benchmark.py --streamed   4096 x 4096 views of --tilts tilts into a zarr array; a tilt of
                                                    path sums takes 5 to 30 s and 0.13 GiB of disk

One example: a slab of 2000 wavelengths, optical depth 10, g = 0.9; n x n views as far apart as 0.4 speckle grains.
Both sides of a ratio are run in turn, best of three; the direct sum at 400 views, times the rest.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

import specklegen as sg
from specklegen.core.memory import resident_memory
from specklegen.paths.phases import random_phases
from specklegen.paths.tracer import slab_tracer
from specklegen.samplers.path_sums.direct import direct_field
from specklegen.samplers.path_sums.nufft import nufft_field
from specklegen.samplers.path_sums.summation import scene_nufft

MEDIUM = sg.Slab(thickness=2000.0, mean_free_path=200.0, scatterer=sg.HenyeyGreenstein(g=0.9))
CONNECTIONS, VIEWS = 30_000, 400
CASES = [(5.0, 101, 1, 1e-3), (5.0, 401, 1, 1e-3), (10.0, 401, 1, 1e-3), (10.0, 401, 5, 1e-3), (20.0, 401, 1, 1e-3),
         (5.0, 401, 1, 1e-6)]  # half a field of view in degrees, views a side, tilts, tolerance  # fmt: skip


def scene(views: int, tilts: int, pitch: float) -> sg.Scene:
    """The example, from a side of views."""
    beams = sg.CollimatedBeams.tilts(np.deg2rad(0.0025) * np.arange(tilts), width=0.4 / pitch)
    return sg.Scene(wavelength=1.0, medium=MEDIUM, illumination=beams, sensor=sg.FarField.grid((views, views), pitch))


def compare(half: float, views: int, tilts: int, tolerance: float) -> str:
    """One row."""
    this = scene(views, tilts, float(np.sin(np.deg2rad(half))) / (views // 2))
    start = time.process_time()
    evaluator = scene_nufft(this, False, tolerance)
    planning = time.process_time() - start
    tracer = slab_tracer(this, False)
    layout, bank = tracer.layout, tracer.trace(2, 2 * CONNECTIONS, threads=1)
    bank = bank.select(slice(0, CONNECTIONS))
    phases = random_phases(bank, 3)
    chosen = np.random.default_rng(0).choice(views**2, VIEWS, replace=False)
    tiled, direct = np.inf, np.inf
    for _ in range(3):
        start = time.process_time()
        exact = direct_field(layout.of_views(this.views[chosen]), bank, (phases, None), threads=1)
        direct = min(direct, time.process_time() - start)
        if evaluator is not None:
            start = time.process_time()
            found = nufft_field(layout, bank, phases, evaluator, threads=1).reshape(tilts, -1)[:, chosen]
            tiled = min(tiled, time.process_time() - start)
    direct *= 1e6 / len(bank) * views**2 / VIEWS
    tiled *= 1e6 / len(bank)
    row = f"{half:>5g} {views:>5} {tilts:>5} {tolerance:>8g} {planning:>8.2f} {direct:>10.0f}"
    if evaluator is None:
        return row + "  direct"
    error = np.linalg.norm(found - exact) / np.linalg.norm(exact)
    tiles = "x".join(str(n) for n in evaluator.tiling.counts)
    return row + f"  {tiles:<8}{evaluator.rank:>5}{tiled:>10.1f}{direct / tiled:>9.1f}{error:>11.1e}"


def stream(sampler: str, tilts: int, threads: int, folder: Path) -> str:
    """Bytes by which the process grows beside those stated."""
    this = scene(4096, tilts, 4e-6)
    stated = sg.plan(this, sampler=sampler, paths=100_000, streamed=True, threads=threads).memory_bytes  # type: ignore[arg-type]
    before, _ = resident_memory()
    start, clock = time.process_time(), time.perf_counter()
    array = sg.render_to_zarr(this, folder / sampler, sampler=sampler, paths=100_000, threads=threads, progress=True)
    took, clock = time.process_time() - start, time.perf_counter() - clock
    grown = resident_memory()[1] - before
    return (
        f"{sampler}: {array.nbytes / 2**30:.2f} GiB in {clock:.0f} s ({took:.0f} CPU s); the process grew by "
        f"{grown / 2**20:.0f} MiB, stated {stated / 2**20:.0f} MiB"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--streamed", action="store_true", help="stream large stacks instead")
    parser.add_argument("--tilts", type=int, default=2)
    parser.add_argument("--threads", type=int, default=1, help="of a streamed stack")
    parser.add_argument("--samplers", nargs="+", default=["paths", "stationary"], help="of streamed stacks")
    options = parser.parse_args()
    if options.streamed:
        with tempfile.TemporaryDirectory() as folder:
            for sampler in options.samplers:
                print(stream(sampler, options.tilts, options.threads, Path(folder)), flush=True)
        return
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; microseconds a connection")
    print(" half views tilts    asked   plan s     direct  tiles    rank     tiled    ratio      error")
    for case in CASES:
        print(compare(*case), flush=True)


if __name__ == "__main__":
    main()
