"""
Train a network
===============

How far does an unknown slab remember? Nine images under tilts that overlap on the camera hold the answer: their
speckle decorrelates as fast as the material says. A perceptron learns it from 384 stacks in a few seconds, and is asked
about materials and media that it has never met. ``specklegen train`` is the same thing from the command line.
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
# Materials of the test split, which share nothing with those of the training split: memory-effect range, as it is and
# as the network tells it from the images.
told, true = (in_units(rows)[:, 0] for rows in (model(held_out.inputs.float()), held_out.targets))
axes = plt.subplots(layout="constrained")[1]
axes.plot(true, told, "o")
axes.axline((float(true.mean()),) * 2, slope=1, color="gray")
axes.set_xlabel("log10 of the memory-effect range")
axes.set_ylabel("the same, told by the network")
axes.set_title(f"R² = {1 - float((told - true).square().sum() / (true - true.mean()).square().sum()):.2f}")
plt.show()
