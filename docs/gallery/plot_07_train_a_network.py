"""
Train a network
===============

Forty steps on a stream that is rendered while the network learns. This is a start, not a good network:
``specklegen train`` is the tool, and a packaged network comes with it.
"""

import torch
from matplotlib import pyplot as plt
from specklegen.datasets import SpeckleStream, load_recipe
from torch import nn

torch.manual_seed(0)
recipe = load_recipe("through-slab", {"samples": {"train": 320}})
layers = [nn.Conv2d(1, 8, 5, 4, 2), nn.ReLU(), nn.Conv2d(8, 16, 5, 2, 2), nn.ReLU(), nn.AdaptiveAvgPool2d(7)]
net = nn.Sequential(*layers, nn.Flatten(), nn.Linear(16 * 49, 28 * 28))
optimiser = torch.optim.Adam(net.parameters(), 1e-3)
losses = []
for batch in SpeckleStream(recipe, seed=0, split="train", batch_size=8).loader(num_workers=0):
    image = batch["image"].float()
    image = (image / image.mean((1, 2), keepdim=True) - 1)[:, None]
    loss = nn.functional.mse_loss(net(image).reshape(-1, 28, 28), batch["object"])
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    losses.append(loss.item())

# %%
axes = plt.subplots(layout="constrained")[1]
axes.plot(losses)
axes.set_xlabel("step")
axes.set_ylabel("mean squared error")
plt.show()
