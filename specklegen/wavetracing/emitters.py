"""Sources of beams."""

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.units import LENGTH, RADIAN, WAVELENGTH
from specklegen.core.values import Array, Positive, Value, unit_vectors
from specklegen.wavetracing.beams import GaussianBeam
from specklegen.wavetracing.kernels.beam_sources import COLLIMATED, LASER, POINT


def _across(wavelength: float, size: float) -> float:
    """9 / (2 k size): the tangent of a beam of this half-width, or the half-width of one of this tangent."""
    return 9 * wavelength / (4 * np.pi * size)


def _packed(emitter: "Emitter", kind: int, lower: np.ndarray, upper: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Numbers of an emitter for kernels, float64[SOURCE]."""
    return np.concatenate([[kind], lower, upper, direction, [emitter.beam_radius, emitter.tangent]])


class _AtOnePlace(Value):
    """Common part of emitters whose light comes from one place."""

    position: Annotated[Array, LENGTH]

    @property
    def origin(self) -> np.ndarray:
        """Its place, float64[3]; of a laser, the middle of its waist."""
        return self.position

    @property
    def coherence(self) -> float:
        """Infinite: such light is coherent with itself anywhere."""
        return np.inf


class CollimatedEmitter(Value):
    """Parallel light over a rectangle, as an ensemble of Gaussian beams of evenly spread centres.

    The ensemble is a Gaussian Schell-model source of coherence width ``sigma_g = sqrt(2 Sigma) = 2 beam_radius / 3``:
    two points d apart have the degree of coherence ``exp(-d^2 / 4 Sigma)``. A wide beam is coherent light, a narrow one
    is not.

    Attributes
    ----------
    lower, upper : float64[3]
        Two opposite corners of a rectangle across one coordinate axis, along which they agree.
    direction : float64[3]
        Unit vector of travel, not in the rectangle's plane.
    beam_radius : float
        Half-width a of a beam's envelope, three standard deviations of its intensity: Sigma = 2 (a / 3)^2.
    wavelength : float
    power : float
        Of the whole rectangle.

    Raises
    ------
    RuleError
        For corners that do not span a rectangle, a direction within it, or a beam that is not paraxial.

    Examples
    --------
    >>> from specklegen.wavetracing import CollimatedEmitter
    >>> light = CollimatedEmitter([-6, -8, -10], [6, 8, -10], [0, 0, 1], beam_radius=30.0, wavelength=1.0)
    >>> light.power
    1.0
    """

    lower: Annotated[Array, LENGTH]
    upper: Annotated[Array, LENGTH]
    direction: Array
    beam_radius: Annotated[Positive, LENGTH]
    wavelength: Annotated[Positive, WAVELENGTH]
    power: Positive = 1.0

    def __init__(self, lower, upper, direction, beam_radius, wavelength, power=1.0):
        super().__init__(
            lower=lower, upper=upper, direction=direction, beam_radius=beam_radius, wavelength=wavelength, power=power
        )

    @model_validator(mode="after")
    def _checked(self) -> Self:
        for name in ("lower", "upper", "direction"):
            if getattr(self, name).shape != (3,):
                reject(f"CollimatedEmitter.{name}", "float64[3]", getattr(self, name).shape)
        unit_vectors("CollimatedEmitter.direction", self.direction)
        size = self.upper - self.lower
        if (size < 0).any() or (size > 0).sum() != 2:
            reject("CollimatedEmitter.upper", "above lower along two axes, and equal to it along the third", self.upper)
        if abs(self.direction[size.argmin()]) < 1e-9:
            reject("CollimatedEmitter.direction", "out of the rectangle's plane", self.direction)
        if self.tangent >= 1:
            reject("CollimatedEmitter.beam_radius", "above 0.72 wavelengths", self.beam_radius)
        return self

    @property
    def sigma(self) -> float:
        """Transverse parameter Sigma of each beam (an area)."""
        return 2 * (self.beam_radius / 3) ** 2

    @property
    def tangent(self) -> float:
        """Tangent 9 / (2 k a) of the half opening angle of each beam."""
        return _across(self.wavelength, self.beam_radius)

    @property
    def origin(self) -> np.ndarray:
        """Middle of the rectangle, float64[3]."""
        return (self.lower + self.upper) / 2

    @property
    def coherence(self) -> float:
        """Coherence width ``sigma_g = sqrt(2 Sigma)``: the degree of coherence is ``exp(-d^2 / 2 sigma_g^2)``."""
        return float(np.sqrt(2 * self.sigma))

    def lights(self, points: np.ndarray) -> np.ndarray:
        """Return whether points float64[P, 3] lie in the light, before anything stands in it: bool[P]."""
        axis = int((self.upper - self.lower).argmin())
        back = (points[:, axis] - self.lower[axis]) / self.direction[axis]
        foot, across = points - back[:, None] * self.direction, np.arange(3) != axis
        return (back >= 0) & ((foot >= self.lower) & (foot <= self.upper))[:, across].all(axis=1)

    def packed(self) -> np.ndarray:
        """Return what kernels know, float64[SOURCE]."""
        return _packed(self, COLLIMATED, self.lower, self.upper, self.direction)


class PointEmitter(_AtOnePlace):
    """A point that radiates evenly in all directions, as beams of mean directions spread evenly.

    Attributes
    ----------
    position : float64[3]
    wavelength : float
    power : float
        Into the whole sphere.
    beam_angle : float
        Half opening angle of a beam's envelope, radians, below pi / 4; the half-width is 9 / (2 k tan(beam_angle)).

    Examples
    --------
    >>> from specklegen.wavetracing import PointEmitter
    >>> lamp = PointEmitter(position=[0, 0, -10], wavelength=1.0)
    >>> round(lamp.beam_radius, 1)
    35.8
    """

    wavelength: Annotated[Positive, WAVELENGTH]
    power: Positive = 1.0
    beam_angle: Annotated[float, RADIAN] = Field(0.02, gt=0, lt=np.pi / 4, allow_inf_nan=False)

    def __init__(self, position, wavelength, power=1.0, beam_angle=0.02):
        super().__init__(position=position, wavelength=wavelength, power=power, beam_angle=beam_angle)

    @model_validator(mode="after")
    def _checked(self) -> Self:
        if self.position.shape != (3,):
            reject("PointEmitter.position", "a point float64[3]", self.position.shape)
        return self

    @property
    def tangent(self) -> float:
        """Tangent of the beam angle."""
        return float(np.tan(self.beam_angle))

    def field(self, points: np.ndarray) -> np.ndarray:
        """Field complex128[...] at float64[..., 3] in free space: |u|^2 is the power flux, ``P / 4 pi r^2``."""
        r = np.linalg.norm(np.asarray(points, float) - self.position, axis=-1)
        return np.sqrt(self.power / (4 * np.pi)) * np.exp(2j * np.pi / self.wavelength * r) / r

    @property
    def beam_radius(self) -> float:
        """Half-width a of a beam at the source."""
        return _across(self.wavelength, self.tangent)

    def lights(self, points: np.ndarray) -> np.ndarray:
        """Return whether points float64[P, 3] lie in the light, before anything stands in it: all, bool[P]."""
        return np.ones(len(points), bool)

    def packed(self) -> np.ndarray:
        """Return what kernels know, float64[SOURCE]."""
        return _packed(self, POINT, self.position, self.position, np.zeros(3))


class GaussianLaser(_AtOnePlace):
    """A laser: one coherent Gaussian beam, from its waist on.

    Attributes
    ----------
    position : float64[3]
        Middle of the waist.
    direction : float64[3]
        Unit vector of travel.
    waist : float
        Radius at which the intensity is e^-2 of that on the axis; Sigma = waist^2 / 2.
    wavelength : float
    power : float

    Raises
    ------
    RuleError
        For a direction that is no unit vector, or a waist of 0.48 wavelengths and less, which is not paraxial.

    Examples
    --------
    >>> from specklegen.wavetracing import GaussianLaser
    >>> laser = GaussianLaser(position=[0, 0, -10], direction=[0, 0, 1], waist=50.0, wavelength=0.5)
    >>> round(float(abs(laser.field([[0.0, 0.0, -10.0]])[0]) ** 2 * 3.141592653589793 * 50**2 / 2), 6)  # of its power 1
    1.0
    """

    direction: Array
    waist: Annotated[Positive, LENGTH]
    wavelength: Annotated[Positive, WAVELENGTH]
    power: Positive = 1.0

    def __init__(self, position, direction, waist, wavelength, power=1.0):
        super().__init__(position=position, direction=direction, waist=waist, wavelength=wavelength, power=power)

    @model_validator(mode="after")
    def _checked(self) -> Self:
        for name in ("position", "direction"):
            if getattr(self, name).shape != (3,):
                reject(f"GaussianLaser.{name}", "float64[3]", getattr(self, name).shape)
        object.__setattr__(self, "direction", unit_vectors("GaussianLaser.direction", self.direction))
        if self.tangent >= 1:
            reject("GaussianLaser.waist", "above 0.48 wavelengths", self.waist)
        return self

    @property
    def beam_radius(self) -> float:
        """Half-width a of its envelope at the waist, three standard deviations of the intensity."""
        return 1.5 * self.waist

    @property
    def tangent(self) -> float:
        """Tangent 9 / (2 k a) of the half opening angle of the envelope."""
        return _across(self.wavelength, self.beam_radius)

    def lights(self, points: np.ndarray) -> np.ndarray:
        """Return whether points float64[P, 3] lie in even light: none, bool[P]."""
        return np.zeros(len(points), bool)

    def field(self, points: np.ndarray) -> np.ndarray:
        """Field complex128[...] at float64[..., 3] in free space, near the axis; |u|^2 is power per area."""
        beam = GaussianBeam(self.position, self.direction, self.waist**2 / 2 * np.eye(2), self.wavelength)
        return np.sqrt(self.power) * beam.field(points)

    def packed(self) -> np.ndarray:
        """Return what kernels know, float64[SOURCE]."""
        return _packed(self, LASER, self.position, self.position, self.direction)


Emitter = CollimatedEmitter | PointEmitter | GaussianLaser
