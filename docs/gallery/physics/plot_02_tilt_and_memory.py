"""
Tilt, and the memory effect
===========================

If the light is tilted, the speckle shifts with it, until it decorrelates. The curve shows over which angle.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt

slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9))
scene = sg.Scene(
    wavelength=0.5,
    medium=slab,
    illumination=sg.light.CollimatedBeams.tilts(np.deg2rad([0, 0.005, 0.01, 0.02, 0.04]), 50_000.0, "disc"),
    sensor=sg.sensors.FarField.grid(shape=(96, 96), pitch=2.2e-6, center=(3e-4, 0.0)),
)
stack = sg.render(scene, seed=1)
axes = stack.plot(label="tilt in millidegrees")
axes.set_xticklabels(["0", "5", "10", "20", "40"])

# %%
# The correlation of the intensities over the tilt, with error bars of two standard errors.
curve = sg.memory_effect(slab, wavelength=0.5, tilts=np.deg2rad(np.linspace(0, 0.04, 33)), paths=100_000)
curve.plot(label="C_I")
plt.show()
