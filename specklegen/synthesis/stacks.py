"""Stacks of speckle with the memory-effect correlation of a wide slab.

    u_t(v) = sum_x e^(-ik(v - i_t) . x) b(x) G_t(x),    E[G_t G*_t'] = K(i_t - i_t'),  white in x

A thousand stacks a second on one core, whatever the optical depth: K is found once per material (and, away from
the axis, per direction of light and view). Valid where the planner's criterion says so (wide window, narrow field
of view).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from specklegen.core.lazy import torch
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid
from specklegen.synthesis.exit_grid import Axis, fft_flops, matrix_flops, sampled_amplitude, stack_axes
from specklegen.synthesis.gaussian_noise import complex_normals

SMALL_PHASE = 1e-3
"""Radians that nobody sees beside the field tolerance of path sums."""


class Weighed(Protocol):
    """Correlations of paths that have weights."""

    @property
    def weights(self) -> np.ndarray:
        """Contributions, of any shape."""
        ...

    @property
    def paths(self) -> int:
        """Divisor of their sum that gives the intensity per unit area."""
        ...


class Matrices(Weighed, Protocol):
    """Correlations that know the matrix between beams."""

    def matrix(self, sines: np.ndarray, wavenumber: float) -> np.ndarray:
        """Matrix between beams at direction sines float64[T, 2], for the ``roots`` of :func:`stack_sampler`."""
        ...


def mean_intensity(correlation: Weighed, area: float) -> float:
    """Intensity I at the centre of the view: contribution per path and area of the window."""
    return float(correlation.weights.sum() / correlation.paths * area) if correlation.paths else 0.0


@dataclass(frozen=True)
class StackSampler:
    """Draws stacks; one matrix product or FFT per realization. Made by :func:`stack_sampler`.

    Attributes
    ----------
    x, y : Axis
        Cells of the exit plane.
    mixing : complex[T, R]
        Root of the tilt correlation: G = mixing @ independent white fields.
    window : float64[T, y.count, x.count]
        b(x) and the root of the intensity.
    shifts : float64[T, 2]
        k (i_t - v_0), from the first view to each tilt, radians per length.
    rows, columns : complex[H, y.count], complex[W, x.count]
        Transforms from cells to views, for the matrix form.
    fft : bool
        The FFT is cheaper than the matrix products.
    face : complex[H, W] or None
        e^(-ik(v_z - c_z) f) of each view v, c the middle one: cells lie in the exit face z = f, and phases are those
        of the origin, as those of path sums. None where that is 1 within a thousandth.
    """

    x: Axis
    y: Axis
    mixing: torch.Tensor
    window: np.ndarray
    shifts: np.ndarray
    rows: torch.Tensor
    columns: torch.Tensor
    shape: tuple[int, int]
    fft: bool
    face: torch.Tensor | None = None

    @cached_property
    def columns_first(self) -> bool:
        """True if the two matrix products to views are fewer operations if that along x comes first."""
        (rows, columns), x, y = self.shape, self.x.count, self.y.count
        return columns * y * (x + rows) < rows * x * (y + columns)

    @cached_property
    def ramps(self) -> torch.Tensor:
        """Window, tilt and first view: b(x) e^(ik(i_t - v_0) . x), complex[T, y.count, x.count]."""
        return self._ramps(slice(None))

    def _ramps(self, tilts: slice) -> torch.Tensor:
        along_x, along_y = self.shifts[tilts, :, None, None].swapaxes(0, 1)
        ramps = self.window[tilts] * np.exp(1j * (along_y * self.y.positions[:, None] + along_x * self.x.positions))
        return torch.as_tensor(ramps).to(device=self.rows.device, dtype=self.rows.dtype)

    def sample(self, seed: Seed, realization: int = 0) -> torch.Tensor:
        """One stack, complex[T, H, W]; a pure function of (seed, realization)."""
        white = self.white(seed, realization)
        with one_torch_thread():
            return self._fields(white, slice(None), self.ramps)

    def one_by_one(self, seed: Seed, realization: int = 0) -> Iterator[torch.Tensor]:
        """The stack of :meth:`sample` within rounding, tilt by tilt, complex[1, H, W]: the noise is held, no stack."""
        white = self.white(seed, realization)
        for t in range(len(self.shifts)):
            with one_torch_thread():
                yield self.fields(white, slice(t, t + 1))

    def fields(self, white: torch.Tensor, tilts: slice) -> torch.Tensor:
        """Fields of some tilts, complex[T, H, W], from :meth:`white`, on one thread of torch."""
        return self._fields(white, tilts, self._ramps(tilts))

    def white(self, seed: Seed, realization: int) -> torch.Tensor:
        """The noise that all tilts mix, complex[R, y.count * x.count]."""
        rank = self.mixing.shape[1]
        return complex_normals(
            seed, realization, (rank, self.y.count * self.x.count), self.rows.dtype, self.rows.device
        )

    def _fields(self, white: torch.Tensor, tilts: slice, ramps: torch.Tensor) -> torch.Tensor:
        fields = (self.mixing[tilts] @ white).reshape(ramps.shape) * ramps
        if not self.fft:
            views = self.rows @ (fields @ self.columns.T) if self.columns_first else self.rows @ fields @ self.columns.T
            return views if self.face is None else views * self.face
        spectrum = torch.fft.fft2(fields, s=(self.y.period, self.x.period))
        # An FFT measures positions from its first cell, the matrices from the middle of the window.
        phase = self.rows[:, :1] * self.columns[:, 0]
        phase = phase if self.face is None else phase * self.face
        return spectrum[:, : self.shape[0], : self.shape[1]] * phase


def tilt_roots(correlation: np.ndarray) -> np.ndarray:
    """Root [T, R] of a correlation, real or complex; the negative eigenvalues of rounding are clipped."""
    values, vectors = np.linalg.eigh(correlation)
    kept = values > 1e-12 * max(values.max(initial=0.0), 1e-300)
    return vectors[:, kept] * np.sqrt(values[kept])


def stack_sampler(
    scene: Scene, correlation: Matrices, *, device: torch.device | str = "cpu", dtype: torch.dtype | None = None,
    fft: bool | None = None, drift: np.ndarray | None = None, roots: Callable[[np.ndarray], np.ndarray] = tilt_roots,
) -> StackSampler:  # fmt: skip
    """Prepare the sampler of a scene with collimated beams and a far-field grid.

    Raise a `RuleError` if the tilts reach too far for a transform of reasonable size.

    Parameters
    ----------
    scene, correlation
        The scene, and K of its medium: that of the axis, or one about the middle of its beams and views.
    device, dtype
        Where and in what precision to draw; the random numbers are the same everywhere.
    fft
        Choose the form; by default the one with fewer operations. Windows wider than a period of the
        transform need the matrix form and get it.
    drift
        float64[T, 2], how far the medium has moved at each beam: the window lies so far off in its noise.
    roots
        Root [T, R] of the correlation complex128[T, T]; of films one that later frames leave as it is.
    """
    dtype = dtype or torch.complex64
    beams, grid = scene.beams, scene.grid
    sines = beams.directions[:, :2]
    x, y = stack_axes(scene, drift)
    first = np.array([axis[0] for axis in grid.sines])
    k = scene.wavenumber
    ramp = np.sqrt(mean_intensity(correlation, beams.window.area))
    if drift is None:
        window = np.broadcast_to(ramp * sampled_amplitude(x, y, beams.window), (len(sines), y.count, x.count))
    else:
        window = ramp * np.stack([sampled_amplitude(x, y, beams.window, (-sx, -sy)) for sx, sy in drift])
    steps = [np.arange(n) * grid.pitch for n in grid.shape]
    rows = np.exp(-1j * k * steps[0][:, None] * y.positions)
    columns = np.exp(-1j * k * steps[1][:, None] * x.positions)
    mixing = roots(correlation.matrix(sines, k)) if len(sines) else np.zeros((0, 1))
    if fft is None:
        fft = fft_flops(x, y) < matrix_flops(x, y, grid.shape)
    # A Gaussian window reaches 2.5 widths; the transform of a coarse grid spans 2 and would cut it off.
    fft = fft and x.count <= x.period and y.count <= y.period
    tensor = lambda a: torch.as_tensor(np.ascontiguousarray(a)).to(device=device, dtype=dtype)  # noqa: E731
    turned = face_phase(scene.thickness if grid.side == "transmission" else 0.0, k, grid)
    face = None if np.abs(turned).max() < SMALL_PHASE else tensor(np.exp(1j * turned))
    shifts = k * (sines - first)
    return StackSampler(x, y, tensor(mixing), window, shifts, tensor(rows), tensor(columns), grid.shape, fft, face)


def face_phase(face: float, wavenumber: float, grid: FarFieldGrid) -> np.ndarray:
    """-k (v_z - c_z) f of every view, float64[H, W], c the middle one, without cancellation."""
    x, y = grid.sines
    center = grid.center_direction
    lateral = (np.square(x) - center[0] ** 2) + (np.square(y) - center[1] ** 2)[:, None]
    vz = np.sqrt(np.clip(center[2] ** 2 - lateral, 0, None))
    return grid.sign * wavenumber * face * lateral / (vz + abs(center[2]))
