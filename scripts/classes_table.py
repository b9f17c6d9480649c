"""How often a character is named rightly by the law of images alone: ``python scripts/classes_table.py --images 384``.

Images are rendered (``characters-of-new-fonts``, test split: fonts, slabs and media that no example has); examples are
drawn from the law (``specklegen.models.learning.classes``). Intervals are of characters and seeds of examples, both
drawn anew; every image has a medium of its own.
"""

import argparse
import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch

from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models.learning.classes import SAMPLES, classes_by_law
from specklegen.models.metrics import bootstrap

RECIPE = "characters-of-new-fonts"
EDGES = 0.0, 0.5, 1.0, 2.0, np.inf  # extents over ranges


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--images", type=int, default=384)
    options.add_argument("--samples", type=int, default=SAMPLES, help="Examples from the law.")
    options.add_argument("--seeds", type=int, default=3, help="Of the examples.")
    options.add_argument("--seed", type=int, default=1, help="Of the images.")
    given = options.parse_args()
    torch.set_num_threads(1)
    recipe = load_recipe(RECIPE)
    if not isinstance(recipe, HiddenObject):
        raise TypeError("a recipe with hidden objects")
    batch = recipe.batch(given.seed, "test", range(given.images))
    label = torch.from_numpy(batch["parameters"]["label"]).long()
    wide = batch["parameters"]["extent_over_range"]
    places = []
    print("| ranges wide | images | seed of examples | named rightly | among the first five | processor s |")
    print("|---|---|---|---|---|---|")
    for seed in range(given.seeds):
        begun = time.process_time()
        ranked = classes_by_law(batch["image"], recipe, samples=given.samples, seed=seed).ranked
        spent = time.process_time() - begun
        places.append((ranked == label[:, None]).double().argmax(1).numpy())
        first, five = (f"{np.mean(places[-1] < most):.3f}" for most in (1, 5))
        print(f"| all | {len(label)} | {seed} | {first} | {five} | {spent:.0f} |", flush=True)
    every = np.stack(places)
    for low, high in [(0.0, np.inf), *zip(EDGES[:-1], EDGES[1:], strict=True)]:
        kept = (wide >= low) & (wide < high)
        cells = []
        for most in (1, 5):
            right = (every[:, kept] < most).astype(float)
            seeds = np.repeat(np.arange(len(right)), kept.sum())
            cells.append("{:.3f} [{:.3f}, {:.3f}]".format(
                *bootstrap(right.ravel(), np.tile(label[kept].numpy(), len(right)), seeds)))  # fmt: skip
        print(f"| {low:g} to {high:g} | {kept.sum()} | all | {' | '.join(cells)} | |")


if __name__ == "__main__":
    main()
