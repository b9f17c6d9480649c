"""
What g and the lobe do
======================

Two fogs of equal optical depth and equal mean cosine, but of different lobes, do not remember alike. The transport
length alone does not say how far the memory effect reaches.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt

scatterers = {
    "Henyey-Greenstein, g = 0.9": sg.media.HenyeyGreenstein(0.9),
    "von Mises-Fisher, g = 0.9": sg.media.VonMisesFisher(10.0),
    "isotropic": sg.media.Isotropic(),
}
figure, (lobes, curves) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
for label, scatterer in scatterers.items():
    slab = sg.Slab(thickness=1000.0, mean_free_path=200.0, scatterer=scatterer)
    print(f"{label}: mean cosine {scatterer.mean_cosine():.3f}")
    scatterer.plot(lobes, label=label)
    sg.memory_effect(slab, wavelength=0.5, tilts=np.deg2rad(np.linspace(0, 0.06, 25)), paths=50_000).plot(curves, label)
curves.legend()
plt.show()
