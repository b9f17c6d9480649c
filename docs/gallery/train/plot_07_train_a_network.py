"""
Train a network
===============

A perceptron estimates the memory-effect range of an unknown slab from nine images under tilts. It trains on 384 stacks
for a few seconds, and is tested on other materials and media. ``specklegen train`` does the same from the command line.
"""

import tempfile

from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe
from specklegen.models import Training, train
from specklegen.models.learning.examples import examples
from specklegen.models.learning.targets import in_units

recipe = load_recipe("registered-tilts")
data, held_out = (
    examples(recipe, "registered", samples, 0, split, "material") for samples, split in ((384, "train"), (96, "test"))
)
settings = Training(target="material", input="registered", network="perceptron", epochs=60, patience=60)
rows = []
with tempfile.TemporaryDirectory() as folder:
    model = train(settings, data, held_out, folder, progress=rows.append)

axes = plt.subplots(layout="constrained")[1]
axes.semilogy([row["epoch"] for row in rows], [row["train_loss"] for row in rows])
axes.set_xlabel("epoch")
axes.set_ylabel("training loss")
plt.show()

# %%
# Memory-effect ranges of the test split, whose materials and media the network has not seen: estimated and true.
estimated, true = (in_units(rows)[:, 0] for rows in (model(held_out.inputs.float()), held_out.targets))
axes = plt.subplots(layout="constrained")[1]
axes.plot(true, estimated, "o")
axes.axline((float(true.mean()),) * 2, slope=1, color="gray")
axes.set_xlabel("true range (log10, radians)")
axes.set_ylabel("estimated range (log10, radians)")
axes.set_title(f"R² = {1 - float((estimated - true).square().sum() / (true - true.mean()).square().sum()):.2f}")
plt.show()
