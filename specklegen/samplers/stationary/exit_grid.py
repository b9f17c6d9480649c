"""The exit plane in cells: white noise under the illuminated window, and its transform to views.

    u(v) = sum_x b(x) G(x) e^(-ik v . x)

Cells a apart make the far field periodic in v with period lambda/a. The period must hold every view of
every tilt and a guard, else views wrap around into false correlations; more cells would compute what
nobody looks at.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len

from specklegen.core.errors import reject
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


def cells(wavelength: float, width: float, profile: Profile, pitch: float, span: float) -> Axis:
    """Cells along one axis for views ``pitch`` apart that, with all tilts, span ``span`` in direction sines."""
    grain = wavelength / width
    period = int(next_fast_len(int(np.ceil((span + GUARD * grain) / pitch)) + 1))  # type: ignore[arg-type]
    size = wavelength / (period * pitch)
    count = int(np.ceil(SUPPORT[profile] * width / size - 1e-9))
    return Axis(max(count, 1), size, period)


def stack_axes(scene: Scene) -> tuple[Axis, Axis]:
    """Cells of the exit plane along x and y for all tilts and views of a scene.

    Raises
    ------
    RuleError
        If the tilts reach too far for a transform of reasonable size.
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
            reject(
                "CollimatedBeams.directions",
                f"within the reach of a transform of {MAX_PERIOD} views for the stationary sampler",
                f"tilts {reach:.3g} apart along {name}, {guarded / grid.pitch:.3g} views of pitch {grid.pitch:.3g} "
                f"with their guard of {GUARD} grains",
                'Use sampler="paths", a coarser pitch, or fewer and closer tilts.',
            )
        axes.append(cells(scene.wavelength, beams.width, beams.profile, grid.pitch, span))
    return axes[0], axes[1]


def sampled_amplitude(x: Axis, y: Axis, window: Window) -> np.ndarray:
    """Amplitude profile b float64[y.count, x.count], with sum of b^2 = 1.

    Cells that the edge of a window cuts count by the share of their area inside it.
    """
    if window.separable:
        return np.sqrt(profile_power(y, window))[:, None] * np.sqrt(profile_power(x, window))
    fine = (np.arange(16) - 7.5) / 16
    xs = (x.positions[:, None] + fine * x.size).ravel()
    ys = (y.positions[:, None] + fine * y.size).ravel()
    inside = np.square(window.amplitude(xs, ys[:, None]))
    power = inside.reshape(y.count, 16, x.count, 16).mean(axis=(1, 3))
    return np.sqrt(power / power.sum())


def profile_power(axis: Axis, window: Window) -> np.ndarray:
    """b^2 of a separable window along one axis, float64[count] with sum 1."""
    power = window.cell_power(axis.positions, axis.size)
    return power / power.sum()


def matrix_flops(x: Axis, y: Axis, shape: tuple[int, int]) -> float:
    """Real operations of the transform to views as two matrix products."""
    return 8.0 * shape[0] * x.count * (y.count + shape[1])


def fft_flops(x: Axis, y: Axis) -> float:
    """Those of an FFT, as many of a matrix product as take its time: it reaches about a third of their speed."""
    size = x.period * y.period
    return 3 * 5.0 * size * np.log2(size)
