"""
Motion
======

A slab changes while a camera films: eight frames of one character, whose speckle decorrelates from frame to frame by an
assumed law, an autoregression. No medium obeys it: scatterers in motion change long paths first (docs/kinds.md,
Films).
"""

import numpy as np
from matplotlib import pyplot as plt
from specklegen.core.display.plot import draw_images
from specklegen.datasets import load_recipe

sample = load_recipe("dynamic-slab").sample(0, "train", 3)
frames = sample["frames"].astype(np.float64)
axes = plt.subplots(figsize=(10, 2), layout="constrained")[1]
draw_images(axes, frames, [f"frame {n}" for n in range(len(frames))])

# %%
# The field decorrelates exponentially with the recipe's correlation time, the intensity twice as fast. An incoherent
# object adds many speckles, and all of them change alike.
time = sample["parameters"]["correlation_time"]
flat = frames.reshape(len(frames), -1)
lags = np.arange(len(frames))
axes = plt.subplots(layout="constrained")[1]
axes.plot(lags, np.corrcoef(flat)[0], "o-", label="correlation with frame 0")
axes.plot(lags, np.exp(-2 * lags / time), "k--", label=f"correlation time {time:.1f} frames")
axes.set_xlabel("frame")
axes.legend()
plt.show()
