"""
Tilt, and the memory of a slab
==============================

Tilt the light and the speckle moves with it, until it turns into another pattern. The curve says how far.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt

slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9))
scene = sg.Scene(
    wavelength=0.5,
    medium=slab,
    illumination=sg.light.CollimatedBeams.tilts(np.deg2rad([0, 0.005, 0.01, 0.02, 0.04]), width=50_000.0),
    sensor=sg.sensors.FarField.grid(shape=(96, 96), pitch=2.2e-6, center=(3e-4, 0.0)),
)
stack = sg.render(scene, seed=1)
stack.plot(label="five tilts of one medium")

# %%
# The same curve, for all tilts at once, with error bars.
curve = sg.memory_effect(slab, wavelength=0.5, tilts=np.deg2rad(np.linspace(0, 0.04, 33)), paths=100_000)
curve.plot(label="C_I").legend()
plt.show()
