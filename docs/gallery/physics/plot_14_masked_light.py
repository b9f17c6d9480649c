"""
Light through a mask, and then a slab
=====================================

A double slit stands between laser and slab. Behind the slab there is speckle. Within the memory effect, the
autocorrelation of the speckle has the fringes of the double slit.
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

# %%
# The field in the illuminated area is a Fourier series of beams. The strongest beams carry 0.8 of the power, which is
# enough for a picture. All pass the same medium in one call.
beams, modes = illumination_of(field, power=0.8)
carried = np.square(np.abs(modes)).sum() / np.square(np.abs(field.values)).mean()
print(f"{len(modes)} beams carry {carried:.0%} of the power")

slab = sg.Slab(thickness=4.0, mean_free_path=2.0, scatterer=sg.media.HenyeyGreenstein(0.9))
sensor = sg.sensors.FarField.grid((65, 65), 0.5 / 32 / 2)
scene = sg.Scene(wavelength=0.5, medium=slab, illumination=beams, sensor=sensor)
warnings.simplefilter("ignore", sg.DoubtWarning)  # fog of a few wavelengths: path sums lose some of the far correlation
images = np.array([
    np.abs(sg.statistics.transmission_matrix(scene, modes, paths=500, seed=n).value[:, 0].reshape(65, 65)) ** 2
    for n in range(8)
])  # fmt: skip

# %%
# Van Cittert and Zernike: the correlation of two directions is the Fourier transform of the intensity in the
# illuminated area. Two slits at a distance of 10 give the first minimum at 3 to 4 pixels.
fluctuation = images - images.mean(axis=0)
spectrum = np.square(np.abs(np.fft.fft2(fluctuation, (130, 130)))).mean(axis=0)
overlap = np.square(np.abs(np.fft.fft2(np.ones((65, 65)), (130, 130))))
correlation = np.fft.ifft2(spectrum).real[0, :33] / np.fft.ifft2(overlap).real[0, :33]

figure, panels = plt.subplots(3, 1, figsize=(3.6, 9), layout="constrained")
panels[0].imshow(np.abs(field.values) ** 2, extent=(-16, 16, -16, 16), cmap="magma")
panels[0].set(title="light at the slab", xlabel="x (µm)")
panels[1].imshow(images[0], cmap="magma")
panels[1].set(title="speckle behind the slab")
panels[2].plot(correlation / correlation[0])
panels[2].set(title="correlation, mean over 8 media", xlabel="distance along x (pixels)")
plt.show()
