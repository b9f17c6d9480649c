"""How the particles of a medium move: laws of their mean square displacement.

Independent particles that are displaced at random by Dr between two times turn the phase of a path by the sum of q_b .
Dr_b over its scatterings, q_b = k (w_b - w_(b-1)), and leave of its amplitude, on average,

    e^(-2 x Y),    Y = sum_b (1 - cos theta_b),    x = k^2 <Dr^2(tau)> / 6 = D k^2 tau

Maret and Wolf, Z. Phys. B 65, 409 (1987); Pine, Weitz, Chaikin, Herbolzheimer, Phys. Rev. Lett. 60, 1134 (1988). <Dr^2>
is that of three components, which share it evenly; in flatland two of them are left, 4 D tau for 6 D tau. A law of
one's own is one method:

    class Subdiffusion(sg.Motion):
        amount: float
        power: float

        def mean_square(self, lag):
            return self.amount * lag**self.power
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import positive_number, real_array
from specklegen.core.errors import reject
from specklegen.core.registered import Registered, member_of
from specklegen.core.registry import Registry
from specklegen.core.values import NonNegative

BOLTZMANN = 1.380649e-23
"""Of the International System, joules per kelvin; exact since 2019."""
_ROUNDING = 1e-9  # relative, of eigenvalues: below it a root of a covariance is 0


def _is_motion(found: Any) -> bool:
    return isinstance(found, type) and issubclass(found, Motion)


class Motion(Registered):
    """A law by which particles move, each by itself. Subclass it for a law of your own.

    A subclass is a frozen value with fields of its own and one method, ``mean_square(lag)``. The name of the class is
    its ``type``.

    Examples
    --------
    >>> import specklegen as sg
    >>> class Slowing(sg.Motion):
    ...     amount: float
    ...     def mean_square(self, lag):
    ...         return self.amount * lag**0.5
    >>> float(Slowing(amount=2.0).mean_square(4.0))
    4.0
    """

    registry: ClassVar = Registry("motion", _is_motion)
    type: Any = None

    @abstractmethod
    def mean_square(self, lag: ArrayLike) -> np.ndarray:
        """<Dr^2> float64[...] after times of at least 0 float64[...], in the medium's unit of length, squared."""

    def speed_beside(self, other: "Motion") -> float:
        """How many times faster <Dr^2> grows than by another law of the same medium.

        Raises
        ------
        RuleError
            Where that is no number: one film has one law of time.
        """
        if self != other:
            reject("motion", "of one law in all of a medium, but for the diffusion of Brownian motions", self,
                   f"Another part moves by {other!r}.")  # fmt: skip
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
    >>> fluid = sg.Brownian(diffusion=0.857)  # um^2 / s
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(0.9), motion=fluid)
    >>> round(float(slab.motion.mean_square(1e-3)), 6)
    0.005142
    """

    diffusion: NonNegative

    @classmethod
    def of_sphere(cls, *, radius: float, viscosity: float, temperature: float, unit: float = 1e-6) -> Self:
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

        Raises
        ------
        RuleError
            For a number that is not above 0.

        Examples
        --------
        >>> import specklegen as sg
        >>> round(sg.Brownian.of_sphere(radius=0.25, viscosity=1.002e-3, temperature=293.15).diffusion, 3)
        0.857
        """
        given = {"radius": radius, "viscosity": viscosity, "temperature": temperature, "unit": unit}
        radius, viscosity, temperature, unit = (
            np.float64(positive_number(f"Brownian.of_sphere {name}", value)) for name, value in given.items()
        )
        with np.errstate(all="ignore"):
            diffusion = BOLTZMANN * temperature / (6 * math.pi * viscosity * radius * unit) / unit**2
        return cls(diffusion=float(diffusion))

    def mean_square(self, lag: ArrayLike) -> np.ndarray:
        """6 D tau."""
        return 6 * self.diffusion * real_array("Brownian.mean_square lag", lag)

    def speed_beside(self, other: Motion) -> float:
        """Ratio of the diffusions."""
        if not isinstance(other, Brownian):
            return super().speed_beside(other)
        return self.diffusion / other.diffusion if other.diffusion else 0.0


AnyMotion = Annotated[Motion, *member_of(Motion)]
"""A motion of any type, written with its type."""


def fastest(motions: Sequence[Motion | None]) -> tuple[Motion, np.ndarray] | None:
    """The fastest of a medium's motions, and the speed of each beside it, float64[n], 0 at rest; None where all rest.

    Raises
    ------
    RuleError
        For laws that differ by more than a factor.
    """
    moving = [motion for motion in motions if motion is not None]
    if not moving:
        return None
    most = max(moving, key=lambda motion: motion.speed_beside(moving[0]))
    speeds = np.array([0.0 if motion is None else motion.speed_beside(most) for motion in motions])
    return (most, speeds) if speeds.any() else None


def reduced_time(owner: str, motion: Motion, wavelength: float, lag: ArrayLike) -> np.ndarray:
    """X = k^2 <Dr^2(tau)> / 6, float64[...], of lags float64[...], whose signs do not matter.

    Raises
    ------
    RuleError
        Where it is not finite, or below 0.
    """
    lag = np.abs(np.asarray(lag, np.float64))
    with np.errstate(over="ignore"):
        x = np.square(2 * np.pi / wavelength) * np.asarray(motion.mean_square(lag), np.float64) / 6
    if x.shape != lag.shape or not np.isfinite(x).all() or (x < 0).any():
        reject(owner, "such that k^2 <Dr^2> is finite and at least 0", lag, f"{motion!r} gives {x} for x.")
    return x


def step_roots(owner: str, motion: Motion, wavelength: float, times: np.ndarray) -> np.ndarray:
    """L float64[T, T - 1], lower triangular: sqrt(2) L n is k times a component of the displacements since the first.

    n are independent standard normals, one a step. L L^T is the covariance of a Gaussian process with stationary steps,
    (x(t) + x(t') - x(t - t')) / 2 with all times since the first, and a film with one frame more keeps the rows before.

    Raises
    ------
    RuleError
        If no such process moves by this law.
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
            reject(f"{type(motion).__name__}.mean_square", "that of random steps which depend on their lag alone", left,
                   "No Gaussian process moves so: <Dr^2> may not grow faster than the lag squared.")  # fmt: skip
        row[n] = math.sqrt(left) if left > _ROUNDING * covariance[n, n] else 0.0
    return root
