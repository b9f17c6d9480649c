"""Count the functions that a scene and a sample pass through, and the circles of imports inside rooms.

Counted are Python functions of this package, by ``sys.setprofile``, in the second of two like calls in a process (the
first one compiles kernels and estimates what is cached), on one thread. The plan of a new scene reads nothing that is
cached on disk.

- named: functions and methods, and the files they are in. Properties and double-underscore methods are left out; a
  comprehension or a lambda is a part of the function that holds it.
- all: every code object, properties, comprehensions and lambdas as well, with the number of all their calls.

Imports count wherever they stand, in functions and under ``TYPE_CHECKING`` too. A circle is a set of files of one room
of which each imports every other one, directly or through others.

    python scripts/count_calls.py            # table of calls, and the circles
    python scripts/count_calls.py --list     # the functions as well
"""

import ast
import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from itertools import count
from pathlib import Path
from types import CodeType, FrameType
from typing import Any
from unittest import mock

import numpy as np
import torch

import specklegen as sg
from specklegen.core.parallel import run_serial_in_this_process
from specklegen.datasets import load_recipe

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("specklegen", "datasets", "models")
MOST_NAMED, MOST_FILES, MOST_CIRCLES = 47, 22, 5
"""Functions and files of a render, and circles, that there are; a test holds the library to them. Lower them."""
Function = tuple[str, int, str]
"""File, line and qualified name of a function."""


@cache
def file_of(name: str) -> str | None:
    """Return the file of the package that a code object names, below the root; None for other files."""
    path = os.path.realpath(name)
    below = os.path.relpath(path, ROOT)
    return below if os.path.isabs(name) and below.split(os.sep)[0] in FOLDERS else None


def calls_of(job: Callable[[], object]) -> Counter[Function]:
    """Count the calls of every function of the package in the second of two calls of a job."""
    codes: Counter[CodeType] = Counter()

    def profile(frame: FrameType, event: str, _: Any) -> None:
        if event == "call":
            codes[frame.f_code] += 1

    job()
    sys.setprofile(profile)
    try:
        job()
    finally:
        sys.setprofile(None)
    calls: Counter[Function] = Counter()
    for code, times in codes.items():
        file = file_of(code.co_filename)
        if file is not None:
            calls[file, code.co_firstlineno, code.co_qualname] += times
    return calls


def is_named(function: Function) -> bool:
    """Tell functions and methods from properties, double-underscore methods, comprehensions and lambdas."""
    file, line, name = function
    last = name.split(".")[-1]
    decorator = (ROOT / file).read_text(encoding="utf-8").splitlines()[line - 1]
    return not (last.startswith("<") or re.fullmatch(r"__\w+__", last) or "property" in decorator)


def scene(thickness: float = 1000.0) -> sg.Scene:
    """Return the scene of the README, or one of another thickness."""
    return sg.Scene(
        wavelength=0.5,
        medium=sg.Slab(thickness=thickness, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9)),
        illumination=sg.light.CollimatedBeams.tilts(np.deg2rad(0.0025) * np.arange(5), width=50_000.0),
        sensor=sg.sensors.FarField.grid(shape=(101, 101), pitch=2.2e-6),
    )


def jobs() -> dict[str, Callable[[], object]]:
    """Return what is counted, by name."""
    readme, recipe, numbers, thicknesses = scene(), load_recipe("unknown-slab"), count(1), count(1100, 100)

    def plan_anew() -> object:
        with mock.patch.dict(os.environ, {"SPECKLEGEN_CACHE": "kernels:"}):
            return sg.plan(scene(float(next(thicknesses))))

    return {
        "render(scene)": lambda: sg.render(readme, seed=0),
        "plan(scene)": lambda: sg.plan(readme),
        "plan of a new scene": plan_anew,
        "sample of unknown-slab": lambda: recipe.sample(0, "train", next(numbers)),
    }


def modules() -> dict[str, Path]:
    """Return the files of the package by the names of their modules."""
    found = {}
    for folder in FOLDERS:
        for file in sorted((ROOT / folder).rglob("*.py")):
            below = file.relative_to(ROOT)
            if any((ROOT / parent).is_symlink() for parent in below.parents):
                continue  # the links to datasets and models
            parts = [part for part in below.with_suffix("").parts if part != "__init__"]
            found[".".join(parts if folder == "specklegen" else ["specklegen", *parts])] = file
    return found


def imports_of(file: Path, known: dict[str, Path]) -> Iterator[str]:
    """Yield the modules of the package that a file imports anywhere."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from (
                name if (name := f"{node.module}.{each.name}") in known else node.module for each in node.names
            )
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)


def circles() -> list[list[str]]:
    """Return the circles of imports inside rooms: sets of modules that reach each other."""
    known = modules()

    def room(name: str) -> str:
        return name.split(".")[1] if "." in name else name

    edges = {
        name: {other for other in imports_of(file, known) if other in known and room(other) == room(name)} - {name}
        for name, file in known.items()
    }

    def reached(name: str) -> set[str]:
        seen, left = set(), [name]
        while left:
            following = edges[left.pop()] - seen
            seen |= following
            left += following
        return seen

    reach = {name: reached(name) for name in known}
    groups = {tuple(sorted({a, *(b for b in reach[a] if a in reach[b])})) for a in known if a in reach[a]}
    return [list(group) for group in sorted(groups)]


def main() -> None:
    """Print the tables."""
    run_serial_in_this_process()
    torch.set_num_threads(1)
    print(f"{'second call':24} {'named':>6} {'files':>6} {'of core':>9} {'all':>6} {'files':>6} {'calls':>6}")
    for name, job in jobs().items():
        calls = calls_of(job)
        named = [function for function in calls if is_named(function)]
        files = {file for file, *_ in named}
        core = [file for file, *_ in named if file.startswith("specklegen/core/")]
        print(f"{name:24} {len(named):6} {len(files):6} {len(core):5} {len(set(core)):3} {len(calls):6} "
              f"{len({file for file, *_ in calls}):6} {sum(calls.values()):6}")  # fmt: skip
        if "--list" in sys.argv:
            for function in sorted(calls):
                print(f"    {calls[function]:4}  {'' if is_named(function) else '(part) '}{function[0]}:{function[1]} "
                      f"{function[2]}")  # fmt: skip
    found = circles()
    print(f"{len(found)} circles of imports inside rooms, of {sum(map(len, found))} files:")
    for names in found:
        print("   ", ", ".join(name.removeprefix("specklegen.") for name in names))


if __name__ == "__main__":
    main()
