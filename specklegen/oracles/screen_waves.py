"""Thin screens by waves: phases drawn on a periodic grid, light carried between them by its angular spectrum.

    E -> E e^(i phi_m),     E -> F^-1 [ e^(i k d (1 - s^2)^(1/2)) F E ],  evanescent waves left out

No closed form and no Gaussian statistics of light enter: the judge of the screens sampler and of its closed forms.
whole steps of the spectrum, lambda / side, so that the waves are periodic too. Goodman, *Introduction to Fourier
Optics* (2017), section 3.10.
"""

from dataclasses import dataclass

import numpy as np

from specklegen.core.errors import reject
from specklegen.scene.screens import ScreenStack

ANGLES_HELD = 4.0
"""Rms angles that the grid's largest sine must hold."""


@dataclass(frozen=True)
class ScreenWaves:
    """A periodic square of a stack of screens.

    Attributes
    ----------
    points : int
        Along a side.
    spacing : float
        Between points.
    """

    stack: ScreenStack
    wavelength: float
    points: int
    spacing: float

    def __post_init__(self) -> None:
        largest = self.wavelength / (2 * self.spacing)
        angle = self.stack.rms_angle(self.wavelength)
        if largest < ANGLES_HELD * angle:
            reject("ScreenWaves.spacing", f"at most {self.wavelength / (2 * ANGLES_HELD * angle):.3g}", self.spacing,
                   f"Its largest sine, {largest:.3g}, must hold {ANGLES_HELD:g} rms angles of {angle:.3g}: wider light "
                   "would be aliased.")  # fmt: skip
        lengths = self.stack.correlation_lengths
        if self.spacing > lengths.min() / 2:
            reject("ScreenWaves.spacing", f"at most half the correlation length {lengths.min():g}", self.spacing)
        if self.side < 8 * lengths.max():
            reject("ScreenWaves.points", f"so many that the side holds 8 correlation lengths of {lengths.max():g}",
                   self.points)  # fmt: skip

    @property
    def side(self) -> float:
        """Period."""
        return self.points * self.spacing

    @property
    def step(self) -> float:
        """Sine between neighbours of the spectrum, and of the tilts."""
        return self.wavelength / self.side

    @property
    def sines(self) -> np.ndarray:
        """float64[n], sines of the spectrum along one axis, in the order of an FFT."""
        return np.fft.fftfreq(self.points, self.spacing / self.wavelength)

    @property
    def positions(self) -> np.ndarray:
        """float64[n], of the points along one axis, 0 the first."""
        return np.arange(self.points) * self.spacing

    def phases(self, rng: np.random.Generator) -> np.ndarray:
        """One draw of all screens, float64[M, n, n]."""
        return np.stack([self._phase(m, rng) for m in range(len(self.stack.screens))])

    def fields(self, phases: np.ndarray, tilts: np.ndarray, window: np.ndarray | float = 1.0) -> np.ndarray:
        """Fields on the exit plane, complex128[T, n, n], of waves of int[T, 2] steps (x, y) through one draw.

        ``window`` is the amplitude of the light on the first screen, broadcast to [n, n].
        """
        turns = np.arange(self.points) / self.points
        waves = [np.exp(2j * np.pi * (tx * turns + ty * turns[:, None])) for tx, ty in np.asarray(tilts)]
        distances = [*self.stack.gaps, self.stack.behind]
        out = []
        for wave in waves:
            field = wave * window
            for phase, distance in zip(phases, distances, strict=True):
                field = self._carried(field * np.exp(1j * phase), distance)
            out.append(field)
        return np.stack(out)

    def spectra(self, fields: np.ndarray) -> np.ndarray:
        """Far field (1 / lambda) sum E e^(-ik s.x) dA of fields [..., n, n], in the order of :attr:`sines`."""
        return np.fft.fft2(fields) * (self.spacing**2 / self.wavelength)

    def _carried(self, field: np.ndarray, distance: float) -> np.ndarray:
        if distance == 0:
            return field
        square = np.square(self.sines) + np.square(self.sines)[:, None]
        forward = np.sqrt(np.clip(1 - square, 0, None))
        phase = np.exp(2j * np.pi * distance / self.wavelength * (forward - 1))
        return np.fft.ifft2(np.where(square < 1, phase, 0) * np.fft.fft2(field))

    def _phase(self, m: int, rng: np.random.Generator) -> np.ndarray:
        """A Gaussian field whose correlation is that of the screen, repeated with the period."""
        length = self.stack.correlation_lengths[m]
        along = np.exp(-np.square((self.positions[:, None] + self.side * np.arange(-2, 3)) / length)).sum(axis=1)
        power = np.clip(np.fft.fft(along).real, 0, None)
        white = rng.standard_normal((self.points, self.points))
        drawn = np.fft.ifft2(np.sqrt(np.outer(power, power)) * np.fft.fft2(white)).real
        return float(self.stack.phases(self.wavelength)[m]) * drawn / along[0]
