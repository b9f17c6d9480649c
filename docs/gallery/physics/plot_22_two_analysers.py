"""
One slab behind two analysers
=============================

Behind ten mean free paths of forward scattering, light is still polarised. A crossed analyser passes light of long
paths only: it is weak, and decorrelates within a fraction of the tilt.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt

slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9),
              polarisation="projector")
light = sg.statistics.mueller_matrix(slab, wavelength=0.5, paths=40_000)
print(f"degree of polarisation {light.linear:.3f}, of circular light {light.circular:.3f}")
print(f"a crossed analyser passes {light.intensity([1, 0], [0, 1]) / light.intensity([1, 0]):.3f} of the light")
print(f"contrast without an analyser {light.contrast:.3f}")

# %%
# A tilt along the polarisation decorrelates less than a tilt across it.
tilts = np.linspace(0.0, 4e-4, 25)
axes = plt.subplots(layout="constrained")[1]
for channel, style in (("co", "-"), ("crossed", "--")):
    for name, azimuth in (("along", 0.0), ("at 45°", np.pi / 4), ("across", np.pi / 2)):
        curve = sg.memory_effect(
            slab, wavelength=0.5, tilts=tilts, channel=channel, azimuth=azimuth, paths=30_000
        )
        axes.plot(curve.q, curve.intensity, style, label=f"{channel}, {name}")
axes.set(xlabel=r"tilt  $q = k\,\sin\theta\,L$", ylabel=r"intensity correlation  $C_I$", ylim=(-0.03, 1.05))
axes.legend()

# %%
# Small (Rayleigh) particles depolarise: the degree of polarisation behind one, five and ten mean free paths.
for depth in (1.0, 5.0, 10.0):
    air = sg.Slab(thickness=1000.0, mean_free_path=1000.0 / depth, scatterer=sg.media.Rayleigh(), polarisation="vector")
    found = sg.statistics.mueller_matrix(air, wavelength=0.5, paths=40_000)
    print(f"optical depth {depth:g}: degree of polarisation {found.linear:.3f} +- {found.linear_error:.3f}")
