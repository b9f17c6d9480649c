"""Tabulated amplitudes: s given at some angles, linear between them."""

import math
from collections.abc import Callable
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.arguments import real_array
from specklegen.core.errors import reject
from specklegen.core.quadrature import gauss_legendre
from specklegen.core.quantities import with_units
from specklegen.core.units import RADIAN
from specklegen.core.values import Array, ComplexArray, remembered
from specklegen.scene.scatterers.scatterer import Dimensions, Row, _WithAnisotropy

WIDEST_BIN = math.pi / 16  # radians: what kernels.phase_table integrates to rounding
ACCURACY = 1e-4  # of a table made of a function, half-way between two nodes, relative to |s| there
NARROWEST = 1e-7  # radians; where an amplitude jumps no bin is narrow enough
_MOST_NODES = 2**18

# Gauss-Legendre on (0, 1), to rounding for a quadratic times sin theta cos theta over a bin of WIDEST_BIN.
_X, _W = gauss_legendre(8)
_X, _W = (_X + 1) / 2, _W / 2


class Bins(NamedTuple):
    """A normalised table: angles float64[n], s complex128[n], integrals over the n - 1 bins between them.

    ``power`` is the integral of |s|^2, which sums to 1; ``cosine`` that of |s|^2 cos theta.
    """

    theta: np.ndarray
    amplitude: np.ndarray
    power: np.ndarray
    cosine: np.ndarray


class Tabulated(_WithAnisotropy):
    """A particle whose amplitude is known at some angles: complex, linear in theta between them.

    The integral of |s|^2 over all directions is made 1 in the dimension asked for, so only the shape and the
    phase of the table matter.

    Parameters
    ----------
    theta
        float64[n], scattering angles in radians, rising from 0 to pi (both within 1e-9).
    amplitude
        complex128[n], s at these angles, in any unit; read back as ``amplitudes``.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> theta = np.linspace(0.0, np.pi, 181)
    >>> measured = sg.media.Tabulated(theta=theta, amplitude=np.exp(-theta))
    >>> round(measured.g, 3)
    0.623
    """

    type: Literal["Tabulated"] = "Tabulated"
    theta: Annotated[Array, RADIAN]
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
            reject("Tabulated.theta", "strictly rising", theta[at : at + 2], "Sort the angles and remove duplicates.")
        if theta[0] > 1e-9 or abs(theta[-1] - math.pi) > 1e-9:
            reject("Tabulated.theta", "angles from 0 to pi (radians)", theta[[0, -1]],
                   "Convert degrees with np.deg2rad, and give the amplitude at both ends.")  # fmt: skip
        if not s.any():
            reject("Tabulated.amplitude", "other than 0 somewhere", s)
        return self

    @classmethod
    @with_units
    def from_power(cls, theta: Annotated[np.ndarray, RADIAN], power: np.ndarray) -> Self:
        """Make a particle of a phase function given at some angles: s is its root, so linear is the root.

        Parameters
        ----------
        theta
            Angles of scattering, radians, float64[n], from 0 to pi, rising.
        power
            Phase function there, float64[n], at least 0, in any unit.
        """
        density = real_array("Tabulated.from_power power", power)
        if not (np.isfinite(density) & (density >= 0)).all():
            reject("Tabulated.from_power power", "densities of at least 0, finite", density)
        return cls(theta=theta, amplitude=np.sqrt(density))

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle, in 3D or in flatland."""
        return math.fsum(self.bins(dimensions).cosine)

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> np.ndarray:
        """Complex amplitude s, per root steradian (root radian in 2D), at the cosine of the scattering angle."""
        bins = self.bins(dimensions)
        return np.interp(np.arccos(np.clip(real_array("amplitude cos", cos), -1.0, 1.0)), bins.theta, bins.amplitude)

    def bins(self, dimensions: Dimensions) -> Bins:
        """Return the table normalised, its wide bins cut so that quadrature over each is exact to rounding."""
        return _bins(self, dimensions)

    def row(self, dimensions: Dimensions) -> Row:
        """Return what the kernels read: bins of theta."""
        bins = self.bins(dimensions)
        below = np.cumsum(np.append(0.0, bins.power))
        return Row("tabulated", (0.0, 0.0), bins.theta, bins.amplitude, below / below[-1])


def tabulated(shape: Callable[[np.ndarray], np.ndarray], owner: str, first: int = 129) -> Tabulated:
    """Make a table of an amplitude that is a function of theta, with nodes as close as ``ACCURACY`` asks for.

    Parameters
    ----------
    shape
        Maps angles float64[n] to amplitudes, real or complex, up to a factor.
    owner
        Who asks, for the message of an error.
    first
        Nodes to begin with; bins whose middle is not on the straight line between their ends are then halved.

    Raises
    ------
    RuleError
        If the function does not return one finite number an angle, or is too rough for a quarter of a million nodes.
    """

    def at(theta: np.ndarray) -> np.ndarray:
        s = np.asarray(shape(theta))
        if s.shape != theta.shape:
            reject(f"{owner} amplitude", f"of the shape of the cosines, {theta.shape}", s.shape)
        if not np.isfinite(s).all():
            reject(f"{owner} amplitude", "finite at every angle", s)
        return s.astype(np.complex128)

    theta = np.linspace(0.0, math.pi, first)
    # A narrow forward lobe may hide within the first bin.
    theta = np.unique(np.concatenate([theta, np.geomspace(1e-6, theta[1], 33)]))
    s = at(theta)
    nodes, values = [theta], [s]
    left, right, below, above = theta[:-1], theta[1:], s[:-1], s[1:]
    while left.size:
        middle = (left + right) / 2
        exact = at(middle)
        bent = np.abs((below + above) / 2 - exact) > ACCURACY * np.maximum(np.abs(below), np.abs(above))
        bent &= right - left > NARROWEST
        left, middle, right, below, exact, above = (a[bent] for a in (left, middle, right, below, exact, above))
        nodes.append(middle)
        values.append(exact)
        if sum(map(len, nodes)) > _MOST_NODES:
            reject(f"{owner} amplitude", "smooth enough for a table",
                   f"an amplitude that needs over {_MOST_NODES} nodes")
        left, right = np.append(left, middle), np.append(middle, right)
        below, above = np.append(below, exact), np.append(exact, above)
    theta, place = np.unique(np.concatenate(nodes), return_index=True)
    return Tabulated(theta=theta, amplitude=np.concatenate(values)[place])


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
