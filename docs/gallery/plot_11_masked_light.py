"""
Light through a mask, and then a slab
=====================================

A double slit stands between laser and slab. Its field at the slab is that of two slits; behind the slab there is
speckle, whose autocorrelation still has the fringes of the mask, as far as the memory effect reaches.
"""

import warnings

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt
from specklegen.wavetracing import Plane, PlaneWave, field_on_plane, illumination_of

slit = np.array([[-2, -6], [2, -6], [2, 6], [-2, 6.0]])  # counter-clockwise; holes would run clockwise
light = PlaneWave(wavelength=0.5)
window = Plane(center=[0, 0, 20], shape=(86, 86), pitch=32 / 86)
field = field_on_plane([slit + [-5, 0], slit + [5, 0]], light, window)
with warnings.catch_warnings():
    warnings.simplefilter("ignore", sg.DoubtWarning)  # 0.5 % of the field is too fine for these pixels
    beams, modes = illumination_of(field, power=0.9)

slab = sg.Slab(thickness=4.0, mean_free_path=2.0, scatterer=sg.HenyeyGreenstein(0.9))
sensor = sg.FarField.grid((65, 65), 0.5 / 32 / 2)
scene = sg.Scene(wavelength=0.5, medium=slab, illumination=beams, sensor=sensor)
images = [
    np.abs(sg.transmission_matrix(scene, modes, seed=n).value[:, 0].reshape(65, 65)) ** 2 for n in range(6)
]
print(f"{len(modes)} beams carry 90 % of the field")

autocorrelation = np.zeros((65, 65))
for image in images:
    spectrum = np.abs(np.fft.fft2(image - image.mean())) ** 2
    autocorrelation += np.fft.fftshift(np.fft.ifft2(spectrum).real)

figure, panels = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
panels[0].imshow(np.abs(field.values) ** 2, extent=(-16, 16, -16, 16), cmap="magma")
panels[0].set(title="the mask's field at the slab", xlabel="x / µm")
panels[1].imshow(images[0], cmap="magma")
panels[1].set(title="speckle behind the slab")
panels[2].plot(np.arange(-32, 33), autocorrelation[32])
panels[2].set(title="autocorrelation of 6 media: fringes", xlabel="pixels")
plt.show()
