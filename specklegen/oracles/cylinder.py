"""One circular cylinder in flatland: its T-matrix, scattering amplitude and cross-section.

A scalar wave of wavenumber k meets a cylinder of radius a and relative index m; field and normal derivative
are continuous (an electric field along the axis). With x = ka and y = mx, the order n of the incident wave
J_n(kr) e^{in phi} comes back as T_n H_n(kr) e^{in phi}, time e^{-i omega t}, H_n = H_n^(1):

    T_n = -A_n / (A_n + i B_n),   A_n = J_n(y) J_n'(x) - m J_n'(y) J_n(x),   B_n the same with Y_n(x) for J_n(x)
    s(theta) = sqrt(2 / (pi k c_s)) e^{-i pi / 4} sum_n T_n e^{in theta},    c_s = (4 / k) sum_n |T_n|^2

so that u_sc -> sqrt(c_s) s(theta) e^{ikr} / sqrt(r) for a unit plane wave, and the integral of |s|^2 is 1.
Source: Bohren, Huffman, *Absorption and Scattering of Light by Small Particles* (1983), section 8.4.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from scipy.optimize import root_scalar
from scipy.special import jn_zeros, jv, jvp, y0, y0_zeros, y1, yv, yvp

from specklegen.core.errors import reject


@dataclass(frozen=True)
class Cylinder:
    """A lossless circular cylinder.

    Attributes
    ----------
    radius, wavelength : float
        Of the cylinder; of the wave around it.
    index : float
        Refractive index relative to the surroundings.
    order : int
        Multipole orders -order ... order are kept. Order 0 alone scatters equally in all directions; a
        cylinder thinner than a fiftieth of the wavelength needs no more than order 1.
    """

    radius: float
    index: float
    wavelength: float = 1.0
    order: int = 1

    def __post_init__(self) -> None:
        for name in ("radius", "index", "wavelength"):
            value = getattr(self, name)
            if not (np.isreal(value) and np.isfinite(value) and value > 0):
                reject(f"Cylinder.{name}", "a finite number greater than 0", value)
        if self.order != int(self.order) or self.order < 0:
            reject("Cylinder.order", "a whole number of at least 0", self.order)

    @classmethod
    def resonant(cls, radius: float, wavelength: float = 1.0, order: int = 1) -> Self:
        """Return the cylinder of the lowest index above 1 at which B_0 = 0: T_0 = -1, the most that is possible.

        B_0 changes its sign just once between m = 1 and the first zero of J_0(y), as long as Y_0(x) < 0. Raise a
        `RuleError` if the radius is not below 0.142 wavelengths, where Y_0(ka) < 0.
        """
        x = 2 * np.pi * radius / wavelength
        thickest = float(y0_zeros(1)[0][0].real)
        if not 0 < x < thickest:
            bound = thickest / (2 * np.pi) * wavelength
            reject("Cylinder.radius", f"between 0 and {bound:.4g} (0.142 wavelengths) for a resonance", radius)
        mismatch = lambda y: y * jv(1, y) * y0(x) - x * jv(0, y) * y1(x)  # noqa: E731
        bracket = (x, float(jn_zeros(0, 1)[0]))
        y = root_scalar(mismatch, bracket=bracket, xtol=1e-15, rtol=4 * np.finfo(float).eps).root
        return cls(radius=radius, index=float(y) / x, wavelength=wavelength, order=order)

    @property
    def wavenumber(self) -> float:
        """K = 2 pi / wavelength, radians per unit length."""
        return 2 * np.pi / self.wavelength

    @property
    def orders(self) -> np.ndarray:
        """Return the multipole orders -order ... order, int64[2M + 1]."""
        return np.arange(-self.order, self.order + 1)

    @cached_property
    def t_matrix(self) -> np.ndarray:
        """Coefficients T_n, complex128[2M + 1]; ``|1 + 2 T_n| = 1``, for nothing is absorbed."""
        a, b = self._mismatch
        return -a / (a + 1j * b)

    @cached_property
    def inner(self) -> np.ndarray:
        """Field inside over field scattered, complex128[2M + 1]: c_n J_n(mkr) inside where b_n H_n(kr) leaves.

        c_n / b_n = -2i / (pi x A_n), by the Wronskian.
        """
        return -2j / (np.pi * self.wavenumber * self.radius * self._mismatch[0])

    @cached_property
    def _mismatch(self) -> tuple[np.ndarray, np.ndarray]:
        """A_n and B_n, float64[2M + 1]."""
        n, m, x = self.orders, self.index, self.wavenumber * self.radius
        inside, slope = jv(n, m * x), m * jvp(n, m * x)
        return inside * jvp(n, x) - slope * jv(n, x), inside * yvp(n, x) - slope * yv(n, x)

    @property
    def cross_section(self) -> float:
        """Return c_s, the scattering width: power scattered over irradiance, a length."""
        return float(4 / self.wavenumber * np.sum(np.abs(self.t_matrix) ** 2))

    def amplitude(self, theta: np.ndarray) -> np.ndarray:
        """Scattering amplitude s(theta), complex128 of the angles' shape; radians between the directions of travel."""
        waves = np.exp(1j * np.asarray(theta)[..., None] * self.orders)
        scale = np.sqrt(2 / (np.pi * self.wavenumber * self.cross_section))
        return scale * np.exp(-0.25j * np.pi) * (waves @ self.t_matrix)
