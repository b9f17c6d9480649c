"""
A TIFF of your own setup
========================

Reconstruct the object from a camera frame and a description of the setup, with a confidence. The package contains no
measured frame, so the script first renders one, as a 12-bit TIFF with an offset. The rest applies to measured frames
too.
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
profile = "disc"
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
# Before the measurement: can such an object be reconstructed behind such a slab?
print(recoverable(setup).explain())

# %%
# The frame, with everything found and assumed.
level = setup.exposure.offset + (setup.exposure.dark_current + setup.exposure.background) / setup.exposure.gain
measured = read_measurement(folder / "frame.tif", dark=level, envelope="fit", bit_depth=12)
print(measured.explain())

# %%
# The reconstruction, up to shift and 180-degree rotation, with its confidence, the probability that r > 0.8; and other
# objects that explain the frame, with weights.
(found,) = reconstruct(measured, setup, draws=4).each
print("no confidence" if found.probability is None else f"confidence {found.probability:.2f}")
figure, rows = plt.subplots(3, 1, figsize=(4.2, 6.4), layout="constrained")
left, middle, right = rows
left.imshow(measured.images[0], cmap="gray")
left.set_axis_off()
left.set_title("camera frame", fontsize=10)
draw_images(middle, np.stack([found.image, np.pad(sample["object"], 4)]), ["reconstruction", "object"], high=1.0)
draws = found.draws
draw_images(right, np.stack([torch.as_tensor(each).numpy() for each in draws.draws[0]]),
            [f"weight {weight:.2f}" for weight in torch.as_tensor(draws.weights[0]).tolist()], high=1.0)  # fmt: skip
plt.show()
