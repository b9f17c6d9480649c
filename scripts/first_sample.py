"""Processor seconds of the first sample of a process: imports, plan, sample and its modes; pilots anew, and kept.

    python scripts/first_sample.py                                         table of three recipes, three runs each
    python scripts/first_sample.py --recipes any-object --runs 5

Every run is a process of its own, those with pilots anew and with kept ones in turn, after one that compiles and keeps
what it can. Run it without PYTHONDONTWRITEBYTECODE, which makes every process compile the package's modules.
"""

import argparse
import json
import os
import subprocess
import sys

RECIPES = ("unknown-slab", "through-slab", "beyond-memory-effect")
STEPS = ("imports", "plan", "sample", "of it modes")
PROGRAM = """
import json, sys, time
from specklegen.datasets import load_recipe
import torch, scipy.special, numba
from specklegen.synthesis import imaging
make, modes = imaging.karhunen_loeve, []
def timed(*given):
    begun = time.process_time()
    made = make(*given)
    modes.append(time.process_time() - begun)
    return made
imaging.karhunen_loeve = timed
spent = [time.process_time()]
recipe = load_recipe(sys.argv[1])
recipe.rendering
spent.append(time.process_time())
recipe.sample(0, "train", 0)
spent.append(time.process_time())
print(json.dumps([b - a for a, b in zip([0.0, *spent[:-1]], spent)] + [sum(modes)]))
"""


def once(name: str, pilots: str) -> list[float]:
    """Seconds of each step in a new process."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, name], env=os.environ | {"SPECKLEGEN_PILOTS": pilots}, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recipes", nargs="+", default=RECIPES)
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    print(f"| | pilots | {' | '.join(STEPS)} |\n|---|---|{'---|' * len(STEPS)}")
    for name in options.recipes:
        once(name, "kept")
        found: dict[str, list[list[float]]] = {"anew": [], "kept": []}
        for _ in range(options.runs):
            for pilots, rows in found.items():
                rows.append(once(name, pilots))
        for pilots, rows in found.items():
            told = (f"{min(step):.3f} to {max(step):.3f}" for step in zip(*rows, strict=True))
            print(f"| {name} | {pilots} | {' | '.join(told)} |", flush=True)


if __name__ == "__main__":
    main()
