"""Thin media: a screen that changes the phase of light and nothing else, ground glass, and screens in a row.

A screen multiplies the field by t = e^(i phi(x)), phi a Gaussian field of rms sigma and correlation e^(-r^2 / xi^2), so

    gamma(r) = <t(x + r) t*(x)> = exp{ -sigma^2 [1 - e^(-r^2 / xi^2)] }

Goodman, *Speckle Phenomena in Optics* (2020), section 4.5. A rough face of height h and index n over that of its
surroundings has ``phi = k (n - 1) h``; under a tilt of sine s it is ``k h [(n^2 - s^2)^(1/2) - (1 - s^2)^(1/2)]``.
Light walks off sideways inside a screen by less than its correlation length, or it is no thin screen: the rms height
times the rms angle is far below xi.
"""

import math
from functools import cached_property
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.quantities import Mark, marked, with_units
from specklegen.core.units import OTHER_LENGTH, SINE, TIME, UNIT, VELOCITY, WAVELENGTH
from specklegen.core.values import Finite, NonNegative, Positive, Value
from specklegen.scene.faces import Faces

STEEPEST = 1 / 3
"""Rms angle along one axis behind a thin medium, at most: of a wider Gaussian lobe more than 1 % is evanescent."""

_GLASS = 1.5  # index of the glass in air for which grits are tabulated
_FWHM = 2 * math.sqrt(2 * math.log(2))  # of a Gaussian, over its standard deviation


class _Thin(Value):
    """Interface that every thin medium shares with a volume of scatterers."""

    has_sides: ClassVar[bool] = False
    homogeneous: ClassVar[bool] = True
    dimension: ClassVar[int | None] = 3
    faces: ClassVar[Faces] = Faces()
    refracts: ClassVar[bool] = False


class PhaseScreen(_Thin):
    """A thin, lossless screen with a Gaussian phase: a medium, or one of the screens of a :class:`ScreenStack`.

    Parameters
    ----------
    correlation_length
        xi, the distance at which the correlation of the phase falls to 1/e; at least the wavelength.
    rms_phase
        sigma, radians; or else give the two below.
    rms_height, index
        Instead of ``rms_phase``: the rms height of a rough face, in the scene's unit of length, and its refractive
        index over that of its surroundings.

    Examples
    --------
    >>> import specklegen as sg
    >>> screen = sg.media.PhaseScreen(correlation_length=10.0, rms_phase=3.0)
    >>> round(screen.rms_angle(0.5), 4)
    0.0338
    """

    type: Literal["PhaseScreen"] = "PhaseScreen"
    correlation_length: Annotated[Positive, OTHER_LENGTH]
    rms_phase: NonNegative | None = None
    rms_height: Annotated[NonNegative, OTHER_LENGTH] | None = None
    index: Positive | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        given = [name for name in ("rms_phase", "rms_height", "index") if getattr(self, name) is not None]
        if given not in (["rms_phase"], ["rms_height", "index"]):
            reject("PhaseScreen", "given by rms_phase, or by rms_height and index", given or "neither")
        return self

    @with_units
    def phase(
        self, wavelength: Annotated[float, WAVELENGTH], sine: Annotated[np.ndarray | float, SINE] = 0.0
    ) -> np.ndarray:
        """Rms phase, radians, for light that meets the screen at direction sines float64[...] from its normal.

        Raises
        ------
        RuleError
            For a sine at which the light is totally reflected.
        """
        square = np.square(np.asarray(sine, np.float64))
        if self.rms_phase is not None:
            return self.rms_phase + 0 * square
        assert self.rms_height is not None
        assert self.index is not None
        if not (square < min(1.0, self.index**2)).all():
            reject("PhaseScreen.phase sine", f"below {min(1.0, self.index):g}", float(np.sqrt(square.max())),
                   "No light passes the face at larger sines.")  # fmt: skip
        # n - 1 and what the tilt adds to it, without cancellation
        added = square / (1 + np.sqrt(1 - square)) - square / (self.index + np.sqrt(self.index**2 - square))
        return np.abs(2 * np.pi / wavelength * self.rms_height * (self.index - 1 + added))

    @with_units
    def rms_angle(self, wavelength: Annotated[float, WAVELENGTH]) -> float:
        """theta_1 = sqrt(2) sigma / (k xi), rms direction sine along one axis, the unscattered light included."""
        return float(math.sqrt(2) * self.phase(wavelength) * wavelength / (2 * np.pi * self.correlation_length))

    @property
    def stack(self) -> "ScreenStack":
        """The screen as a stack of one."""
        return ScreenStack(screens=(self,))


class Ground(NamedTuple):
    """Assumed surface of a grit: rms height in micrometres, full width of the scattered light in sines."""

    rms_height: float
    angle: float


GRITS = {
    120: Ground(5.0, 0.35), 220: Ground(3.0, 0.26), 400: Ground(1.5, 0.21), 600: Ground(1.0, 0.17),
    1500: Ground(0.5, 0.09),
}  # fmt: skip
"""Assumed, of the order that is usual for glass of index 1.5 in air, within a factor of 1.5 in the angle and 2 in the
height: no maker prints a roughness. Measure the lobe of your own glass and give ``angle`` where that matters."""


class GroundGlass(_Thin):
    """A ground face of glass: a :class:`PhaseScreen` by the grit that ground it, or by how wide it scatters.

    Either is one number, and a screen has two. What is assumed besides stands in :attr:`screen`: of a grit both are
    those of :data:`GRITS`, in air at index 1.5; of an angle the rms height is. The correlation length follows,

        xi = sqrt(2) (n - 1) rms_height / theta_1,     theta_1 = angle / 2.355

    Where sigma is above 3 the angle alone decides what a far-field camera sees, and the assumption matters little.

    Parameters
    ----------
    grit
        Of the abrasive, one of :data:`GRITS`, as the catalogue has it; or else give the angle.
    angle
        Instead of the grit: full width at half maximum of the scattered intensity in direction sines, in the
        surroundings.
    rms_height
        Of the face, in the unit of length of the scene, where it is known; otherwise that of the grit, and 2
        micrometres of a glass that is given by its angle.
    index
        Of the glass over that of its surroundings.
    unit
        Metres in the unit of length of the scene; micrometres by default.

    Examples
    --------
    >>> import specklegen as sg
    >>> glass = sg.GroundGlass(grit=220)
    >>> glass.screen.rms_height, round(glass.screen.correlation_length)  # micrometres
    (3.0, 19)
    """

    type: Literal["GroundGlass"] = "GroundGlass"
    grit: int | None = None
    angle: Annotated[float, Field(gt=0, le=_FWHM * STEEPEST), SINE] | None = None
    rms_height: Annotated[Positive, OTHER_LENGTH] | None = None
    index: Annotated[float, Field(gt=1, allow_inf_nan=False)] = 1.5
    unit: Annotated[Positive, UNIT] = 1e-6

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.grit is None) == (self.angle is None):
            reject("GroundGlass", "given by one of grit and angle", {"grit": self.grit, "angle": self.angle})
        if self.grit is not None and self.grit not in GRITS:
            reject("GroundGlass.grit", f"one of {', '.join(map(str, GRITS))}", self.grit, "Or give an angle.")
        if self.grit is not None and self.rms_height is not None:
            reject("GroundGlass.rms_height", "left out if a grit is given", self.rms_height,
                   "For another roughness use a PhaseScreen.")  # fmt: skip
        # What is assumed of the face is known in micrometres.
        return self if self.rms_height is not None else marked(self, Mark(self.unit))

    @property
    def screen(self) -> PhaseScreen:
        """The screen that it is taken for, with the roughness that is assumed."""
        micrometre = 1e-6 / self.unit
        if self.grit is not None:
            height, angle, index = GRITS[self.grit].rms_height * micrometre, GRITS[self.grit].angle, _GLASS
        else:
            assert self.angle is not None
            height, angle, index = self.rms_height or 2 * micrometre, self.angle, self.index
        length = math.sqrt(2) * (index - 1) * height * _FWHM / angle  # of the face, whatever surrounds it
        return marked(PhaseScreen(rms_height=height, index=self.index, correlation_length=length), Mark(self.unit))

    @property
    def stack(self) -> "ScreenStack":
        """The glass as a stack of one screen."""
        return self.screen.stack


Screen = Annotated[PhaseScreen | GroundGlass, Field(discriminator="type")]


class ScreenStack(_Thin):
    """Screens one behind the other with clear space between them, infinite sideways.

    Parameters
    ----------
    screens
        The first one is met first, at z = 0.
    gaps
        Distance from each screen to the next: one fewer than there are screens.
    behind
        From the last screen to the exit plane, to which shifts of the pattern refer; a far field does not feel it.
    velocities
        (x, y) of each screen across the light, lengths per unit of time; None where they stand still. Beams see them
        move by their ``times``: ``CollimatedBeams(times=)``.

    Examples
    --------
    >>> import specklegen as sg
    >>> screen = sg.media.PhaseScreen(correlation_length=10.0, rms_phase=3.0)
    >>> sg.media.ScreenStack(screens=[screen, screen], gaps=[200.0]).thickness
    200.0
    """

    type: Literal["ScreenStack"] = "ScreenStack"
    screens: tuple[Screen, ...]
    gaps: tuple[Annotated[NonNegative, OTHER_LENGTH], ...] = ()
    behind: Annotated[NonNegative, OTHER_LENGTH] = 0.0
    velocities: tuple[tuple[Annotated[Finite, VELOCITY], Annotated[Finite, VELOCITY]], ...] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.screens:
            reject("ScreenStack.screens", "at least one screen", self.screens)
        if len(self.gaps) != len(self.screens) - 1:
            reject("ScreenStack.gaps", f"{len(self.screens) - 1} numbers for {len(self.screens)} screens", self.gaps)
        if self.velocities is not None and len(self.velocities) != len(self.screens):
            reject("ScreenStack.velocities", f"{len(self.screens)} pairs (x, y), one for each screen", self.velocities)
        return self

    @cached_property
    def stack(self) -> "ScreenStack":
        """The stack with every ground glass as the screen that it is taken for."""
        if all(isinstance(each, PhaseScreen) for each in self.screens):
            return self
        screens = tuple(each if isinstance(each, PhaseScreen) else each.screen for each in self.screens)
        return self.replace(screens=screens)

    @property
    def thickness(self) -> float:
        """Distance from the first screen to the exit plane."""
        return sum(self.gaps) + self.behind

    @property
    def distances(self) -> np.ndarray:
        """float64[M], from each screen to the exit plane."""
        return self.behind + np.append(np.cumsum(self.gaps[::-1])[::-1], 0.0)

    @with_units
    def moved(self, times: Annotated[np.ndarray, TIME]) -> np.ndarray:
        """Displacement of each screen at times float64[T], float64[T, M, 2]."""
        velocities = np.zeros((len(self.screens), 2)) if self.velocities is None else np.array(self.velocities)
        return np.asarray(times, np.float64)[:, None, None] * velocities

    @with_units
    def phases(
        self, wavelength: Annotated[float, WAVELENGTH], sine: Annotated[np.ndarray | float, SINE] = 0.0
    ) -> np.ndarray:
        """Rms phase of every screen float64[M, ...], for light at direction sines float64[...]."""
        return np.stack([each.phase(wavelength, sine) for each in self._phase_screens])

    @property
    def correlation_lengths(self) -> np.ndarray:
        """float64[M]."""
        return np.array([each.correlation_length for each in self._phase_screens])

    @with_units
    def rms_angle(self, wavelength: Annotated[float, WAVELENGTH]) -> float:
        """Rms direction sine along one axis behind all screens, the unscattered light included."""
        return float(np.sqrt(sum(each.rms_angle(wavelength) ** 2 for each in self._phase_screens)))

    @with_units
    def optical_depth(self, wavelength: Annotated[float, WAVELENGTH]) -> float:
        """Sum of the sigma^2: the unscattered share of the light is e^-OD, and sigma^2 the mean number of events."""
        return float(np.square(self.phases(wavelength)).sum())

    @property
    def _phase_screens(self) -> tuple[PhaseScreen, ...]:
        return self.stack.screens  # type: ignore[return-value]



ThinMedium = PhaseScreen | GroundGlass | ScreenStack


_MOST_WAVES = 1e12


def require_thin(medium: ThinMedium, wavelength: float) -> ScreenStack:
    """Return a thin medium as a stack, unless the model of thin screens does not hold at a wavelength.

    Raise a `RuleError` if it is no thin medium, a screen's correlation length is below the wavelength, or it scatters
    too wide.
    """
    stack = getattr(medium, "stack", None)
    if stack is None:
        reject("medium", "a slab or layers, or a PhaseScreen, GroundGlass or ScreenStack", medium)
    shortest = float(stack.correlation_lengths.min())
    if shortest < wavelength:
        reject(
            f"{medium.type}.correlation_length", f"at least the wavelength, {wavelength:g}", shortest,
            "A finer phase scatters into evanescent waves and is no thin screen.",
        )  # fmt: skip
    if float(stack.correlation_lengths.max()) > _MOST_WAVES * wavelength:
        reject("wavelength", f"at least {1 / _MOST_WAVES:g} of a screen's correlation length", wavelength,
               "Phases over more wavelengths lose their precision.")  # fmt: skip
    angle = stack.rms_angle(wavelength)
    if angle > STEEPEST:
        reject(
            f"{medium.type}", f"of an rms angle (sqrt(2) sigma / (k xi)) of at most {STEEPEST:.3g}", f"{angle:.3g}",
            "Light at wider angles is not paraxial: lower the rms phase, raise the correlation length, or use a "
            "Slab.",
        )  # fmt: skip
    return stack
