"""Spheres of many sizes in a clear host: their cross-sections added up, and their phase functions, by Mie theory.

    sigma_s = sum N_i C_i,      |s(theta)|^2 = sum N_i (|S_1i|^2 + |S_2i|^2) / (2 k^2 sigma_s)

Bohren and Huffman, *Absorption and Scattering of Light by Small Particles* (1983), Eqs. 4.74 and 4.77. Spheres scatter
independently here, which overestimates dense suspensions. Sizes are many, as the ripples of single spheres are narrow:
g of fog is right to 0.003.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.core.lazy import special, stats
from specklegen.core.values import Array, Value, remembered
from specklegen.scene.scatterers import Mie, Tabulated
from specklegen.scene.scatterers.tabulated import tabulated

NODES = 128
"""Sizes of a distribution: equal shares of what is scattered or of the volume."""


class Sizes(Value):
    """Radii of spheres, micrometres, and how many there are in a cubic micrometre."""

    radii: Array
    numbers: Array

    @property
    def volume(self) -> float:
        """Share of the volume that they fill."""
        return float(4 / 3 * math.pi * (self.numbers * self.radii**3).sum())

    def filling(self, share: float) -> "Sizes":
        """Return as many particles as fill a share of the volume."""
        return self.replace(numbers=self.numbers * share / self.volume)


def _middles(nodes: int) -> np.ndarray:
    return (np.arange(nodes) + 0.5) / nodes


def lognormal(mean: float, variation: float, nodes: int = NODES) -> Sizes:
    """Radii whose volume is log-normally distributed, of a mean and a standard deviation over it; of volume 1."""
    width = math.sqrt(math.log1p(variation**2))
    radii = mean * np.exp(width * stats.norm.ppf(_middles(nodes)) - width**2 / 2)
    return Sizes(radii=radii, numbers=1 / nodes / (4 / 3 * math.pi * radii**3))


def modified_gamma(power: float, slope: float, nodes: int = NODES) -> Sizes:
    """Numbers proportional to r^power e^(-slope r), of a mean square radius of 1."""
    radii = stats.gamma.ppf(_middles(nodes), power + 3, scale=1 / slope)  # equal shares of r^2
    return Sizes(radii=radii, numbers=1 / nodes / radii**2)


def exponential(length: float, largest: float, nodes: int = NODES) -> Sizes:
    """Numbers proportional to e^(-d / length) up to a largest diameter d, of volume 1."""
    most = special.gammainc(4, largest / length)  # equal shares of the volume, d^3 e^(-d / length)
    radii = length / 2 * special.gammaincinv(4, _middles(nodes) * most)
    return Sizes(radii=radii, numbers=1 / nodes / (4 / 3 * math.pi * radii**3))


class Suspension(NamedTuple):
    """Coefficients, 1 / micrometre, and what the spheres do together."""

    scattering: float
    absorption: float
    scatterer: Tabulated


@remembered(32)
def suspension(parts: tuple[tuple[Sizes, complex], ...], wavelength: float) -> Suspension:
    """Spheres of several kinds together.

    Parameters
    ----------
    parts
        Sizes, and the refractive index over that of the host, of each kind.
    wavelength
        Inside the host, micrometres.
    """
    numbers = np.concatenate([sizes.numbers for sizes, _ in parts])
    spheres = [
        Mie(radius=radius, wavelength=wavelength, refractive_index=index)
        for sizes, index in parts for radius in sizes.radii
    ]  # fmt: skip
    scattering = float(numbers @ [sphere.scattering_cross_section for sphere in spheres])
    extinction = float(numbers @ [sphere.extinction_cross_section for sphere in spheres])
    orders = max(sphere.coefficients.shape[1] for sphere in spheres)
    electric, magnetic = np.zeros((2, 2 * len(spheres), orders))  # real parts, then imaginary parts
    for n, (a, b) in enumerate(sphere.coefficients for sphere in spheres):
        rows = slice(n, None, len(spheres))
        electric[rows, : len(a)], magnetic[rows, : len(b)] = (a.real, a.imag), (b.real, b.imag)
    twice = np.concatenate([numbers, numbers])

    def shape(theta: np.ndarray) -> np.ndarray:
        pi, tau = _angular(np.cos(theta), orders)
        first, second = electric @ pi + magnetic @ tau, electric @ tau + magnetic @ pi
        return np.sqrt(twice @ (np.square(first) + np.square(second)))

    table = tabulated(shape, "Suspension")
    return Suspension(scattering, max(extinction - scattering, 0.0), table)


def _angular(cos: np.ndarray, orders: int) -> tuple[np.ndarray, np.ndarray]:
    """Return ``(2n + 1) / (n (n + 1))`` times pi_n and tau_n, float64[N, ...]: Bohren and Huffman, Eq. 4.47."""
    pi, tau = np.zeros((2, orders + 1, *cos.shape))
    pi[1] = 1.0
    for n in range(1, orders + 1):
        tau[n] = n * cos * pi[n] - (n + 1) * pi[n - 1]
        if n < orders:
            pi[n + 1] = ((2 * n + 1) * cos * pi[n] - (n + 1) * pi[n - 1]) / n
    n = np.arange(1, orders + 1)
    share = ((2 * n + 1) / (n * (n + 1)))[:, None]
    return share * pi[1:], share * tau[1:]
