"""Coherent objects behind screens whose phases are drawn, for few correlation lengths in the lit area.

    E -> E e^(i phi_m),     E -> F^-1 [ e^(ik d (cos - 1)) F E ]

from screen to screen on one periodic grid: no Gaussian statistics of the light, no memory effect in closed form, and
what is not scattered is part of it. Goodman, *Introduction to Fourier Optics* (4th edition), section 3.10.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import next_fast_len

from specklegen.core.decision import Decision
from specklegen.core.lazy import torch
from specklegen.core.nanoseconds import Cost
from specklegen.samplers.sampler import FIXED_BYTES, TORCH_BYTES
from specklegen.scene.scene import Scene
from specklegen.scene.screens import ScreenStack
from specklegen.synthesis.coherent import WaveGrid, wave_grid

MOST_POINTS = 4096
"""Points along a side, at most: a medium of one screen takes some seconds then."""
_ANGLES = 5.0  # rms angles that the grid holds: e^(-12.5) of the light is beyond
_SPREAD = 4.0  # rms angles over which light walks without meeting the copy of the lit area
_PER_LENGTH = 3.0  # points in a correlation length, at least
_APART = 3.0  # correlation lengths from the lit area to its copy, at least


@dataclass(frozen=True, eq=False)
class DrawnScreens:
    """Draws media with their phases; see :class:`specklegen.synthesis.coherent.ManyObjects`, whose methods it has.

    Attributes
    ----------
    grid : WaveGrid
    stack : ScreenStack
        All of it phase screens.
    lit, points : int
        Points across the window, and across the period.
    ballistic : bool
        Whether what is not scattered is part of the field.
    """

    grid: WaveGrid
    stack: ScreenStack
    lit: int
    points: int
    ballistic: bool = False

    @property
    def spacing(self) -> float:
        """Distance between points."""
        return self.grid.side / self.lit

    @property
    def normals(self) -> tuple[int, ...]:
        """Shape of the noise: the spectrum of a real phase a screen."""
        return len(self.stack.screens), self.points, self.points // 2 + 1

    @property
    def bytes(self) -> float:
        """Bytes of one complex field over the period."""
        return 8.0 * self.points**2

    @property
    def flops(self) -> tuple[float, float]:
        """Operations of the phases of one medium, and of one object behind them."""
        size, (rows, columns) = float(self.points) ** 2, self.grid.shape
        transform, screens = 15.0 * size * np.log2(size), len(self.stack.screens)
        seen = 8.0 * rows * self.points * (self.points + columns)
        return screens * (0.5 * transform + 40.0 * size), seen + (screens - 1) * 2 * transform + 8.0 * size

    @cached_property
    def _amplitudes(self) -> np.ndarray:
        """Rms of the spectrum of every phase, float32[screens, points, points / 2 + 1]."""
        found, positions = [], np.arange(self.points) * self.spacing
        period, sigmas = self.points * self.spacing, self.stack.phases(self.grid.wavelength)
        for sigma, length in zip(sigmas, self.stack.correlation_lengths, strict=True):
            along = np.exp(-np.square((positions[:, None] + period * np.arange(-2, 3)) / length)).sum(axis=1)
            power = np.clip(np.fft.fft(along).real, 0, None)
            rms = np.sqrt(np.outer(power, power[: self.points // 2 + 1]))
            rms[:, 0] *= np.sqrt(2)  # a real transform takes the real part of this column
            found.append(sigma * self.points / along[0] * rms)
        return np.array(found, np.float32)

    def medium(self, white: torch.Tensor) -> torch.Tensor:
        """Return e^(i phi) complex64[screens, points, points] of one medium."""
        size = (self.points, self.points)
        phases = torch.fft.irfft2(white * torch.from_numpy(self._amplitudes), s=size)
        return torch.polar(torch.ones_like(phases), phases)

    def _places(self, count: int) -> np.ndarray:
        """Positions float64[count] of the first points: those of the window, then those beside it."""
        place = np.arange(count) - (self.lit - 1) / 2
        return (np.mod(place + self.points / 2, self.points) - self.points / 2) * self.spacing

    def light(self, amplitudes: np.ndarray) -> torch.Tensor:
        """Return the fields complex64[T, lit, lit] of objects complex[T, M, M] on the first screen."""
        k = 2 * np.pi / self.grid.wavelength
        waves = np.exp(1j * k * self._places(self.lit)[:, None] * self.grid.sines)
        return torch.from_numpy((waves @ amplitudes @ waves.T).astype(np.complex64))

    @cached_property
    def _views(self) -> tuple[np.ndarray, np.ndarray]:
        """Sines of the camera, y float64[H] and x float64[W]."""
        grid = self.grid
        y, x = (
            middle + (np.arange(count) - (count - 1) / 2) * grid.pitch
            for count, middle in zip(grid.shape, grid.center[::-1], strict=True)
        )
        return y, x

    def _far_field(self, fields: torch.Tensor) -> torch.Tensor:
        """Return (1 / wavelength) sum E e^(-ik v . x) dA complex64[..., H, W], of fields [..., count, count]."""
        k, places = 2 * np.pi / self.grid.wavelength, self._places(fields.shape[-1])
        y, x = (
            torch.from_numpy(np.exp(-1j * k * views[:, None] * places).astype(np.complex64)) for views in self._views
        )
        return (y @ fields @ x.T) * (self.spacing**2 / self.grid.wavelength)

    @cached_property
    def _carriers(self) -> list[torch.Tensor]:
        """e^(ik d (cos - 1)) complex64[points, points] of every gap; 0 where waves are evanescent."""
        sines = np.fft.fftfreq(self.points, self.spacing / self.grid.wavelength)
        return [_carrier(self.grid.wavelength, gap, sines, sines) for gap in self.stack.gaps]

    def speckle(self, medium: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        """Return fields complex64[T, H, W] of :meth:`light` behind :meth:`medium`."""
        fields = light * medium[0, : self.lit, : self.lit]
        for screen, carrier in zip(medium[1:], self._carriers, strict=True):
            spectrum = torch.fft.fft2(fields, s=(self.points, self.points))
            fields = torch.fft.ifft2(spectrum * carrier) * screen
        depth = sum(self.stack.gaps)
        seen = self._far_field(fields) * _carrier(self.grid.wavelength, -depth, *self._views)  # phases of z = 0
        if self.ballistic:
            return seen
        return seen - self._far_field(light) * float(np.exp(-0.5 * self.stack.optical_depth(self.grid.wavelength)))


def _carrier(wavelength: float, way: float, y: np.ndarray, x: np.ndarray) -> torch.Tensor:
    """Phases complex64[y, x] of light along sines on its way, over e^(ik way)."""
    square = np.square(x) + np.square(y)[:, None]
    phase = -2 * np.pi / wavelength * way * square / (1 + np.sqrt(np.clip(1 - square, 0, None)))
    return torch.from_numpy(np.where(square < 1, np.exp(1j * phase), 0).astype(np.complex64))


def drawn_screens(stack: ScreenStack, wavelength: float, grid: WaveGrid, ballistic: bool = False) -> DrawnScreens:
    """Return what draws the phases of a stack, on a grid that holds its light."""
    stack, lengths, angle = stack.stack, stack.correlation_lengths, stack.rms_angle(wavelength)
    widest = float(np.abs(grid.sines).max())
    sine = widest + _ANGLES * angle
    seen = float(np.abs(grid.center).max()) + grid.pitch * max(grid.shape) / 2
    most = min(wavelength / (sine + max(sine, seen)), float(lengths.min()) / _PER_LENGTH)
    lit = int(np.ceil(grid.side / most))
    spread = 2 * (widest + _SPREAD * angle) * sum(stack.gaps)
    beside = max(_APART * float(lengths.max()), spread) / grid.side * lit
    points = int(next_fast_len(int(np.ceil(min(lit + beside, 2**31))), real=True))  # type: ignore[arg-type]
    return DrawnScreens(grid, stack, lit, points + points % 2, ballistic)


def _of_scene(scene: Scene) -> tuple[DrawnScreens, int]:
    """Return the drawer of the phases of a scene, and its number of objects."""
    assert scene.thin is not None
    grid, amplitudes = wave_grid(scene.illumination, scene.wavelength, scene.grid)
    return drawn_screens(scene.thin, scene.wavelength, grid), len(amplitudes)


def drawn_cost(scene: Scene) -> Cost:
    """Count the operations of one medium."""
    drawn, objects = _of_scene(scene)
    of_medium, of_object = drawn.flops
    return Cost({"normal": float(np.prod(drawn.normals)), "flop": of_medium + objects * of_object})


def drawn_memory(scene: Scene) -> int:
    """Bytes by which the process grows at most."""
    drawn, objects = _of_scene(scene)
    return int((4 * len(drawn.stack.screens) + 4 * objects) * drawn.bytes + TORCH_BYTES + FIXED_BYTES)


def drawn_decision(scene: Scene, decisions: Sequence[Decision]) -> Decision | None:
    """Return why phases are drawn: Gaussian fields are off by more than allowed, and the grid holds the light."""
    doubted = [each for each in decisions if each.part == "screens" and each.doubt]
    if not doubted:
        return None
    drawn, _ = _of_scene(scene)
    if drawn.points > MOST_POINTS:
        return None
    beyond = np.exp(-0.5 * _ANGLES**2)
    return Decision(
        "screens", True, f"phases drawn on {drawn.points}x{drawn.points} points, {drawn.spacing:.3g} apart, and light "
        f"carried from screen to screen; what the grid folds is below {beyond:.0e} of the light. As Gaussian speckle "
        f"({doubted[0].reason})",
    )  # fmt: skip
