"""
First speckle
=============

A beam, a slab of fog, a camera: one image of speckle, and what its planner says.
"""

import specklegen as sg
from matplotlib import pyplot as plt

scene = sg.Scene(
    wavelength=0.5,  # inside the medium; all lengths in one unit, here micrometres
    medium=sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9)),
    illumination=sg.light.CollimatedBeams.tilts([0.0], width=50_000.0),
    sensor=sg.sensors.FarField.grid(shape=(128, 128), pitch=2.2e-6),  # direction sines
)
scene.plot()

# %%
# A plan says what a render will do, what it leaves out and why, and what it costs.
print(sg.plan(scene).explain())

# %%
# The field is circular Gaussian: its intensity is exponential, and its contrast 1.
stack = sg.render(scene, seed=0)
intensity = stack.intensity[0]
print(f"contrast {intensity.std() / intensity.mean():.2f}")
stack.plot(label="intensity")
plt.show()
