"""
Motion
======

A slab changes while a camera records eight frames of one character. The speckle decorrelates by an autoregression. No
medium obeys this simple law, because moving scatterers change long paths first (docs/kinds.md, Films).
"""

import numpy as np
from matplotlib import pyplot as plt
from specklegen.core.display.plot import draw_images
from specklegen.datasets import load_recipe

sample = load_recipe("dynamic-slab", {"window": {"profile": "disc"}}).sample(0, "train", 3)
frames = sample["frames"].astype(np.float64)
rows = plt.subplots(2, 1, figsize=(4.2, 3.4), layout="constrained")[1]
for row, first in zip(rows, (0, 3), strict=True):
    draw_images(row, frames[first : first + 3], [f"frame {n}" for n in range(first, first + 3)])

# %%
# The field decorrelates exponentially with the recipe's correlation time, the intensity twice as fast.
time = sample["parameters"]["correlation_time"]
flat = frames.reshape(len(frames), -1)
lags = np.arange(len(frames))
axes = plt.subplots(layout="constrained")[1]
axes.plot(lags, np.corrcoef(flat)[0], "o-", label="correlation with frame 0")
axes.plot(lags, np.exp(-2 * lags / time), "k--", label=f"correlation time {time:.1f} frames")
axes.set_xlabel("frame")
axes.legend()
plt.show()
