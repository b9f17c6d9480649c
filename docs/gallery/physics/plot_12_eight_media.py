"""
Eight media side by side
========================

Speckle behind eight media, the speckle under a tilt of 0.5 mrad, which the camera follows, and how fast it
decorrelates. The media are thin screens, and phantoms and tissues of 0.5 mm. Numbers are correlations
of the two images.
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
figure, axes = plt.subplots(len(media) // 2, 4, figsize=(4.4, 5.8), layout="constrained")
for pair, (name, medium) in zip(axes.reshape(-1, 2), media.items(), strict=True):
    inside = getattr(named.get(name), "wavelength", wavelength)
    light = sg.light.CollimatedBeams.tilts([0.0, np.arcsin(turned * pitch)], width, "disc")
    scene = sg.Scene(
        wavelength=inside, medium=medium, illumination=light,
        sensor=sg.sensors.FarField.grid((side, side + 2 * turned), pitch),
    )
    images = sg.render(scene, seed=1, paths=20_000).intensity
    here, there = images[0, :, turned : turned + side], images[1, :, 2 * turned : 2 * turned + side]
    for ax, image in zip(pair, (here, there), strict=True):
        ax.imshow(image, cmap="magma")
        ax.set_axis_off()
    pair[0].set_title(name.replace(", ", ",\n").replace("glasses in", "glasses,\n"), fontsize=8)
    pair[1].set_title(f"tilted:\n{np.corrcoef(here.ravel(), there.ravel())[0, 1]:.2f}", fontsize=8)

# %%
# One ground glass never decorrelates. The range of a stack of glasses is the wavelength over scattering angle and gap.
# Behind the dilute phantom, light that was scattered once leaves a floor.
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
