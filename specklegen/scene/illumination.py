"""Illumination: plane waves, collimated beams, point sources, and incoherent objects made of beams.

Directions are unit vectors of travel; the optical axis is the last one (z).
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from specklegen.core.arguments import real_array
from specklegen.core.errors import reject
from specklegen.core.memory import require_memory
from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH, NUMBER, RADIAN, SINE, TIME
from specklegen.core.values import Array, Positive, Value, position_vectors, read_only, unit_vectors
from specklegen.scene.window import Profile, Window

MOST_SUB_FRAMES = 4096
"""Of one exposure: beyond, its speckle is so smooth that a camera's noise is all there is."""


def _light(field: str, directions: np.ndarray) -> np.ndarray:
    directions = unit_vectors(field, directions)
    if directions.ndim != 2:
        reject(field, "an array of shape (T, 3), or (T, 2) in flatland", directions.shape)
    return directions


def _tilted(field: str, angles: ArrayLike, dimensions: int) -> np.ndarray:
    """Unit vectors of tilts float[T] in the x-z plane or float[T, 2], radians below a right angle."""
    angles = real_array(f"{field} angles", angles)
    if dimensions not in (2, 3):
        reject(f"{field} dimensions", "2 or 3", dimensions)
    if angles.ndim == 1:
        angles = np.stack([angles, np.zeros_like(angles)], axis=-1)
    elif dimensions == 2:
        reject(f"{field} angles", "of shape (T,) in flatland", angles.shape)
    if angles.ndim != 2 or angles.shape[-1] != 2:
        reject(f"{field} angles", "of shape (T,) or (T, 2)", angles.shape)
    if angles.size and not np.abs(angles).max() < np.pi / 2:
        reject(f"{field} angles", "radians between -pi/2 and pi/2", angles, "Use np.deg2rad.")
    directions = directions_of_sines(f"{field} angles", np.sin(angles))
    return directions[:, [0, 2]] if dimensions == 2 else directions


def directions_of_sines(field: str, sines: ArrayLike, sign: float = 1.0) -> np.ndarray:
    """Unit vectors float64[..., 3] from direction sines float64[..., 2] = (x, y); z has the sign given."""
    sines = real_array(field, sines)
    square = np.square(sines).sum(-1)
    if sines.size and not square.max() <= 1:
        reject(field, "direction sines inside the unit circle", float(np.sqrt(square.max())))
    return np.concatenate([sines, sign * np.sqrt(1 - square)[..., None]], axis=-1)


class Light(Value):
    """Interface of every illumination, so that no code asks for its type."""

    limited: ClassVar[bool] = True
    """Whether beams pass a window; otherwise light is unlimited sideways."""
    near: ClassVar[bool] = False
    """Whether lights are points, not directions."""
    focused: ClassVar[bool] = False
    """Whether each light is a sum of collimated beams, the scene's ``beams``, whose fields add."""
    gridded: ClassVar[bool] = False
    """True if these are the plane waves of a grid of pixels, which samplers other than path sums serve too."""

    @property
    def coherent(self) -> bool:
        """True if each light has a field; otherwise intensities of ``beams`` add up to images (``shares``)."""
        return True

    @property
    def vectors(self) -> np.ndarray:
        """float64[n, d], directions of travel or points."""
        return self.points if self.near else self.directions

    @property
    def images(self) -> tuple[int, ...]:
        """Shape of the images of one medium, before that of the sensor."""
        return (len(self.vectors),)

    def of(self, chosen: np.ndarray) -> Self:
        """Copy with only some lights, by their numbers int[n]."""
        return self.replace(**{"points" if self.near else "directions": self.vectors[chosen]})


class PlaneWaves(Light):
    """Plane waves of unit irradiance, unlimited sideways.

    Parameters
    ----------
    directions
        float64[T, 3], or float64[T, 2] in flatland: unit vectors of travel.

    Examples
    --------
    >>> import specklegen as sg
    >>> sg.light.PlaneWaves([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]]).directions.shape
    (2, 3)
    """

    limited: ClassVar[bool] = False
    type: Literal["PlaneWaves"] = "PlaneWaves"
    directions: Annotated[Array, NUMBER] = Field(kw_only=False)

    @model_validator(mode="after")
    def _check(self) -> Self:
        object.__setattr__(self, "directions", _light("PlaneWaves.directions", self.directions))
        return self

    @classmethod
    @with_units
    def tilts(cls, angles: Annotated[ArrayLike, RADIAN], dimensions: int = 3) -> Self:
        """Plane waves tilted from the axis by ``angles`` in radians.

        Parameters
        ----------
        angles
            float[T] tilts in the x-z plane, or float[T, 2] tilts (x, y); the sine of an angle is the direction sine
            along its axis.
        dimensions
            3, or 2 for flatland.
        """
        return cls(directions=_tilted("PlaneWaves.tilts", angles, dimensions))


class CollimatedBeams(Light):
    """Coherent collimated beams, one per tilt, all through one window of the entrance face.

    Parameters
    ----------
    directions
        float64[T, 3], or float64[T, 2] in flatland: unit vectors of travel, towards +z.
    width
        Full side ("square"), diameter ("disc") or 1/e^2 intensity diameter ("gaussian") of the window,
        in the scene's unit of length, measured on the entrance face and centred at x = 0 (and y = 0) for every tilt.
        The entrance face is the medium's face of smallest z.
    profile
        Shape of the window; the peak irradiance is 1 per area *of the face*, at every tilt.
    times
        float64[T], when each beam is on: before a medium that moves (``Slab(motion=)``, ``ScreenStack(velocities=)``),
        a film is beams of one direction at many times. None: all at once.
    exposure
        float64[T], or one number for all: each beam is on from its time for so long, above 0, while the medium moves.
        ``render`` gives mean intensities over it, and no field. None: for an instant.
    sub_frames
        int[T], or one number for all: instants that make up each exposure, at the midpoints of as many parts. None:
        as many as keep K^2, the squared contrast, from being more than the tolerance of a plan too high.

    Examples
    --------
    >>> import specklegen as sg
    >>> beams = sg.light.CollimatedBeams.tilts([0.0, 1e-4, 2e-4], width=1000.0)  # radians from the axis, towards x
    >>> beams.directions.shape
    (3, 3)
    >>> sg.light.CollimatedBeams.tilts([0.0, 0.0], width=1000.0, times=[0.0, 1.0], exposure=[1e-3, 0.1]).exposure
    array([0.001, 0.1  ])
    """

    type: Literal["CollimatedBeams"] = "CollimatedBeams"
    directions: Annotated[Array, NUMBER]
    width: Annotated[Positive, LENGTH]
    profile: Profile = "square"
    times: Annotated[Array, TIME] | None = None
    exposure: Annotated[Array, TIME] | None = None
    sub_frames: Array | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        directions = _light("CollimatedBeams.directions", self.directions)
        if (directions[:, -1] <= 0).any():
            worst = directions[directions[:, -1].argmin()]
            reject("CollimatedBeams.directions", "directions towards +z", worst,
                   "Beams enter through the medium's face of smallest z.")  # fmt: skip
        object.__setattr__(self, "directions", directions)
        if self.times is not None and self.times.shape != (len(directions),):
            reject("CollimatedBeams.times", f"{len(directions)} numbers, one for each beam", self.times.shape)
        if self.exposure is not None:
            if self.times is None:
                reject("CollimatedBeams.exposure", "left out without times", self.exposure,
                       "Give the time: times=[0.0].")
            self._one_each("exposure", self.exposure)
            if not (self.exposure > 0).all():
                reject("CollimatedBeams.exposure", "above 0", self.exposure, "Leave it out for single instants.")
        if self.sub_frames is not None:
            if self.exposure is None:
                reject("CollimatedBeams.sub_frames", "left out without an exposure", self.sub_frames)
            self._one_each("sub_frames", self.sub_frames)
            whole = (self.sub_frames >= 1) & (self.sub_frames <= MOST_SUB_FRAMES) & (self.sub_frames % 1 == 0)
            if not whole.all():
                reject("CollimatedBeams.sub_frames", f"whole numbers from 1 to {MOST_SUB_FRAMES}", self.sub_frames)
        return self

    def _one_each(self, name: str, given: np.ndarray) -> None:
        """Store one number a beam."""
        count = len(self.directions)
        if given.shape not in ((), (count,)):
            reject(f"CollimatedBeams.{name}", f"one number, or {count}, one for each beam", given.shape)
        each = np.broadcast_to(given, count).copy()
        each.flags.writeable = False
        object.__setattr__(self, name, each)

    @property
    def coherent(self) -> bool:
        """True if each beam has a field: not over an exposure."""
        return self.exposure is None

    @property
    def instants(self) -> np.ndarray:
        """int64[T], sub-frames of each beam: 1 where nobody has chosen them."""
        return np.ones(len(self.directions), np.int64) if self.sub_frames is None else self.sub_frames.astype(np.int64)

    @cached_property
    def beams(self) -> CollimatedBeams:
        """The instants that exposures are made of, each a beam at its time, one exposure after the other."""
        if self.exposure is None or self.times is None:
            return self
        count = self.instants
        which, first = np.repeat(np.arange(len(count)), count), np.cumsum(count) - count
        part = (np.arange(len(which)) - first[which] + 0.5) / count[which]
        times = self.times[which] + part * self.exposure[which]
        changes = {"times": times, "exposure": None, "sub_frames": None}
        return self.replace(directions=self.directions[which], **changes)

    @property
    def shares(self) -> np.ndarray:
        """float64[T, n], what each instant of ``beams`` adds to the mean over each exposure."""
        count = self.instants
        return np.repeat(np.eye(len(count)) / count, count, axis=1)

    def of(self, chosen: np.ndarray) -> Self:
        """Copy with only some beams, by their numbers int[n]."""
        each = {name: getattr(self, name) for name in ("times", "exposure", "sub_frames")}
        changes = {name: value[chosen] for name, value in each.items() if value is not None}
        return self.replace(directions=self.directions[chosen], **changes)

    @property
    def window(self) -> Window:
        """Profile and width together, with what follows from them."""
        return Window(self.profile, self.width)

    @classmethod
    @with_units
    def tilts(
        cls, angles: Annotated[ArrayLike, RADIAN], width: Annotated[float, LENGTH], profile: Profile = "square",
        dimensions: int = 3, times: Annotated[ArrayLike, TIME] | None = None,
        exposure: Annotated[ArrayLike, TIME] | None = None,
    ) -> Self:  # fmt: skip
        """Beams tilted from the axis by ``angles`` in radians.

        Parameters
        ----------
        angles
            float[T] tilts in the x-z plane, or float[T, 2] tilts (x, y); the sine of an angle is the
            direction sine along its axis.
        width
            Full side ("square"), diameter ("disc") or 1/e^2 intensity diameter ("gaussian") of the window on the
            entrance face, in the scene's unit of length.
        profile
            Shape of the window.
        times
            float[T], when each beam is on, before a medium that moves; by default all at once.
        exposure
            float[T], or one number for all: how long each is on; by default an instant.
        dimensions
            3, or 2 for flatland.
        """
        directions = _tilted("CollimatedBeams.tilts", angles, dimensions)
        return cls(directions=directions, width=width, profile=profile, times=times, exposure=exposure)


class PointSources(Light):
    """Point sources of unit strength, e^(ikr) / r^((d-1)/2), inside or outside the medium.

    |u|^2 is then relative to the irradiance at unit distance from a source.

    Parameters
    ----------
    points
        float64[T, 3], or float64[T, 2] in flatland: positions.

    Examples
    --------
    >>> import specklegen as sg
    >>> sg.light.PointSources([[0.0, 0.0, -500.0]]).points.shape  # before the medium
    (1, 3)
    """

    limited: ClassVar[bool] = False
    near: ClassVar[bool] = True
    type: Literal["PointSources"] = "PointSources"
    points: Annotated[Array, LENGTH] = Field(kw_only=False)

    @model_validator(mode="after")
    def _check(self) -> Self:
        object.__setattr__(self, "points", position_vectors("PointSources.points", self.points))
        if self.points.ndim != 2:
            reject("PointSources.points", "an array of shape (T, 3), or (T, 2) in flatland", self.points.shape)
        return self


class IncoherentObject(Light):
    """A far object of mutually incoherent pixels: one collimated beam a pixel, intensities added.

    Pixel (row, column) sends its beam at direction sines -(index - centre) * pitch, so that the image
    behind a thin layer appears turned by 180 degrees, as in a laboratory.

    Parameters
    ----------
    brightness
        float64[h, w], irradiance of each pixel's beam at its peak, per area of the entrance face; >= 0.
    pitch
        Direction sine between neighbouring pixels, inside the medium.
    width
        Of the window on the entrance face, in the scene's unit of length: full side ("square"), diameter ("disc") or
        1/e^2 intensity diameter ("gaussian").
    profile
        Its shape; the peak irradiance is 1 per area of the face.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> letter = np.zeros((28, 28))
    >>> letter[6:22, 8:11] = letter[19:22, 8:20] = 1.0  # L
    >>> hidden = sg.light.IncoherentObject(brightness=letter, pitch=1e-5, width=1000.0)
    >>> hidden.directions.shape
    (784, 3)
    """

    type: Literal["IncoherentObject"] = "IncoherentObject"
    brightness: Array
    pitch: Annotated[Positive, SINE]
    width: Annotated[Positive, LENGTH]
    profile: Profile = "square"

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.brightness.ndim != 2 or self.brightness.size == 0:
            reject("IncoherentObject.brightness", "an array of shape (h, w)", self.brightness.shape)
        require_memory("IncoherentObject.brightness", "held", 100.0 * self.brightness.size,
                       f"{self.brightness.shape} pixels",
                       "Each pixel is a separate beam: use fewer pixels.")  # fmt: skip
        if (self.brightness < 0).any():
            reject("IncoherentObject.brightness", "at least 0 everywhere", float(self.brightness.min()))
        require_corner("IncoherentObject", self.brightness.shape, self.pitch)
        return self

    @property
    def window(self) -> Window:
        """Profile and width together, with what follows from them."""
        return Window(self.profile, self.width)

    @property
    def coherent(self) -> bool:
        """Pixels have no field together."""
        return False

    @property
    def images(self) -> tuple[int, ...]:
        """One image, without an axis."""
        return ()

    @property
    def shares(self) -> np.ndarray:
        """float64[1, n], brightness of the pixels that shine."""
        return self.brightness[self.brightness > 0][None]

    @cached_property
    def directions(self) -> np.ndarray:
        """float64[h * w, 3], the beam of each pixel in C order."""
        sines = object_sines("IncoherentObject", self.brightness.shape, self.pitch)
        return read_only(directions_of_sines("IncoherentObject.pitch", sines))

    @cached_property
    def beams(self) -> CollimatedBeams:
        """The beams of the pixels that shine."""
        lit = self.brightness.ravel() > 0
        return CollimatedBeams(directions=self.directions[lit], width=self.width, profile=self.profile)


def require_corner(owner: str, shape: tuple[int, ...], pitch: float) -> None:
    """Refuse an object whose pixels reach beyond the half space."""
    if math.hypot(*((n - 1) / 2 * pitch for n in shape)) >= 1:
        reject(f"{owner}.pitch", "small enough that the object's corner has a sine below 1", pitch)


def object_sines(owner: str, shape: tuple[int, ...], pitch: float, pixels: np.ndarray | None = None) -> np.ndarray:
    """Direction sines float64[n, 2] = (x, y) of some pixels of an object, by their numbers, or of all in C order.

    Raise a `RuleError` if pixels reach beyond the half space, or there are more of them than memory holds.
    """
    require_corner(owner, shape, pitch)
    if pixels is None:
        require_memory(
            owner, "held", 64.0 * math.prod(shape), f"directions of {shape} pixels", "Use an object of fewer pixels."
        )
        pixels = np.arange(math.prod(shape))
    numbers = reversed(np.divmod(pixels, shape[1]))
    return np.stack([-(n - (count - 1) / 2) * pitch for n, count in zip(numbers, reversed(shape), strict=True)], -1)


def reference_direction(directions: np.ndarray) -> np.ndarray:
    """Mean direction float64[3] of a set of beams; the axis where there are none."""
    if len(directions) == 0:
        return np.array([0.0, 0.0, 1.0])
    mean = directions.mean(axis=0)
    return mean / np.linalg.norm(mean)
