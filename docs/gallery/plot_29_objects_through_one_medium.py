"""
Five objects through one medium, from their images alone
========================================================

Within the memory effect every image is one pattern, moved and added up over an object. One image cannot part the two;
five images through the same medium can, without a prior, a training or a memory effect that was measured.
"""

import numpy as np
import torch
from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe
from specklegen.models import Optics, align, multiframe_deconvolution
from specklegen.models.metrics import pearson

recipe = load_recipe("one-angular-size", {"media_group": 5, "camera": {"shape": [224, 224]}})
batch = recipe.batch(1, "test", range(5))  # five characters, one slab
drawn = {name: float(values[0]) for name, values in batch["parameters"].items() if np.ndim(values) == 1}
step = drawn["object_pitch"] / drawn["camera_pitch"]
grain = drawn["wavelength"] / drawn["width"] / drawn["camera_pitch"]

# %%
# What it is told: how many camera pixels an object pixel and a grain have, and how large a frame holds every object.
images, hidden = torch.from_numpy(batch["image"]), torch.from_numpy(batch["object"])
found = multiframe_deconvolution(images, Optics(step=step, grain=grain), 36)
print(found)
hidden = torch.nn.functional.pad(hidden, (4, 4, 4, 4))
print("correlation with the hidden object:", [f"{r:.2f}" for r in pearson(align(found.image, hidden), hidden).tolist()])

figure, rows = plt.subplots(3, 5, figsize=(8, 5), layout="constrained")
shown = {"camera": images, "found, the right way up": found.image, "hidden": hidden}
for row, (name, pictures) in zip(rows, shown.items(), strict=True):
    row[0].set_title(name, loc="left", fontsize=9)
    for axis, picture in zip(row, pictures, strict=True):
        axis.imshow(picture, cmap="gray", vmin=0)
        axis.set_axis_off()
plt.show()

# %%
# Eight searches from other blobs say how far to believe it: they agree, or they do not. With files of your own:
# ``specklegen reconstruct shot-*.tiff --setup setup.toml --together``.
print(f"agreement of searches: {found.agreement:.3f}")
