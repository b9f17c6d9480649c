"""How even the p-values of ``sg.twin`` are where nothing differs, and in how many sets a wrong setup is told and named.

    python scripts/twin_power.py run --out twin.csv [--first 0] [--runs 100] [--workers 16] [--seconds 140]
    python scripts/twin_power.py table twin.csv [more.csv ...]

Null: 16 photographs of 96 x 96 pixels of a drawn setup (iris, grain 3 to 6 pixels, polarised or not, noise 0 to 15 %), beside the
setup that is fitted to them. Wrong setups: 16 stacks of five tilts of a slab (g .9, optical depth 8), whose C_I is .989 from tilt to
tilt, beside the recipe that they are not of.
"""  # noqa: E501

import argparse
import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from _rows import write_rows
from scipy.stats import kstest

import specklegen as sg
from specklegen.core.statistics import wilson
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.recipe_files import changed
from specklegen.models.calibration.point_speckle import PointSpeckle

RECIPE: Mapping[str, Any] = {
    "material": {"g": 0.9, "optical_depth": 8.0, "thickness": 800.0}, "camera": {"shape": [96, 96]},
}  # fmt: skip
STEP = 4.3633231299858236e-05
WRONG: Mapping[str, tuple[Mapping[str, Any], tuple[str, ...]]] = {
    "range 15 % shorter": ({"material": {"thickness": 800.0 / 0.85}}, ("C_I",)),
    "analyser left out": ({"light": {"polarised": False}}, ("contrast",)),
    "out of focus": ({"tilts": {"step": 1.05 * STEP}}, ("displacement",)),
    "disc for a square": ({"window": {"profile": "disc"}}, ("grain", "spectrum")),
    "nothing": ({}, ()),
}
"""What is wrong of the photographs, and the group, or one of the groups, that should name it."""
HEAD = ("kind", "run", "p", "differs")


def null(run: int) -> list[Any]:
    """A set of photographs beside what was fitted to it."""
    rng = np.random.default_rng([31, run])
    profile = ("square", "disc", "gaussian")[rng.integers(3)]
    setup = PointSpeckle(profile, rng.uniform(3, 6), (1.0, 0.5)[rng.integers(2)], rng.uniform(0, 0.15) ** 2, True)
    found = sg.twin(setup.draw((96, 96), 16, 1000 + run), images=64, seed=run)
    return ["fitted", run, f"{found.p_value:.4f}", " ".join(each.name.replace(" ", "-") for each in found.differs)]


def wrong(kind: str, run: int) -> list[Any]:
    """A set of stacks beside a recipe that they are not of."""
    other = load_recipe("tilt-stack", changed(RECIPE, WRONG[kind][0]))
    frames = np.concatenate(list(other.batch(5000 + run, "train", range(16))["stack"]))
    found = sg.twin(frames, load_recipe("tilt-stack", RECIPE), images=64, seed=run)
    return [kind, run, f"{found.p_value:.4f}", " ".join(each.name.replace(" ", "-") for each in found.differs)]


def one(task: tuple[str, int]) -> list[Any]:
    """A line of the table."""
    kind, run = task
    return null(run) if kind == "fitted" else wrong(kind, run)


def table(files: Iterable[Path]) -> str:
    """What the lines of tables say together, in Markdown."""
    rows = [row for file in files for row in csv.DictReader(file.read_text().splitlines())]
    lines = ["| | sets | told (p < .05) | p below .01 | named |", "|---|---|---|---|---|"]
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        p = np.array([float(row["p"]) for row in own])
        names = [name.replace(" ", "-") for name in WRONG.get(kind, ({}, ()))[1]]
        named = sum(any(name in row["differs"].split() for name in names) for row in own)
        low, high = wilson(int((p < 0.05).sum()), len(p))
        even = f"; p-values even: Kolmogorov-Smirnov p {kstest(p, 'uniform').pvalue:.2f}" if not names else ""
        lines.append(f"| {kind} | {len(p)} | {(p < 0.05).sum()} ({low:.2f} to {high:.2f}) | {(p < 0.01).sum()} | "
                     f"{named if names else '-'}{even} |")  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    """Read the command line."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("task", choices=("run", "table"))
    asked.add_argument("files", nargs="*", type=Path)
    asked.add_argument("--out", type=Path, default=Path("twin.csv"))
    asked.add_argument("--first", type=int, default=0)
    asked.add_argument("--runs", type=int, default=100)
    asked.add_argument("--kinds", nargs="+", default=["fitted", *WRONG])
    asked.add_argument("--workers", type=int, default=16)
    asked.add_argument("--seconds", type=float, default=1e9)
    given = asked.parse_args()
    if given.task == "table":
        print(table(given.files or [given.out]))
        return
    load_recipe("tilt-stack", RECIPE).batch(0, "train", range(2))  # compiled before there are several of us
    tasks = [(kind, run) for run in range(given.first, given.first + given.runs) for kind in given.kinds]
    write_rows(one, tasks, given.out, given.workers, given.seconds, HEAD)
    print(table([given.out]))


if __name__ == "__main__":
    main()
