"""Error against run time of every sampler on every scene: the tables and figures of docs/notes/performance.md.

    python scripts/error_vs_time.py                  # all scenes and the calibration: some 15 minutes on two idle cores
    python scripts/error_vs_time.py --quick          # rough curves of short runs, no calibration: under two minutes
    python scripts/error_vs_time.py --scenes NAME    # some scenes, no calibration; what is stored of others stays
    python scripts/error_vs_time.py --tables-only    # write the tables anew from the stored CSV files
    python scripts/error_vs_time.py --references     # freeze the right values anew; eleven minutes

The tables also take docs/performance/benchmark.json, which ``python scripts/benchmark.py --json`` writes. Every method
runs on one thread; two scenes run side by side. Results other than times are functions of the seeds.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import multiprocessing
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import fields
from pathlib import Path

from error_time import machine, references, tables
from error_time.calibration import RUNS, Calibrated, calibrate
from error_time.runs import BUDGETS, Row, run
from error_time.scenes import SCENES
from tqdm import tqdm

OUT = Path("docs/performance")
BUDGETS_QUICK = 3
LONGEST, LONGEST_QUICK = 2.0, 0.03
"""Processor seconds of the longest runs that are still repeated four times larger."""
THOROUGH = ("transmission-g0-od10", "transmission-g09-od10")
"""Scenes whose runs may be four times longer, for their slope; 3.0 decades of time were fitted with runs up to 36 s."""


def scene_rows(name: str, longest: float, budgets: int) -> list[Row]:
    """All methods on one scene."""
    return list(run(name, SCENES[name](), longest, budgets=budgets))


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line, run, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="short runs, no calibration")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES), metavar="NAME", help="only these")
    parser.add_argument("--longest", type=float, help="processor seconds of the longest runs")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1), help="scenes at a time")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of tables and figures; the page lies beside it")
    parser.add_argument("--tables-only", action="store_true", help="run nothing")
    parser.add_argument("--calibration-only", action="store_true", help="run the 200 seeds and no scene")
    parser.add_argument("--references", action="store_true", help="freeze the right values and stop")
    options = parser.parse_args(arguments)
    if options.references:
        for name in options.scenes:
            found = references.freeze(name, f"python scripts/error_vs_time.py --references --scenes {name}")
            print(f"{name}: {found.source}", flush=True)
        return
    options.out.mkdir(parents=True, exist_ok=True)
    if not options.tables_only:
        if not options.calibration_only:
            longest = options.longest or (LONGEST_QUICK if options.quick else LONGEST)
            measure(options.scenes, longest, BUDGETS_QUICK if options.quick else BUDGETS, options.workers, options.out)
        if options.calibration_only or not (options.quick or len(options.scenes) < len(SCENES)):
            with tqdm(unit="sampler") as bar:
                found = list(calibrate(RUNS, lambda what: (bar.set_description(what), bar.update())))
            tables.write_table(options.out / "calibration.csv", Calibrated._fields, [each._asdict() for each in found])
    print(tables.write(options.out))


def measure(names: Sequence[str], longest: float, budgets: int, workers: int, out: Path) -> None:
    """Run scenes side by side; rows and circumstances of each replace what is stored of it, as soon as it is done."""
    stored, about = tables.stored_rows(out), machine.stored(out)
    longest_of = {name: longest * (4 if name in THOROUGH else 1) for name in names}
    started = time.perf_counter()
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        jobs = {pool.submit(scene_rows, name, longest_of[name], budgets): name for name in names}
        for job in tqdm(as_completed(jobs), total=len(jobs), unit="scene"):
            name = jobs[job]
            stored = [row for row in stored if row.scene != name] + job.result()
            stored.sort(key=lambda row: list(SCENES).index(row.scene))
            about[name] = machine.circumstances() | {"longest": longest_of[name]}
            tables.write_table(out / "error-vs-time.csv", [*(f.name for f in fields(Row)), "efficiency"],
                  [row.written() for row in stored])  # fmt: skip
            machine.store(out, about)
    print(f"{len(names)} scenes in {(time.perf_counter() - started) / 60:.1f} minutes")


if __name__ == "__main__":
    main()
