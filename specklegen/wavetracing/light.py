"""Light that falls on a screen in the plane z = 0, from z < 0: its field, time e^{-i omega t}."""

from typing import Literal, Protocol, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.values import Array, ComplexNumber, Positive, Value, unit_vectors


class Light(Protocol):
    """What openings are lit by: anything with a wavelength and a field.

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
        In the medium around the screen.
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
    wavelength: Positive
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
        """Whether it travels along z exactly."""
        return bool(self.direction[0] == 0 and self.direction[1] == 0)

    def field(self, points: np.ndarray) -> np.ndarray:
        """Field complex128[...] at float64[..., 3]."""
        return self.amplitude * np.exp(1j * self.wavenumber * (np.asarray(points, float) @ self.direction))
