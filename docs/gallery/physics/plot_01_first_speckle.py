"""
First speckle
=============

A laser beam, a scattering slab and a camera give one image of speckle.
"""

import specklegen as sg
from matplotlib import pyplot as plt

scene = sg.Scene(
    wavelength=0.5,  # inside the medium; all lengths in one unit, here micrometres
    medium=sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9)),
    illumination=sg.light.CollimatedBeams.tilts([0.0], width=50_000.0, profile="disc"),
    sensor=sg.sensors.FarField.grid(shape=(128, 128), pitch=2.2e-6),  # direction sines
)
scene.plot()

# %%
# The plan lists the sampler, the neglected effects with reasons, the expected error, and the cost.
print(sg.plan(scene).explain())

# %%
# The field is circular Gaussian, so the intensity is exponentially distributed, with contrast 1.
stack = sg.render(scene, seed=0)
intensity = stack.intensity[0]
print(f"contrast {intensity.std() / intensity.mean():.2f}")
stack.plot(label="intensity")
plt.show()
