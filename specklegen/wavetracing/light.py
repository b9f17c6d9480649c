"""Light that falls on a screen in the plane z = 0, from z < 0: its field, time e^{-i omega t}."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, Protocol, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.arguments import finite_numbers
from specklegen.core.errors import reject
from specklegen.core.units import WAVELENGTH
from specklegen.core.values import Array, ComplexArray, ComplexNumber, Positive, Value, unit_vectors
from specklegen.wavetracing.beams import GaussianBeam
from specklegen.wavetracing.emitters import GaussianLaser, PointEmitter
from specklegen.wavetracing.meshes import proper_rotation
from specklegen.wavetracing.plane import Plane


class Light(Protocol):
    """Light on openings: anything with a wavelength and a field.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.wavetracing import Light, Plane, field_on_plane
    >>> class Tilted:
    ...     wavelength = 1.0
    ...     def field(self, points):
    ...         return np.exp(2j * np.pi * points @ np.array([0.1, 0.0, np.sqrt(0.99)]))
    >>> light: Light = Tilted()
    >>> field_on_plane(None, light, Plane(center=[0, 0, 1], shape=(8, 8), pitch=0.5)).values.shape
    (8, 8)
    """

    @property
    def wavelength(self) -> float:
        """Wavelength in the medium around the screen, in the unit of all lengths."""
        ...

    def field(self, points: np.ndarray) -> np.ndarray:
        """Field complex128[...] at float64[..., 3] without any screen."""
        ...


class PlaneWave(Value):
    """A plane wave A e^{ik d.x}.

    Parameters
    ----------
    wavelength
        In the medium around the screen, in the unit of all lengths.
    direction
        float64[3], unit vector of travel, towards +z.
    amplitude
        A, the field at the origin.

    Examples
    --------
    >>> from specklegen.wavetracing import PlaneWave
    >>> PlaneWave(wavelength=1.0).field([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5]]).round(6)
    array([ 1.+0.j, -1.+0.j])
    """

    type: Literal["PlaneWave"] = "PlaneWave"
    wavelength: Annotated[Positive, WAVELENGTH]
    direction: Array = np.array([0.0, 0.0, 1.0])
    amplitude: ComplexNumber = 1.0 + 0.0j

    @model_validator(mode="after")
    def _check(self) -> Self:
        direction = unit_vectors("PlaneWave.direction", np.asarray(self.direction))
        if direction.shape != (3,) or not direction[2] > 0:
            reject("PlaneWave.direction", "one unit vector float64[3] that travels towards +z", direction)
        object.__setattr__(self, "direction", direction)
        return self

    @property
    def wavenumber(self) -> float:
        """K = 2 pi / wavelength, radians per unit length."""
        return 2 * np.pi / self.wavelength

    @property
    def normal(self) -> bool:
        """True if it travels along z exactly."""
        return bool(self.direction[0] == 0 and self.direction[1] == 0)

    def field(self, points: np.ndarray) -> np.ndarray:
        """Field complex128[...] at float64[..., 3]."""
        return self.amplitude * np.exp(1j * self.wavenumber * (np.asarray(points, float) @ self.direction))


class WaveSum(Value):
    """Plane waves that interfere: light that leaves a slab, or comes from a source of many directions.

    Parameters
    ----------
    directions
        float64[m, 3], unit vectors of travel.
    amplitudes
        complex128[m], field of each at the origin.
    wavelength
        In the medium around, in the unit of all lengths.

    Examples
    --------
    >>> from specklegen.wavetracing import WaveSum
    >>> two = WaveSum(directions=[[0.6, 0, 0.8], [-0.6, 0, 0.8]], amplitudes=[1.0, 1.0], wavelength=1.0)
    >>> abs(two.field([[0.0, 0.0, 3.0]])).round(6)
    array([2.])
    """

    type: Literal["WaveSum"] = "WaveSum"
    directions: Array
    amplitudes: ComplexArray
    wavelength: Annotated[Positive, WAVELENGTH]

    @model_validator(mode="after")
    def _check(self) -> Self:
        directions = unit_vectors("WaveSum.directions", self.directions)
        if directions.ndim != 2 or directions.shape[1] != 3 or not len(directions):
            reject("WaveSum.directions", "float64[m, 3], one at least", directions.shape)
        if self.amplitudes.shape != directions.shape[:1]:
            reject("WaveSum.amplitudes", f"one for each of {len(directions)} directions", self.amplitudes.shape)
        object.__setattr__(self, "directions", directions)
        return self

    def field(self, points: np.ndarray) -> np.ndarray:
        """Field complex128[...] at float64[..., 3]."""
        points = np.asarray(points, float)
        flat, k = points.reshape(-1, 3), 2 * np.pi / self.wavelength
        step = max(1, 2**21 // len(self.amplitudes))
        parts = [
            np.exp(1j * k * (flat[n : n + step] @ self.directions.T)) @ self.amplitudes
            for n in range(0, len(flat), step)
        ]
        return np.concatenate(parts or [np.empty(0, complex)]).reshape(points.shape[:-1])


@dataclass(frozen=True)
class _Turned:
    """Any light, in the frame of a screen at ``shift`` with the axes ``turn``."""

    light: Light
    shift: np.ndarray
    turn: np.ndarray

    @property
    def wavelength(self) -> float:
        return self.light.wavelength

    def field(self, points: np.ndarray) -> np.ndarray:
        return self.light.field(np.asarray(points, float) @ self.turn.T + self.shift)


def seen_from(
    name: str, light: Light, plane: Plane, shift: Sequence[float] | None, rotation: np.ndarray | None
) -> tuple[Light, Plane]:
    """Light and a plane in the frame of a screen that was turned, then moved."""
    move = np.zeros(3) if shift is None else finite_numbers(f"{name} shift", shift)
    if move.shape != (3,) or np.iscomplexobj(move):
        reject(f"{name} shift", "float64[3]", shift)
    turn = proper_rotation(f"{name} rotation", np.eye(3) if rotation is None else rotation)
    plane = plane.replace(center=(plane.center - move) @ turn, normal=plane.normal @ turn, up=plane.up @ turn)
    if isinstance(light, PlaneWave | GaussianBeam | GaussianLaser):
        direction = light.direction @ turn
        if not direction[2] > 0:
            reject(f"{name} rotation", "a screen that the light meets from behind, at z < 0 of its frame", direction,
                   "Turn the screen so that its normal points the way the light travels.")  # fmt: skip
        if isinstance(light, PlaneWave):
            return light.replace(direction=direction, amplitude=complex(light.field(move))), plane
    if isinstance(light, PointEmitter):
        return light.replace(position=(light.position - move) @ turn), plane
    return _Turned(light, move, turn), plane
