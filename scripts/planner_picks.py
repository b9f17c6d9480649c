"""Whether "auto" picks the quickest sampler: forty scenes, each for 1, 10 and 100 realizations.

    python scripts/planner_picks.py [SCENES]

Every sampler that serves a scene without a doubt is timed in processor seconds of one thread: its first realization,
and what a further one takes; set-up and draws for more realizations follow from these two. What the medium's memory
effect cost is counted anew for each. Printed are the picks, how much longer than the best they take, and how many are
within 15 %.
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
_DRAWS = 3


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


def measured(made: Plan) -> tuple[float, float]:
    """Processor seconds of the first realization, and of a further one: the least of two runs."""
    runs = []
    for seed in (1, 2):
        with estimated_anew(seed), one_blas_thread():
            before = time.process_time()
            media = made.chosen.prepare(seed, 1).media(1 + _DRAWS)
            next(media)
            first = time.process_time()
            for _ in media:
                pass
            after = time.process_time()
        runs.append((first - before, (after - first) / _DRAWS))
    return min(each[0] for each in runs), min(each[1] for each in runs)


def main(scenes: int) -> None:
    """Time all, and print them."""
    within, asked = 0, 0
    for n in range(scenes):
        where, paths = scene(n)
        times = {}
        for sampler in SAMPLERS:
            try:
                made = sg.plan(where, paths=paths, sampler=sampler, threads=1)
            except sg.RuleError:
                continue
            if not made.doubts:
                measured(made)  # compiles
                times[sampler] = measured(made)
        for count in COUNTS:
            pick = sg.plan(where, paths=paths, realizations=count, threads=1).sampler
            took = {name: first + (count - 1) * further for name, (first, further) in times.items()}
            took[pick] = took.get(pick, float("nan"))
            excess = took[pick] / min(took.values()) - 1
            asked, within = asked + 1, within + (excess <= 0.15)
            told = " ".join(f"{name} {each:.3g} s" for name, each in took.items())
            shape = type(where.medium).__name__
            print(f"{n:3} {shape:10} {count:4} {pick:11} {100 * excess:6.0f} %  {told}", flush=True)
    print(f"{within} of {asked} picks are within 15 % of the best")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
