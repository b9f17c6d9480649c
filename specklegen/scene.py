"""The scene: what is simulated, in one frozen value."""

from typing import Self

import numpy as np
from pydantic import model_validator

from specklegen.illumination import CollimatedBeams, Illumination, IncoherentObject, PlaneWaves
from specklegen.media import Medium
from specklegen.sensors import Sensor
from specklegen.values import Positive, Value, reject


class Scene(Value):
    """A medium, its illumination and a sensor. Every length is in one unit, which the wavelength fixes.

    Parameters
    ----------
    wavelength
        Inside the medium.
    medium, illumination, sensor
        See :class:`Slab`, :class:`CollimatedBeams`, :class:`IncoherentObject`, :class:`FarField`.
    """

    wavelength: Positive
    medium: Medium
    illumination: Illumination
    sensor: Sensor

    @model_validator(mode="after")
    def _finite_power(self) -> Self:
        if isinstance(self.illumination, PlaneWaves):
            reject(
                "Scene.illumination",
                "limited sideways, for a slab seen from the far field",
                "PlaneWaves",
                "An unlimited wave on an infinite slab scatters infinite power: use CollimatedBeams with a width.",
            )
        return self

    @property
    def wavenumber(self) -> float:
        """K = 2 pi / wavelength, radians per unit length."""
        return 2 * np.pi / self.wavelength

    @property
    def beams(self) -> CollimatedBeams:
        """The coherent beams that carry light: the illumination's own, or those of an object's lit pixels."""
        if isinstance(self.illumination, IncoherentObject):
            return self.illumination.beams
        assert isinstance(self.illumination, CollimatedBeams)
        return self.illumination

    @property
    def speckle_size(self) -> float:
        """Direction sine over which far-field speckle changes: wavelength / window width."""
        return self.wavelength / self.beams.width
