"""The exit plane in cells: white noise under the illuminated window, and its transform to views.

    u(v) = sum_x b(x) G(x) e^(-ik v . x)

Cells a apart make the far field periodic in v with period lambda/a. The period must hold every view of
every tilt and a guard, else views wrap around into false correlations; more cells would compute what
nobody looks at.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import next_fast_len

from specklegen.core.errors import reject
from specklegen.core.lazy import torch
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid
from specklegen.scene.window import PROFILES, Profile, Window

MAX_PERIOD = 16384
GUARD = 8
"""Speckle grains kept free between the last view and the first one's copy."""
SUPPORT = {profile: Window(profile, 1.0).support(12.5) for profile in PROFILES}
"""Sampled width over nominal width: cells cover what is brighter than e^-12.5 of the peak, 2.5 widths of a Gaussian."""


@dataclass(frozen=True)
class Axis:
    """Cells along one axis.

    Attributes
    ----------
    count : int
        Cells under the window.
    size : float
        Distance between cells.
    period : int
        Views a period: size * period * pitch = wavelength, so an FFT of this length steps by one pitch.
    """

    count: int
    size: float
    period: int

    @property
    def positions(self) -> np.ndarray:
        """float64[count], centres of the cells, symmetric about 0."""
        return (np.arange(self.count) - (self.count - 1) / 2) * self.size

    def wider(self, reach: float) -> "Axis":
        """Return the cells with a margin, so that a window may lie ``reach`` off on either side."""
        return replace(self, count=self.count + 2 * int(np.ceil(reach / self.size)))


def cells(wavelength: float, width: float, profile: Profile, pitch: float, span: float) -> Axis:
    """Cells along one axis for views ``pitch`` apart that, with all tilts, span ``span`` in direction sines."""
    grain = wavelength / width
    period = int(next_fast_len(int(np.ceil((span + GUARD * grain) / pitch)) + 1))  # type: ignore[arg-type]
    size = wavelength / (period * pitch)
    count = int(np.ceil(SUPPORT[profile] * width / size - 1e-9))
    return Axis(max(count, 1), size, period)


def stack_axes(scene: Scene, drift: np.ndarray | None = None) -> tuple[Axis, Axis]:
    """Cells of the exit plane along x and y for all tilts and views of a scene.

    ``drift`` float64[T, 2] is how far the medium has moved at each beam.
    """
    beams, grid = scene.beams, scene.sensor
    assert isinstance(grid, FarFieldGrid)
    sines = beams.directions[:, :2]
    axes = []
    for axis, name in ((0, "x"), (1, "y")):
        reach = float(np.ptp(sines[:, axis])) if len(sines) else 0.0
        span = grid.pitch * (grid.shape[1 - axis] - 1) + reach
        guarded = span + GUARD * scene.wavelength / beams.width
        if guarded / grid.pitch + 1 > MAX_PERIOD:
            reject("CollimatedBeams.directions",
                   f"within a transform of {MAX_PERIOD} views, for the stationary sampler",
                   f"tilts {reach:.3g} apart along {name}, {guarded / grid.pitch:.3g} views of pitch {grid.pitch:.3g} "
                   f"with their guard of {GUARD} grains",
                   'Use sampler="paths", a coarser pitch, or fewer and closer tilts.')  # fmt: skip
        axes.append(cells(scene.wavelength, beams.width, beams.profile, grid.pitch, span))
        if drift is not None:
            moved = float(np.abs(drift[:, axis]).max(initial=0.0))
            if moved / axes[-1].size > MAX_PERIOD / 2:
                reject("CollimatedBeams.times", f"so few that the pattern shifts by at most {MAX_PERIOD} cells", moved,
                       "Make several films of fewer frames: distant frames are independent.")  # fmt: skip
            axes[-1] = axes[-1].wider(moved)
    return axes[0], axes[1]


def sampled_amplitude(x: Axis, y: Axis, window: Window, centre: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Amplitude profile b float64[y.count, x.count] of a window about ``centre``, with sum of b^2 = 1.

    Cells that the edge of a window cuts count by the share of their area inside it.
    """
    if window.separable:
        along_y, along_x = (profile_power(axis, window, c) for axis, c in ((y, centre[1]), (x, centre[0])))
        return np.sqrt(along_y)[:, None] * np.sqrt(along_x)
    fine = (np.arange(16) - 7.5) / 16
    xs = (x.positions[:, None] + fine * x.size).ravel() - centre[0]
    ys = (y.positions[:, None] + fine * y.size).ravel() - centre[1]
    inside = np.square(window.amplitude(xs, ys[:, None]))
    power = inside.reshape(y.count, 16, x.count, 16).mean(axis=(1, 3))
    return np.sqrt(power / power.sum())


def disc_power(width: torch.Tensor, count: torch.Tensor, size: torch.Tensor, rows: int, columns: int) -> torch.Tensor:
    """b^2 of round windows over cells, float64[M, rows, columns] with sum 1.

    Of width float64[M], count int64[M, 2] and size float64[M, 2] of the cells along (y, x). Cells that the edge cuts
    count by the share of 16 x 16 points inside it.
    """
    fine = (torch.arange(16, dtype=torch.float64, device=width.device) - 7.5) / 16

    def squares(axis: int, most: int) -> torch.Tensor:
        cell = torch.arange(most, dtype=torch.float64, device=width.device) - (count[:, axis, None] - 1) / 2
        return ((cell[:, :, None] + fine) * size[:, axis, None, None]).flatten(1).square()

    y, x = squares(0, rows), squares(1, columns)
    inside = (y[:, :, None] + x[:, None] <= (width / 2).square()[:, None, None]).to(torch.float64)
    power = inside.unflatten(2, (columns, 16)).unflatten(1, (rows, 16)).mean((2, 4))
    return power / power.sum((1, 2), keepdim=True)


def profile_power(axis: Axis, window: Window, centre: float = 0.0) -> np.ndarray:
    """b^2 of a separable window about ``centre`` along one axis, float64[count] with sum 1."""
    power = window.cell_power(axis.positions - centre, axis.size)
    return power / power.sum()


NORMAL_FLOPS = 140.0
"""Operations of a matrix product that take the time of one complex normal number."""


def matrix_flops(x: Axis, y: Axis, shape: tuple[int, int]) -> float:
    """Real operations of the transform to views as two matrix products, in the order that takes fewer."""
    return 8.0 * min(shape[1] * y.count * (x.count + shape[0]), shape[0] * x.count * (y.count + shape[1]))


def fft_flops(x: Axis, y: Axis) -> float:
    """Count an FFT in operations of a matrix product that take its time: it reaches about a third of their speed."""
    size = x.period * y.period
    return 3 * 5.0 * size * np.log2(size)
