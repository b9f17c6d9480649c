"""Work of fourteen jobs as counts, which no busy machine sways: compared with those kept, at 3 % more it fails.

    python scripts/counted_work.py            # compare with the kept ones; exit status 1 where one has grown
    python scripts/counted_work.py --keep     # keep the counts of now

Counted are, of a job that has been done once before under another seed, on one thread:

- calls: of functions, Python's and those of extensions, which is what a small job takes;
- events, connections: of the paths that were traced;
- points: strengths, and values of transforms, that go through FINUFFT;
- elements: of all tensors that torch makes.

What a kernel does within an event, or NumPy in a call, is not counted: `make speed` times that. Counts of calls depend
on the versions of libraries, which are kept with them; other versions are said.
"""

import gc
import json
import os
import sys
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import finufft
import numpy as np
import torch
from torch.utils._python_dispatch import TorchDispatchMode

import specklegen as sg
from specklegen.core.libraries import library_versions
from specklegen.core.parallel import run_serial_in_this_process
from specklegen.datasets import load_recipe
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.paths.volume_tracer import VolumeTracer

os.environ["SPECKLEGEN_CACHE"] = "kernels:"  # results of another run would be read, not computed
KEPT = Path(__file__).with_suffix(".json")
ALLOWED = 1.03
Job = Callable[[int], object]


class _Elements(TorchDispatchMode):
    """Counts the elements of what torch makes."""

    def __init__(self, counts: Counter[str]) -> None:
        super().__init__()
        self.counts = counts

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        made = func(*args, **(kwargs or {}))
        for each in made if isinstance(made, tuple | list) else (made,):
            if isinstance(each, torch.Tensor):
                self.counts["elements"] += each.numel()
        return made


@contextmanager
def counted() -> Iterator[Counter[str]]:
    """Count what is done meanwhile."""
    counts: Counter[str] = Counter()

    def tracing(trace: Callable) -> Callable:
        def counting(*args: Any, **named: Any) -> Any:
            bank = trace(*args, **named)
            counts["events"] += int(bank.events)
            counts["connections"] += len(bank)
            return bank

        return counting

    def transforming(execute: Callable) -> Callable:
        def counting(self: Any, data: np.ndarray, *args: Any, **named: Any) -> Any:
            made = execute(self, data, *args, **named)
            counts["points"] += data.size + np.size(made)
            return made

        return counting

    def called(_: Any, event: str, __: Any) -> None:
        if event in ("call", "c_call"):
            counts["calls"] += 1

    with ExitStack() as stack:
        for tracer in (SlabTracer, VolumeTracer):
            stack.enter_context(mock.patch.object(tracer, "trace", tracing(tracer.trace)))
        stack.enter_context(mock.patch.object(finufft.Plan, "execute", transforming(finufft.Plan.execute)))
        stack.enter_context(_Elements(counts))
        gc.collect()
        gc.disable()
        sys.setprofile(called)
        try:
            yield counts
        finally:
            sys.setprofile(None)
            gc.enable()


def slab(thickness: float = 2000.0, tilts: int = 5, side: Any = "transmission", views: int = 101) -> sg.Scene:
    """The slab of the README, or like it."""
    return sg.Scene(
        wavelength=1.0,
        medium=sg.Slab(thickness=thickness, mean_free_path=200.0, scatterer=sg.media.HenyeyGreenstein(0.9)),
        illumination=sg.light.CollimatedBeams.tilts(np.deg2rad(0.0025) * np.arange(tilts) / max(1, tilts / 5),
                                                    width=1e5),
        sensor=sg.sensors.FarField.grid((views, views), float(np.deg2rad(0.000125)), side=side),
    )


def hidden() -> sg.Scene:
    """An object of 28 x 28 pixels behind that slab."""
    brightness = np.zeros((28, 28))
    brightness[8:20, 10:18] = 1
    light = sg.light.IncoherentObject(brightness=brightness, pitch=2e-6, width=5e4)
    return slab().replace(illumination=light, sensor=sg.sensors.FarField.grid((128, 128), 1e-5))


def walled(medium: Any, near: bool = False) -> sg.Scene:
    """A body with sides, lit and seen aslant."""
    angles = np.linspace(0.1, 0.5, 8)
    aside = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1)
    sensor = sg.sensors.NearField(points=60 * aside) if near else sg.sensors.FarField(directions=aside)
    return sg.Scene(wavelength=1.0, medium=medium, illumination=sg.light.PlaneWaves(directions=aside[:3]),
                    sensor=sensor)


def rendered(scene: sg.Scene, paths: int, sampler: str = "paths") -> Job:
    """A render of a scene under a seed."""
    return lambda seed: sg.render(scene, paths=paths, sampler=sampler, seed=seed, threads=1)


def sampled(name: str) -> Job:
    """Eight samples of a recipe."""
    recipe = load_recipe(name)
    return lambda seed: recipe.batch(0, "train", range(8 * seed, 8 * seed + 8))


def jobs() -> dict[str, Job]:
    """All of them, by name."""
    corners = {"lower": [-20.0] * 3, "upper": [20.0] * 3}
    lobe = sg.media.HenyeyGreenstein(0.8)
    box = sg.media.Box(**corners, mean_free_path=20.0, scatterer=lobe)
    extinction = np.linspace(0.2, 1, 64).reshape(4, 4, 4) / 20
    voxels = sg.media.VoxelGrid(**corners, extinction=extinction, scatterers=(lobe,))
    return {
        "slab, path sums": rendered(slab(), 10_000),
        "slab, backscattered": rendered(slab(side="reflection", views=17), 1000),
        "slab, a stack of a new seed": rendered(slab(), 10_000, "stationary"),
        "slab, 120 tilts": rendered(slab(tilts=120), 10_000, "stationary"),
        "hidden object, an image": rendered(hidden(), 10_000, "stationary"),
        "box": rendered(walled(box), 2000),
        "box, near field": rendered(walled(box, near=True), 1000),
        "box, covariance": rendered(walled(box), 2000, "covariance"),
        "voxels": rendered(walled(voxels), 1000),
        "memory effect": lambda seed: sg.memory_effect(
            slab().medium, wavelength=1.0, tilts=[0.0, 1e-5, 1e-4], paths=10_000, seed=seed
        ),
        "plan of a further slab": lambda seed: sg.plan(slab(2000.0 + seed), rel_error=0.02, threads=1),
        "through-slab, 8 samples": sampled("through-slab"),
        "tilt-stack, 8 samples": sampled("tilt-stack"),
        "unknown-slab, 8 samples": sampled("unknown-slab"),
    }


def measured() -> dict[str, dict[str, int]]:
    """Counts of every job."""
    found = {}
    for name, job in jobs().items():
        with counted():  # counting loads something, too
            job(1)
        with counted() as counts:
            job(2)
        found[name] = dict(sorted(counts.items()))
    return found


def grown(now: dict[str, dict[str, int]], before: dict[str, dict[str, int]]) -> list[str]:
    """What has become more than 3 % more, in words."""
    return [
        f"{name}: {kind} {before[name].get(kind, 0)} -> {count}"
        for name, counts in now.items() if name in before
        for kind, count in counts.items() if count > ALLOWED * before[name].get(kind, 0)
    ]  # fmt: skip


def _times(count: int, before: int | None) -> str:
    return f" ({count / before:.3f})" if before else ""


def main() -> None:
    """Count, and keep or compare."""
    options = ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--keep", action="store_true", help="keep these counts instead of comparing them")
    keep = options.parse_args().keep
    run_serial_in_this_process()
    torch.set_num_threads(1)
    now, versions = measured(), dict(library_versions())
    kept = {"counts": {}, "versions": {}} if keep else json.loads(KEPT.read_text())
    for name, counts in now.items():
        before = kept["counts"].get(name, {})
        said = (f"  {kind} {count}" + _times(count, before.get(kind)) for kind, count in counts.items())
        print(f"{name:28s}" + "".join(said))
    if keep:
        KEPT.write_text(json.dumps({"counts": now, "versions": versions}, indent=1) + "\n")
        return
    others = {name: version for name, version in versions.items() if kept["versions"].get(name) != version}
    if others:
        print(f"kept with other versions of {', '.join(others)}: counts of calls may differ by them")
    more = grown(now, kept["counts"])
    if more:
        sys.exit("more work than before:\n" + "\n".join(more))


if __name__ == "__main__":
    main()
