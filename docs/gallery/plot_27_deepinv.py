"""
A scattering medium as a physics of deepinv
===========================================

Through a medium that is known, what a camera sees is linear in the brightness of the object, and deepinv has what
solves such equations. Needs the extra ``deepinv``.
"""

import deepinv
import torch
from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe
from specklegen.datasets.loading.deepinverse import SpecklePhysics

recipe = load_recipe("through-slab", {"camera": {"shape": [96, 96]}})
hidden = torch.from_numpy(recipe.batch(0, "test", range(3))["object"])[:, None]
hidden = hidden / hidden.mean((2, 3), keepdim=True)
media = torch.arange(3)
noise = deepinv.physics.GaussianNoise(sigma=0.02)
physics = SpecklePhysics(recipe, seed=0, split="test", medium=media, noise_model=noise, max_iter=60)
images = physics(hidden)

# %%
# The adjoint is exact, and conjugate gradients invert the map: 9216 pixels say what 784 were. A physics of other media,
# which is what one has without a guide star, makes nothing of the same images.
known = physics.A_dagger(images)
other = SpecklePhysics(recipe, seed=0, split="test", medium=media + 8, max_iter=60).A_dagger(images)

figure, rows = plt.subplots(4, 3, figsize=(5, 6.5), layout="constrained")
shown = {"camera": images, "medium known": known, "other medium": other, "hidden": hidden}
for row, (name, pictures) in enumerate(shown.items()):
    rows[row, 0].set_title(name, loc="left", fontsize=9)
    for axis, picture in zip(rows[row], pictures[:, 0], strict=True):
        axis.imshow(picture.detach(), cmap="gray", vmin=0)
        axis.set_axis_off()
for name, pictures in (("known", known), ("other", other)):
    pairs = zip(pictures.flatten(1), hidden.flatten(1), strict=True)
    print(name, [f"{torch.corrcoef(torch.stack(pair))[0, 1]:.2f}" for pair in pairs])
plt.show()
