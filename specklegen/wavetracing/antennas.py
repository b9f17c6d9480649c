"""Impulse responses: what an antenna receives of another by each path, with the patterns of both.

A pattern is a function of directions of travel away from the antenna, float64[N, 3]. It returns the amplitudes of the
field along theta and phi of spherical coordinates about the z axis, complex128[N, 2]; |amplitude|^2 is the gain. A path
(`RayPath.vectors`, v_theta and v_phi) and the two patterns g and G make

    E = g_theta v_theta + g_phi v_phi,   h = G_theta e_theta.E + G_phi e_phi.E.

G and its unit vectors belong to the direction in which the receiver looks, against the path's arrival. So emitter and
receiver may change places.

Received power is ``|h|^2 wavelength^2 / 4 pi``. Source: C. A. Balanis, *Antenna Theory*, sections 2.12 to 2.17.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.arguments import several
from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.core.labelled import Labelled, Labels
from specklegen.core.units import RADIAN
from specklegen.core.values import Array, ComplexArray, Value
from specklegen.wavetracing.ray_paths import RayPath, spherical

AntennaPattern = Callable[[np.ndarray], np.ndarray]
"""Amplitudes along theta and phi, complex128[N, 2], of directions float64[N, 3]."""


class AntennaTable(Value):
    """A measured pattern, linear between its angles.

    Attributes
    ----------
    theta : float64[T]
        Angles from the z axis, radians, rising from 0 to pi.
    phi : float64[P]
        Angles from the x axis, radians, rising, within 2 pi; the table goes on periodically.
    values : complex128[T, P, 2]
        Amplitudes along theta and phi.

    Raises
    ------
    RuleError
        For angles that do not rise, or values that are not one pair for each of them.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.wavetracing import AntennaTable
    >>> theta, phi = np.linspace(0, np.pi, 19), np.arange(4) * np.pi / 2
    >>> sine = np.sin(theta)[:, None, None] * np.ones((1, 4, 1))  # a short vertical wire
    >>> wire = AntennaTable(theta=theta, phi=phi, values=np.concatenate([np.sqrt(1.5) * sine, 0 * sine], axis=2))
    >>> wire(np.array([[1.0, 0.0, 0.0]])).round(3)
    array([[1.225+0.j, 0.   +0.j]])
    """

    theta: Annotated[Array, RADIAN]
    phi: Annotated[Array, RADIAN]
    values: ComplexArray

    @model_validator(mode="after")
    def _check(self) -> Self:
        theta, phi = self.theta, self.phi
        ends = theta[[0, -1]] - [0, np.pi] if theta.ndim == 1 and len(theta) > 1 else np.inf
        if (np.abs(ends) > 1e-9).any() or (np.diff(theta) <= 0).any():
            reject("AntennaTable.theta", "rising from 0 to pi (radians)", theta)
        if phi.ndim != 1 or not len(phi) or (np.diff(phi) <= 0).any() or phi[-1] - phi[0] >= 2 * np.pi:
            reject("AntennaTable.phi", "rising, within less than 2 pi (radians)", phi)
        if self.values.shape != (len(theta), len(phi), 2):
            reject("AntennaTable.values", f"of shape ({len(theta)}, {len(phi)}, 2)", self.values.shape)
        return self

    def __call__(self, directions: np.ndarray) -> np.ndarray:
        """Amplitudes complex128[N, 2] along theta and phi, of unit vectors float64[N, 3]."""
        theta = np.arccos(np.clip(directions[:, 2], -1, 1))
        row = np.clip(np.searchsorted(self.theta, theta, side="right") - 1, 0, len(self.theta) - 2)
        down = ((theta - self.theta[row]) / (self.theta[row + 1] - self.theta[row]))[:, None]
        along = np.append(self.phi, self.phi[0] + 2 * np.pi)
        phi = (np.arctan2(directions[:, 1], directions[:, 0]) - along[0]) % (2 * np.pi) + along[0]
        left = np.clip(np.searchsorted(along, phi, side="right") - 1, 0, len(self.phi) - 1)
        across = ((phi - along[left]) / (along[left + 1] - along[left]))[:, None]
        right = (left + 1) % len(self.phi)
        upper, lower = (
            (1 - across) * self.values[r, left] + across * self.values[r, right] for r in (row, row + 1)
        )  # fmt: skip
        return (1 - down) * upper + down * lower


@dataclass(frozen=True, eq=False)
class ImpulseResponse(Labelled):
    """Paths between two antennas, the shortest first.

    Attributes
    ----------
    delays : float64[N]
        Seconds, for lengths in metres and light in vacuum.
    amplitudes : complex128[N]
        h of each path, roots of a power flux, with the phase of its length; their sum is that of the wave.
    departures, arrivals : float64[N, 3]
        Unit vectors of travel at the emitter and at the receiver.

    Examples
    --------
    >>> from specklegen.wavetracing import Conductor, Geometry, PointEmitter, perforated_screen
    >>> from specklegen.wavetracing import coherent_paths, impulse_response
    >>> ground = Geometry([perforated_screen([[-90, -90], [90, -90], [90, 90], [-90, 90]], material=Conductor())])
    >>> lamp = PointEmitter(position=[-12, 0, 9], wavelength=0.3)
    >>> response = impulse_response(coherent_paths(ground, lamp, [12.0, 0, 9], diffractions=0))
    >>> (response.delays * 1e9).round(2)
    array([ 80.06, 100.07])
    """

    delays: np.ndarray
    amplitudes: np.ndarray
    departures: np.ndarray
    arrivals: np.ndarray

    __repr__ = short

    def _arrays(self) -> Mapping[str, Labels]:
        angles = {
            f"{end}_{name}": Labels(("path",), values, "rad", True)
            for end, ways in (("departure", self.departures), ("arrival", self.arrivals))
            for name, values in zip(("theta", "phi"), _angles(ways), strict=True)
        }
        return {
            "delay": Labels(("path",), self.delays, "s", True), **angles,
            "amplitude": Labels(("path",), self.amplitudes),
        }  # fmt: skip


def impulse_response(
    paths: Sequence[RayPath], emitter: AntennaPattern | None = None, receiver: AntennaPattern | None = None
) -> ImpulseResponse:
    """Return the impulse response of two antennas from the paths between them.

    Parameters
    ----------
    paths
        Of `coherent_paths`; none where it is dark.
    emitter, receiver
        Patterns: functions of unit vectors float64[N, 3] away from the antenna that return amplitudes along theta and
        phi, complex128[N, 2], or an `AntennaTable`. By default 1 along theta in all directions.

    Raises
    ------
    RuleError
        For something other than paths, or a pattern that does not return one pair a direction.

    Examples
    --------
    >>> from specklegen.wavetracing import Conductor, Geometry, PointEmitter, perforated_screen
    >>> from specklegen.wavetracing import coherent_paths, impulse_response
    >>> ground = Geometry([perforated_screen([[-90, -90], [90, -90], [90, 90], [-90, 90]], material=Conductor())])
    >>> lamp = PointEmitter(position=[-12, 0, 9], wavelength=0.3)
    >>> paths = coherent_paths(ground, lamp, [12.0, 0, 9], diffractions=0)
    >>> abs(impulse_response(paths).amplitudes).round(4)  # sqrt(1 / 4 pi) over 24 and 30 m
    array([0.0118, 0.0094])
    """
    none = isinstance(paths, Sequence) and not len(paths)  # in the dark
    found = () if none else several("impulse_response paths", paths, RayPath)
    departures, arrivals = (
        np.reshape([getattr(path, name) for path in found], (-1, 3)) for name in ("departure", "arrival")
    )
    sent, taken = _amplitudes("emitter", emitter, departures), _amplitudes("receiver", receiver, -arrivals)
    vectors = np.reshape([path.vectors for path in found], (-1, 2, 3))
    looks = np.reshape([spherical(-way) for way in arrivals], (-1, 2, 3))
    amplitudes = np.einsum("ni,nic,njc,nj->n", sent, vectors, looks, taken)
    return ImpulseResponse(np.array([path.delay for path in found]), amplitudes, departures, arrivals)


def _amplitudes(name: str, pattern: AntennaPattern | None, directions: np.ndarray) -> np.ndarray:
    if pattern is not None and not callable(pattern):
        reject(f"impulse_response {name}", "a function of directions, or an AntennaTable", pattern)
    if pattern is None or not len(directions):
        return np.tile([1.0 + 0j, 0.0], (len(directions), 1))
    values = np.asarray(pattern(directions), complex)
    if values.shape != (len(directions), 2) or not np.isfinite(values).all():
        reject(f"impulse_response {name}", "a pattern of finite amplitudes, one pair (theta, phi) a direction",
               values.shape)  # fmt: skip
    return values


def _angles(ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.arccos(np.clip(ways[:, 2], -1, 1)), np.arctan2(ways[:, 1], ways[:, 0])
