"""
A TIFF of your own setup
========================

A file that says what stands on the bench, and a frame of its camera: what is hidden there, and how sure is that? No
frame of a laboratory comes with the package, so one is rendered first and written as a camera writes it, 12 bits with
an offset. Everything after that is what one does with a measured frame.
"""

import tempfile
from pathlib import Path

import numpy as np
import tifffile
import torch
from matplotlib import pyplot as plt
from specklegen.core.display.plot import draw_images
from specklegen.datasets import load_recipe
from specklegen.measured import read_measurement
from specklegen.models import reconstruct, recoverable

folder = Path(tempfile.mkdtemp())
(folder / "setup.toml").write_text("""
inherits = "through-slab-lab"
name = "my-setup"

[lab]
object_distance = "300 mm"
object_extent = "0.4 mm"
aperture = "3 mm"
camera_distance = "100 mm"
pixel_pitch = "5 um"
wavelength = "532 nm"
bandwidth = "1 nm"

[material]
thickness = "0.1 mm"
optical_depth = 8.0
g = 0.92
""")
setup = load_recipe(folder / "setup.toml")
sample = setup.sample(7, "test", 0)  # in place of your laboratory
tifffile.imwrite(folder / "frame.tif", sample["image"].astype(np.uint16))

# %%
# Before anything is measured: can such an object be seen through such a slab, and if not, why?
print(recoverable(setup).explain())

# %%
# The frame, with what was found of it and what had to be assumed.
level = setup.exposure.offset + (setup.exposure.dark_current + setup.exposure.background) / setup.exposure.gain
measured = read_measurement(folder / "frame.tif", dark=level, envelope="fit", bit_depth=12)
print(measured.explain())

# %%
# What is hidden, up to a shift and a turn by 180 degrees, with the probability that it is right, told without the
# object; and other pictures that explain the frame, with their weights.
(found,) = reconstruct(measured, setup, draws=4).each
print("no probability" if found.probability is None else f"probability {found.probability:.2f}")
figure, (left, middle, right) = plt.subplots(1, 3, figsize=(9, 2.4), layout="constrained", width_ratios=(1, 2, 4))
left.imshow(measured.images[0], cmap="gray")
left.set_axis_off()
left.set_title("frame", fontsize=9)
draw_images(middle, np.stack([found.image, np.pad(sample["object"], 4)]), ["found", "hidden"], high=1.0)
draws = found.draws
draw_images(right, np.stack([torch.as_tensor(each).numpy() for each in draws.draws[0]]),
            [f"weight {weight:.2f}" for weight in torch.as_tensor(draws.weights[0]).tolist()], high=1.0)  # fmt: skip
plt.show()
