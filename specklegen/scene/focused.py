"""Beams that a lens focuses onto points in a medium or before it: sums of collimated beams through one window.

    E(x) = sum over n of a_n / sqrt(cos_n) e^(ik [s_n . (x - p) + (cos_n - 1) (z - p_z)]),    W^2 sum |a_n|^2 = 1

over the sines s_n inside the aperture that are whole multiples of wavelength / W, W the window's side: a Fourier series
of what a lens sends through the window, and of unit power. a_n is the pupil's transmission, as behind a lens that obeys
Abbe's sine condition (Richards and Wolf, Proc. R. Soc. A 253, 358 (1959)); of Gaussian beams of waist w0 it is

    a_n ~ e^(kappa (cos_n - 1)) / sqrt(cos_n),    kappa = (k w0)^2 / 2

whose field has a closed form (:mod:`specklegen.theory.focused_light`): Bar, Alterman, Gkioulekas, Levin, ACM Trans.
Graph. 39(6), 187 (2020).
"""

import math
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.arguments import positive_number, real_array
from specklegen.core.errors import reject
from specklegen.core.memory import require_memory
from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH, OTHER_LENGTH, SINE, WAVELENGTH
from specklegen.core.values import Array, Positive, position_vectors
from specklegen.scene.illumination import CollimatedBeams, Light, directions_of_sines
from specklegen.scene.imaging import Pupil
from specklegen.scene.window import Profile, Window

_TAIL = 3.0  # 1/e^2 half angles of a Gaussian beam up to which its sines reach: e^-9 of its amplitude is beyond
_MARGIN = 8.0  # of the window beyond the cone, in wavelength / aperture: 13 Airy radii, or 8 waists
_BEAM_BYTES = 400  # of one collimated beam, with what is made of it
_AT_ONCE = 2**22  # phasors of a field that is summed over beams


class FocusedBeams(Light):
    """Coherent beams of unit power, each focused onto a point; |u|^2 is then the share of its power per steradian.

    Parameters
    ----------
    points
        float64[T, 3], foci (x, y, z): z is the depth behind the entrance face at which the light would meet if nothing
        scattered it, negative before the face, as a length inside the medium.
    aperture
        Largest direction sine inside the medium: n times smaller than the numerical aperture in air, behind faces of
        index n. None: of Gaussian beams, three times their divergence.
    waist
        1/e^2 radius of the intensity in focus: Gaussian beams, which the aperture, if one is given, ends. None: the
        pupil is evenly lit.
    pupil
        What the lens lets through.
    width
        Side of the square window on the entrance face that the beams pass. None: as wide as the widest cone, and
        8 wavelength / aperture more. A wider one takes more collimated beams, (2 aperture width / wavelength)^2 pi / 4.

    Examples
    --------
    >>> import specklegen as sg
    >>> tissue = sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))  # wavelengths
    >>> light = sg.light.FocusedBeams([[0.0, 0.0, 20.0]], aperture=0.1)
    >>> scene = sg.Scene(wavelength=1.0, medium=tissue, illumination=light,
    ...                  sensor=sg.sensors.FarField.grid((16, 16), 2e-3))
    >>> sg.render(scene, paths=500, seed=0).field.shape
    (1, 16, 16)
    """

    focused: ClassVar[bool] = True
    profile: ClassVar[Profile] = "square"
    type: Literal["FocusedBeams"] = "FocusedBeams"
    points: Annotated[Array, LENGTH] = Field(kw_only=False)
    aperture: Annotated[float, Field(gt=0, lt=1), SINE] | None = None
    waist: Annotated[Positive, OTHER_LENGTH] | None = None
    pupil: Pupil = Pupil()
    width: Annotated[Positive, LENGTH] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        object.__setattr__(self, "points", position_vectors("FocusedBeams.points", self.points))
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            reject("FocusedBeams.points", "an array of shape (T, 3)", self.points.shape)
        if self.aperture is None and self.waist is None:
            reject("FocusedBeams.aperture", "given, or waist", None, "It sets the focus of the beams.")
        return self

    @property
    def vectors(self) -> np.ndarray:
        """float64[T, 3], the foci."""
        return self.points

    def of(self, chosen: np.ndarray) -> Self:
        """Copy with only some foci, by their numbers int[n]."""
        return self.replace(points=self.points[chosen])

    @with_units
    def sine(self, wavelength: Annotated[float, WAVELENGTH]) -> float:
        """Largest direction sine of the light."""
        if self.aperture is not None:
            return self.aperture
        assert self.waist is not None
        return _TAIL * wavelength / (math.pi * self.waist)

    @with_units
    def side(self, wavelength: Annotated[float, WAVELENGTH]) -> float:
        """Side W of the window."""
        if self.width is not None:
            return self.width
        return self._cone(wavelength) + _MARGIN * wavelength / self.sine(wavelength)

    def _cone(self, wavelength: float) -> float:
        """Side of the square about the axis that the widest cone of rays fills on the entrance face."""
        sine = self.sine(wavelength)
        slope = sine / math.sqrt(1 - sine**2)
        aside = np.abs(self.points[:, :2]).max(axis=1, initial=0.0)
        return 2 * float((aside + slope * np.abs(self.points[:, 2])).max(initial=0.0))

    @with_units
    def require_focus(self, wavelength: Annotated[float, WAVELENGTH], largest_sine: float) -> None:
        """Refuse cones that the window cuts off, apertures that no light has, and more beams than memory holds."""
        sine = self.sine(wavelength)
        if not sine < largest_sine:
            if self.aperture is not None:
                reject("FocusedBeams.aperture", f"below {largest_sine:.4g}", sine,
                       "Light of larger sines does not enter the medium.")  # fmt: skip
            least = _TAIL * wavelength / (math.pi * largest_sine)
            reject("FocusedBeams.waist", f"above {least:.4g}, or given with an aperture", self.waist,
                   "Three times its divergence exceeds 90 degrees.")  # fmt: skip
        cone = self._cone(wavelength)
        if not math.isfinite(cone):
            reject("FocusedBeams.points", "lengths near that of the wavelength", float(np.abs(self.points).max()))
        if self.side(wavelength) < cone * (1 - 1e-12):
            reject("FocusedBeams.width", f"at least {cone:.4g}", self.width,
                   "The cone of light to the farthest focus is this wide on the entrance face; with a "
                   "narrower area its "
                   "rim would wrap around to the other side.")  # fmt: skip
        across = 2 * self.sine(wavelength) * self.side(wavelength) / wavelength
        require_memory(
            "FocusedBeams.points", "held", (_BEAM_BYTES + 32.0 * len(self.points)) * across**2,
            f"{across:.3g} collimated beams across",
            "Use a smaller aperture, a narrower window, or foci nearer to the face.",
        )  # fmt: skip

    def _modes(self, wavelength: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sines float64[N, 2] of the beams, their cosines, and their amplitudes complex128[N] of a focus at 0."""
        wavelength = positive_number("FocusedBeams wavelength", wavelength)
        sine, step = self.sine(wavelength), wavelength / self.side(wavelength)
        most = math.ceil(sine / step + 0.5)
        pupil = self.pupil.cells(2 * most + 1, step / sine)
        along = np.arange(-most, most + 1) * step
        x, y = np.meshgrid(along, along)
        kept = (np.abs(pupil) > 0) & (np.square(x) + np.square(y) < 1)
        sines, amplitudes = np.stack([x[kept], y[kept]], axis=-1), pupil[kept]
        cosines = np.sqrt(1 - np.square(sines).sum(axis=-1))
        if self.waist is not None:
            sharp = (2 * np.pi / wavelength * self.waist) ** 2 / 2
            # cos - 1 without cancellation
            amplitudes = amplitudes * np.exp(-sharp * np.square(sines).sum(-1) / (1 + cosines)) / np.sqrt(cosines)
        return sines, cosines, amplitudes / (np.sqrt(np.square(np.abs(amplitudes)).sum()) * self.side(wavelength))

    @with_units
    def modes(self, wavelength: Annotated[float, WAVELENGTH]) -> CollimatedBeams:
        """The N collimated beams that every focus is a sum of."""
        sines, _, _ = self._modes(wavelength)
        return CollimatedBeams(
            directions=directions_of_sines("FocusedBeams", sines), width=self.side(wavelength), profile=self.profile
        )

    @with_units
    def amplitudes(self, wavelength: Annotated[float, WAVELENGTH]) -> np.ndarray:
        """complex128[T, N], those of the beams in every focus."""
        sines, cosines, pupil = self._modes(wavelength)
        way = self.points[:, :2] @ sines.T - self.points[:, 2:] * (np.square(sines).sum(-1) / (1 + cosines))
        return pupil * np.exp(-2j * np.pi / wavelength * way)

    @with_units
    def field(self, places: Annotated[np.ndarray, LENGTH], wavelength: Annotated[float, WAVELENGTH]) -> np.ndarray:
        """Field of the light that nothing scatters, complex128[T, P], at places float64[P, 3]; over e^(ikz).

        |E|^2 is an irradiance for unit power, 1 / area. Each beam is lit under the window as it goes along.

        Examples
        --------
        >>> import specklegen as sg
        >>> light = sg.light.FocusedBeams([[0.0, 0.0, 30.0]], waist=3.0)
        >>> peak, beside = abs(light.field([[0.0, 0.0, 30.0], [3.0, 0.0, 30.0]], wavelength=1.0))[0]
        >>> round(beside / peak, 3)  # 1/e, and less by the cosine of wide angles
        0.368
        """
        places = np.atleast_2d(real_array("FocusedBeams.field places", places))
        if places.ndim != 2 or places.shape[1] != 3:
            reject("FocusedBeams.field places", "of shape (P, 3)", places.shape)
        sines, cosines, _ = self._modes(wavelength)
        amplitudes = self.amplitudes(wavelength) / np.sqrt(cosines)
        window, k = Window(self.profile, self.side(wavelength)), 2 * np.pi / wavelength
        field = np.empty((len(self.points), len(places)), complex)
        step = max(1, _AT_ONCE // max(len(sines), 1))
        for start in range(0, len(places), step):
            some = places[start : start + step]
            lag = np.square(sines).sum(-1) / (1 + cosines)
            waves = np.exp(1j * k * (sines @ some[:, :2].T - lag[:, None] * some[:, 2]))
            aside = some[None, :, :2] - some[None, :, 2:] * (sines / cosines[:, None])[:, None]
            field[:, start : start + step] = amplitudes @ (waves * window.amplitude(aside[..., 0], aside[..., 1]))
        return field
