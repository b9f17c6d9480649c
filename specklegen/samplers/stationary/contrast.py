"""The contrast that speckle is expected to have at one camera pixel.

Two object pixels a lateral wavevector kappa apart give, at one camera pixel, images whose covariance over
the product of their means is

    V(kappa) = sum_n mu_n^2 |K_n(kappa)|^2  sum_s A(s) a(s)^2 e^(i kappa . s)

A(s) the autocorrelation of the window's intensity b^2, a(s) the transform of the pixel's area, n the modes
of the light. A finite window makes different beams independent from one speckle grain on, whatever the
memory effect says.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.lazy import LazyModule
from specklegen.core.parallel import one_torch_thread
from specklegen.samplers.stationary.exit_grid import Axis, profile_power, sampled_amplitude
from specklegen.samplers.stationary.modes import on_differences
from specklegen.samplers.stationary.spectrum import LightModes
from specklegen.scene.window import Window

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")


def speckle_variance(
    light: LightModes, x: Axis, y: Axis, window: Window, wavenumber: float, shape: tuple[int, int],
    pitch: float, pixel: float,
) -> np.ndarray:  # fmt: skip
    """V by the difference (row, column) of two object pixels, float64[2h - 1, 2w - 1].

    Parameters
    ----------
    light
        Modes of the light.
    x, y, window
        Cells of the exit plane, and the window over them.
    wavenumber, shape, pitch
        2 pi / wavelength; shape (h, w) and pitch (sine) of the object.
    pixel
        Side of a camera pixel over the wavelength; 0 for a point.
    """
    steps = [wavenumber * pitch * np.arange(n) for n in shape]
    if not window.separable:
        shown = _lag_sum(x, y, window, steps, pixel)
    else:
        along_y, along_x = (
            lag_transform(profile_power(axis, window), axis.size, step, pixel)
            for axis, step in zip((y, x), steps, strict=True)
        )
        shown = along_y[:, None] * along_x
    memory = sum(
        share**2 * np.square(on_differences(kernel, shape, wavenumber * pitch))
        for share, kernel in zip(light.shares, light.kernels, strict=True)
    )
    # Real and even along both axes, since the window is.
    rows, columns = (np.abs(np.arange(1 - n, n)) for n in shape)
    return (shown * memory)[rows[:, None], columns]


def lag_transform(power: np.ndarray, size: float, step: np.ndarray, pixel: float) -> np.ndarray:
    """Sum over lags s of A(s) a(s)^2 cos(kappa s) along one axis, at lateral wavevectors ``step``, float64[n]."""
    lag = size * np.arange(len(power))
    pairs = np.correlate(power, power, "full")[len(power) - 1 :] * np.square(np.sinc(pixel * lag))
    pairs[1:] *= 2  # lags of either sign
    return (np.cos(step[:, None] * lag) * pairs).sum(axis=1)


def _lag_sum(x: Axis, y: Axis, window: Window, steps: list[np.ndarray], pixel: float) -> np.ndarray:
    """The sum over lags of both axes, for a window that is no product of a row and a column."""
    lags = 2 * y.count, 2 * x.count
    power = np.square(np.abs(np.fft.rfft2(np.square(sampled_amplitude(x, y, window)), lags)))
    lag_y = np.fft.fftfreq(lags[0], 1 / lags[0]) * y.size
    lag_x = np.arange(x.count + 1) * x.size
    twice = np.where(lag_x == 0, 1.0, 2.0)
    # irfft2 gives the autocorrelation over lags of both signs; half of the columns say it all.
    pairs = np.fft.irfft2(power, lags)[:, : len(lag_x)] * twice
    pairs *= np.square(np.sinc(pixel * lag_y))[:, None] * np.square(np.sinc(pixel * lag_x))
    waves_y = torch.from_numpy(np.cos(steps[0][:, None] * lag_y))
    waves_x = torch.from_numpy(np.cos(lag_x[:, None] * steps[1]))
    with one_torch_thread():
        return (waves_y @ torch.from_numpy(pairs) @ waves_x).numpy()
