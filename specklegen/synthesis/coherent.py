"""Speckle of coherent objects: fields of plane waves that add behind one medium, by one transform or a few.

With T(x, y) what reaches the exit plane at x of light that enters at y, white over both but for how far it walks,

    u(v) = sum_x e^(-ik v . x) U(x),   U(x) = sum_y T(x, y) E(y),   <T(x, y) T*(x', y')> = delta_xx' delta_yy' P(x - y)

P is the transform of the memory effect, K(q) = sum_R P(R) e^(-iq . R). Of one object alone U is white noise under
the light that has walked, J = P * |E|^2. Objects that see the same medium share its modes,

    U_t(x) = sum_r G_r(x) L_rt(x),   L_rt(x) = sum_n a_nt phi_r(n) e^(ik s_n . x),
    K(s_n - s_m) = sum_r phi_r(n) phi_r(m)

of the angular spectrum a_n. Frames of a film, and objects where K is neither round nor real (behind analysers), have in
every cell the covariance J_tt'(x) = P_tt' * (E_t E_t'^*), of which a triangular root mixes white noise. G_r is
white, or behind a thin screen has the spectrum f(v - s), the light about each wave.
Of one screen K is 1: the field is the product of the object's field with that of the screen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from specklegen.core.lazy import torch
from specklegen.scene.window import Window
from specklegen.synthesis.exit_grid import Axis, cells, fft_flops, profile_power

if TYPE_CHECKING:
    from specklegen.synthesis.correlations import Correlations

MODE_TOLERANCE = 1e-3
"""Share of the intensity that modes leave out, and that is put back evenly."""
_NODES = 512  # of tables over |q| and |p|
_DIM = 1e-6  # of the light: what walks farther is left out

Radial = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class WaveGrid:
    """Plane waves through a square window, cells of the exit plane, and a far-field camera.

    Attributes
    ----------
    wavelength, side : float
        Inside the medium, and of the window.
    sines : float64[M]
        Of the waves along either axis.
    shape, pitch, center
        Of the camera, as of :class:`~specklegen.sensors.FarField` grids.
    """

    wavelength: float
    side: float
    sines: np.ndarray
    shape: tuple[int, int]
    pitch: float
    center: tuple[float, float]

    @cached_property
    def axes(self) -> tuple[Axis, Axis]:
        """Cells along y and x, fine enough for every view and for the irradiance of all waves."""
        reach = float(np.ptp(self.sines))
        return tuple(  # type: ignore[return-value]
            cells(self.wavelength, self.side, "square", self.pitch, self.pitch * (n - 1) + reach) for n in self.shape
        )

    @cached_property
    def period(self) -> tuple[int, int]:
        """Views a period along y and x."""
        return self.axes[0].period, self.axes[1].period

    @cached_property
    def area(self) -> float:
        """Area of a cell."""
        return self.axes[0].size * self.axes[1].size

    @cached_property
    def _waves(self) -> list[np.ndarray]:
        """e^(ik s x) under the window, complex64[cells, M] of either axis."""
        k, window, waves = 2 * np.pi / self.wavelength, Window("square", self.side), []
        for axis in self.axes:
            share = profile_power(axis, window)  # cells that the edge cuts count by their share
            edge = np.sqrt(share / share.max())
            waves.append((edge[:, None] * np.exp(1j * k * axis.positions[:, None] * self.sines)).astype(np.complex64))
        return waves

    def field(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return E complex64[..., y, x] under the window, of amplitudes complex[..., M, M]."""
        rows, columns = self._waves
        return rows @ amplitudes.astype(np.complex64) @ columns.T

    @cached_property
    def lateral(self) -> np.ndarray:
        """Return |q| float64[Y, X / 2 + 1] of a real transform over the period, radians per length."""
        y, x = self.axes
        along, across = np.fft.fftfreq(y.period, y.size), np.fft.rfftfreq(x.period, x.size)
        return 2 * np.pi * np.hypot(along[:, None], across)

    @property
    def around(self) -> np.ndarray:
        """Return |q| float64[Y, X] of a complex transform over the period."""
        y, x = self.axes
        return 2 * np.pi * np.hypot(np.fft.fftfreq(y.period, y.size)[:, None], np.fft.fftfreq(x.period, x.size))

    def walked(self, irradiance: np.ndarray, walk: np.ndarray) -> np.ndarray:
        """Return J float64[Y, X] over a period: irradiance float[y, x] that walks as ``walk`` says, K at ``lateral``.

        Cells are counted from the first of the window. In double precision, since fields go with the root of J: what
        single precision rounds at dark cells would be 3e-4 of the brightest amplitude.
        """
        spectrum = torch.fft.rfft2(torch.from_numpy(np.float64(irradiance)), s=self.period)
        walked = torch.fft.irfft2(spectrum * torch.from_numpy(walk), s=self.period)
        return walked.clamp_(min=0.0).numpy()

    @cached_property
    def _ramps(self) -> dict[tuple, tuple[np.ndarray, np.ndarray]]:
        return {}

    def _ramps_of(self, cells: tuple[int, int], start: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """e^(-ik v x) of the first view over some cells, and of the first of them at every view."""
        k, inside, beyond = 2 * np.pi / self.wavelength, [], []
        for axis, held, begin, count, center in zip(
            self.axes, cells, start, self.shape, self.center[::-1], strict=True
        ):
            first = center - (count - 1) / 2 * self.pitch
            places = axis.positions[0] + (begin + np.arange(held)) * axis.size if begin or held != axis.count \
                else axis.positions
            inside.append(np.exp(-1j * k * first * places))
            beyond.append(np.exp(-1j * k * self.pitch * np.arange(count) * places[0]))
        return np.multiply.outer(*inside).astype(np.complex64), np.multiply.outer(*beyond).astype(np.complex64)

    def far_field(self, fields: torch.Tensor, start: tuple[int, int] = (0, 0)) -> torch.Tensor:
        """Return sum_x e^(-ik v . x) U(x) complex64[..., H, W], of U on cells from ``start`` of the window's on."""
        key = (*fields.shape[-2:], *start)
        if key not in self._ramps:
            self._ramps[key] = self._ramps_of((key[0], key[1]), start)
        inside, beyond = (torch.from_numpy(each) for each in self._ramps[key])
        return self.transform(fields * inside) * beyond

    def transform(self, fields: torch.Tensor) -> torch.Tensor:
        """Return the far field of noise, whose phases do not matter: views counted from the first."""
        rows, columns = self.shape
        return torch.fft.fft2(fields, s=self.period)[..., :rows, :columns]

    @cached_property
    def flops(self) -> float:
        """Operations of one transform."""
        return fft_flops(*self.axes)

    def distances(self) -> np.ndarray:
        """Return |v - s| float64[Y, X] of the spectrum of a screen, in the order of a transform over a period."""
        along = []
        for axis, center in zip(self.axes, self.center[::-1], strict=True):
            whole = self.wavelength / axis.size
            p = np.fft.fftfreq(axis.period) * whole
            along.append(center + np.mod(p - center + whole / 2, whole) - whole / 2)
        return np.hypot(along[0][:, None], along[1])


def radial(values: Radial, at: np.ndarray) -> np.ndarray:
    """Return a smooth function of a distance at many, by a table."""
    reach = np.linspace(0.0, float(at.max(initial=0.0)) or 1.0, _NODES)
    return np.interp(at, reach, values(reach))


def wave_modes(
    correlations: Correlations, grid: WaveGrid, tolerance: float = MODE_TOLERANCE, device: torch.device | str = "cpu"
) -> np.ndarray:
    """Return phi_r float64[R, M, M] over the plane waves, of K of one medium, which is known on some device."""
    from specklegen.synthesis.modes import Lattice, karhunen_loeve

    count, k = len(grid.sines), 2 * np.pi / grid.wavelength
    step = torch.tensor([k * float(np.ptp(grid.sines)) / max(count - 1, 1)], dtype=torch.float64, device=device)
    lattice = Lattice((count, count), step, torch.zeros((1, 1, 2), dtype=torch.float64, device=device))
    ((_, modes),) = karhunen_loeve(correlations, lattice, tolerance)
    values = modes.values(int(modes.rank[0]))[0]
    return values.cpu().numpy().T.reshape(-1, count, count)


@dataclass(frozen=True, eq=False)
class OneObject:
    """Draws the speckle of one object behind media of one kind: white noise under the light that has walked.

    Attributes
    ----------
    grid : WaveGrid
    root : float32[y, x]
        Root of J times the area of a cell and the scattered intensity, on the cells that hold the light.
    """

    grid: WaveGrid
    root: np.ndarray

    @property
    def normals(self) -> tuple[int, ...]:
        """Shape of the noise."""
        return 1, *self.root.shape

    def speckle(self, white: torch.Tensor) -> torch.Tensor:
        """Return the field complex64[1, H, W] of noise complex64[1, y, x]."""
        return self.grid.transform(white * torch.from_numpy(self.root))


def one_object(grid: WaveGrid, amplitudes: np.ndarray, walk: np.ndarray, intensity: float) -> OneObject:
    """Prepare one object of amplitudes complex[M, M] whose light walks as ``walk`` says; see :meth:`WaveGrid.walked`.

    ``intensity`` is the scattered intensity of a beam of unit irradiance, over its area.
    """
    field = grid.field(amplitudes)
    light = grid.walked(np.square(field.real) + np.square(field.imag), walk)
    for axis in (0, 1):  # the cells that hold the light, from wherever in the period
        along = light.sum(axis=1 - axis)
        held = _shortest(along, (1 - _DIM) * along.sum())
        light = np.take(light, held, axis=axis)
    return OneObject(grid, np.sqrt(light * (intensity * grid.area)).astype(np.float32))


def _shortest(along: np.ndarray, enough: float) -> np.ndarray:
    """Cells int64[n] of a period, in their order, without the darkest that follow each other."""
    count = len(along)
    turned = np.roll(along, -int(along.argmax()))
    left = (turned.sum() - enough) / 2
    after = int(np.searchsorted(turned[: count // 2 + 1].cumsum(), turned[: count // 2 + 1].sum() - left)) + 1
    before = int(np.searchsorted(turned[count // 2 + 1 :][::-1].cumsum(), turned[count // 2 + 1 :].sum() - left)) + 1
    if after + before >= count:
        return np.arange(count)
    return (int(along.argmax()) + np.arange(-before, after)) % count


@dataclass(frozen=True, eq=False)
class JointObjects:
    """Draws the speckle of a few objects behind one medium, or of one in a film: noise mixed cell by cell.

    Attributes
    ----------
    grid : WaveGrid
    roots : complex64[T, T, y, x]
        Lower triangular roots of the covariance of the fields in each cell: frames that come later change none before.
    first : (int, int)
        Cells from the first of the window to the first of these, along (y, x).
    """

    grid: WaveGrid
    roots: torch.Tensor
    first: tuple[int, int]

    @property
    def normals(self) -> tuple[int, ...]:
        """Shape of the noise."""
        return tuple(self.roots.shape[1:])

    def medium(self, white: torch.Tensor) -> torch.Tensor:
        """Return the noise itself."""
        return white

    def light(self, amplitudes: np.ndarray) -> torch.Tensor:  # noqa: ARG002 - the roots hold it
        """Return the roots."""
        return self.roots

    def speckle(self, medium: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        """Return fields complex64[T, H, W], of phases at the exit face."""
        return torch.stack([self.grid.far_field((row * medium).sum(0), self.first) for row in light])


def joint_objects(
    grid: WaveGrid, amplitudes: np.ndarray, walk: Callable[[int, int], np.ndarray], intensity: float
) -> JointObjects:
    """Prepare objects of amplitudes complex[T, M, M]; ``walk(t, t')`` is K of two of them, complex[Y, X].

    ``intensity`` is the scattered intensity of a beam of unit irradiance, over its area.
    """
    fields, count = torch.from_numpy(grid.field(amplitudes)).to(torch.complex128), len(amplitudes)
    period = grid.period

    def covariance(t: int, other: int) -> torch.Tensor:
        spectrum = torch.fft.fft2(fields[t] * fields[other].conj(), s=period)
        return torch.fft.ifft2(spectrum * torch.from_numpy(walk(t, other)))

    own = [covariance(t, t).real.clamp_(min=0.0) for t in range(count)]
    light = torch.stack(own).sum(0).numpy()
    held = []
    for axis in (0, 1):
        along = light.sum(axis=1 - axis)
        held.append(_shortest(along, (1 - _DIM) * along.sum()))
    rows, columns = (torch.from_numpy(np.ascontiguousarray(each)) for each in held)
    roots = torch.zeros((count, count, len(rows), len(columns)), dtype=torch.complex128)
    for t in range(count):
        lit = own[t][rows[:, None], columns]
        for other in range(t):
            shared = covariance(t, other)[rows[:, None], columns]
            left = shared - (roots[t, :other] * roots[other, :other].conj()).sum(0)
            pivot = roots[other, other].real
            roots[t, other] = torch.where(pivot > 0, left / pivot.clamp_min(1e-150), 0.0)
        used = roots[t].abs().square().sum(0)  # more than there is only by rounding, where cells are dark
        roots[t] *= torch.sqrt(torch.where(used > lit, lit / used.clamp_min(1e-300), 1.0))
        roots[t, t] = torch.sqrt((lit - used).clamp_min(0.0))
    roots *= (intensity * grid.area) ** 0.5
    first = tuple(int(each[0]) - (n if each[0] > n // 2 else 0) for each, n in zip(held, period, strict=True))
    return JointObjects(grid, roots.to(torch.complex64).contiguous(), first)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class ManyObjects:
    """Draws the speckle of any object behind one medium, by the modes of its memory effect over the plane waves.

    Attributes
    ----------
    grid : WaveGrid
    modes : float64[R, M, M]
    gain : float
        Root of the scattered intensity of a beam of unit irradiance over its area, times the area of a cell.
    spectrum : float32[Y, X] or None
        Of a screen: root of f / f(0) over a period; None of white noise.
    mirrored : float32[Y, X] or None
        Of one weak screen: what multiplies the mirror image of the noise.
    """

    grid: WaveGrid
    modes: np.ndarray
    gain: float
    spectrum: np.ndarray | None = None
    mirrored: np.ndarray | None = None

    @property
    def normals(self) -> tuple[int, ...]:
        """Shape of the noise."""
        y, x = self.grid.axes
        cells_of = (y.count, x.count) if self.spectrum is None else self.grid.period
        return len(self.modes), *cells_of

    def medium(self, white: torch.Tensor) -> torch.Tensor:
        """Return G_r complex64[R, y, x] of a medium under the window, from noise."""
        if self.spectrum is None:
            return white * self.gain
        drawn = white * torch.from_numpy(self.spectrum)
        if self.mirrored is not None:
            opposite = torch.roll(white.flip(1, 2), (1, 1), (1, 2)).conj()
            drawn = drawn + opposite * torch.from_numpy(self.mirrored)
        y, x = self.grid.axes
        rows, columns = self.grid.period
        return torch.fft.ifft2(drawn)[:, : y.count, : x.count] * (self.gain * (rows * columns) ** 0.5)

    def light(self, amplitudes: np.ndarray) -> torch.Tensor:
        """Return L_rt complex64[T, R, y, x] of objects complex[T, M, M]."""
        return torch.from_numpy(self.grid.field(amplitudes[:, None] * self.modes))

    def speckle(self, medium: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        """Return fields complex64[T, H, W] of :meth:`light` behind :meth:`medium`."""
        return self.grid.far_field((medium * light).sum(1))


def wave_grid(light: Any, wavelength: float, camera: Any) -> tuple[WaveGrid, np.ndarray]:
    """Return the grid of a coherent object before a far-field camera, and its amplitudes complex128[T, M, M]."""
    sines, amplitudes = light.spectrum(wavelength)
    grid = WaveGrid(wavelength, light.side(wavelength), sines, camera.shape, camera.pitch, camera.center)
    return grid, amplitudes
