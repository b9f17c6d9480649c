"""Mie scattering by a homogeneous sphere, for unpolarised light, by miepython (extra ``mie``).

The engine is scalar, a sphere is not: it scatters the two polarisations with amplitudes S1 and S2. Here
|s|^2 is the phase function of unpolarised light, (|S1|^2 + |S2|^2)/2, normalised, and the phase of s is that
of i (S1 + S2)/2, the amplitude that forward scattering has for either polarisation: S_1, S_2 in the convention
of Bohren and Huffman (*Absorption and Scattering of Light by Small Particles*, 1983, Eq. 4.74, outgoing wave
e^(ikr)/(-ikr)), so that a small dielectric sphere has s > 0 forward.
"""

import math
from functools import cached_property
from types import ModuleType
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import field_validator

from specklegen.core.arguments import real_array
from specklegen.core.errors import reject
from specklegen.core.units import LENGTH, WAVELENGTH
from specklegen.core.values import ComplexNumber, Positive, read_only
from specklegen.scene.scatterers.scatterer import Dimensions, Row, _WithAnisotropy
from specklegen.scene.scatterers.tabulated import Tabulated, tabulated


class Efficiencies(NamedTuple):
    """Cross-sections over the geometric one, and the mean cosine."""

    extinction: float
    scattering: float
    mean_cosine: float


class Mie(_WithAnisotropy):
    """A sphere, homogeneous, in unpolarised light; three dimensions only.

    An absorbing sphere is allowed. What it absorbs is not part of s: give the medium the sphere's ``albedo``.

    Parameters
    ----------
    radius
        Of the sphere, in the unit of the wavelength.
    wavelength
        Inside the medium, around the sphere: the wavelength of the scene.
    refractive_index
        Of the sphere over that of the medium, n + i kappa; kappa >= 0 absorbs.

    Examples
    --------
    >>> import specklegen as sg
    >>> bead = sg.media.Mie(radius=0.5, wavelength=0.633 / 1.33, refractive_index=1.59 / 1.33)  # micrometres
    >>> round(bead.g, 2)
    0.92
    """

    type: Literal["Mie"] = "Mie"
    radius: Annotated[Positive, LENGTH]
    wavelength: Annotated[Positive, WAVELENGTH]
    refractive_index: ComplexNumber

    @field_validator("refractive_index")
    @classmethod
    def _passive(cls, index: complex) -> complex:
        if index.real <= 0:
            reject("Mie.refractive_index", "of a real part greater than 0", index)
        if index.imag < 0:
            reject("Mie.refractive_index", "of an imaginary part of at least 0 (absorption)", index,
                   "Fields go as e^(+ikr) here: n + i kappa absorbs.")  # fmt: skip
        if index == 1:
            reject("Mie.refractive_index", "other than 1: such a sphere scatters nothing", index)
        return index

    @property
    def size_parameter(self) -> float:
        """Circumference over wavelength, 2 pi radius / wavelength."""
        return 2 * math.pi * self.radius / self.wavelength

    @cached_property
    def efficiencies(self) -> Efficiencies:
        """Cross-sections over pi radius^2, and g."""
        extinction, scattering, _, g = _miepython().efficiencies_mx(self.refractive_index, self.size_parameter)
        return Efficiencies(float(extinction), float(scattering), float(g))

    @property
    def scattering_cross_section(self) -> float:
        """Scattered power per unit irradiance, an area; its number density times it is sigma_s."""
        return self.efficiencies.scattering * math.pi * self.radius**2

    @property
    def extinction_cross_section(self) -> float:
        """Scattered and absorbed power per unit irradiance, an area; its number density times it is sigma_t."""
        return self.efficiencies.extinction * math.pi * self.radius**2

    @property
    def albedo(self) -> float:
        """Share of the extinction that is scattered, for the albedo of a medium of these spheres."""
        return min(1.0, self.efficiencies.scattering / self.efficiencies.extinction)

    @property
    def g(self) -> float:
        """Anisotropy: mean cosine of the scattering angle, from the Mie series."""
        return self.efficiencies.mean_cosine

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle, from the Mie series; in 3D alone."""
        _refuse_flatland(dimensions)
        return self.g

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> np.ndarray:
        """Complex amplitude s, per root steradian, at the cosine of the scattering angle: the table that is traced."""
        _refuse_flatland(dimensions)
        return self.table.amplitude(cos)

    def row(self, dimensions: Dimensions) -> Row:
        """Return what the kernels read: the table's bins of theta."""
        _refuse_flatland(dimensions)
        return self.table.row(dimensions)

    @cached_property
    def table(self) -> Tabulated:
        """The amplitude, linear in theta between nodes that lie as close as the accuracy of tables asks for.

        Where S1 + S2 passes through 0 the phase jumps, and no bin is narrow enough.
        """
        # Eight nodes to the period of the fastest term, 2 pi / x.
        return tabulated(self.exact_amplitude, "Mie", 33 + 4 * math.ceil(self.size_parameter))

    @property
    def made_for(self) -> float:
        """Its wavelength."""
        return self.wavelength

    def exact_amplitude(self, theta: np.ndarray) -> np.ndarray:
        """Complex amplitude s, per root steradian, at the scattering angle, from the Mie series itself."""
        # Exactly backward S1 + S2 is 0 and would have the phase of its rounding: stay a hair's breadth away.
        s1, s2 = self._series(np.cos(np.minimum(theta, math.pi - 1e-3 / (1 + self.size_parameter))))
        power = (np.abs(s1) ** 2 + np.abs(s2) ** 2) / (4 * math.pi * self._strength)
        return np.sqrt(power) * np.exp(1j * np.angle(1j * (s1 + s2)))

    def amplitude_matrix(self, cos: np.ndarray | float) -> np.ndarray:
        """Return i S_1 and i S_2, complex128[2, ...], per root steradian, at cosines of the scattering angle."""
        cos = real_array("amplitude_matrix cos", cos)
        return 1j / math.sqrt(2 * math.pi * self._strength) * np.stack(self._series(cos))

    def _series(self, cos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """S_1 and S_2 at cosines of the scattering angle: Bohren and Huffman, Eq. 4.74."""
        s1, s2 = np.zeros(cos.shape, np.complex128), np.zeros(cos.shape, np.complex128)
        before, now = np.zeros_like(cos), np.ones_like(cos)  # pi_(n-1), pi_n: Bohren and Huffman, Eqs. 4.47, 4.74
        for n, (a, b) in enumerate(self.coefficients.T, start=1):
            tau = n * cos * now - (n + 1) * before
            share = (2 * n + 1) / (n * (n + 1))
            s1 += share * (a * now + b * tau)
            s2 += share * (a * tau + b * now)
            before, now = now, ((2 * n + 1) * cos * now - (n + 1) * before) / n
        return s1, s2

    @cached_property
    def coefficients(self) -> np.ndarray:
        """a_n and b_n, complex128[2, N]: Bohren and Huffman, Eqs. 4.56 and 4.57."""
        return read_only(np.array(_miepython().coefficients(self.refractive_index, self.size_parameter)))

    @cached_property
    def _strength(self) -> float:
        """Sum of ``(2n + 1)(|a_n|^2 + |b_n|^2)``: ``x^2/2`` of the scattering efficiency."""
        order = np.arange(1, self.coefficients.shape[1] + 1)
        return float(((2 * order + 1) * np.abs(self.coefficients) ** 2).sum())


def _refuse_flatland(dimensions: Dimensions) -> None:
    if dimensions != 3:
        reject("Mie dimensions", "3: a sphere has no scattering in flatland", dimensions, "Use Tabulated in 2D.")


def _miepython() -> ModuleType:
    try:
        import miepython  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ImportError('Mie needs miepython: pip install "specklegen-torch[mie]"') from None
    return miepython
