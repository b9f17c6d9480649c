"""
Phase function and memory effect
================================

Two slabs have equal optical depth and equal g, but different phase functions. Their memory effects differ: the
 transport length alone does not determine the range.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt

scatterers = {
    "Henyey-Greenstein, g = 0.9": sg.media.HenyeyGreenstein(0.9),
    "von Mises-Fisher, g = 0.9": sg.media.VonMisesFisher(10.0),
    "isotropic": sg.media.Isotropic(),
}
figure, (phase_functions, curves) = plt.subplots(2, 1, figsize=(4.2, 6), layout="constrained")
for label, scatterer in scatterers.items():
    slab = sg.Slab(thickness=1000.0, mean_free_path=200.0, scatterer=scatterer)
    print(f"{label}: mean cosine {scatterer.mean_cosine():.3f}")
    scatterer.plot(phase_functions, label=label)
    sg.memory_effect(slab, wavelength=0.5, tilts=np.deg2rad(np.linspace(0, 0.06, 25)), paths=50_000).plot(curves, label)
curves.legend()
plt.show()
