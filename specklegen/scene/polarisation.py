"""Polarisation of light at the particles of a medium."""

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.arguments import real_number
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.units import RADIAN
from specklegen.core.values import ComplexArray, Value
from specklegen.scene.faces import Faces
from specklegen.scene.motion import Motion
from specklegen.scene.scatterers import Scatterer

Polarisation = Literal["scalar", "projector", "vector"]
"""Not at all; by the projector of Rayleigh and Gans, S2 = cos(theta) S1; by the particles' own S1 and S2."""


class Polarisers(Value):
    """Polarised light before a medium, and an analyser behind it.

    Parameters
    ----------
    light, analyser
        Fields complex128[2] along x and y, of the light and of what the analyser passes, as they are seen against z; of
        any length above 0. They are turned with light and view the shortest way from the axis.

    Examples
    --------
    >>> import specklegen as sg
    >>> sg.light.Polarisers.crossed().analyser
    array([0.+0.j, 1.+0.j])
    >>> quarter_wave = [[1, 0], [0, 1j]]
    >>> sg.light.Polarisers.parallel(angle=0.7853981633974483).behind(quarter_wave).light.round(3)
    array([0.707+0.j   , 0.   +0.707j])
    """

    light: ComplexArray = Field(default_factory=lambda: np.array([1.0 + 0j, 0.0]), validate_default=True)
    analyser: ComplexArray = Field(default_factory=lambda: np.array([1.0 + 0j, 0.0]), validate_default=True)

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name in ("light", "analyser"):
            field = getattr(self, name)
            if field.shape != (2,) or not 1e-100 < np.abs(field).max() < 1e100:
                reject(f"Polarisers.{name}", "two numbers, not both 0: fields along x and y", field)
        return self

    @classmethod
    @with_units
    def parallel(cls, angle: Annotated[float, RADIAN] = 0.0) -> Self:
        """Light polarised at an angle (radians) from x, and an analyser along it."""
        turned = real_number("Polarisers.parallel angle", angle)
        field = np.array([np.cos(turned), np.sin(turned)])
        return cls(light=field, analyser=field)

    @classmethod
    @with_units
    def crossed(cls, angle: Annotated[float, RADIAN] = 0.0) -> Self:
        """Copy with an analyser across the light."""
        turned = real_number("Polarisers.crossed angle", angle)
        cosine, sine = float(np.cos(turned)), float(np.sin(turned))
        return cls(light=[cosine, sine], analyser=[-sine, cosine])

    @classmethod
    def circular(cls, flipped: bool = False) -> Self:
        """Circular light, and an analyser of circular light, that of the same field or of the other."""
        return cls(light=[1, 1j], analyser=[1, -1j if flipped else 1j])

    def behind(self, plate: Any) -> Self:
        """Return the same with a wave plate, of the Jones matrix complex[2, 2], before the medium."""
        matrix = np.asarray(plate)
        if matrix.shape != (2, 2):
            reject("Polarisers.behind plate", "a Jones matrix [2, 2]", plate)
        return self.replace(light=matrix @ self.light)

    @property
    def fields(self) -> tuple[np.ndarray, np.ndarray]:
        """Light and analyser complex128[2] of length 1."""
        return self.light / np.linalg.norm(self.light), self.analyser / np.linalg.norm(self.analyser)

    @property
    def straight(self) -> complex:
        """Amplitude that the analyser passes of light that keeps its polarisation."""
        light, analyser = self.fields
        return complex(np.vdot(analyser, light))


def require_polarised(
    owner: str, polarisation: Polarisation, scatterer: Scatterer, faces: Faces, motion: Motion | None = None
) -> None:
    """Refuse particles without amplitudes S1 and S2 where these are asked for, walls whose echoes mix, and flows."""
    if polarisation == "scalar":
        return
    if faces.wall not in (None, faces.inside):
        reject(f"{owner}.faces", "without a wall, since light is polarised", faces,
               "Reflections in a wall are added as powers, without polarisation: leave the wall out.")  # fmt: skip
    if motion is not None and motion.carries:
        reject(f"{owner}.motion", "random, since light is polarised", motion,
               "Flows are modelled for scalar light only: use Brownian(diffusion=...), or leave out "
               "polarisation.")  # fmt: skip
    if polarisation == "vector" and not scatterer.has_matrix:
        reject(f"{owner}.polarisation", f'"scalar" or "projector" of {scatterer.type} particles', polarisation,
               "Only Mie, Rayleigh and classes with amplitude_matrix, of one type, have S1 and S2.")  # fmt: skip


def require_scalar(field: str, medium: Any) -> None:
    """Refuse a medium that polarises light, where nothing is known of it."""
    polarisation = getattr(medium, "polarisation", "scalar")
    if polarisation != "scalar":
        reject(field, 'of polarisation = "scalar" for this function', polarisation,
               "Polarised light is supported by memory_effect, temporal_correlation, mueller_matrix "
               "and scenes.")  # fmt: skip
