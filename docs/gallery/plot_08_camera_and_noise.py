"""
Camera and noise
================

The same medium and object through one camera at three exposures. Counts carry shot noise, read noise, dark current and
background; a longer exposure finds the same pixels lucky.
"""

import numpy as np
from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe

figure, axes = plt.subplots(1, 3, figsize=(10, 3.6), layout="constrained")
for axis, photons in zip(axes, (5.0, 50.0, 500.0), strict=True):
    recipe = load_recipe("through-slab-lab", {"exposure": {"photons": photons}})
    counts = recipe.sample(0, "train", 0)["image"].astype(np.float64)
    axis.imshow(counts, cmap="gray", vmax=np.percentile(counts, 99.5))
    axis.set_title(f"{photons:g} photons a pixel: contrast {counts.std() / counts.mean():.3f}", fontsize=9)
    axis.set_axis_off()
plt.show()
