"""Tabulated amplitudes: s given at some angles, linear between them."""

import math
from typing import Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.values import Array, ComplexArray, Value, remembered
from specklegen.scene.scatterers.closed_form import Dimensions

WIDEST_BIN = math.pi / 16  # radians: what kernels.phase_table integrates to rounding

# Gauss-Legendre on (0, 1), to rounding for a quadratic times sin theta cos theta over a bin of WIDEST_BIN.
_X, _W = np.polynomial.legendre.leggauss(8)
_X, _W = (_X + 1) / 2, _W / 2


class Bins(NamedTuple):
    """A normalised table: angles float64[n], s complex128[n], integrals over the n - 1 bins between them.

    ``power`` is the integral of |s|^2, which sums to 1; ``cosine`` that of |s|^2 cos theta.
    """

    theta: np.ndarray
    amplitude: np.ndarray
    power: np.ndarray
    cosine: np.ndarray


class Tabulated(Value):
    """A particle whose amplitude is known at some angles: complex, linear in theta between them.

    The integral of |s|^2 over all directions is made 1 in the dimension asked for, so only the shape and the
    phase of the table matter.

    Parameters
    ----------
    theta
        float64[n], scattering angles in radians, rising from 0 to pi (both within 1e-9).
    amplitude
        complex128[n], s at these angles, in any unit; read back as ``amplitudes``.
    """

    type: Literal["Tabulated"] = "Tabulated"
    theta: Array
    amplitudes: ComplexArray = Field(alias="amplitude")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        theta, s = self.theta, self.amplitudes
        if theta.ndim != 1 or theta.size < 2:
            reject("Tabulated.theta", "a list of at least two angles", theta)
        if s.shape != theta.shape:
            reject("Tabulated.amplitude", f"of the shape of theta, {theta.shape}", s.shape)
        if theta[0] < 0:
            reject("Tabulated.theta", "at least 0", theta[0], "The amplitude is even in theta: give one side.")
        if (np.diff(theta) <= 0).any():
            at = int(np.argmax(np.diff(theta) <= 0))
            reject("Tabulated.theta", "strictly rising", theta[at : at + 2], "Sort the angles and drop doubles.")
        if theta[0] > 1e-9 or abs(theta[-1] - math.pi) > 1e-9:
            reject(
                "Tabulated.theta", "angles from 0 to pi (radians)", theta[[0, -1]],
                "Convert degrees with np.deg2rad, and give the amplitude at both ends.",
            )  # fmt: skip
        if not s.any():
            reject("Tabulated.amplitude", "other than 0 somewhere", s)
        return self

    @classmethod
    def from_power(cls, theta: np.ndarray, power: np.ndarray) -> Self:
        """Make a particle of a phase function given at some angles: s is its root, so linear is the root.

        Raises
        ------
        RuleError
            If a density is negative or not finite, or the angles break the rules of the class.
        """
        density = np.asarray(power, dtype=np.float64)
        if not (np.isfinite(density) & (density >= 0)).all():
            reject("Tabulated.from_power power", "densities of at least 0, finite", density)
        return cls(theta=theta, amplitude=np.sqrt(density))

    @property
    def g(self) -> float:
        """Anisotropy: mean cosine of the scattering angle in 3D."""
        return self.mean_cosine(3)

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle, in 3D or in flatland."""
        return math.fsum(self.bins(dimensions).cosine)

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> np.ndarray:
        """Complex amplitude s, per root steradian (root radian in 2D), at the cosine of the scattering angle."""
        bins = self.bins(dimensions)
        return np.interp(np.arccos(np.clip(cos, -1.0, 1.0)), bins.theta, bins.amplitude)

    def bins(self, dimensions: Dimensions) -> Bins:
        """Return the table normalised, its wide bins cut so that quadrature over each is exact to rounding."""
        return _bins(self, dimensions)


@remembered(32)
def _bins(table: Tabulated, dimensions: Dimensions) -> Bins:
    if dimensions not in (2, 3):
        reject("Tabulated dimensions", "2 or 3", dimensions)
    ends = np.array([0.0, *table.theta[1:-1], math.pi])
    pieces = np.ceil(np.diff(ends) / WIDEST_BIN).astype(int)
    piece = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    theta = np.append(np.repeat(ends[:-1], pieces) + piece * np.repeat(np.diff(ends) / pieces, pieces), math.pi)
    s = np.interp(theta, ends, table.amplitudes / np.abs(table.amplitudes).max())

    width = np.diff(theta)[:, None]
    at = theta[:-1, None] + width * _X
    power = np.abs(s[:-1, None] * (1 - _X) + s[1:, None] * _X) ** 2 * width * _W
    power *= 2 * math.pi * np.sin(at) if dimensions == 3 else 2.0  # flatland: both sides
    total = math.fsum(power.sum(axis=1))
    bins = Bins(theta, s / math.sqrt(total), power.sum(axis=1) / total, (power * np.cos(at)).sum(axis=1) / total)
    for array in bins:
        array.flags.writeable = False
    return bins
