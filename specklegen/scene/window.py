"""The window through which light enters: its profile and what follows from it in closed form.

A beam has the amplitude b(x) on the entrance face, b = 1 at its peak, and a width W:

    profile    b(x, y)               area of b^2   transform of b over that at 0   overlap at shift s, t = |s| / W
    square     1 for |x|, |y| < W/2  W^2           sinc(W fx) sinc(W fy)           (1 - |sx| / W)(1 - |sy| / W)
    disc       1 for r < W/2         pi W^2 / 4    2 J1(pi W f) / (pi W f)         2/pi (acos t - t sqrt(1 - t^2))
    gaussian   exp(-4 r^2 / W^2)     pi W^2 / 8    exp(-(pi W f / 2)^2)            exp(-4 t^2)

with f in cycles per length and ``sinc(x) = sin(pi x) / (pi x)``. The transforms are those of Goodman, *Introduction to
Fourier Optics* (2005), section 2.1; the overlap of the disc is the optical transfer function of a circular pupil there,
section 6.3. The Gaussian's W is its ``1/e^2`` intensity diameter, so ``b^2`` is the amplitude of a Gaussian narrower by
the root of 2; the others are their own squares. In flatland a disc is a slit, as a square is.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.special import j1

Profile = Literal["square", "disc", "gaussian"]
PROFILES: tuple[Profile, ...] = get_args(Profile)


@dataclass(frozen=True)
class _Shape:
    """Formulas of one profile; functions take the width, then coordinates (y is None in flatland).

    Attributes
    ----------
    area
        Of b^2, in squared widths.
    narrowing
        b^2 of width W is the b of width W / narrowing.
    sharp
        Whether b is 1 inside an edge and 0 outside.
    amplitude, transform, overlap
        b, its Fourier transform, and the autocorrelation of b^2 over that at shift 0.
    cell_power
        Mean of b^2 over cells of one axis: (width, centres, size). None where b is no product of x and y.
    """

    area: float
    narrowing: float
    sharp: bool
    amplitude: Callable
    transform: Callable
    overlap: Callable
    cell_power: Callable | None


def _square_amplitude(width: float, x: np.ndarray, y: np.ndarray | None) -> np.ndarray:
    inside = np.abs(x) <= width / 2
    return np.asarray(inside if y is None else inside & (np.abs(y) <= width / 2), np.float64)


def _disc_amplitude(width: float, x: np.ndarray, y: np.ndarray | None) -> np.ndarray:
    return np.asarray(_square_radius(x, y) <= width**2 / 4, np.float64)


def _gaussian_amplitude(width: float, x: np.ndarray, y: np.ndarray | None) -> np.ndarray:
    radius = width / 2
    return np.exp(-_square_radius(x / radius, None if y is None else y / radius))


def _square_radius(x: np.ndarray, y: np.ndarray | None) -> np.ndarray:
    return np.square(x) if y is None else np.square(x) + np.square(y)


def _square_transform(width: float, x: np.ndarray, y: np.ndarray | None) -> np.ndarray:
    if y is None:
        return width * np.sinc(width * x)
    return width**2 * np.sinc(width * x) * np.sinc(width * y)


def _disc_transform(width: float, x: np.ndarray, y: np.ndarray | None) -> np.ndarray:
    if y is None:
        return _square_transform(width, x, y)
    t = np.pi * width * np.hypot(x, y)
    return np.pi / 4 * width**2 * np.where(t < 1e-8, 1.0, 2 * j1(t) / np.where(t < 1e-8, 1.0, t))


def _gaussian_transform(width: float, x: np.ndarray, y: np.ndarray | None) -> np.ndarray:
    if y is None:
        return np.sqrt(np.pi) / 2 * width * np.exp(-((np.pi * width * x / 2) ** 2))
    return np.pi / 4 * width**2 * np.exp(-((np.pi * width * np.hypot(x, y) / 2) ** 2))


def _square_overlap(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.clip(1 - np.abs(x), 0, None) * np.clip(1 - np.abs(y), 0, None)


def _disc_overlap(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    s = np.clip(np.hypot(x, y), 0, 1)
    return 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s**2))


def _gaussian_overlap(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.exp(-4 * np.hypot(x, y) ** 2)


def _square_cells(width: float, centres: np.ndarray, size: float) -> np.ndarray:
    """Cells that an edge cuts count by their share inside it."""
    lower = np.maximum(centres - size / 2, -width / 2)
    upper = np.minimum(centres + size / 2, width / 2)
    return np.clip(upper - lower, 0, None) / size


def _gaussian_cells(width: float, centres: np.ndarray, size: float) -> np.ndarray:
    """Transmission at the centres of cells, which are far smaller than the window."""
    return np.exp(-8 * np.square(centres / width))


_SHAPES: dict[Profile, _Shape] = {
    "square": _Shape(1.0, 1.0, True, _square_amplitude, _square_transform, _square_overlap, _square_cells),
    "disc": _Shape(np.pi / 4, 1.0, True, _disc_amplitude, _disc_transform, _disc_overlap, None),
    "gaussian": _Shape(
        np.pi / 8, math.sqrt(2), False, _gaussian_amplitude, _gaussian_transform, _gaussian_overlap, _gaussian_cells
    ),
}


@dataclass(frozen=True)
class Window:
    """A window of the entrance face, centred at 0.

    Attributes
    ----------
    profile : str
        Its shape.
    width : float
        Full side ("square"), diameter ("disc") or 1/e^2 intensity diameter ("gaussian").
    """

    profile: Profile
    width: float

    @property
    def area(self) -> float:
        """Integral of b^2 over the face: the power at unit peak irradiance, an area."""
        return _SHAPES[self.profile].area * self.width**2

    @property
    def sharp(self) -> bool:
        """True if b is 1 inside an edge and 0 outside."""
        return _SHAPES[self.profile].sharp

    @property
    def flat(self) -> float:
        """Half the side of the largest square about the middle in which b is 1."""
        return self.width / 2 * {"square": 1.0, "disc": math.sqrt(0.5), "gaussian": 0.0}[self.profile]

    @property
    def separable(self) -> bool:
        """True if b is a product of a function of x and one of y."""
        return _SHAPES[self.profile].cell_power is not None

    def support(self, decay: float) -> float:
        """Full width of the square or disc outside which b^2 is below e^(-decay)."""
        return self.width * (1.0 if self.sharp else math.sqrt(decay / 2))

    def amplitude(self, x: np.ndarray, y: np.ndarray | None = None) -> np.ndarray:
        """B at points of the face, which broadcast; y is left out in flatland."""
        return _SHAPES[self.profile].amplitude(self.width, x, y)

    def transform(self, x: np.ndarray, y: np.ndarray | None = None) -> np.ndarray:
        """Fourier transform of b at frequencies in cycles per length: an area, or in flatland a length."""
        return _SHAPES[self.profile].transform(self.width, x, y)

    def coherence(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """W^, the Fourier transform of b^2 over its area, at frequencies in cycles per length.

        The correlation at one view of beams whose sines over the wavelength differ by (x, y): physics.md 4.
        """
        intensity = Window(self.profile, self.width / _SHAPES[self.profile].narrowing)
        return intensity.transform(x, y) / self.area

    def overlap(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Autocorrelation of b^2 at shifts (x, y) over that at 0: the incoherent transfer function."""
        return _SHAPES[self.profile].overlap(x / self.width, y / self.width)

    def cell_power(self, centres: np.ndarray, size: float) -> np.ndarray:
        """b^2 of a separable window in cells along one axis, 1 at its peak; ``centres`` and ``size`` are lengths."""
        cell_power = _SHAPES[self.profile].cell_power
        assert cell_power is not None
        return cell_power(self.width, centres, size)
