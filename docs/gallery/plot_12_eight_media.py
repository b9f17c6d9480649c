"""
Eight media side by side
========================

Speckle behind eight media through one window, its copy under a tilt of half a milliradian, to which the camera is
turned, and how fast each decorrelates. Thin screens, phantoms and tissues of half a millimeter.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt

wavelength, width, tilt, side = 0.633, 20_000.0, 5e-4, 48
glass = sg.GroundGlass(angle=0.1)
named = {name: sg.materials.get(name, wavelength) for name in ("intralipid", "milk", "brain", "muscle", "skin")}
media = {"ground glass": glass, "two glasses, 1 mm apart": sg.media.ScreenStack(screens=(glass, glass), gaps=(1000.0,)),
         "eight glasses in 1 mm": sg.media.ScreenStack(screens=(glass,) * 8, gaps=(140.0,) * 7)}  # fmt: skip
media |= {name: material.slab(500.0, outside=None) for name, material in named.items()}

pitch = 0.3 * wavelength / width
turned = round(np.sin(tilt) / pitch)
figure, axes = plt.subplots(2, len(media), figsize=(12, 3.4), layout="constrained")
for column, (name, medium) in zip(axes.T, media.items(), strict=True):
    inside = getattr(named.get(name), "wavelength", wavelength)
    light = sg.light.CollimatedBeams.tilts([0.0, np.arcsin(turned * pitch)], width)
    scene = sg.Scene(
        wavelength=inside, medium=medium, illumination=light,
        sensor=sg.sensors.FarField.grid((side, side + 2 * turned), pitch),
    )
    images = sg.render(scene, seed=1, paths=20_000).intensity
    here, there = images[0, :, turned : turned + side], images[1, :, 2 * turned : 2 * turned + side]
    for ax, image in zip(column, (here, there), strict=True):
        ax.imshow(image, cmap="magma")
        ax.set_axis_off()
    column[0].set_title(name, fontsize=8)
    column[1].set_title(f"correlation {np.corrcoef(here.ravel(), there.ravel())[0, 1]:.2f}", fontsize=8)

# %%
# The curves: one ground glass has no range, that of a stack is the wavelength over lobe and gap, and behind the dilute
# phantom the light that was scattered once keeps a floor.
tilts = np.geomspace(1e-5, 2e-2, 40)
axes = plt.subplots(layout="constrained")[1]
for name, medium in media.items():
    inside = getattr(named.get(name), "wavelength", wavelength)
    curve = sg.memory_effect(medium, wavelength=inside, tilts=np.append(0.0, tilts), paths=10_000, seed=1)
    axes.semilogx(1e3 * tilts, curve.intensity[1:], label=name)
axes.set_xlabel("tilt, mrad")
axes.set_ylabel("intensity correlation")
axes.legend()
plt.show()
