"""
Published measurements of speckle
=================================

Experiments of the time when diffusing waves were new, beside what this package says of them: a cell of variable
thickness, light sent back by a deep suspension, and how bright it is straight back. The rows are those of
docs/measurements.md.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt
from scipy.optimize import brentq
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.oracles.vector_adding_doubling import backscattering, projected, rayleigh, vector_adding_doubling
from specklegen.theory.diffusing_wave import inferred_depths

# %%
# Diffusing-wave spectroscopy reads the thickness over the transport length, Lambda, off the decay of a slab's speckle.
# Kaplan, Kao, Yodh and Pine (Appl. Opt. 32, 3828, 1993) found its answers consistent within 5 % in cells of more than
# ten transport lengths. Here it is given what radiative transfer says, and what random paths say, at g1 = 1/2.
depths = np.array([3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0])


def transfer(depth, x):
    """Light that a slab passes, and that keeps its phase in moving particles."""
    return adding_doubling(depth, albedo=1.0, g=0.0, motion=x, nodes=32).transmitted


halves, exact = [], []
for depth in depths:
    rest = transfer(depth, 0.0)
    halves.append(brentq(lambda x, d=depth, r=rest: transfer(d, x) / r - 0.5, 1e-5, 1.0, xtol=1e-8))
    exact.append(inferred_depths(0.5, halves[-1]) / depth)

wavelength, paths = 1e-3, []  # far below a mean free path: both ways of a path interfere straight back alone
for depth, x in zip(depths, halves, strict=True):
    slab = sg.Slab(thickness=depth, mean_free_path=1.0, scatterer=sg.media.Isotropic(),
                   motion=sg.media.Brownian(diffusion=1.0))
    curve = sg.statistics.temporal_correlation(slab, wavelength=wavelength, lags=[x * (wavelength / 2 / np.pi) ** 2],
                                               paths=40_000)
    g1, error = curve.field.real[0], curve.standard_error[0] / 2 / curve.field.real[0]
    told = [inferred_depths(g1 + d, x) / depth for d in (0, -error, error)]
    paths.append((told[0], abs(told[1] - told[2]) / 2))

for depth, ratio, found in zip(depths, exact, paths, strict=True):
    print("Lambda = {:g}: inferred over true {:.3f}, by paths {:.3f} +- {:.3f}".format(depth, ratio, *found))

axes = plt.subplots(figsize=(6, 4), layout="constrained")[1]
axes.axhspan(0.95, 1.05, xmin=0, color="0.9", label="within 5 %")
axes.plot(depths, exact, "k-", lw=1, label="radiative transfer")
axes.errorbar(depths, *np.transpose(paths), fmt="o", ms=4, label="random paths")
axes.axvline(10, color="k", ls=":", lw=0.8)
axes.set(xlabel=r"true $\Lambda = L / \ell^*$", ylabel=r"$\Lambda$ of diffusing waves over the true one")
axes.legend()

# %%
# Rosenbluh, Hoshen and Freund (Phys. Rev. Lett. 58, 2754, 1987) saw light that is sent back forgotten 25 times sooner
# than light scattered once at a right angle. Of isotropic particles, 5 degrees off, multiple scattering alone:
cosine = np.cos(np.deg2rad(5))
rate = 1 + 1 / cosine


def multiple(x, depth):
    """Light that a slab sends back at five degrees after more than one scattering."""
    light = adding_doubling(depth, albedo=1.0, g=0.0, motion=x, view=cosine, nodes=48).reflected
    return light + np.expm1(-depth * rate) / rate / (4 * np.pi * cosine) * np.exp(-2 * x * (1 + cosine))


for depth in (60.0, 4000.0):
    rest = multiple(0.0, depth)
    fallen = brentq(lambda x, d=depth, r=rest: (multiple(x, d) / r) ** 2 - np.exp(-1), 1e-3, 0.1, xtol=1e-9)
    print(f"optical depth {depth:g}: {0.25 / fallen:.2f} times sooner")

# %%
# Wiersma, van Albada, van Tiggelen and Lagendijk (Phys. Rev. Lett. 74, 4193, 1995) saw light of kept helicity come
# straight back from weakly scattering powders 2.00 +- .01 times as bright as beside. Without reversed paths, and with
# them, from Rayleigh particles 40 mean free paths deep: all four channels, from ten runs of a thousand paths.
powder = sg.Slab(thickness=40.0, mean_free_path=1.0, scatterer=sg.media.Rayleigh(), polarisation="vector")
left, right = np.array([1, 1j]) / np.sqrt(2), np.array([1, -1j]) / np.sqrt(2)
channels = {
    "helicity kept": (left, right), "helicity flipped": (left, left),  # seen against z, fields of one helicity differ
    "linear, parallel": ([1, 0], [1, 0]), "linear, crossed": ([1, 0], [0, 1]),
}  # fmt: skip
lit = np.array([
    [[light.intensity(*pair) for pair in channels.values()] for light in (
        sg.statistics.mueller_matrix(powder, wavelength=1e-3, mode="reflection", view=[0.0, 0.0, -1.0], reverse=way,
                                     paths=1000,
                          seed=seed)
        for way in (True, False))]
    for seed in range(10)
])  # fmt: skip
without = (lit.sum(axis=0) - lit)[:, 0] / (lit.sum(axis=0) - lit)[:, 1]
for name, ratio, error in zip(channels, lit[:, 0].sum(0) / lit[:, 1].sum(0), 3 * without.std(axis=0), strict=True):
    print(f"{name}: {ratio:.3f} +- {error:.3f}")

# %%
# A half space of such particles, without a random number: what a path and its reverse add, from adding and doubling.
spins = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])
seen, added = backscattering(1e4, rayleigh)
for name, pair in channels.items():
    into, passed = (np.einsum("a,iab,b->i", np.conj(field), spins, field).real for field in pair)
    print(f"half space, {name}: {1 + passed @ added @ into / (passed @ seen @ into):.4f}")
print(f"half space, all light: {1 + added[0, 0] / seen[0, 0]:.4f}")

# %%
# Thick slabs that absorb nothing, by radiative transfer: Hopf's constant from transmittances at two depths, the law of
# darkening towards the limb of light that leaves behind, and Rayleigh particles' polarisation at the limb.
passes = {depth: adding_doubling(depth, albedo=1.0, g=0.0, nodes=32).transmittance for depth in (20.0, 40.0)}
(one, two), (first, second) = passes, passes.values()
print(f"Hopf's constant: {(one * first - two * second) / 2 / (second - first):.4f}")
limb = {mu: adding_doubling(20.0, albedo=1.0, g=0.0, nodes=32, view=mu).transmitted / mu for mu in (1.0, 0.8, 0.5, 0.2)}
print("radiance over that along the axis:", {mu: round(light / limb[1.0], 4) for mu, light in limb.items()})
steep = vector_adding_doubling(20.0, rayleigh, views=(1e-4,), nodes=32).transmitted[0, 0, :, 0]
print(f"polarisation at the limb: {-steep[1] / steep[0]:.4f}")

# %%
# Light sent back by moving particles is forgotten as exp(-gamma sqrt(6 tau / tau0)), tau0 = 1 / (D k^2). Seen along the
# light's polarisation, spheres far smaller than the wavelength have gamma 1.6 in print: here with and without a face.
root = np.array([0.1, 0.2, 0.3, 0.5, 0.7])
for index in (1.0, 1.33):
    deep = sg.Slab(thickness=150.0, mean_free_path=1.0, scatterer=sg.media.Rayleigh(), polarisation="vector",
                   motion=sg.media.Brownian(diffusion=1.0), faces=sg.media.Faces(inside=index))  # fmt: skip
    for channel in ("co", "crossed"):
        curve = sg.statistics.temporal_correlation(deep, wavelength=wavelength,
                                                   lags=root**2 / 6 * (wavelength / 2 / np.pi) ** 2,
                                        mode="reflection", channel=channel, paths=20_000, reverse=False)  # fmt: skip
        print(f"index {index:g}, {channel}: gamma {-np.polyfit(root, np.log(curve.field.real), 1)[0]:.2f}")

# %%
# Jacques, Roman and Lee (Lasers Surg. Med. 26, 119, 2000) gave suspensions, skin, muscle and liver a polarisation
# diffusivity chi in rad^2 a mean free path. If the angle has the variance chi tau, light keeps P = exp(-2 chi tau).
for g, nodes in ((0.0, 8), (0.5, 12), (0.8, 24)):
    matrix = projected(lambda c, g=g: (1 - g * g) / (1 + g * g - 2 * g * c) ** 1.5) if g else rayleigh
    for depth in (2.0, 5.0):
        light = vector_adding_doubling(depth, matrix, nodes=nodes).transmitted[0, 0]
        print(f"g = {g:g}, depth {depth:g}: chi = {-np.log(light[1, 1] / light[0, 0]) / (2 * depth):.4f} rad^2")

# %%
# Fat emulsions by Mie theory, beside what was measured of them: mu_s (1 - g) of Intralipid, per millimetre. Van
# Staveren et al. (Appl. Opt. 30, 4507, 1991) had Intralipid-10 %, the fat of half as much of the 20 % emulsion; Di
# Ninni, Martelli and Zaccanti (Phys. Med. Biol. 56, N21, 2011) nine batches of 20 %. Sizes are fitted to a third work.
formula = {x: 1.6 * x**-2.4 * (1 - (1.1 - 0.58 * x)) for x in (0.4579, 0.5145, 0.6328)}
batches = {0.6328: 25.9, 0.751: 21.2, 0.833: 18.4}
for source, printed, share in (("a tenth of 10 %", formula, 0.05), ("20 %", batches, 0.01)):
    for vacuum, measured in printed.items():
        whole = 1.0 if share == 0.05 else share  # those of 2011 are stated as of the undiluted emulsion
        ours = 1000 / sg.materials.get("intralipid-mie", vacuum, dilution=share).transport_length / whole
        print(f"Intralipid, {source}, {vacuum:g} micrometres: {measured:.2f} measured, {ours:.2f} by Mie theory")

# %%
# Silica spheres of 345 nm in water at 685 nm, transport lengths by the group of Furst (numbers of Q. Li in the program
# nsbalbi/Scattering): spheres that keep each other apart, and independent ones.
sphere = sg.media.Mie(radius=0.1725, wavelength=0.685 / 1.332, refractive_index=1.446 / 1.332)
for share, measured in ((0.065, 230), (0.067, 225), (0.069, 216), (0.072, 215), (0.075, 205), (0.135, 130)):
    dense = sg.media.PercusYevick(sphere, share, 0.345)
    alone = 1 / (dense.number_density * sphere.scattering_cross_section * (1 - sphere.g))
    ours = dense.mean_free_path / (1 - dense.g)
    print(f"silica, {share:g} of the volume: {measured} measured, {ours:.0f} by hard spheres, {alone:.0f} independent")

# %%
# Milk, in red, green and blue light (Jensen, Marschner, Levoy and Hanrahan, SIGGRAPH 2001): the same.
for name, fat, printed in (("skimmed", 0.1, (0.70, 1.22, 1.90)), ("whole", 3.5, (2.55, 3.21, 3.77))):
    for vacuum, measured in zip((0.65, 0.55, 0.475), printed, strict=True):
        ours = 1000 / sg.materials.get("milk", vacuum, fat=fat).transport_length
        print(f"{name} milk, {vacuum:g} micrometres: {measured:.2f} measured, {ours:.2f} by Mie theory")

# %%
# Schott, Bertolotti, Leger, Bourdieu and Gigan (Opt. Express 23, 13505, 2015) found the memory effect of tissue to
# reach more than an order of magnitude further than that of isotropic particles. Slabs of g = .98, over those of g = 0:
for depth in (10.0, 20.0, 30.0):
    slabs = [sg.Slab(thickness=1.0, mean_free_path=1 / depth, scatterer=sg.media.HenyeyGreenstein(g))
             for g in (0.98, 0.0)]
    forward, isotropic = (estimate_correlation(slab, 400_000, seed=3).half_range() for slab in slabs)
    print(f"optical depth {depth:g}: {forward / isotropic:.1f} times as far")
plt.show()
