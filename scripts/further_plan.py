"""Processor seconds of the plan of a further scene beside those of its render, at rel_error=.02, on one thread.

    python scripts/further_plan.py [TURNS] [SCENES ...]

Every turn plans and renders each scene once with a mean free path that no turn had before, so that nothing of it is
known but what the program has compiled; pilots kept on disk are not read. Printed are the least and the median of plan
and render, and of their ratio in each turn.
"""

import os
import sys
import time
import warnings

os.environ["SPECKLEGEN_PILOTS"] = "anew"

import numpy as np

import specklegen as sg
from specklegen.core.parallel import one_blas_thread

GRID = sg.FarField.grid((101, 101), 2e-6)
BEAMS = sg.CollimatedBeams.tilts(np.arange(5) * 4e-5, width=1e5)


def _scene(medium: object, light: object, sensor: object) -> sg.Scene:
    return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor)


def slab(free: float, g: float, **parts: object) -> sg.Scene:
    """Five tilts through a slab of optical depth 10, on 101 x 101 views."""
    medium = sg.Slab(thickness=2000.0, mean_free_path=200 * free, scatterer=sg.HenyeyGreenstein(g), **parts)
    return _scene(medium, BEAMS, GRID)


def thin(free: float) -> sg.Scene:
    """A slab of optical depth 2: single scattering has a part in it."""
    medium = sg.Slab(thickness=400.0, mean_free_path=200 * free, scatterer=sg.HenyeyGreenstein(0.7))
    return _scene(medium, BEAMS, GRID)


def wide(free: float) -> sg.Scene:
    """Views so far apart that the grid is cut into tiles or takes a high rank."""
    medium = sg.Slab(thickness=100.0, mean_free_path=20 * free, scatterer=sg.HenyeyGreenstein(0.8))
    light = sg.CollimatedBeams.tilts([0.0, 1e-3], width=500.0)
    return _scene(medium, light, sg.FarField.grid((120, 120), 1e-3))


def hidden(free: float) -> sg.Scene:
    """An object of 28 x 28 pixels behind a slab."""
    brightness = np.random.default_rng(0).random((28, 28)) > 0.65
    light = sg.IncoherentObject(brightness=brightness.astype(float), pitch=4e-6, width=1e5)
    medium = sg.Slab(thickness=2000.0, mean_free_path=200 * free, scatterer=sg.HenyeyGreenstein(0.9))
    return _scene(medium, light, sg.FarField.grid((128, 128), 2e-6))


def layers(free: float) -> sg.Scene:
    """Two layers of their own scatterers."""
    parts = [
        sg.Layer(thickness=500.0, mean_free_path=100 * free, scatterer=sg.HenyeyGreenstein(0.9)),
        sg.Layer(thickness=1000.0, mean_free_path=250 * free, scatterer=sg.HenyeyGreenstein(0.6)),
    ]
    return _scene(sg.Layers(layers=parts), BEAMS, GRID)


def _around(near: bool) -> tuple[sg.PlaneWaves, object]:
    angles = np.linspace(0.1, 0.5, 30)
    aside = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1)
    sensor = sg.NearField(points=60 * aside) if near else sg.FarField(directions=aside)
    return sg.PlaneWaves(directions=aside[::10]), sensor


def box(free: float, near: bool = False) -> sg.Scene:
    """A cube, seen from afar or near by."""
    medium = sg.Box(lower=[-20.0] * 3, upper=[20.0] * 3, mean_free_path=10 * free, scatterer=sg.HenyeyGreenstein(0.5))
    return _scene(medium, *_around(near))


def voxels(free: float) -> sg.Scene:
    """4 x 4 x 4 voxels."""
    extinction = np.random.default_rng(1).uniform(0.2, 1, (4, 4, 4)) / (10 * free)
    medium = sg.VoxelGrid(
        lower=[-20.0] * 3, upper=[20.0] * 3, extinction=extinction, scatterers=(sg.HenyeyGreenstein(0.5),)
    )
    return _scene(medium, *_around(False))


CASES = {
    "slab, g = .9": (lambda free: slab(free, 0.9), "auto"),
    "slab, g = .9, paths": (lambda free: slab(free, 0.9), "paths"),
    "slab, g = .7, paths": (lambda free: slab(free, 0.7), "paths"),
    "thin slab, paths": (thin, "paths"),
    "wide field, paths": (wide, "paths"),
    "layers, paths": (layers, "paths"),
    "hidden object": (hidden, "auto"),
    "box": (box, "auto"),
    "near field": (lambda free: box(free, True), "auto"),
    "voxels": (voxels, "auto"),
}


def once(name: str, turn: int) -> tuple[float, float]:
    """Processor seconds of the plan and of the render of a scene of its own."""
    make, sampler = CASES[name]
    scene = make(1 + 1e-3 * turn + 1e-5 * list(CASES).index(name))
    spent = [time.process_time()]
    sg.plan(scene, rel_error=0.02, sampler=sampler, threads=1)
    spent.append(time.process_time())
    sg.render(scene, rel_error=0.02, sampler=sampler, threads=1, seed=turn)
    spent.append(time.process_time())
    return spent[1] - spent[0], spent[2] - spent[1]


def main(turns: int, names: list[str]) -> None:
    """Measure and print the table."""
    found = {name: [] for name in names}
    with one_blas_thread():
        for turn in range(turns + 1):
            for name, rows in found.items():
                rows.append(once(name, turn))
    print("| scene | plan, ms: least, median | render, ms: least, median | plan / render, median |\n|---|---|---|---|")
    for name, rows in found.items():
        plans, renders = 1e3 * np.array(rows[1:]).T  # the first turn compiles
        told = [f"{each.min():.1f}, {np.median(each):.1f}" for each in (plans, renders)]
        print(f"| {name} | {' | '.join(told)} | {np.median(plans / renders):.2f} |", flush=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main(int((sys.argv[1:] or ["8"])[0]), sys.argv[2:] or list(CASES))
