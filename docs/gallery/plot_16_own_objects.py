"""
Hidden objects of your own
==========================

A family of objects is one class: what its sources are, and how one is drawn. It joins by being defined, and is then
hidden, split, streamed and stored like those that come with the package.
"""

import numpy as np
from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe
from specklegen.datasets.objects.family import DrawnFamily


class Spirals(DrawnFamily):
    """Spirals with one to four arms, wound as tightly as they please."""

    sharpness: float = 3.0

    def propose(self, rng):
        return int(rng.integers(1, 5)), int(rng.integers(10**6))

    def picture(self, source, rng):
        arms, number = source
        wound = 2 + 6 * np.random.default_rng(number).random()
        y, x = (np.indices(self.shape) - np.array(self.shape)[:, None, None] / 2) / max(self.shape) * 2
        wave = (1 + np.cos(arms * np.arctan2(y, x) + wound * np.hypot(y, x))) / 2
        return wave**self.sharpness * (np.hypot(y, x) < 1)


recipe = load_recipe("through-slab", {"objects": {"type": "Spirals"}, "material": {"kernel_paths": 20_000}})
samples = [recipe.sample(0, "train", n) for n in range(4)]

# %%
# Above the objects, below what a camera sees of them through a slab ten mean free paths thick.
figure, rows = plt.subplots(2, 4, figsize=(9, 4.6), layout="constrained")
for column, sample in zip(rows.T, samples, strict=True):
    for axis, name in zip(column, ("object", "image"), strict=True):
        axis.imshow(sample[name], cmap="gray")
        axis.set_axis_off()
plt.show()

# %%
# A recipe's file may name the class by its import path; the fingerprint knows it by its content.
print(recipe.objects.to_toml())
