"""
Camera and noise
================

One camera records the same medium and object at three exposures. Counts include shot noise, read noise, dark current
and background.
"""

import numpy as np
from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe

figure, axes = plt.subplots(3, 1, figsize=(3, 9), layout="constrained")
for axis, photons in zip(axes, (5.0, 50.0, 500.0), strict=True):
    recipe = load_recipe("through-slab-lab", {"exposure": {"photons": photons}, "lab": {"profile": "disc"}})
    counts = recipe.sample(0, "train", 0)["image"].astype(np.float64)
    axis.imshow(counts, cmap="gray", vmax=np.percentile(counts, 99.5))
    axis.set_title(f"{photons:g} photons per pixel: contrast {counts.std() / counts.mean():.3f}", fontsize=9)
    axis.set_axis_off()
plt.show()
