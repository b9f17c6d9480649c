"""
A figure of the paper
=====================

Figure 8 of Bar et al. (2019), smaller: the covariance between all viewing directions of the speckle of a
two-dimensional box, for light from 0 degrees and light from 0, 1, 4 and 20 degrees. ``scripts/reproduce_figures.py``
draws it in full, beside the wave equation.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt

degrees = [0, 1, 4, 20]
scene = sg.Scene(
    wavelength=1.0,
    medium=sg.media.Box(lower=[-10, -10], upper=[10, 10], mean_free_path=10.0, scatterer=sg.media.Isotropic()),
    illumination=sg.light.PlaneWaves.tilts(np.deg2rad(degrees), dimensions=2),
    sensor=sg.sensors.FarField.angles(np.deg2rad(np.arange(0, 360, 4))),
)
cov = sg.statistics.covariance(scene, paths=4000)
print(cov)

# %%
figure, axes = plt.subplots(2, 2, figsize=(4.2, 4.4), layout="constrained")
for n, axis in enumerate(axes.flat):
    axis.imshow(np.abs(cov.value[0, :, n]), extent=(0, 360, 360, 0), cmap="magma", vmax=np.abs(cov.value).max() / 3)
    axis.set_title(f"light from 0° and {degrees[n]}°", fontsize=9)
figure.supxlabel("first viewing direction (degrees)", fontsize=9)
figure.supylabel("second viewing direction (degrees)", fontsize=9)
plt.show()
