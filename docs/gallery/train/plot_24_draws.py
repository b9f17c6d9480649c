"""
Several objects that explain one image
======================================

A camera image behind a slab does not determine the object: within the noise, several objects explain it. ``posterior``
draws some, each with a weight, and returns how far they agree in each pixel.
"""

import numpy as np
from matplotlib import pyplot as plt
from specklegen.core.display.plot import draw_images
from specklegen.datasets import load_recipe
from specklegen.models import load_solver
from specklegen.models.learning.measurement import measured

changes = {"material": {"thickness": 1000.0, "optical_depth": 10.0, "g": 0.9}, "window": {"profile": "disc"}}
recipe = load_recipe("one-angular-size", changes)
batch = recipe.batch(1, "test", range(2))
found = load_solver().posterior(*measured(batch, recipe), draws=6)

# %%
# Draws start from noise, from the solver's image, and from that of phase retrieval. A denoising network removes the
# noise in steps, and each step follows the likelihood of the camera image. The number below a draw is its weight. The
# orientation is ambiguous by 180 degrees.
rows, axes = plt.subplots(6, 1, figsize=(4.2, 9), layout="constrained")
inside = slice(4, -4), slice(4, -4)
for n, (above, middle, below) in enumerate(axes.reshape(2, 3)):
    known = [batch["object"][n], found.mean[n][inside].numpy(), found.certain[n][inside].numpy()]
    draw_images(above, np.stack(known), ["object", "mean of draws", "agreement"], high=1.0)
    weights = [f"weight {weight:.2f}" for weight in found.weights[n].tolist()]
    draws = np.stack([draw[inside].numpy() for draw in found.draws[n]])
    draw_images(middle, draws[:3], weights[:3], high=1.0)
    draw_images(below, draws[3:], weights[3:], high=1.0)

# %%
# The agreement needs no ground truth: it is the mean correlation of two draws, by their weights.
print([f"{agreement:.2f}" for agreement in found.agreement.tolist()])
