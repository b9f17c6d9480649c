"""
Refractive-index mismatch
=========================

The boundaries of a sample in air reflect light back into it. That light travels farther sideways before it leaves, and
the memory-effect range shrinks: by more than half at an index of 1.33.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt

slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9))
tilts = np.linspace(0, 4e-4, 25)
axes = plt.subplots(layout="constrained")[1]
for index in (1.0, 1.33, 1.5):
    faced = slab.replace(faces=sg.media.Faces(inside=index, outside=1.0))
    curve = sg.memory_effect(faced, wavelength=0.5, tilts=tilts, paths=20_000, seed=1)
    axes.errorbar(1e3 * tilts, curve.intensity, curve.standard_error, label=f"index {index:g} in air")
axes.set_xlabel("tilt inside the slab, mrad")
axes.set_ylabel("intensity correlation")
axes.legend()

# %%
# A material by its name has its refractive index. It stands in air by default.
phantom = sg.materials.get("intralipid", wavelength=0.633, dilution=0.05)
print(phantom.slab(thickness=2000.0).faces)
plt.show()
