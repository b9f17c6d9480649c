"""Coherent objects behind screens whose phases are drawn: few correlation lengths lit, lenses, points, moving screens.

    E -> E e^(i phi_m(x - v_m t)),     E -> F^-1 [ e^(ik d (cos - 1)) F E ]

from screen to screen on one periodic grid: no Gaussian statistics of the light, no memory effect in closed form, and
what is not scattered is part of it. Goodman, *Introduction to Fourier Optics* (4th edition), section 3.10. Views are
propagations of that one field: its Fourier transform, its image through a pupil, its values on planes behind.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol, cast

import numpy as np
from scipy.fft import next_fast_len

from specklegen.core.lazy import torch
from specklegen.core.nanoseconds import WAVE
from specklegen.scene.coherent import CoherentObject
from specklegen.scene.imaging import Imaging
from specklegen.scene.scene import Scene
from specklegen.scene.screens import ScreenStack
from specklegen.synthesis.coherent import WaveGrid

_ANGLES = 5.0  # rms angles that the grid holds: e^(-12.5) of the light is beyond
HELD = float(np.exp(-0.5 * _ANGLES**2))
"""Share of the light that a grid folds, at most."""
_SPREAD = 4.0  # rms angles over which light walks without meeting the copy of the lit area
_PER_LENGTH = 3.0  # points in a correlation length, at least
_APART = 3.0  # correlation lengths from the lit area to its copy, at least
_EDGES = 3.0  # sines of the objects, by which edges of the lit area spread light to points and lenses
_AT_ONCE = 512  # points


class Views(Protocol):
    """Views of light behind screens."""

    near: ClassVar[bool]

    @property
    def sine(self) -> float:
        """Largest sine at which it sees light."""
        ...

    @property
    def reach(self) -> float:
        """Half of the longer side of what it sees, 0 of the far field."""
        ...

    def beyond(self, depth: float) -> float:
        """Longest way from a plane at this depth to where light is seen, 0 of the far field."""
        ...

    def flops(self, drawn: DrawnScreens) -> float:
        """Operations of one image."""
        ...

    def seen(self, drawn: DrawnScreens, fields: torch.Tensor, depth: float) -> torch.Tensor:
        """Return what is seen complex64[T, *shape] of fields complex64[T, n, n] on the plane at this depth."""
        ...


@dataclass(frozen=True, eq=False)
class FarGrid:
    """Views of the far field on a grid of sines, float64[H] along y and float64[W] along x; phases are those of z = 0.

    (1 / wavelength) sum E e^(-ik v . x) dA.
    """

    near: ClassVar[bool] = False
    y: np.ndarray
    x: np.ndarray
    sine: float
    reach: float = 0.0

    def beyond(self, depth: float) -> float:  # noqa: ARG002
        """0: a far field does not feel it."""
        return 0.0

    def flops(self, drawn: DrawnScreens) -> float:
        """Operations of two matrix products and their waves."""
        points, rows, columns = drawn.carried, len(self.y), len(self.x)
        return _PRODUCT * rows * points * (points + columns) + WAVE * points * (rows + columns)

    def seen(self, drawn: DrawnScreens, fields: torch.Tensor, depth: float) -> torch.Tensor:
        """Return the far field complex64[T, H, W]."""
        k, places = 2 * np.pi / drawn.wavelength, drawn.places(fields.shape[-1])
        y, x = (
            torch.from_numpy(np.exp(-1j * k * views[:, None] * places).astype(np.complex64))
            for views in (self.y, self.x)
        )
        far = (y @ fields @ x.T) * (drawn.spacing**2 / drawn.wavelength)
        return far if depth == 0 else far * _carrier(drawn.wavelength, -depth, self.y, self.x)


@dataclass(frozen=True, eq=False)
class FarViews:
    """Views of the far field at any directions float64[..., 3]."""

    near: ClassVar[bool] = False
    directions: np.ndarray
    reach: float = 0.0

    @property
    def sine(self) -> float:
        """Largest sine of a view."""
        return float(np.abs(self.directions[..., :2]).max(initial=0.0))

    def beyond(self, depth: float) -> float:  # noqa: ARG002
        """0: a far field does not feel it."""
        return 0.0

    def flops(self, drawn: DrawnScreens) -> float:
        """Operations of a sum for each row of views, and of another for each view."""
        return _point_flops(self.directions[..., 1], drawn.carried)

    def seen(self, drawn: DrawnScreens, fields: torch.Tensor, depth: float) -> torch.Tensor:
        """Return the far field complex64[T, ...]."""
        x, y, z = np.moveaxis(self.directions.reshape(-1, 3), -1, 0)
        waves = (-2 * np.pi / drawn.wavelength) * drawn.places(fields.shape[-1])
        far = _at_points(fields, waves, y, x) * (drawn.spacing**2 / drawn.wavelength)
        turns = (2 * np.pi / drawn.wavelength * depth) * (np.square(x) + np.square(y)) / (1 + z)
        far = far * torch.from_numpy(np.exp(1j * turns).astype(np.complex64))
        return far.reshape(len(fields), *self.directions.shape[:-1])


@dataclass(frozen=True, eq=False)
class LensViews:
    """Pixels of a camera with a lens, focused on the plane at a depth behind the first screen."""

    near: ClassVar[bool] = True
    camera: Imaging
    plane: float

    @property
    def sine(self) -> float:
        """Sine of the aperture."""
        return self.camera.aperture

    @property
    def reach(self) -> float:
        """Half the longer side of the image on the plane in focus."""
        return self.camera.reach

    def beyond(self, depth: float) -> float:
        """Distance of the plane in focus."""
        return abs(self.plane - depth)

    def _orders(self, drawn: DrawnScreens) -> np.ndarray:
        """Numbers of the grid's waves that pass the pupil, along either axis."""
        step = drawn.wavelength / drawn.period
        most = min(int(np.ceil(self.camera.aperture / step + 0.5)), (drawn.points - 1) // 2)
        return np.arange(-most, most + 1)

    def flops(self, drawn: DrawnScreens) -> float:
        """Operations of a transform, of the waves within the pupil, and of two matrix products."""
        (rows, columns), passed = self.camera.shape, float(len(self._orders(drawn)))
        waves = WAVE * passed * (passed + rows + columns)
        return _transform_flops(drawn.points) + waves + _PRODUCT * rows * passed * (passed + columns)

    def seen(self, drawn: DrawnScreens, fields: torch.Tensor, depth: float) -> torch.Tensor:
        """Return the image complex64[T, H, W]: the waves within the pupil, carried to the plane."""
        step, orders = drawn.wavelength / drawn.period, self._orders(drawn)
        pupil = self.camera.pupil.cells(len(orders), step / self.camera.aperture).astype(np.complex64)
        passed = torch.from_numpy(pupil) * _carrier(drawn.wavelength, self.plane - depth, *(2 * [orders * step]))
        spectrum = drawn.spectrum(fields)[..., orders[:, None] % drawn.points, orders % drawn.points] * passed
        x, y = self.camera.positions
        rows, columns = (
            torch.from_numpy(np.exp(1j * np.outer(at - drawn.first, 2 * np.pi / drawn.period * orders)))
            for at in (y, x)
        )
        return rows.to(spectrum.dtype) @ spectrum @ columns.T.to(spectrum.dtype)


@dataclass(frozen=True, eq=False)
class NearPoints:
    """Points float64[..., 3] behind the last screen, where the field is seen itself, e^(ikz) included."""

    near: ClassVar[bool] = True
    points: np.ndarray
    sine: float = 1.0

    @property
    def reach(self) -> float:
        """Largest distance from the axis along x or y."""
        return float(np.abs(self.points[..., :2]).max(initial=0.0))

    def beyond(self, depth: float) -> float:
        """Distance of the farthest point."""
        return float((self.points[..., 2] - depth).max(initial=0.0))

    def flops(self, drawn: DrawnScreens) -> float:
        """Operations of a transform, and of the waves of every plane and their sums."""
        planes = len(np.unique(self.points[..., 2]))
        carried = _transform_flops(drawn.points) + planes * WAVE * float(drawn.points) ** 2
        return carried + _point_flops(self.points[..., 1], drawn.points)

    def seen(self, drawn: DrawnScreens, fields: torch.Tensor, depth: float) -> torch.Tensor:
        """Return the field complex64[T, ...]: all waves, carried to the plane of each point."""
        x, y, z = np.moveaxis(self.points.reshape(-1, 3), -1, 0)
        orders = np.fft.fftfreq(drawn.points, 1 / drawn.points)
        sines, waves = orders * drawn.wavelength / drawn.period, 2 * np.pi / drawn.period * orders
        spectrum = drawn.spectrum(fields)
        seen = torch.empty((len(fields), len(z)), dtype=torch.complex64)
        for plane in np.unique(z):
            here = np.flatnonzero(z == plane)
            carried = spectrum * _carrier(drawn.wavelength, float(plane) - depth, sines, sines)
            turn = complex(np.exp(2j * np.pi * np.mod(plane / drawn.wavelength, 1.0)))
            seen[:, here] = _at_points(carried, waves, y[here] - drawn.first, x[here] - drawn.first) * turn
        return seen.reshape(len(fields), *self.points.shape[:-1])


_PRODUCT, _PHASOR = 4.0, 200.0
"""Operations that take the time of a complex multiplication and addition within a product, and of a point's phase."""


def _transform_flops(points: int) -> float:
    """Operations that take the time of a transform of points x points."""
    return 30.0 * float(points) ** 2 * float(np.log2(points))


def _point_flops(y: np.ndarray, points: int) -> float:
    """Operations of :func:`_at_points`, most of whose time is that of exponentials."""
    return 8.0 * len(np.unique(y)) * points**2 + 1000.0 * y.size * points


def _at_points(values: torch.Tensor, waves: np.ndarray, y: np.ndarray, x: np.ndarray) -> torch.Tensor:
    """Return sum_nm values[n, m] e^(i (waves_n y + waves_m x)) complex64[T, P] at points, those of a row together."""
    found, order = torch.empty((len(values), len(y)), dtype=torch.complex64), np.argsort(y, kind="stable")
    for start in range(0, len(y), _AT_ONCE):
        some = order[start : start + _AT_ONCE]
        rows, which = np.unique(y[some], return_inverse=True)
        lines, turned = (
            torch.from_numpy(np.exp(1j * np.outer(at, waves)).astype(np.complex64)) for at in (rows, x[some])
        )
        found[:, some] = ((lines @ values)[:, which] * turned).sum(-1)
    return found


@dataclass(frozen=True, eq=False)
class DrawnScreens:
    """Draws media with their phases; see :class:`specklegen.synthesis.coherent.ManyObjects`, whose methods it has.

    Attributes
    ----------
    wavelength, side : float
        Side of the window.
    sines : float64[M]
        Of the objects' plane waves along either axis.
    stack : ScreenStack
        All of it phase screens.
    views : Views
    lit, points : int
        Points across the window, and across the period.
    ballistic : bool
        Whether what is not scattered is part of the field.
    moved : float64[T, screens, 2] or None
        How far each screen has moved when each object is shown.
    """

    wavelength: float
    side: float
    sines: np.ndarray
    stack: ScreenStack
    views: Views
    lit: int
    points: int
    ballistic: bool = False
    moved: np.ndarray | None = None

    @property
    def spacing(self) -> float:
        """Distance between points."""
        return self.side / self.lit

    @property
    def period(self) -> float:
        """Distance from the lit area to its copy."""
        return self.points * self.spacing

    @property
    def first(self) -> float:
        """Position of the first point."""
        return -(self.lit - 1) / 2 * self.spacing

    @property
    def normals(self) -> tuple[int, ...]:
        """Shape of the noise: the spectrum of a real phase a screen."""
        return len(self.stack.screens), self.points, self.points // 2 + 1

    @property
    def carried(self) -> int:
        """Points a side of a field behind the last screen: behind one alone, those of the lit area."""
        return self.lit if len(self.stack.screens) == 1 else self.points

    @property
    def bytes(self) -> float:
        """Bytes of one complex field over the period."""
        return 8.0 * self.points**2

    @property
    def flops(self) -> tuple[float, float, float]:
        """Operations of the phases of one medium, of one object behind them, and of an object's light, found once."""
        size, screens, transform = float(self.points) ** 2, len(self.stack.screens), _transform_flops(self.points)
        phases = screens * (0.5 * transform + _PHASOR * size)
        seen = (1 if self.ballistic else 2) * self.views.flops(self)  # once more what no screen scatters
        shown = seen + (screens - 1) * 2 * transform + 8.0 * size
        waves = float(len(self.sines))
        light = 2 * _PRODUCT * self.lit * waves * (waves + self.lit) + WAVE * self.lit * waves
        return (phases, shown, light) if self.moved is None else (0.0, phases + shown, light)

    @cached_property
    def _amplitudes(self) -> np.ndarray:
        """Rms of the spectrum of every phase, float32[screens, points, points / 2 + 1]."""
        found, positions = [], np.arange(self.points) * self.spacing
        period, sigmas = self.points * self.spacing, self.stack.phases(self.wavelength)
        for sigma, length in zip(sigmas, self.stack.correlation_lengths, strict=True):
            along = np.exp(-np.square((positions[:, None] + period * np.arange(-2, 3)) / length)).sum(axis=1)
            power = np.clip(np.fft.fft(along).real, 0, None)
            rms = np.sqrt(np.outer(power, power[: self.points // 2 + 1]))
            rms[:, 0] *= np.sqrt(2)  # a real transform takes the real part of this column
            found.append(sigma * self.points / along[0] * rms)
        return np.array(found, np.float32)

    def medium(self, white: torch.Tensor) -> torch.Tensor:
        """Return e^(i phi) complex64[screens, points, points] of one medium; of one that moves the transform of phi."""
        spectrum = white * torch.from_numpy(self._amplitudes)
        return spectrum if self.moved is not None else self._turns(spectrum)

    def _turns(self, spectrum: torch.Tensor) -> torch.Tensor:
        phases = torch.fft.irfft2(spectrum, s=(self.points, self.points))
        return torch.polar(torch.ones_like(phases), phases)

    def _moved_turns(self, spectrum: torch.Tensor, moved: np.ndarray) -> torch.Tensor:
        """Return e^(i phi(x - d)) of screens that have moved by d float64[screens, 2]."""
        f = np.fft.fftfreq(self.points, self.spacing)
        ramps = [
            np.exp(-2j * np.pi * f[:, None] * dy) * np.exp(-2j * np.pi * np.abs(f[: self.points // 2 + 1]) * dx)
            for dx, dy in moved
        ]
        return self._turns(spectrum * torch.from_numpy(np.array(ramps).astype(np.complex64)))

    def places(self, count: int) -> np.ndarray:
        """Positions float64[count] of the first points: those of the window, then those beside it."""
        place = np.arange(count) - (self.lit - 1) / 2
        return (np.mod(place + self.points / 2, self.points) - self.points / 2) * self.spacing

    def light(self, amplitudes: np.ndarray) -> torch.Tensor:
        """Return the fields complex64[T, lit, lit] of objects complex[T, M, M] on the first screen."""
        k = 2 * np.pi / self.wavelength
        waves = np.exp(1j * k * self.places(self.lit)[:, None] * self.sines)
        return torch.from_numpy((waves @ amplitudes @ waves.T).astype(np.complex64))

    def spectrum(self, fields: torch.Tensor) -> torch.Tensor:
        """Return the waves of the grid complex64[..., points, points] whose sum is a field, counted from its first."""
        return torch.fft.fft2(fields, s=(self.points, self.points)) / self.points**2

    @cached_property
    def _carriers(self) -> list[torch.Tensor]:
        """e^(ik d (cos - 1)) complex64[points, points] of every gap; 0 where waves are evanescent."""
        sines = np.fft.fftfreq(self.points, self.spacing / self.wavelength)
        return [_carrier(self.wavelength, gap, sines, sines) for gap in self.stack.gaps]

    def speckle(self, medium: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        """Return fields complex64[T, *views] of :meth:`light` behind :meth:`medium`."""
        if self.moved is None:
            return self._behind(medium, light)
        frames = zip(self.moved, light, strict=True)
        return torch.cat([self._behind(self._moved_turns(medium, by), frame[None]) for by, frame in frames])

    def _behind(self, turns: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        fields = light * turns[0, : self.lit, : self.lit]
        for screen, carrier in zip(turns[1:], self._carriers, strict=True):
            spectrum = torch.fft.fft2(fields, s=(self.points, self.points))
            fields = torch.fft.ifft2(spectrum * carrier) * screen
        seen = self.views.seen(self, fields, sum(self.stack.gaps))
        return seen if self.ballistic else seen - self.unscattered(light)

    def unscattered(self, light: torch.Tensor) -> torch.Tensor:
        """Return what is seen of light that no screen scatters."""
        return self.views.seen(self, light, 0.0) * float(np.exp(-0.5 * self.stack.optical_depth(self.wavelength)))


def _carrier(wavelength: float, way: float, y: np.ndarray, x: np.ndarray) -> torch.Tensor:
    """Phases complex64[y, x] of light along sines on its way, over e^(ik way)."""
    square = np.square(x) + np.square(y)[:, None]
    phase = -2 * np.pi / wavelength * way * square / (1 + np.sqrt(np.clip(1 - square, 0, None)))
    return torch.from_numpy(np.where(square < 1, np.exp(1j * phase), 0).astype(np.complex64))


def drawn_screens(stack: ScreenStack, wavelength: float, grid: WaveGrid, ballistic: bool = False) -> DrawnScreens:
    """Return what draws the phases of a stack before a far-field camera, on a grid that holds its light."""
    y, x = (
        middle + (np.arange(count) - (count - 1) / 2) * grid.pitch
        for count, middle in zip(grid.shape, grid.center[::-1], strict=True)
    )
    seen = float(np.abs(grid.center).max()) + grid.pitch * max(grid.shape) / 2
    return _held(stack, wavelength, grid.side, grid.sines, FarGrid(y, x, seen), ballistic)


def drawn_scene(scene: Scene) -> tuple[DrawnScreens, np.ndarray]:
    """Return what draws the phases of a scene's screens, and the amplitudes complex128[T, M, M] of its objects."""
    light, sensor, stack, views = cast(CoherentObject, scene.illumination), scene.sensor, scene.thin, None
    assert stack is not None
    sines, amplitudes = light.spectrum(scene.wavelength)
    if sensor.focused:
        views = LensViews(cast(Imaging, sensor), stack.thickness + sensor.focus)  # type: ignore[attr-defined]
    elif sensor.near:
        views = NearPoints(sensor.vectors)
    elif sensor.regular_grid is None:
        views = FarViews(sensor.vectors)
    else:
        grid = sensor.regular_grid
        x, y = grid.sines
        views = FarGrid(y, x, float(np.abs(grid.center).max()) + grid.pitch * max(grid.shape) / 2)
    moved = None if light.times is None else stack.moved(light.times)
    return _held(stack, scene.wavelength, light.side(scene.wavelength), sines, views, moved=moved), amplitudes


def unscattered_field(scene: Scene) -> np.ndarray:
    """Return what no screen of a scene scatters, complex128[T, *sensor.shape]."""
    drawn, amplitudes = drawn_scene(scene)
    return drawn.unscattered(drawn.light(amplitudes)).numpy().astype(complex)


def _held(
    stack: ScreenStack, wavelength: float, side: float, sines: np.ndarray, views: Views, ballistic: bool = False,
    moved: np.ndarray | None = None,
) -> DrawnScreens:  # fmt: skip
    """Return what draws phases on a grid that holds all light, its way to the views, and the way of the screens."""
    stack, lengths, angle = stack.stack, stack.correlation_lengths, stack.rms_angle(wavelength)
    widest = float(np.abs(sines).max())
    sine = widest + _ANGLES * angle + (_EDGES * widest if views.near else 0.0)
    seen = 0.0 if views.near else views.sine
    most = min(wavelength / (sine + max(sine, seen)), float(lengths.min()) / _PER_LENGTH)
    lit = int(np.ceil(side / most))
    depth, steep = sum(stack.gaps), widest + _SPREAD * angle
    spread = 2 * steep * depth + 2 * min(steep, views.sine) * views.beyond(depth)
    travel = 0.0 if moved is None else float(np.ptp(moved, axis=0).max(initial=0.0))
    apart = max(_APART * float(lengths.max()), spread, views.reach - (side - spread) / 2) + travel
    beside = apart / side * lit
    points = int(next_fast_len(int(np.ceil(min(lit + beside, 2**31))), real=True))  # type: ignore[arg-type]
    return DrawnScreens(wavelength, side, sines, stack, views, lit, points + points % 2, ballistic, moved)
