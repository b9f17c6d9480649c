"""Spheres so dense that they keep each other apart: interference of their single scattering, after Percus and Yevick.

    rho(theta) = rho_1(theta) S(q) / ratio,     ratio = integral of rho_1 S,     q = 2 k sin(theta/2)

    1 / S(q) = 1 + 24 phi * integral from 0 to 1 of (a + b s + c s^3) s^2 sinc(q d s) ds

    a = (1 + 2 phi)^2 / (1 - phi)^4,    b = -6 phi (1 + phi/2)^2 / (1 - phi)^4,    c = phi a / 2

Percus and Yevick, Phys. Rev. 110, 1 (1958); Wertheim, Phys. Rev. Lett. 10, 321 (1963). Fraden and Maret, Phys. Rev.
Lett. 65, 512 (1990), measured that transport lengths follow it.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.quadrature import gauss_legendre
from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH, RADIAN, WAVELENGTH
from specklegen.core.values import Positive, read_only
from specklegen.scene.scatterers.scatterer import AnyScatterer, Dimensions, _WithAnisotropy
from specklegen.scene.scatterers.tabulated import Tabulated, tabulated

DENSEST = 0.5
"""Largest volume fraction: fluids of hard spheres begin to freeze at 0.494."""
_SERIES = 2.0  # q d below which the closed form would cancel
_X, _W = gauss_legendre(16)
_X, _W = (_X + 1) / 2, _W / 2


def structure_factor(qd: np.ndarray, volume_fraction: float) -> np.ndarray:
    """S(q) of hard spheres in the approximation of Percus and Yevick, float64[...], at q times their diameter."""
    phi, x = volume_fraction, np.asarray(qd, np.float64)
    a = (1 + 2 * phi) ** 2 / (1 - phi) ** 4
    b = -6 * phi * (1 + phi / 2) ** 2 / (1 - phi) ** 4
    c = phi * a / 2
    few = np.minimum(x, _SERIES)[..., None]
    near = ((a + b * _X + c * _X**3) * _X**2 * np.sinc(few * _X / np.pi)) @ _W
    y = np.maximum(x, _SERIES)
    sin, cos = np.sin(y), np.cos(y)
    far = (a * (sin - y * cos) / y**3 + b * (2 * y * sin + (2 - y**2) * cos - 2) / y**4
           + c * (-(y**4) * cos + 4 * ((3 * y**2 - 6) * cos + (y**3 - 6 * y) * sin + 6)) / y**6)  # fmt: skip
    return 1 / (1 + 24 * phi * np.where(x < _SERIES, near, far))


class PercusYevick(_WithAnisotropy):
    """Particles of a dense suspension of hard spheres: a phase function times their structure factor; 3D only.

    The mean free path is another one too: that of independent particles over ``cross_section_ratio``. Of `Mie` spheres
    ``mean_free_path`` and ``albedo`` say what the medium needs.

    Parameters
    ----------
    scatterer
        One particle by itself: any type but a `Mixture` or another `PercusYevick`.
    volume_fraction
        Share of the volume that the hard spheres fill: above 0, at most 0.5. Hard spheres freeze at 0.494.
    diameter
        Of the hard spheres, in the unit of the wavelength: at least that of the particle. Charged particles keep
        apart by more.
    wavelength
        Inside the medium, in the unit of the diameter. Left out beside a `Mie` sphere, which has one; else needed.

    Examples
    --------
    >>> import specklegen as sg
    >>> sphere = sg.media.Mie(radius=0.1725, wavelength=0.685 / 1.332, refractive_index=1.446 / 1.332)  # micrometres
    >>> dense = sg.media.PercusYevick(sphere, 0.135, 0.345)
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=dense.mean_free_path, scatterer=dense)
    >>> round(slab.transport_length)
    127
    """

    type: Literal["PercusYevick"] = "PercusYevick"
    scatterer: AnyScatterer = Field(kw_only=False)
    volume_fraction: Positive = Field(kw_only=False)
    diameter: Annotated[Positive, LENGTH] = Field(kw_only=False)
    wavelength: Annotated[Positive | None, WAVELENGTH] = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        inner: Any = self.scatterer
        if inner.type == self.type or inner.components != ((inner, 1.0),):
            reject("PercusYevick.scatterer", "one type of particle, not a mixture", inner)
        if self.volume_fraction > DENSEST:
            reject("PercusYevick.volume_fraction", f"at most {DENSEST:g}", self.volume_fraction,
                   "Hard spheres freeze at 0.494; the approximation holds for fluids.")  # fmt: skip
        if inner.made_for is not None:
            if self.wavelength is not None:
                reject("PercusYevick.wavelength", "left out for a Mie sphere, which has it already", self.wavelength)
            if self.diameter < 2 * inner.radius * (1 - 1e-9):
                reject("PercusYevick.diameter", f"at least that of the sphere, {2 * inner.radius:g}", self.diameter)
        elif self.wavelength is None:
            reject("PercusYevick.wavelength", "given, unless the scatterer is a Mie sphere", None,
                   "It is the wavelength inside the medium.")  # fmt: skip
        return self

    @with_units
    def structure_factor(self, theta: Annotated[ArrayLike, RADIAN]) -> np.ndarray:
        """Return S at scattering angles, float64[...], radians."""
        q = 4 * np.pi / self.made_for * np.sin(np.asarray(theta, np.float64) / 2)
        return structure_factor(q * self.diameter, self.volume_fraction)

    @property
    def made_for(self) -> float:
        """Its wavelength: that of the sphere, or as given."""
        made_for = self.scatterer.made_for or self.wavelength
        assert made_for is not None, "checked"
        return made_for

    @property
    def number_density(self) -> float:
        """Spheres in a unit of volume, 6 phi / (pi diameter^3)."""
        return 6 * self.volume_fraction / (math.pi * self.diameter**3)

    @cached_property
    def cross_section_ratio(self) -> float:
        """Cross-section of scattering over that of an independent particle: the mean of S over its phase function."""
        highest = (np.abs(each).max() for each in (self.table.amplitudes, self.table.bins(3).amplitude))
        return float(next(highest) / next(highest)) ** 2

    @property
    def mean_free_path(self) -> float:
        """Mean free path of light among `Mie` spheres, absorption included, in the unit of the diameter."""
        return 1 / (self.number_density * sum(self._cross_sections))

    @property
    def albedo(self) -> float:
        """Share of the extinction that is scattered, of `Mie` spheres alone."""
        scattered, absorbed = self._cross_sections
        return scattered / (scattered + absorbed)

    @property
    def _cross_sections(self) -> tuple[float, float]:
        """Scattering and absorption of one sphere in the crowd."""
        sphere: Any = self.scatterer
        if sphere.made_for is None:
            reject("PercusYevick.mean_free_path", "computed for Mie spheres, whose cross-section is known", sphere,
                   "Divide the mean free path of independent particles by cross_section_ratio.")  # fmt: skip
        scattered = sphere.scattering_cross_section
        return scattered * self.cross_section_ratio, max(sphere.extinction_cross_section - scattered, 0.0)

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle, in 3D alone."""
        return self._table(dimensions).mean_cosine(3)

    @cached_property
    def table(self) -> Tabulated:
        """The amplitude of the particle times the root of S, per root steradian."""
        size = 2 * math.pi * self.diameter / self.made_for  # eight nodes to a period of S

        def amplitude(theta: np.ndarray) -> np.ndarray:
            return self.scatterer.exact_amplitude(theta) * np.sqrt(self.structure_factor(theta))

        return tabulated(amplitude, "PercusYevick", 129 + 8 * math.ceil(size))

    def _table(self, dimensions: Dimensions) -> Tabulated:
        if dimensions != 3:
            reject("PercusYevick dimensions", "3: spheres have no structure factor in flatland", dimensions)
        return self.table

    def amplitude_matrix(self, cos: np.ndarray | float) -> np.ndarray:
        """S1 and S2 of the particle times the root of S, complex128[2, ...], per root steradian."""
        share = self.structure_factor(np.arccos(np.clip(cos, -1.0, 1.0))) / self.cross_section_ratio
        return read_only(self.scatterer.amplitude_matrix(cos) * np.sqrt(share))

    @property
    def has_matrix(self) -> bool:
        """True if the amplitudes S1 and S2 of the particle are known."""
        return self.scatterer.has_matrix
