"""
Your own pictures as hidden objects
===================================

A folder of pictures can supply the hidden objects of any recipe. Each picture belongs to one split only.
"""

import tempfile
from pathlib import Path

import skimage.data
from matplotlib import pyplot as plt
from PIL import Image
from specklegen.datasets import load_recipe

folder = Path(tempfile.mkdtemp())
for name in ("camera", "coins", "moon", "page", "text", "brick", "grass", "gravel", "clock", "cell"):
    Image.fromarray(getattr(skimage.data, name)()).save(folder / f"{name}.png")

# %%
recipe = load_recipe("through-slab", {
    "objects": {"type": "Folder", "path": str(folder)}, "window": {"profile": "disc"},
})  # fmt: skip
samples = [recipe.sample(0, "train", n) for n in range(3)]
figure, rows = plt.subplots(2, 3, figsize=(4.2, 3), layout="constrained")
for column, sample in enumerate(samples):
    rows[0, column].imshow(sample["object"], cmap="gray")
    rows[1, column].imshow(sample["image"], cmap="gray")
for axis in rows.flat:
    axis.set(xticks=[], yticks=[])
rows[0, 0].set_ylabel("object")
rows[1, 0].set_ylabel("camera")
print(recipe.split_notes())
plt.show()
