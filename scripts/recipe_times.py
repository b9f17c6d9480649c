"""CPU milliseconds a sample of every packaged recipe, beside those of another tree of this project.

    git worktree add ../before COMMIT
    python scripts/recipe_times.py ../before                          all recipes that both trees have
    python scripts/recipe_times.py ../before --recipes tilt-stack --batches 16 --seconds 20

Each tree runs in processes of its own, one for every way in which it makes samples: "batch" (``recipe.batch``: streams
on the CPU, stores) and, in trees that have a second program for devices, "batched" (`SpeckleGenerator`). They are asked
in turn for the same sample numbers, one torch thread each, on their own processor clocks; what is kept of media is made
before. A ratio is that to the better way of the other tree: of the least times of each, and the median over rounds of
the times of one round. The last columns are the most memory that the processes held, MB.
"""

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

HERE = Path(__file__).parents[1]
WORKER = """
import sys, time
from pathlib import Path
from specklegen.datasets import load_recipe
name, way = sys.argv[1:]
recipe = load_recipe(name)
if way == "batched":
    from specklegen.datasets.batched.generator import SpeckleGenerator
    make = SpeckleGenerator(recipe, 0, "train", "cpu")
else:
    make = lambda numbers: recipe.batch(0, "train", numbers)
print("ready", flush=True)
for line in sys.stdin:
    first, last = map(int, line.split())
    start = time.process_time()
    make(range(first, last))
    took = time.process_time() - start
    status = Path("/proc/self/status").read_text()
    peak = int(status.split("VmHWM:")[1].split()[0]) / 1024
    print(took, peak, flush=True)
"""
WARM = 64
"""Samples made before anything is timed."""


@dataclass
class Way:
    """A process that makes samples of one recipe in one way.

    Attributes
    ----------
    process : subprocess.Popen
    times : dict of list of float
        Milliseconds a sample of every round, by the size of its batches.
    peak : float
        Most memory, MB.
    """

    process: subprocess.Popen
    times: dict[int, list[float]] = field(default_factory=dict)
    peak: float = 0.0

    @classmethod
    def start(cls, tree: Path, recipe: str, way: str) -> "Way | None":
        """Start one; None where the tree has no such recipe or way."""
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        process = subprocess.Popen(
            [sys.executable, "-c", WORKER, recipe, way], cwd=tree, text=True, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **threads, "PYTHONPATH": str(tree)},
        )  # fmt: skip
        assert process.stdout is not None, "a pipe"
        return cls(process) if process.stdout.readline().strip() == "ready" else None

    def make(self, first: int, count: int) -> float:
        """Make samples; CPU milliseconds each."""
        assert self.process.stdin is not None, "a pipe"
        assert self.process.stdout is not None, "a pipe"
        self.process.stdin.write(f"{first} {first + count}\n")
        self.process.stdin.flush()
        took, self.peak = map(float, self.process.stdout.readline().split())
        return 1e3 * took / count

    def stop(self) -> None:
        """End the process."""
        assert self.process.stdin is not None, "a pipe"
        self.process.stdin.close()
        self.process.wait()


def compared(recipe: str, other: Path, batches: list[int], seconds: float, rounds: int) -> list[str]:
    """Lines of the table of one recipe."""
    asked = {"batch, before": (other, "batch"), "batched, before": (other, "batched"), "now": (HERE, "batch")}
    started = {name: Way.start(*where[:1], recipe, where[1]) for name, where in asked.items()}
    ways = {name: way for name, way in started.items() if way is not None}
    lines = []
    if "now" in ways:
        warm = {name: way.make(0, WARM) for name, way in ways.items()}
        for size in batches:
            most = 1e3 * seconds / (size * sum(warm.values()))
            first = 2**20
            for _ in range(max(3, min(rounds, int(most)))):
                for way in ways.values():
                    way.times.setdefault(size, []).append(way.make(first, size))
                first += size
            lines.append(_line(recipe, size, ways))
    for way in ways.values():
        way.stop()
    return lines


def _line(recipe: str, size: int, ways: dict[str, Way]) -> str:
    least = {name: min(way.times[size]) for name, way in ways.items()}
    before = [way for name, way in ways.items() if name != "now"]
    cells = [f"{least[name]:.3g}" if name in least else "" for name in ("batch, before", "batched, before", "now")]
    if before:
        best = min(min(way.times[size]) for way in before)
        rounds = np.min([way.times[size] for way in before], axis=0)
        paired = np.median(np.array(ways["now"].times[size]) / rounds)
        cells += [f"{least['now'] / best:.2f}", f"{paired:.2f}"]
        cells += [" / ".join(f"{way.peak:.0f}" for way in before), f"{ways['now'].peak:.0f}"]
    return f"| {recipe} | {size} | " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("tree", type=Path, help="folder of the other tree")
    packaged = sorted(file.stem for file in (HERE / "datasets/recipes/packaged").glob("*.toml"))
    arguments.add_argument("--recipes", nargs="+", default=packaged, choices=packaged, metavar="NAME")
    arguments.add_argument("--batches", nargs="+", type=int, default=[16, 64])
    arguments.add_argument("--rounds", type=int, default=12, help="of every size, at the most")
    arguments.add_argument("--seconds", type=float, default=60.0, help="of every size, about; at least three rounds")
    asked = arguments.parse_args()
    print("| recipe | samples | batch, before | batched, before | now | least | median | MB before | MB now |")
    print("|---|---|---|---|---|---|---|---|---|")
    for recipe in asked.recipes:
        for line in compared(recipe, asked.tree.resolve(), asked.batches, asked.seconds, asked.rounds):
            print(line, flush=True)


if __name__ == "__main__":
    main()
