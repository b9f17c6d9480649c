"""
A data set for the Hugging Face hub
===================================

``export`` writes a store as Parquet with a data card. The hub, ``datasets`` and pandas read this folder. Needs the
extra ``parquet``.
"""

import tempfile
from pathlib import Path

import pyarrow.parquet as pq
from matplotlib import pyplot as plt
from specklegen.datasets import generate, load_recipe
from specklegen.datasets.loading.export import export

folder = Path(tempfile.mkdtemp())
changes = {"camera": {"shape": [96, 96]}, "exposure": {"photons": 300.0}, "window": {"profile": "disc"}}
recipe = load_recipe("through-slab", changes)
for split in ("train", "test"):
    generate(recipe, split=split, samples=16, folder=folder / f"{split}.zarr")
    export(folder / f"{split}.zarr", folder / "hub", format="parquet")
for file in sorted((folder / "hub").rglob("*")):
    if file.is_file():
        print(file.relative_to(folder / "hub"), file.stat().st_size)

# %%
# The card names the files of each split.
print((folder / "hub" / "README.md").read_text().split("---")[1])

# %%
# A row is a sample: its arrays and drawn numbers. The package ``datasets`` loads the folder, or a data set on the
# hub:
#
# .. code-block:: python
#
#     from datasets import load_dataset
#
#     data = load_dataset("hub", split="train").with_format("numpy")       # or "you/your-speckle"
#     data[0]["image"].shape
#
# ``python scripts/upload_dataset.py hub you/your-speckle --licence cc-by-4.0`` lists what it would upload; ``--really``
# uploads it.
(file,) = (folder / "hub").rglob("train*.parquet")
table = pq.read_table(file)
print(table.num_rows, [name for name in table.column_names][:8])
figure, rows = plt.subplots(2, 4, figsize=(4.4, 2.4), layout="constrained")
for column in range(4):
    for axis, key in zip(rows[:, column], ("image", "object"), strict=True):
        axis.imshow(table[key][column].as_py(), cmap="gray")
        axis.set_axis_off()
plt.show()
