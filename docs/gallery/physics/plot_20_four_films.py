"""
Four films of equal 1/e time
============================

In four films of speckle the correlation of the fields falls to 1/e within the same time. One is a slab of particles in
Brownian motion. The other three are simple substitutes: an autoregression, a fade from one pattern to another, and a
drifting pattern. A long exposure distinguishes them.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt
from specklegen.core.display.plot import draw_images

particles = sg.media.HenyeyGreenstein(0.9)
slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=particles, motion=sg.media.Brownian(diffusion=1.0))
lags = np.linspace(0.0, 0.1, 400)
curve = sg.statistics.temporal_correlation(slab, wavelength=0.5, lags=lags, paths=20_000)
time = np.interp(-np.exp(-1), -curve.field.real, lags)
print(f"g1 falls to 1/e within {time:.4f}")

# %%
# Frames are a twentieth of that time apart. The film of the slab is one call. The others combine independent patterns
# of a slab at rest.
count, width, pitch = 101, 20_000.0, 1e-5
since = np.arange(count) / 20  # over the 1/e time


def fields(medium, times, realizations):
    """Fields of films of a medium, complex64[realizations, times, 96, 96]."""
    beams = sg.light.CollimatedBeams.tilts(np.zeros(len(times)), width=width, times=times)
    scene = sg.Scene(wavelength=0.5, medium=medium, illumination=beams,
                     sensor=sg.sensors.FarField.grid((96, 96), pitch))
    return sg.render(scene, realizations=realizations, paths=20_000).field


fresh = fields(slab, [0.0], count)[:, 0]
kept = np.exp(-1 / 20)
film = [fresh[0]]
for pattern in fresh[1:]:
    film.append(kept * film[-1] + np.sqrt(1 - kept**2) * pattern)
angle = np.minimum(since * np.arccos(np.exp(-1)), np.pi / 2)[:, None, None]
# The illuminated area is square, so a drift by d grains leaves sinc(d), which is 1/e at d = 0.716.
moved = 0.716 * since * 0.5 / width / pitch
turn = np.exp(-2j * np.pi * np.fft.fftfreq(96) * moved[:, None, None])
films = {
    "Brownian motion": fields(slab, since * time, 1)[0],
    "autoregression": np.array(film),
    "fade": np.cos(angle) * fresh[0] + np.sin(angle) * fresh[1],
    "drift": np.fft.ifft(np.fft.fft(fresh[0]) * turn),
}
shown = (0, 2, 10, 20, 60)
rows, axes = plt.subplots(4, 1, figsize=(4.4, 4.6), layout="constrained")
for ax, (name, frames) in zip(axes, films.items(), strict=True):
    pictures = np.square(np.abs(frames[list(shown), :32, :32]))
    draw_images(ax, pictures, [f"{since[n]:.1f}" for n in shown])
    ax.set_title(name, loc="left", fontsize=9)

# %%
# Long paths decorrelate first, short ones last. So the correlation of moving particles is not one exponential. Points:
# the films. Dotted line: ``temporal_correlation``.
axes = plt.subplots(layout="constrained")[1]
axes.plot(lags / time, curve.intensity, "k:", label="temporal_correlation")
for name, frames in films.items():
    power = np.square(np.abs(frames)).mean(axis=(1, 2))
    g1 = (frames[0].conj() * frames).mean(axis=(1, 2)) / np.sqrt(power * power[0])
    axes.plot(since, np.square(np.abs(g1)), ".-", ms=3, lw=0.7, label=name)
axes.set(xlabel="lag / (1/e time)", ylabel="$|g_1|^2$", xlim=(0, 3.2))
axes.legend()

# %%
# The contrast of an exposure shows the difference. If one exponential is assumed, the speed found for moving particles
# depends on the exposure.
exposures = np.geomspace(0.1, 5.0, 12)
axes = plt.subplots(layout="constrained")[1]
axes.loglog(exposures, curve.contrast(exposures * time).squared, "k:", label="temporal_correlation")
for name, frames in films.items():
    power = np.square(np.abs(frames))
    exposed = [power[: max(1, round(20 * each))].mean(axis=0) for each in exposures]
    axes.plot(exposures, [each.var() / each.mean() ** 2 for each in exposed], ".-", lw=0.7, label=name)
axes.set(xlabel="exposure / (1/e time)", ylabel="$K^2$")
axes.legend()
plt.show()
