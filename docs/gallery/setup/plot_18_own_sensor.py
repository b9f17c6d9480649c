"""
A sensor of your own
====================

A sensor is a class with directions or with points. This one is a ring of fibres around the axis. If the light is
tilted, the speckle along the ring decorrelates.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt


class FibreRing(sg.sensors.Sensor):
    """Fibres around the axis, all at one angle to it."""

    sine: float
    count: int = 360

    @property
    def directions(self):
        turn = 2 * np.pi * np.arange(self.count) / self.count
        x, y = self.sine * np.cos(turn), self.sine * np.sin(turn)
        return np.stack([x, y, np.full(self.count, np.sqrt(1 - self.sine**2))], -1)


scene = sg.Scene(
    wavelength=0.5,
    medium=sg.Slab(thickness=100.0, mean_free_path=25.0, scatterer=sg.media.HenyeyGreenstein(0.8)),
    illumination=sg.light.CollimatedBeams.tilts(np.linspace(0, 3e-3, 25), width=500.0, profile="disc"),
    sensor=FibreRing(sine=0.05),
)
stack = sg.render(scene, paths=4000, seed=0)

# %%
# Left to right: along the ring. Top to bottom: tilts.
axes = plt.subplots(figsize=(4.4, 3), layout="constrained")[1]
axes.imshow(stack.intensity, cmap="gray", aspect="auto", extent=(0, 360, 3, 0))
axes.set_xlabel("position on the ring (degrees)")
axes.set_ylabel("tilt (mrad)")
plt.show()
