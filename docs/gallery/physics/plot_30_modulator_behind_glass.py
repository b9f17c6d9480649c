"""
A coherent object behind ground glass
=====================================

A digit on a modulator in laser light is a coherent object: behind ground glass the fields of its pixels add, not their
intensities. Another glass gives an unrelated image of the same digit, so a network must train on several glasses.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt
from specklegen.datasets import load_recipe

digit = load_recipe("coherent-digits").sample(3, "train", 0)["object"]  # 28 x 28 pixels, 0 to 1
objects = np.stack([digit, np.exp(1j * np.pi * digit), np.roll(digit, 1, axis=1)])
light = sg.light.CoherentObject(objects, pitch="72 um", distance="20 mm")
camera = sg.sensors.FarField.grid((96, 96), 9e-5)


def images(medium, seed):
    """Images of all three objects behind one medium, float32[3, 96, 96], over their mean."""
    scene = sg.Scene(wavelength="633 nm", medium=medium, illumination=light, sensor=camera)
    seen = sg.render(scene, seed=seed, mean=True).intensity
    return seen / seen.mean(axis=(1, 2), keepdims=True)


# %%
# Two glasses of one kind, and a smooth screen of which the digit illuminates few correlation lengths. There the speckle
# is not Gaussian.
smooth = sg.media.PhaseScreen(rms_phase=3.0, correlation_length="400 um")
rows = {
    "ground glass 1": images(sg.GroundGlass(angle=0.2), 0),
    "ground glass 2": images(sg.GroundGlass(angle=0.2), 1),
    "smooth screen": images(smooth, 0),
}
figure, axes = plt.subplots(3, 4, figsize=(4.6, 4), layout="constrained")
for row, (name, seen) in zip(axes, rows.items(), strict=True):
    row[0].imshow(digit, cmap="gray")
    for axis, image, title in zip(row[1:], seen, ("amplitude", "phase", "shifted"), strict=True):
        axis.imshow(image, cmap="gray", vmin=0, vmax=6)
        axis.set_title(title, fontsize=9)
    row[0].set_title(name, loc="left", fontsize=9)
    for axis in row:
        axis.set_axis_off()
plt.show()

# %%
# The contrast of coherent speckle is about 1, whatever the object; with few correlation lengths lit it is higher.
for name, seen in rows.items():
    print(f"{name}: contrast {seen[0].std() / seen[0].mean():.2f}")
same, other = rows["ground glass 1"][0].ravel(), rows["ground glass 2"][0].ravel()
print(f"one digit behind two glasses: correlation {np.corrcoef(same, other)[0, 1]:.2f}")
