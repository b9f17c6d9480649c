"""
A scattering medium as a deepinv physics
========================================

Behind a known medium, the camera image is linear in the brightness of the object. deepinv solves such inverse problems.
Needs the extra ``deepinv``.
"""

import deepinv
import torch
from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe
from specklegen.datasets.loading.deepinverse import SpecklePhysics

recipe = load_recipe("through-slab", {"camera": {"shape": [96, 96]}, "window": {"profile": "disc"}})
hidden = torch.from_numpy(recipe.batch(0, "test", range(3))["object"])[:, None]
hidden = hidden / hidden.mean((2, 3), keepdim=True)
media = torch.arange(3)
noise = deepinv.physics.GaussianNoise(sigma=0.02)
physics = SpecklePhysics(recipe, seed=0, split="test", medium=media, noise_model=noise, max_iter=60)
images = physics(hidden)

# %%
# Conjugate gradients invert the linear map from 784 object pixels to 9216 camera pixels. With a wrong medium the
# reconstruction fails.
known = physics.A_dagger(images)
other = SpecklePhysics(recipe, seed=0, split="test", medium=media + 8, max_iter=60).A_dagger(images)

figure, rows = plt.subplots(4, 3, figsize=(4.2, 5.8), layout="constrained")
shown = {"camera": images, "known medium": known, "wrong medium": other, "hidden": hidden}
for row, (name, pictures) in enumerate(shown.items()):
    rows[row, 0].set_title(name, loc="left", fontsize=9)
    for axis, picture in zip(rows[row], pictures[:, 0], strict=True):
        axis.imshow(picture.detach(), cmap="gray", vmin=0)
        axis.set_axis_off()
for name, pictures in (("known medium", known), ("wrong medium", other)):
    pairs = zip(pictures.flatten(1), hidden.flatten(1), strict=True)
    print(name, [f"{torch.corrcoef(torch.stack(pair))[0, 1]:.2f}" for pair in pairs])
plt.show()
