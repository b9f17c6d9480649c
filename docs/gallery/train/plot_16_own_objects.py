"""
Hidden objects of your own
==========================

A family of objects is one class with two methods: `propose` draws a source, `picture` draws its picture. Define the
class, and recipes can use it like the families of the package.
"""

import numpy as np
from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe
from specklegen.datasets.objects.family import DrawnFamily


class Spirals(DrawnFamily):
    """Spirals with one to four arms."""

    sharpness: float = 3.0

    def propose(self, rng):
        return int(rng.integers(1, 5)), int(rng.integers(10**6))

    def picture(self, source, rng):
        arms, number = source
        wound = 2 + 6 * np.random.default_rng(number).random()
        y, x = (np.indices(self.shape) - np.array(self.shape)[:, None, None] / 2) / max(self.shape) * 2
        wave = (1 + np.cos(arms * np.arctan2(y, x) + wound * np.hypot(y, x))) / 2
        return wave**self.sharpness * (np.hypot(y, x) < 1)


recipe = load_recipe("through-slab", {"objects": {"type": "Spirals"}, "window": {"profile": "disc"}})
samples = [recipe.sample(0, "train", n) for n in range(4)]

# %%
# Top: objects. Bottom: camera images behind a slab of ten mean free paths.
figure, rows = plt.subplots(2, 4, figsize=(4.4, 2.3), layout="constrained")
for column, sample in zip(rows.T, samples, strict=True):
    for axis, name in zip(column, ("object", "image"), strict=True):
        axis.imshow(sample[name], cmap="gray")
        axis.set_axis_off()
plt.show()

# %%
# A recipe file names the class by its import path. Its content is part of the recipe's fingerprint.
print(recipe.objects.to_toml())
