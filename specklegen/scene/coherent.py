"""Coherent objects before a medium: what a spatial light modulator or a transparency shows, lit by a laser.

    E(x) = sum over n of a_n / sqrt(cos_n) e^(ik [s_n . x + d (cos_n - 1)]),     s_n = n wavelength / W

d the distance from the object to the entrance face, over e^(ikd), and W the side of a square window of whole pixels.
Without distance, beam profile or lens, E at the centre of each pixel is the value of that pixel: the field between them
is the trigonometric one, which holds the sines up to wavelength / (2 pitch) and no diffraction orders beyond. Goodman,
*Introduction to Fourier Optics* (4th edition), section 3.10.
"""

import math
from functools import cached_property
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject, warn_user
from specklegen.core.memory import require_memory
from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH, SINE, TIME, WAVELENGTH
from specklegen.core.values import Array, ComplexArray, Finite, NonNegative, Positive, read_only
from specklegen.scene.illumination import CollimatedBeams, Light, directions_of_sines
from specklegen.scene.window import Profile

_MARGIN = 0.5  # of the object's side, that its window has more
_NONE = 1e-12  # of the largest amplitude: plane waves that are not there
_WAVE_BYTES = 400  # of one plane wave, with what is made of it


class CoherentObject(Light):
    """Coherent objects, one or several before one medium: the fields of their plane waves add.

    |field| = 1 is unit irradiance, as of a :class:`~specklegen.light.CollimatedBeams`. The object is dark beside its
    pixels.

    Parameters
    ----------
    field
        complex128[h, w] or [T, h, w], amplitude transmission of the pixels, rows along y and columns along x, each from
        the smallest; phases as e^(+ikx). The image behind a medium is not turned.
    pitch
        Length of a pixel, in the plane of the object; at least half a wavelength.
    distance
        From the object to the entrance face of the medium, as a length inside the medium: before faces n_inside /
        n_outside times the distance outside. 0: in the front plane.
    waist
        1/e^2 radius of the irradiance of a Gaussian beam on the object. None: a plane wave of irradiance 1.
    focus
        Distance behind the object at which the illuminating beam converges, as a length inside the medium; negative: it
        diverges from there. None: it does neither.
    aperture
        Largest direction sine inside the medium that a lens or a 4f relay between object and medium lets through. None:
        all sines of the pixels.
    times
        float64[T], when each object is shown, before a slab that moves (``Slab(motion=)``); of one object alone, the
        times of its film. None: all at once.
    width
        Side of the square window on the entrance face, in whole pixels (rounded). None: one and a half times the
        object, and what light spreads over the distance.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> letter = np.zeros((12, 12))
    >>> letter[2:10, 3] = letter[9, 3:9] = 1.0  # L
    >>> shown = sg.light.CoherentObject(letter, pitch=20.0)  # micrometres
    >>> tissue = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> scene = sg.Scene(wavelength=0.5, medium=tissue, illumination=shown,
    ...                  sensor=sg.sensors.FarField.grid((32, 32), 6e-4))
    >>> sg.render(scene, paths=10_000, seed=0).field.shape
    (1, 32, 32)
    """

    focused: ClassVar[bool] = True
    gridded: ClassVar[bool] = True
    profile: ClassVar[Profile] = "square"
    type: Literal["CoherentObject"] = "CoherentObject"
    field: ComplexArray = Field(kw_only=False)
    pitch: Annotated[Positive, LENGTH] = Field(kw_only=False)
    distance: Annotated[NonNegative, LENGTH] = Field(default=0.0, kw_only=False)
    waist: Annotated[Positive, LENGTH] | None = None
    focus: Annotated[Finite, LENGTH] | None = None
    aperture: Annotated[float, Field(gt=0, lt=1), SINE] | None = None
    width: Annotated[Positive, LENGTH] | None = None
    times: Annotated[Array, TIME] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.field.ndim not in (2, 3) or self.field.size == 0:
            reject("CoherentObject.field", "an array of shape (h, w) or (T, h, w)", self.field.shape)
        if self.focus == 0:
            reject("CoherentObject.focus", "other than 0", self.focus, "The beam would converge onto one point of it.")
        if self.times is not None and self.times.shape != (len(self.fields),):
            reject("CoherentObject.times", f"{len(self.fields)} numbers, one an object", self.times.shape)
        side = max(self.fields.shape[1:]) * self.pitch
        if self.width is not None and self.width < side * (1 - 1e-9):
            reject("CoherentObject.width", f"at least the side of the object, {side:.4g}", self.width,
                   "Widen the illuminated area, or use fewer or smaller pixels.")  # fmt: skip
        if self.waist is not None:
            dark = np.hypot(*self._axes()) > self.waist
            if (np.abs(self.fields)[:, dark] > 0).any():
                reject("CoherentObject.waist", "large enough that the beam illuminates all pixels that transmit",
                       self.waist,
                       "Beyond the 1/e^2 radius of the irradiance the object is dark: widen the beam, or make "
                       "the object "
                       "smaller.")  # fmt: skip
        return self

    @cached_property
    def fields(self) -> np.ndarray:
        """complex128[T, h, w], all objects; of one alone, as often as there are times."""
        fields = self.field if self.field.ndim == 3 else self.field[None]
        frames = 1 if self.times is None or self.times.ndim != 1 else len(self.times)
        return fields if len(fields) > 1 else np.broadcast_to(fields, (frames, *fields.shape[1:]))

    @property
    def vectors(self) -> np.ndarray:
        """float64[T, 3], the optical axis for each object."""
        return np.tile([0.0, 0.0, 1.0], (len(self.fields), 1))

    def of(self, chosen: np.ndarray) -> Self:
        """Return some of the objects, by their numbers int[n]."""
        times = None if self.times is None else self.times[chosen]
        return self.replace(field=self.fields[chosen], times=times)

    def _axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres of the pixels, x float64[1, w] and y float64[h, 1]."""
        h, w = self.fields.shape[1:]
        return (np.arange(w) - (w - 1) / 2)[None] * self.pitch, (np.arange(h) - (h - 1) / 2)[:, None] * self.pitch

    @with_units
    def sine(self, wavelength: Annotated[float, WAVELENGTH]) -> float:
        """Largest direction sine of the light along one axis."""
        largest = wavelength / (2 * self.pitch)
        return largest if self.aperture is None else min(largest, self.aperture)

    @with_units
    def pixels(self, wavelength: Annotated[float, WAVELENGTH]) -> int:
        """Pixels along a side of the window."""
        if self.width is not None:
            return round(self.width / self.pitch)
        sine, side = min(self.sine(wavelength), 0.99), max(self.fields.shape[1:])
        spread = 2 * self.distance * sine / math.sqrt(1 - sine**2) / self.pitch
        return min(math.ceil((1 + _MARGIN) * side + spread), 2**31)

    @with_units
    def side(self, wavelength: Annotated[float, WAVELENGTH]) -> float:
        """Side W of the window."""
        return self.pixels(wavelength) * self.pitch

    @with_units
    def require_focus(self, wavelength: Annotated[float, WAVELENGTH], largest_sine: float) -> None:
        """Refuse pixels finer than half a wavelength, beams that they do not sample, and more waves than memory holds.

        A lens that does not resolve a pixel is warned of.
        """
        if self.pitch < wavelength / 2:
            reject("CoherentObject.pitch", f"at least half a wavelength, {wavelength / 2:.4g}", self.pitch,
                   "Finer pixels send evanescent waves only. Check units: the wavelength is the one inside the "
                   "medium.")  # fmt: skip
        if self.aperture is not None and not self.aperture < largest_sine:
            reject("CoherentObject.aperture", f"below {largest_sine:.4g}", self.aperture,
                   "Light of larger sines does not enter the medium.")  # fmt: skip
        if self.aperture is not None and self.aperture < wavelength / (2 * self.pitch):
            warn_user(
                f"CoherentObject.aperture: a lens of aperture {self.aperture:.3g} does not resolve pixels of "
                f"{self.pitch:.4g}, which need {wavelength / (2 * self.pitch):.3g}. The object is blurred"
            )
        if self.focus is not None:
            farthest = (max(self.fields.shape[1:]) - 1) / 2 * self.pitch
            if farthest * self.pitch / abs(self.focus) > wavelength / 2:
                least = 2 * farthest * self.pitch / wavelength
                reject("CoherentObject.focus", f"at least {least:.4g} away", self.focus,
                       "At a shorter distance the phase of the beam changes by more than pi from "
                       "pixel to pixel.")  # fmt: skip
        across = float(self.pixels(wavelength))
        require_memory(
            "CoherentObject.width", "held", (_WAVE_BYTES + 32.0 * len(self.fields)) * across**2,
            f"{across:.3g} plane waves across", "Use a narrower window, a shorter distance, or larger pixels.",
        )  # fmt: skip

    @with_units
    def spectrum(self, wavelength: Annotated[float, WAVELENGTH]) -> tuple[np.ndarray, np.ndarray]:
        """All plane waves on the entrance face: sines float64[M] along one axis, amplitudes complex128[T, M, M].

        Amplitudes are a_n, rows along y. They are 0 beyond the aperture and where waves are evanescent.
        """
        count, k = self.pixels(wavelength), 2 * np.pi / wavelength
        sines = (np.arange(count) - count // 2) * (wavelength / (count * self.pitch))
        x, y = self._axes()
        lit = self.fields.astype(complex)
        radius = np.square(x) + np.square(y)
        if self.waist is not None:
            lit = lit * np.exp(-radius / self.waist**2)
        if self.focus is not None:
            lit = lit * np.exp(-0.5j * k * radius / self.focus)
        waves = [np.exp(-1j * k * sines[:, None] * axis.ravel()) / count for axis in (y, x)]
        amplitudes = waves[0] @ lit @ waves[1].T
        square = np.square(sines) + np.square(sines)[:, None]
        passed = square < (1.0 if self.aperture is None else self.aperture**2 * (1 + 1e-12))
        cosines = np.sqrt(np.where(passed, 1 - square, 1.0))
        carried = np.sqrt(cosines) * np.exp(-1j * k * self.distance * square / (1 + cosines))
        amplitudes = np.where(passed, amplitudes * carried, 0)
        weak = np.abs(amplitudes) <= _NONE * np.abs(amplitudes).max(axis=(1, 2), keepdims=True)
        return sines, np.where(weak, 0, amplitudes)

    def _waves(self, wavelength: float) -> tuple[np.ndarray, np.ndarray]:
        """Sines float64[N, 2] of the plane waves that some object has, and their amplitudes complex128[T, N]."""
        sines, amplitudes = self.spectrum(wavelength)
        there = (amplitudes != 0).any(axis=0)
        if not there.any():
            there[len(sines) // 2, len(sines) // 2] = True  # of a dark object
        rows, columns = np.nonzero(there)
        return np.stack([sines[columns], sines[rows]], axis=-1), amplitudes[:, rows, columns]

    @with_units
    def modes(self, wavelength: Annotated[float, WAVELENGTH]) -> CollimatedBeams:
        """The N collimated beams that every object is a sum of; with times, as many for each of them."""
        sines, _ = self._waves(wavelength)
        directions, times = directions_of_sines("CoherentObject", sines), self.times
        if times is not None:
            directions, times = np.tile(directions, (len(times), 1)), np.repeat(times, len(directions))
        return CollimatedBeams(
            directions=read_only(directions), width=self.side(wavelength), profile=self.profile, times=times
        )

    @with_units
    def amplitudes(self, wavelength: Annotated[float, WAVELENGTH]) -> np.ndarray:
        """complex128[T, N], those of the beams in every object; with times [T, T N], 0 at those of others."""
        own = self._waves(wavelength)[1]
        return own if self.times is None else (np.eye(len(own))[..., None] * own).reshape(len(own), -1)

    @with_units
    def outermost(self, wavelength: Annotated[float, WAVELENGTH]) -> CollimatedBeams:
        """The beam along the axis and those of the largest sines along both axes, by which samplers are judged."""
        sines, amplitudes = self.spectrum(wavelength)
        there = (amplitudes != 0).any(axis=0)
        rows, columns = (np.abs(sines[there.any(axis=axis)]).max(initial=0.0) for axis in (1, 0))
        sine = np.array([columns, rows])
        if self.aperture is not None and np.hypot(*sine) > self.aperture:
            sine *= self.aperture / np.hypot(*sine)
        corners = np.array([[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]]) * sine
        directions = directions_of_sines("CoherentObject", np.unique(corners, axis=0))
        return CollimatedBeams(directions=directions, width=self.side(wavelength), profile=self.profile)
