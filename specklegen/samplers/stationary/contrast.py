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
from specklegen.samplers.stationary.modes import tabulated
from specklegen.samplers.stationary.spectrum import LightModes

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")


def speckle_variance(
    light: LightModes,
    amplitude: np.ndarray,
    lags: tuple[int, int],
    lag_y: np.ndarray,
    lag_x: np.ndarray,
    area_y: np.ndarray,
    area_x: np.ndarray,
    twice: np.ndarray,
    wavenumber: float,
    shape: tuple[int, int],
    pitch: float,
) -> np.ndarray:
    """V by the difference (row, column) of two object pixels, float64[2h - 1, 2w - 1].

    Parameters
    ----------
    light
        Modes of the light.
    amplitude
        Window b over the cells, with sum of b^2 = 1.
    lags, lag_y, lag_x
        Size of the lag grid, and the lags of its rows and of its columns of either sign.
    area_y, area_x
        Transforms of the camera pixel's area at the lags.
    twice
        How often a column of lags counts.
    wavenumber, shape, pitch
        2 pi / wavelength; shape (h, w) and pitch (sine) of the object.
    """
    power = np.square(np.abs(np.fft.rfft2(np.square(amplitude), lags)))
    # irfft2 gives the autocorrelation over lags of both signs; the lag grid keeps its first half of columns.
    pairs = np.fft.irfft2(power, lags)[:, : len(lag_x)] * np.square(area_y)[:, None] * np.square(area_x) * twice
    dy, dx = (wavenumber * pitch * np.arange(1 - n, n) for n in shape)
    # Real and even along both axes, since the window is.
    waves_y, waves_x = torch.from_numpy(np.cos(dy[:, None] * lag_y)), torch.from_numpy(np.cos(lag_x[:, None] * dx))
    with one_torch_thread():
        window = (waves_y @ torch.from_numpy(pairs) @ waves_x).numpy()
    distance = np.hypot(dy[:, None], dx)
    memory = sum(
        share**2 * np.square(tabulated(kernel, float(distance.max()))(distance))
        for share, kernel in zip(light.shares, light.kernels, strict=True)
    )
    return window * memory
