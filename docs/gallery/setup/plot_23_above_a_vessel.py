"""
Speckle contrast above a blood vessel
=====================================

A laser illuminates tissue, and a camera images its surface. Above a vessel, moving blood blurs the speckle during the
exposure. Instruments compute the contrast in small regions. The recipe also returns the expected contrast of each
pixel.
"""

import numpy as np
from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe

vessel = {"depth": 150.0, "radius": 60.0, "speed": 1000.0, "angle": 0.5, "offset": 0.0}  # micrometres, seconds
recipe = load_recipe("flow-vessel", {"vessel": vessel})
sample = recipe.sample(0, "train", 0)
print(sample["stack"].shape, f"{sample['parameters']['static_share']:.2f} of the light above the axis is static")

# %%
# Contrast in regions of 7 x 7 pixels, and the expected contrast. About twelve speckle grains a region give a noisy
# estimate, and blur edges. Dark blue is a contrast of 0, yellow of 1.
windows = np.lib.stride_tricks.sliding_window_view(sample["stack"], (7, 7), axis=(1, 2))
measured = windows.std(axis=(-2, -1)) / windows.mean(axis=(-2, -1))
figure, axes = plt.subplots(3, 3, figsize=(4.4, 4.6), layout="constrained")
for column, duration in enumerate(recipe.exposures.durations):
    axes[0, column].imshow(sample["stack"][column], cmap="gray", vmin=0, vmax=3)
    axes[1, column].imshow(measured[column], vmin=0, vmax=1)
    axes[2, column].imshow(sample["target"][column], vmin=0, vmax=1)
    axes[0, column].set_title(f"{1e3 * duration:g} ms")
for ax, name in zip(axes[:, 0], ("speckle", "measured contrast", "expected contrast"), strict=True):
    ax.set_ylabel(name)
for ax in axes.flat:
    ax.set(xticks=[], yticks=[])
