"""Motion of the particles of a medium: laws of their mean square displacement, and flows that carry them along.

Independent particles that are displaced at random by Dr between two times turn the phase of a path by the sum of q_b .
Dr_b over its scatterings, q_b = k (w_b - w_(b-1)), and leave of its amplitude, on average,

    e^(-2 x Y),    Y = sum_b (1 - cos theta_b),    x = k^2 <Dr^2(tau)> / 6 = D k^2 tau

Maret and Wolf, Z. Phys. B 65, 409 (1987); Pine, Weitz, Chaikin, Herbolzheimer, Phys. Rev. Lett. 60, 1134 (1988). <Dr^2>
is that of three components, which share it evenly; in flatland two of them are left, 4 D tau for 6 D tau. A law of
one's own is one method:

    class Subdiffusion(sg.media.Motion):
        amount: float
        power: float

        def mean_square(self, lag):
            return self.amount * lag**self.power

A flow carries particles by V(x) tau, to which there is nothing random. It turns the phase of each path by

    k tau D,    D = sum_b (w_(b-1) - w_b) . V(x_b)

a Doppler shift of its own, which nothing forgets: what decorrelates is that paths have different ones. Of a uniform V
the sum is (i - v) . V, whatever the path: the pattern moves, and that is all. Of the shear V = rate z along x, on the
axis, D = rate M, M the sum of s w_x w_z over all legs (Wu, Pine, Chaikin, Huang, Weitz, J. Opt. Soc. Am. B
7, 15 (1990)). Displacements are small: beside the mean free path, and beside what the flow itself changes over.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from specklegen.core.arguments import positive_number, real_array
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.registered import Registered, member_of
from specklegen.core.registry import Registry
from specklegen.core.units import DIFFUSION, LENGTH, RATE, TIME, UNIT, VELOCITY
from specklegen.core.values import Array, Finite, NonNegative, position_vectors

BOLTZMANN = 1.380649e-23
"""Of the International System, joules per kelvin; exact since 2019."""
FLOW_COLUMNS = 12
"""Numbers of V(x) = V_0 + A x in space: V_0, then A, row after row."""
_ROUNDING = 1e-9  # relative, of eigenvalues: below it a root of a covariance is 0


class Motion(Registered):
    """A law by which particles move, each by itself. Subclass it for a law of your own.

    A subclass is a frozen value with fields of its own and one method, ``mean_square(lag)``. The name of the class is
    its ``type``.

    Examples
    --------
    >>> import specklegen as sg
    >>> class Slowing(sg.media.Motion):
    ...     amount: float
    ...     def mean_square(self, lag):
    ...         return self.amount * lag**0.5
    >>> float(Slowing(amount=2.0).mean_square(4.0))
    4.0
    """

    registry: ClassVar = Registry("motion")
    type: Any = None

    @abstractmethod
    def mean_square(self, lag: ArrayLike) -> np.ndarray:
        """<Dr^2> float64[...] after times of at least 0 float64[...], in the medium's unit of length, squared."""

    def affine(self, dimension: int) -> tuple[np.ndarray, np.ndarray]:
        """V_0 float64[d] and A float64[d, d] of the flow V(x) = V_0 + A x that carries all particles along.

        By default it is 0. In space d = 3, (x, y, z); in flatland 2, (x, z).
        """
        return np.zeros(dimension), np.zeros((dimension, dimension))

    @property
    def dimension(self) -> int | None:
        """2 or 3, where it serves flatland or space alone."""
        return None

    @property
    def carries(self) -> bool:
        """True if it carries particles along."""
        return any(part.any() for part in self.affine(self.dimension or 3))

    def speed_beside(self, other: "Motion") -> float:
        """Ratio of the growth of <Dr^2> to that by another law of the same medium.

        Raises
        ------
        RuleError
            Where that is no number: one film has one law of time.
        """
        if self != other:
            reject("motion", "of one law in the whole medium (the diffusion of Brownian motions may vary)", self,
                   f"Another part has the motion {other!r}.")  # fmt: skip
        return 1.0


class Brownian(Motion):
    """Brownian motion, <Dr^2> = 6 D tau.

    Parameters
    ----------
    diffusion
        D, length^2 per unit of time.

    Examples
    --------
    >>> import specklegen as sg
    >>> fluid = sg.media.Brownian(diffusion=0.857)  # um^2 / s
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9), motion=fluid)
    >>> round(float(slab.motion.mean_square(1e-3)), 6)
    0.005142
    """

    diffusion: Annotated[NonNegative, DIFFUSION]

    @classmethod
    @with_units
    def of_sphere(
        cls, *, radius: Annotated[float, LENGTH], viscosity: float, temperature: float,
        unit: Annotated[float, UNIT] = 1e-6,
    ) -> Self:  # fmt: skip
        """Brownian motion of a sphere in a liquid, D = k_B T / (6 pi eta a) (Einstein 1905; Stokes's drag).

        Parameters
        ----------
        radius
            a, in the scene's unit of length.
        viscosity
            eta of the liquid, Pa s: 1.002e-3 of water at 20 degrees Celsius.
        temperature
            T, kelvin.
        unit
            The scene's unit of length in metres, by default a micrometre. Time is in seconds.

        Examples
        --------
        >>> import specklegen as sg
        >>> round(sg.media.Brownian.of_sphere(radius=0.25, viscosity=1.002e-3, temperature=293.15).diffusion, 3)
        0.857
        """
        given = {"radius": radius, "viscosity": viscosity, "temperature": temperature, "unit": unit}
        radius, viscosity, temperature, unit = (
            np.float64(positive_number(f"Brownian.of_sphere {name}", value)) for name, value in given.items()
        )
        with np.errstate(all="ignore"):
            diffusion = BOLTZMANN * temperature / (6 * math.pi * viscosity * radius * unit) / unit**2
        return cls(diffusion=float(diffusion))

    @with_units
    def mean_square(self, lag: Annotated[ArrayLike, TIME]) -> np.ndarray:
        """6 D tau."""
        return 6 * self.diffusion * real_array("Brownian.mean_square lag", lag)

    def speed_beside(self, other: Motion) -> float:
        """Ratio of the diffusions."""
        if not isinstance(other, Brownian):
            return super().speed_beside(other)
        return self.diffusion / other.diffusion if other.diffusion else 0.0


class Flow(Motion):
    """A steady flow, V(x) = V_0 + A x, and nothing random. Subclass it for a flow of your own.

    A subclass is a frozen value with fields of its own and one method, ``affine(dimension)``: V_0 float64[d], length
    per unit of time, and A float64[d, d], one over a unit of time. A flow that is not linear is made of pieces: layers,
    or voxels of several materials.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> class Turntable(sg.media.Flow):
    ...     per_second: float
    ...     def affine(self, dimension):
    ...         turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    ...         return np.zeros(3), 2 * np.pi * self.per_second * turn
    >>> Turntable(per_second=1.0).carries
    True
    """

    @abstractmethod
    def affine(self, dimension: int) -> tuple[np.ndarray, np.ndarray]:
        """V_0 float64[d] and A float64[d, d] of V(x) = V_0 + A x: d = 3, (x, y, z), or in flatland 2, (x, z)."""

    @with_units
    def mean_square(self, lag: Annotated[ArrayLike, TIME]) -> np.ndarray:
        """0: nothing is random."""
        return 0.0 * real_array(f"{type(self).__name__}.mean_square lag", lag)


class Drift(Flow):
    """One velocity for all particles: a medium, or a piece of one, that moves as a whole.

    Parameters
    ----------
    velocity
        float64[3], or float64[2] in flatland, length per unit of time.

    Examples
    --------
    >>> import specklegen as sg
    >>> blood = sg.media.Drift(velocity=[500.0, 0.0, 0.0])  # um / s
    >>> still = sg.media.Layer(thickness=300.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> sg.Layers(layers=[still, still.replace(motion=blood), still]).moves
    True
    """

    velocity: Annotated[Array, VELOCITY]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if position_vectors("Drift.velocity", self.velocity).ndim != 1:
            reject("Drift.velocity", "one velocity, of length 2 or 3", self.velocity.shape)
        return self

    @property
    def dimension(self) -> int:
        """Number of components of its velocity."""
        return len(self.velocity)

    def affine(self, dimension: int) -> tuple[np.ndarray, np.ndarray]:
        """The velocity, and no gradient."""
        return self.velocity, np.zeros((dimension, dimension))


class Shear(Flow):
    """A flow along x that is faster the deeper it is, V = rate z: a liquid between a plate at rest and one that moves.

    Parameters
    ----------
    rate
        Velocity over depth, one over a unit of time.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(
    ...     thickness=100.0, mean_free_path=10.0, scatterer=sg.media.Isotropic(), motion=sg.media.Shear(rate=20.0)
    ... )
    >>> curve = sg.statistics.temporal_correlation(slab, wavelength=6.283185, lags=[0.0, 2.5e-3], paths=5000)
    >>> curve.intensity.round(1)
    array([1. , 0.2])
    """

    rate: Annotated[Finite, RATE]

    def affine(self, dimension: int) -> tuple[np.ndarray, np.ndarray]:
        """No velocity at the origin, and the gradient of x along z."""
        gradient = np.zeros((dimension, dimension))
        gradient[0, -1] = self.rate
        return np.zeros(dimension), gradient


AnyMotion = Annotated[Motion, *member_of(Motion)]
"""A motion of any type, written with its type."""


def fastest(motions: Sequence[Motion | None]) -> tuple[Motion, np.ndarray] | None:
    """The fastest of a medium's motions, and the speed of each beside it, float64[n], 0 at rest; None where all rest.

    Raise a `RuleError` for laws that differ by more than a factor.
    """
    moving = [motion for motion in motions if motion is not None and not isinstance(motion, Flow)]
    if not moving:
        return None
    most = max(moving, key=lambda motion: motion.speed_beside(moving[0]))
    speeds = np.array([
        0.0 if motion is None or isinstance(motion, Flow) else motion.speed_beside(most) for motion in motions
    ])  # fmt: skip
    return (most, speeds) if speeds.any() else None


def law_of(motions: Sequence[Motion | None]) -> Motion | None:
    """The fastest of a medium's random motions, or, where it has none, a flow; None where all rest."""
    found = fastest(motions)
    if found is not None:
        return found[0]
    return next((motion for motion in motions if motion is not None and motion.carries), None)


def flow_rows(motions: Sequence[Motion | None], dimension: int) -> np.ndarray:
    """V_0 and A of each of a medium's motions in space, float64[n, 12]; float64[0, 12] where nothing flows."""
    rows = np.zeros((len(motions), FLOW_COLUMNS))
    axes = [0, 1, 2] if dimension == 3 else [0, 2]
    for row, motion in zip(rows, motions, strict=True):
        if motion is None or not motion.carries:
            continue
        if motion.dimension not in (None, dimension):
            reject(f"{type(motion).__name__}.velocity", f"of {dimension} components in this medium", motion)
        velocity, gradient = (np.asarray(part, np.float64) for part in motion.affine(dimension))
        fits = velocity.shape == (dimension,) and gradient.shape == (dimension, dimension)
        if not fits or not np.isfinite(velocity).all() or not np.isfinite(gradient).all():
            shapes = f"({dimension},) and ({dimension}, {dimension})"
            reject(f"{type(motion).__name__}.affine", f"finite, of shapes {shapes}", (velocity, gradient))
        row[axes] = velocity
        row[3:].reshape(3, 3)[np.ix_(axes, axes)] = gradient
    return rows if rows.any() else rows[:0]


def reduced_time(owner: str, motion: Motion, wavelength: float, lag: ArrayLike) -> np.ndarray:
    """Return ``x = k^2 <Dr^2(tau)> / 6``, float64[...], of lags float64[...], whose signs do not matter."""
    lag = np.abs(np.asarray(lag, np.float64))
    with np.errstate(over="ignore"):
        x = np.square(2 * np.pi / wavelength) * np.asarray(motion.mean_square(lag), np.float64) / 6
    if x.shape != lag.shape or not np.isfinite(x).all() or (x < 0).any():
        reject(owner, "such that k^2 <Dr^2> is finite and at least 0", lag, f"{motion!r} gives {x} for x.")
    return x


def step_roots(owner: str, motion: Motion, wavelength: float, times: np.ndarray) -> np.ndarray:
    """L float64[T, T - 1], lower triangular: sqrt(2) L n is k times a component of the displacements since the first.

    n are independent standard normals, one a step. L L^T is the covariance of a Gaussian process with stationary steps,
    (x(t) + x(t') - x(t - t')) / 2 with all times since the first; a film with one frame more keeps the rows before.
    """
    since = np.asarray(times, np.float64) - times[:1]
    x = reduced_time(owner, motion, wavelength, since)
    apart = reduced_time(owner, motion, wavelength, since[1:, None] - since[None, 1:])
    covariance = (x[1:, None] + x[None, 1:] - apart) / 2
    root = np.zeros((len(since), max(len(since) - 1, 0)))
    for n in range(len(since) - 1):
        row = root[n + 1]
        for m in range(n):
            if root[m + 1, m] > 0:
                row[m] = (covariance[n, m] - row[:m] @ root[m + 1, :m]) / root[m + 1, m]
        left = covariance[n, n] - row[:n] @ row[:n]
        if left < -_ROUNDING * covariance[n, n]:
            reject(f"{type(motion).__name__}.mean_square", "a stationary random motion", left,
                   "No Gaussian process has it: <Dr^2> may not grow faster than the lag squared.")  # fmt: skip
        row[n] = math.sqrt(left) if left > _ROUNDING * covariance[n, n] else 0.0
    return root
