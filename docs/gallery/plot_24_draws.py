"""
Several pictures that explain one image
=======================================

A camera image behind a slab does not determine what was hidden: several pictures have the same autocorrelation, as far
as noise lets it be known. The posterior draws them, each with a weight, and says which pixels they agree on.
"""

import numpy as np
from matplotlib import pyplot as plt
from specklegen.core.display.plot import draw_images
from specklegen.datasets import load_recipe
from specklegen.models import load_solver
from specklegen.models.learning.measurement import measured

changes = {"material": {"thickness": 1000.0, "optical_depth": 10.0, "g": 0.9}}
recipe = load_recipe("one-angular-size", changes)
batch = recipe.batch(1, "test", range(2))
found = load_solver().posterior(*measured(batch, recipe), draws=6)

# %%
# Each draw begins elsewhere: the first half at noise, the others at the solver's image and at phase retrieval's, to
# which noise was added. A net that knows what pictures look like takes the noise off, step by step, and every step
# follows the exact likelihood of the camera image. Above each draw stands its weight. All are up to a turn by 180
# degrees, which lags do not tell.
rows, axes = plt.subplots(2, 2, figsize=(9, 3.2), layout="constrained", width_ratios=(1, 2))
inside = slice(4, -4), slice(4, -4)
for n, (left, right) in enumerate(axes):
    known = [batch["object"][n], found.mean[n][inside].numpy(), found.certain[n][inside].numpy()]
    draw_images(left, np.stack(known), ["object", "mean", "certain"], high=1.0)
    weights = [f"{weight:.2f}" for weight in found.weights[n].tolist()]
    draw_images(right, np.stack([draw[inside].numpy() for draw in found.draws[n]]), weights, high=1.0)

# %%
# How far draws agree is told before anybody knows the object: the mean correlation of two of them, by their weights.
print([f"{agreement:.2f}" for agreement in found.agreement.tolist()])
