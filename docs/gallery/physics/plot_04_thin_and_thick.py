"""
Thin and thick slabs
====================

The tilt is scaled by the thickness: q = k sin(theta) L. Thick slabs of isotropic scatterers approach the diffusion
curve. The curve of a thin slab ends at a floor, the square of the share of single scattering, which no tilt
decorrelates.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt
from specklegen.theory.slab import memory_effect_diffusion

axes = plt.subplots(layout="constrained")[1]
for depth in (0.5, 2.0, 10.0):
    slab = sg.Slab(thickness=100.0, mean_free_path=100.0 / depth, scatterer=sg.media.Isotropic())
    tilts = np.arcsin(np.linspace(0, 8, 25) / (2 * np.pi / 0.5 * slab.thickness))
    curve = sg.memory_effect(slab, wavelength=0.5, tilts=tilts, paths=100_000)
    curve.plot(axes, label=f"optical depth {depth:g}, single share {curve.single_share:.2f}")
q = np.linspace(0, 8, 200)
axes.plot(q, memory_effect_diffusion(q), "k--", label="diffusion")
axes.legend()
plt.show()
