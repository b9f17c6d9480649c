"""Transfer function of an aperture of finite width, and objects as it can show them.

The window's transfer function T is the autocorrelation of its intensity, in frequencies over the cut-off width /
wavelength. Speckle through it turns the modulus |O| of an object into |O| sqrt(T) (:mod:`autocorrelation`): the
modulus of an image that is negative in places. Times sqrt(T) once more it is that of O * P, the image by diffraction
through the same window, which is nowhere negative: what phase retrieval can look for.
"""

import numpy as np
import torch
from torch import Tensor

from specklegen.core.errors import reject
from specklegen.scene.window import Profile, Window


def transfer_function(window: int, pixels_per_grain: float, profile: Profile = "square") -> Tensor:
    """T at the frequencies of an FFT of n x n pixels, float64[n, n]; 1 at frequency 0.

    Parameters
    ----------
    window
        n.
    pixels_per_grain
        Camera pixels per grain, wavelength / width.
    profile
        Shape of the window; width is the side, the diameter, or the 1/e^2 intensity diameter.
    """
    if not pixels_per_grain > 0:
        reject("transfer_function pixels_per_grain", "above 0", pixels_per_grain)
    shift = np.fft.fftfreq(window) * pixels_per_grain  # of the window against itself, in widths
    return torch.from_numpy(Window(profile, 1.0).overlap(shift, shift[:, None]))


def framed(objects: Tensor, window: int) -> Tensor:
    """Objects real[..., h, w] in the first corner of a dark frame, real[..., n, n]."""
    rows, columns = objects.shape[-2:]
    if max(rows, columns) > window:
        reject("framed objects", f"at most {window} pixels a side", (rows, columns))
    return torch.nn.functional.pad(objects, (0, window - columns, 0, window - rows))


def diffraction_limited(objects: Tensor, transfer: Tensor) -> Tensor:
    """Objects real[..., h, w] as a window of transfer function real[n, n] can show them, real[..., n, n]."""
    spectrum = torch.fft.fft2(framed(objects, len(transfer))) * transfer.to(objects)
    return torch.fft.ifft2(spectrum).real
