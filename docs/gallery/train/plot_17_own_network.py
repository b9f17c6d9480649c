"""
A network of your own
=====================

A network is a class with the arguments side, shape and width, and a name. Training, checkpoints and evaluation work as
for networks of the package. On the command line: ``specklegen train --network my_module:Autocorrelator``.
"""

import tempfile

from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe
from specklegen.models import Network, Training, train
from specklegen.models.learning.examples import examples
from torch import nn


class Autocorrelator(Network, name="autocorrelator"):
    """Two layers from the small lags to the object."""

    def __init__(self, side, shape=(28, 28), width=16):
        super().__init__()
        self.shape, self.near = shape, slice(side // 2 - shape[0], side // 2 + shape[0])
        self.layers = nn.Sequential(
            nn.Linear(4 * shape[0] ** 2, 16 * width), nn.GELU(), nn.Linear(16 * width, shape[0] * shape[1])
        )

    def forward(self, pictures):
        return self.layers(pictures[:, 0, self.near, self.near].flatten(1)).reshape(-1, *self.shape)


recipe = load_recipe("unknown-slab", {"objects": {"shape": [16, 16]}, "camera": {"shape": [64, 64]}})
data, held_out = (examples(recipe, "autocorrelation", n, 0, split) for n, split in ((256, "train"), (32, "validation")))
rows = []
with tempfile.TemporaryDirectory() as folder:
    settings = Training(network="autocorrelator", epochs=6, batch_size=32)
    model = train(settings, data, held_out, folder, progress=rows.append)

# %%
axes = plt.subplots(layout="constrained")[1]
axes.plot([row["epoch"] for row in rows], [row["validation_pearson"] for row in rows], "o-")
axes.set_xlabel("epoch")
axes.set_ylabel("Pearson correlation (validation)")
plt.show()
