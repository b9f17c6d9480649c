"""
Focusing through a slab, and scanning the focus
===============================================

The transmission matrix contains the phase with which each beam arrives at a point behind a slab. If the beams are sent
with the opposite phases, they interfere constructively there, and the point is (N - 1) pi / 4 + 1 times as bright
(Vellekoop and Mosk 2007). If the whole wavefront is tilted, the focus moves, within the memory-effect range.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt
from specklegen.coherence import transmission_matrix

width, side, scanned = 2000.0, 10, 10  # wavelengths, beams along each side, steps of the scan
slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.Isotropic())
y, x = np.meshgrid(np.arange(side), np.arange(side + scanned), indexing="ij")
sines = np.stack([x - side / 2, y - side / 2], axis=-1).reshape(-1, 2) / width
beams = sg.light.CollimatedBeams(directions=np.column_stack([sines, np.sqrt(1 - np.square(sines).sum(1))]), width=width)
camera = sg.sensors.FarField.grid((48, 97), 1 / width / 4)  # grains of four pixels
scene = sg.Scene(wavelength=1.0, medium=slab, illumination=beams, sensor=camera)
matrix = transmission_matrix(scene, paths=20_000, seed=0, reverse=False).value.reshape(48, 97, side, side + scanned)

# %%
# The first hundred beams in phase at the target, then the same phases on beams tilted by some steps.
target = matrix[24, 28, :, :side]
phases = np.exp(-1j * np.angle(target)) / side
plain = np.square(np.abs(matrix[..., :side].sum(axis=(2, 3)) / side))
images = [np.square(np.abs(np.einsum("hwab,ab->hw", matrix[..., s : s + side], phases))) for s in (0, 4, 8)]
mean = np.square(np.abs(matrix)).mean()
axes = plt.subplots(4, 1, figsize=(4.2, 8.4), layout="constrained")[1].ravel()
titles = ("flat wavefront", "shaped", "tilted by 4 steps", "tilted by 8 steps")
for panel, image, title in zip(axes, (plain, *images), titles, strict=True):
    panel.imshow(image / mean, cmap="gray", vmax=40)
    panel.set_title(f"{title}: up to {image.max() / mean:.0f} times the mean", fontsize=9)
    panel.set_xticks([])
    panel.set_yticks([])
expected = 1 + (side**2 - 1) * np.pi / 4
print(f"enhancement {images[0][24, 28] / mean:.1f}, expected {expected:.1f} with 10 % from medium to medium")

# %%
# The brightness of the focus, and the memory effect of the slab, which is computed without wavefronts.
steps = np.arange(scanned + 1)
kept = [
    np.square(np.abs(np.sum(matrix[24, 28 + 4 * s, :, s : s + side] * phases))) / mean for s in steps
]  # the target moves by a grain, 4 pixels, a step
curve = sg.memory_effect(slab, wavelength=1.0, tilts=steps / width, paths=50_000, seed=0)
figure, panel = plt.subplots(layout="constrained")
panel.plot(steps / width * 1e3, kept, "o", label="focus")
panel.plot(steps / width * 1e3, 1 + (side**2 - 1) * np.pi / 4 * curve.intensity, label=r"$(N - 1)\,\pi/4\;C_I + 1$")
panel.set(xlabel="tilt of the wavefront (mrad)", ylabel="brightness / mean", ylim=(0, None))
panel.legend()
plt.show()
