"""
Five objects through one medium, from their images alone
========================================================

Within the memory effect, each image is the convolution of one speckle pattern with an object. One image cannot separate
the two. Five images behind the same medium can, without a prior, without training and without a measured memory effect.
"""

import numpy as np
import torch
from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe
from specklegen.models import Optics, align, multiframe_deconvolution
from specklegen.models.metrics import pearson

changes = {"media_group": 5, "camera": {"shape": [224, 224]}, "window": {"profile": "disc"}}
recipe = load_recipe("one-angular-size", changes)
batch = recipe.batch(1, "test", range(5))  # five characters, one slab
drawn = {name: float(values[0]) for name, values in batch["parameters"].items() if np.ndim(values) == 1}
step = drawn["object_pitch"] / drawn["camera_pitch"]
grain = drawn["wavelength"] / drawn["width"] / drawn["camera_pitch"]

# %%
# The function needs the camera pixels per object pixel, the speckle size, and the side of the frame that contains each
# object.
images, hidden = torch.from_numpy(batch["image"]), torch.from_numpy(batch["object"])
found = multiframe_deconvolution(images, Optics(step=step, grain=grain), 36)
print(found)
hidden = torch.nn.functional.pad(hidden, (4, 4, 4, 4))
print("correlation with the hidden object:", [f"{r:.2f}" for r in pearson(align(found.image, hidden), hidden).tolist()])

figure, rows = plt.subplots(3, 5, figsize=(4.4, 3.2), layout="constrained")
shown = {"camera": images, "reconstruction": found.image, "hidden": hidden}
for row, (name, pictures) in zip(rows, shown.items(), strict=True):
    row[0].set_title(name, loc="left", fontsize=9)
    for axis, picture in zip(row, pictures, strict=True):
        axis.imshow(picture, cmap="gray", vmin=0)
        axis.set_axis_off()
plt.show()

# %%
# Eight searches from different starts agree if the result is reliable. With your own files:
# ``specklegen reconstruct shot-*.tiff --setup setup.toml --together``.
print(f"agreement of searches: {found.agreement:.3f}")
