"""
One medium at five focal planes
===============================

A microscope is focused through a scattering slab: 40 wavelengths of it, lit through a window as wide as itself. Deep
inside, the image is as if nothing had scattered the light on its way out; the same paths make all five images.
"""

import specklegen as sg
from matplotlib import pyplot as plt

scene = sg.Scene(
    wavelength=1.0,
    medium=sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9)),
    illumination=sg.light.CollimatedBeams.tilts([0.0], width=40.0),
    sensor=sg.sensors.Imaging(shape=(80, 80), pitch=1.0, aperture=0.2, views=61),
)

# %%
# One number of directions, ``views``, for all planes: the far field of the medium is the same, so is the medium.
axes = plt.subplots(1, 5, figsize=(10, 2.4), layout="constrained")[1]
for panel, focus in zip(axes, (-40.0, -20.0, 0.0, 20.0, 60.0), strict=True):
    stack = sg.render(scene.replace(sensor=scene.sensor.replace(focus=focus)), paths=4000, seed=0)
    panel.imshow(stack.intensity[0], cmap="gray", extent=(-40, 40, 40, -40))
    panel.set_title(f"{focus:+.0f} from the face", fontsize=9)
    panel.set_xticks([])
    panel.set_yticks([])
plt.show()
