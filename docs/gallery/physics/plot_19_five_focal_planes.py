"""
One medium at five focal planes
===============================

A microscope images five planes in and around a scattering slab of 40 wavelengths. The illuminated area is as wide as
the slab is thick. The same paths serve all five images.
"""

import specklegen as sg
from matplotlib import pyplot as plt

scene = sg.Scene(
    wavelength=1.0,
    medium=sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9)),
    illumination=sg.light.CollimatedBeams.tilts([0.0], width=40.0, profile="disc"),
    sensor=sg.sensors.Imaging(shape=(80, 80), pitch=1.0, aperture=0.2, views=61),
)

# %%
# ``views``, the number of directions, is equal for all planes, so all show the same medium.
axes = plt.subplots(2, 3, figsize=(4.4, 3.2), layout="constrained")[1].ravel()
axes[-1].set_axis_off()
for panel, focus in zip(axes[:5], (-40.0, -20.0, 0.0, 20.0, 60.0), strict=True):
    stack = sg.render(scene.replace(sensor=scene.sensor.replace(focus=focus)), paths=4000, seed=0)
    panel.imshow(stack.intensity[0], cmap="gray", extent=(-40, 40, 40, -40))
    panel.set_title(f"z = {focus:+.0f}", fontsize=9)
    panel.set_xticks([])
    panel.set_yticks([])
plt.show()
