"""CPU milliseconds a sample of every packaged recipe, beside those of another tree of this project.

    git worktree add ../before COMMIT
    python scripts/recipe_times.py ../before                          all recipes that both trees have
    python scripts/recipe_times.py ../before --recipes tilt-stack --batches 16 --seconds 20

Each tree runs in a process of its own. Both make the same sample numbers in turn (``recipe.batch``), with one torch
thread each, on their own CPU clocks; cached media are made before. A ratio is that of the least times, and the median
over rounds of the ratio of one round. The last columns are the most memory that the processes held, MB.
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
recipe = load_recipe(sys.argv[1])
print("ready", flush=True)
for line in sys.stdin:
    first, last = map(int, line.split())
    start = time.process_time()
    recipe.batch(0, "train", range(first, last))
    took = time.process_time() - start
    status = Path("/proc/self/status").read_text()
    peak = int(status.split("VmHWM:")[1].split()[0]) / 1024
    print(took, peak, flush=True)
"""
WARM = 64
"""Samples made before anything is timed."""


@dataclass
class Maker:
    """A process of one tree that makes samples of one recipe.

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
    def start(cls, tree: Path, recipe: str) -> "Maker | None":
        """Start one; None where the tree has no such recipe."""
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        process = subprocess.Popen(
            [sys.executable, "-c", WORKER, recipe], cwd=tree, text=True, stdin=subprocess.PIPE,
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
    """Lines of the table of one recipe; none where a tree lacks it."""
    before, now = Maker.start(other, recipe), Maker.start(HERE, recipe)
    if before is None or now is None:
        return []
    warm = before.make(0, WARM) + now.make(0, WARM)
    lines, first = [], 2**20
    for size in batches:
        for _ in range(max(3, min(rounds, int(1e3 * seconds / (size * warm))))):
            for maker in (before, now):
                maker.times.setdefault(size, []).append(maker.make(first, size))
            first += size
        old, new = min(before.times[size]), min(now.times[size])
        paired = np.median(np.divide(now.times[size], before.times[size]))
        lines.append(f"| {recipe} | {size} | {old:.3g} | {new:.3g} | {new / old:.3f} | {paired:.3f} "
                     f"| {before.peak:.0f} | {now.peak:.0f} |")  # fmt: skip
    for maker in (before, now):
        maker.stop()
    return lines


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
    print("| recipe | samples | ms before | ms now | least | median | MB before | MB now |")
    print("|---|---|---|---|---|---|---|---|")
    for recipe in asked.recipes:
        for line in compared(recipe, asked.tree.resolve(), asked.batches, asked.seconds, asked.rounds):
            print(line, flush=True)


if __name__ == "__main__":
    main()
