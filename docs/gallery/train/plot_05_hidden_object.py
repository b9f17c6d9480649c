"""
A hidden object, and phase retrieval
====================================

The autocorrelation of a camera image approximates that of the hidden object (Katz et al. 2014). Phase retrieval
reconstructs the object from it, up to shift and 180-degree rotation. A small network does the same.
"""

import numpy as np
from matplotlib import pyplot as plt
from specklegen.core.statistics import autocorrelation
from specklegen.datasets import load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.models import Retrieval, evaluate, katz, load_pretrained

recipe = load_recipe("unknown-slab", {"window": {"profile": "disc"}})  # a round aperture
batch = tensors(recipe.batch(0, "test", range(3)))
methods = {"phase retrieval": katz(Retrieval(restarts=2)), "network": load_pretrained().reconstruct}
found, cases = evaluate(methods, [batch], recipe.profile)

# %%
# The number is the Pearson correlation with the hidden object, after alignment.
figure, rows = plt.subplots(5, 3, figsize=(4.2, 7.4), layout="constrained")
for axes, case in zip(rows.T, cases, strict=True):
    lags = np.clip(autocorrelation(case.image.astype(np.float64))[32:-32, 32:-32], 0, 0.7)
    pictures = {"camera": case.image, "autocorrelation": lags} | case.reconstructions | {"object": case.object}
    for axis, (name, picture) in zip(axes, pictures.items(), strict=True):
        axis.imshow(picture, cmap="gray")
        axis.set_axis_off()
        score = f" {case.scores[name]:.2f}" if name in case.scores else ""
        axis.set_title({"phase retrieval": "Katz"}.get(name, name) + score, fontsize=9)
plt.show()
