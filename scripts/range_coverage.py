"""How often the interval of a fitted memory-effect range holds the range: fresh images behind eight materials.

    python scripts/range_coverage.py --images 50                    # 400 intervals of one image each
    python scripts/range_coverage.py --images 96 --together 4       # 192 intervals of four images each
    python scripts/range_coverage.py --images 16 --frames 9

Three of the materials are thin: their C_I never falls to one half, or far beyond the object, and an interval that holds
their range has no upper end. The shape of C_I is that of `one-angular-size`, as where the slab is not known.
"""

import argparse
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.stats import binomtest

from specklegen.core.errors import RuleError, reject
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models import Solver, load_solver
from specklegen.models.learning.measurement import memory_effect_of, seen_by_camera
from specklegen.models.learning.range_fit import fit_range, range_of
from specklegen.models.recoverability.assessment import Setup, setup_of

MATERIALS: dict[str, dict[str, float]] = {
    "optical depth 0.5": {"thickness": 100.0, "optical_depth": 0.5, "g": 0.9},
    "optical depth 2": {"thickness": 300.0, "optical_depth": 2.0, "g": 0.95},
    "optical depth 3": {"thickness": 600.0, "optical_depth": 3.0, "g": 0.9},
    "through-slab": {"thickness": 1000.0, "optical_depth": 10.0, "g": 0.9},
    "thick": {"thickness": 4000.0, "optical_depth": 20.0, "g": 0.95},
    "g 0.7": {"thickness": 2000.0, "optical_depth": 12.0, "g": 0.7},
    "isotropic": {"thickness": 1500.0, "optical_depth": 15.0, "g": 0.0},
    "absorbing": {"thickness": 3000.0, "optical_depth": 15.0, "g": 0.85, "albedo": 0.99},
}
LEVELS = 0.68, 0.95
SEED = 90


class Coverage(NamedTuple):
    """Of one material: the range over the setup's, which intervals hold it, and which have no upper end."""

    factor: float
    holds: dict[float, list[bool]]
    open_above: list[bool]


def behind(material: dict[str, Any], images: int, frames: int, seed: int) -> tuple[HiddenObject, torch.Tensor]:
    """Recipe, and images real[B, F, H, W] of objects of many kinds behind media of one material."""
    recipe = load_recipe("any-object", {"material": {**material, "kernel": "estimate", "kernel_paths": 100000}})
    if not isinstance(recipe, HiddenObject):
        reject("behind recipe", "one with hidden objects", recipe.name)
    stack = [[recipe.prepare(seed, "test", n * frames + f).images(recipe.objects.image(seed, "test", n))[0]
              for f in range(frames)] for n in range(images)]  # fmt: skip
    return recipe, torch.from_numpy(np.asarray(stack, np.float32))


def coverage(
    solver: Solver, setup: Setup, material: dict[str, Any], images: int, together: int = 1, frames: int = 1,
    seed: int = SEED,
) -> Coverage:  # fmt: skip
    """Fit ranges to sets of images behind a material."""
    recipe, stack = behind(material, images, frames, seed)
    c_i = memory_effect_of(recipe.material_of(seed, "test", 0).correlation, recipe.wavelength, setup.pitch)
    try:
        factor = range_of(c_i) / range_of(setup.memory_effect)
    except RuleError:
        factor = float("inf")
    holds: dict[float, list[bool]] = {level: [] for level in LEVELS}
    open_above = []
    grain = torch.full((together,), float(setup.optics.grain))
    for few in stack.split(together):
        if len(few) == together:
            fit = fit_range(solver, seen_by_camera(few, grain), setup.optics, [setup.memory_effect] * together)
            for level in LEVELS:
                low, high = fit.interval(level)
                holds[level].append(low <= factor <= high)
            open_above.append(fit.high == float("inf"))
    return Coverage(factor, holds, open_above)


def share(holds: list[bool]) -> str:
    """Share of intervals that hold, with Wilson's 99 % limits."""
    found = binomtest(sum(holds), len(holds)).proportion_ci(0.99, "wilson")
    return f"{np.mean(holds):.3f} [{found.low:.3f}, {found.high:.3f}]"


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--images", type=int, default=50, help="Images behind each material.")
    options.add_argument("--together", type=int, default=1, help="Images that a range is fitted to.")
    options.add_argument("--frames", type=int, default=1, help="Frames of each object.")
    options.add_argument("--seed", type=int, default=SEED)
    given = options.parse_args()
    torch.set_num_threads(1)
    solver, setup = load_solver(), setup_of(load_recipe("one-angular-size"))
    every: dict[float, list[bool]] = {level: [] for level in LEVELS}
    print("| material | range over the setup's | intervals | 68 % | 95 % | no upper end at 95 % |\n" + "|---" * 6 + "|")
    for n, (name, material) in enumerate(MATERIALS.items()):
        found = coverage(solver, setup, material, given.images, given.together, given.frames, given.seed + n)
        for level in LEVELS:
            every[level] += found.holds[level]
        told = " | ".join(share(found.holds[level]) for level in LEVELS)
        counted = f"{found.factor:.3g} | {len(found.open_above)}"
        print(f"| {name} | {counted} | {told} | {np.mean(found.open_above):.2f} |", flush=True)
    print(f"| all | | {len(every[LEVELS[0]])} | {' | '.join(share(every[level]) for level in LEVELS)} | |")


if __name__ == "__main__":
    main()
