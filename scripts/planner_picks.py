"""Whether "auto" picks the quickest sampler: forty scenes, each for 1, 10 and 100 realizations.

    python scripts/planner_picks.py [SCENES] [FIRST]

Every sampler that serves a scene without a doubt is timed in processor seconds of one thread: its first realization,
and what a further one takes; set-up and draws for more realizations follow from these two. What the medium's memory
effect cost is counted anew for each. Samplers take turns, and the least of three turns counts, so that a busy machine
slows all of them alike. One that is predicted to take four times as long as others for every count is not timed, and
one that takes three times as long is timed once, after it has compiled.
Printed are the picks, how much longer than the best they take, what was predicted, and how many are within 15 %.
"""

import sys
import time
import warnings

import numpy as np

import specklegen as sg
from specklegen.core.parallel import one_blas_thread
from specklegen.memory_effects.kept import estimated_anew
from specklegen.planning.plan import Plan

COUNTS, SAMPLERS = (1, 10, 100), ("stationary", "paths", "covariance")
_DRAWS, _HOPELESS = 2, 4.0


def scene(n: int) -> tuple[sg.Scene, int]:
    """Scene n and its paths, drawn under the seed n: slabs, boxes in space and flatland, voxels, near and far."""
    drawn = np.random.default_rng(n)
    paths = int(10 ** drawn.uniform(3.3, 4.6))
    scatterer = sg.HenyeyGreenstein(float(drawn.uniform(0, 0.9)))
    lights, views = int(drawn.integers(1, 6)), int(drawn.integers(2, 40))
    if n % 2 == 0:
        depth = float(drawn.uniform(1, 12))
        medium = sg.Slab(thickness=1000.0, mean_free_path=1000 / depth, scatterer=scatterer)
        tilts = np.arange(lights if n % 4 else 4 * lights) * float(10 ** drawn.uniform(-5, -3.5))
        light, side = sg.CollimatedBeams.tilts(tilts, width=2e4), int(drawn.integers(8, 80))
        sensor = sg.FarField.grid((side, side), 8e-6)
        return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor), paths
    dimensions = 2 if n % 8 == 1 else 3
    corners = {"lower": [-20.0] * dimensions, "upper": [20.0] * dimensions}
    mean_free_path = float(drawn.uniform(10, 40))
    medium = sg.Box(**corners, mean_free_path=mean_free_path, scatterer=scatterer)
    if n % 8 == 3:
        extinction = drawn.uniform(0.2, 1, (4, 4, 4)) / mean_free_path
        medium = sg.VoxelGrid(**corners, extinction=extinction, scatterers=(scatterer,))
    angles = np.linspace(0.1, 0.5, views)
    aside = np.stack([np.sin(angles), *([] if dimensions == 2 else [0 * angles]), np.cos(angles)], axis=-1)
    light = sg.PlaneWaves(directions=aside[:: max(1, views // lights)][:lights])
    sensor = sg.NearField(points=60 * aside) if n % 8 == 5 else sg.FarField(directions=aside)
    return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor), paths


def measured(made: Plan, seed: int) -> tuple[float, float]:
    """Processor seconds of the first realization under a seed, and of a further one."""
    with estimated_anew(seed), one_blas_thread():
        before = time.process_time()
        media = made.chosen.prepare(seed, 1).media(1 + _DRAWS)
        next(media)
        first = time.process_time()
        for _ in media:
            pass
        after = time.process_time()
    return first - before, (after - first) / _DRAWS


def serving(where: sg.Scene, paths: int) -> dict[str, Plan]:
    """Plans of the samplers that serve without a doubt, and may be the quickest for some count."""
    found = {}
    for sampler in SAMPLERS:
        try:
            made = sg.plan(where, paths=paths, sampler=sampler, threads=1)
        except sg.RuleError:
            continue
        if not made.doubts:
            found[sampler] = made
    least = {count: min(made.chosen.seconds(count) for made in found.values()) for count in COUNTS}
    return {
        name: made for name, made in found.items()
        if any(made.chosen.seconds(count) <= _HOPELESS * least[count] for count in COUNTS)
    }  # fmt: skip


def _hopeful(runs: dict[str, list[tuple[float, float]]]) -> list[str]:
    """Samplers that take less than thrice the time of the best, for some count."""
    if not all(len(some) > 1 for some in runs.values()):  # the first compiles
        return list(runs)
    once, further = np.array([np.min(some[1:], axis=0) for some in runs.values()]).T
    totals = [once + (count - 1) * further for count in COUNTS]
    keep = np.any([total <= 3 * total.min() for total in totals], axis=0)
    return [name for name, good in zip(runs, keep, strict=True) if good]


def main(scenes: int, begin: int) -> None:
    """Time all, and print them."""
    within, asked = 0, 0
    for n in range(begin, scenes):
        where, paths = scene(n)
        plans = serving(where, paths)
        runs: dict[str, list[tuple[float, float]]] = {name: [] for name in plans}
        for turn in range(4):
            for name in _hopeful(runs):
                runs[name].append(measured(plans[name], turn))
        times = {name: np.min(some[1:], axis=0) for name, some in runs.items()}
        for count in COUNTS:
            pick = sg.plan(where, paths=paths, realizations=count, threads=1).sampler
            took = {name: first + (count - 1) * further for name, (first, further) in times.items()}
            excess = took.get(pick, np.inf) / min(took.values()) - 1
            asked, within = asked + 1, within + (excess <= 0.15)
            told = " ".join(
                f"{name} {each:.3g} ({plans[name].chosen.seconds(count):.3g})" for name, each in took.items()
            )
            shape = type(where.medium).__name__
            print(f"{n:3} {shape:10} {count:4} {pick:11} {100 * excess:6.0f} %  {told}", flush=True)
    print(f"{within} of {asked} picks are within 15 % of the best")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main(*(int(each) for each in (*sys.argv[1:], *("40", "0")[len(sys.argv) - 1 :])))
