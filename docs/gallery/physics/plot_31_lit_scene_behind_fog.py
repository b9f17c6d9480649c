"""
A lit scene behind fog
======================

A wall with a slit, a lamp behind it, and two solids on the floor. Wave tracing computes how bright they are: light
comes straight through the slit and past its edges. That brightness is then a hidden object behind a slab of fog.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt
from specklegen.core.statistics import autocorrelation
from specklegen.wavetracing import Absorber, Diffuse, Geometry, Mesh, Plane, PointEmitter, picture


def block(lower, upper, material):
    """A box between two corners."""
    corners = [[(lower, upper)[n >> a & 1][a] for a in range(3)] for n in range(8)]
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return Mesh(corners, [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))], material)


def upright(x0, x1, y, height):
    """A thin black wall along x."""
    return Mesh([[x0, y, 0], [x1, y, 0], [x1, y, height], [x0, y, height]], [[0, 1, 2], [0, 2, 3]], Absorber())


white, grey = Diffuse(albedo=0.9), Diffuse(albedo=0.3)
floor = Mesh([[-40, -2.9, 0], [40, -2.9, 0], [40, 40, 0], [-40, 40, 0]], [[0, 1, 2], [0, 2, 3]], grey)
solids = [block((-5, 2, 0), (-1, 6, 5), white), block((2, 4, 0), (5, 7, 2), white)]
scene = Geometry([floor, *solids, upright(-30, -2, -3, 12), upright(1, 30, -3, 12)])
lamp = PointEmitter([-1, -15, 6], wavelength=0.01)

# %%
# The camera looks down, aslant. Every pixel is connected with the lamp; no ray has to hit it by chance.
sight = np.array([0, -0.5, np.sqrt(0.75)])  # towards the camera
view = Plane(center=[-1, 5, 2] + 60 * sight, normal=sight, up=[0, 1, 0], shape=(28, 28), pitch=0.5)
straight = picture(scene, lamp, view)
with_edges = picture(scene, lamp, view, diffractions=1, samples=1)

# %%
# Its brightness as a hidden object behind a slab, whose speckle images add up pixel by pixel.
slab = sg.Slab(thickness=400.0, mean_free_path=40.0, scatterer=sg.media.HenyeyGreenstein(g=0.9))
hidden = sg.light.IncoherentObject(brightness=straight[::-1] / straight.max(), pitch=6e-6, width=20_000.0)
camera = sg.sensors.FarField.grid((96, 96), pitch=1e-5)
stack = sg.render(sg.Scene(wavelength=0.5, medium=slab, illumination=hidden, sensor=camera), seed=1)
image = np.asarray(stack.intensity).reshape(96, 96)

figure, panels = plt.subplots(1, 4, figsize=(13, 3.3), layout="constrained")
shown = {
    "straight light, root": np.sqrt(straight), "past the slit's edges, dB": 10 * np.log10(with_edges + 1e-9),
    "behind fog": image, "its autocorrelation": np.clip(autocorrelation(image.astype(float))[24:-24, 24:-24], 0, 0.5),
}  # fmt: skip
for panel, (name, values) in zip(panels, shown.items(), strict=True):
    panel.imshow(values, cmap="magma", origin="lower")
    panel.set(title=name)
    panel.set_axis_off()
plt.show()
