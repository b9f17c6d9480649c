"""Camera noise, read off the image itself: beyond the window's band there is nothing else.

Speckle through a window of width W has no frequency above W / wavelength, one cycle a grain (Goodman, *Introduction to
Fourier Optics*, 2005, section 6.3). Photon and read noise are white. So the mean power of the frequencies above is the
noise's, whatever the gain of the camera, its photons and its background. Images are weighted by a Hann window first,
whose transform falls off so fast (Harris, *Proc. IEEE* 66, 51, 1978) that no light leaks there.
"""

from typing import Literal

import torch
from torch import Tensor

from specklegen.core.errors import reject
from specklegen.instrument.camera import Camera

Stated = Camera | Literal["none", "unknown"]
"""A camera that states its noise, none, or one that states nothing."""

BEYOND = 1.08
"""Frequencies that are taken, over the highest that the window passes; above 1 for the width of Hann's peak."""
READABLE = 2.4
"""Pixels in a grain from which on a camera of 32 pixels a side has enough of them."""
FEWEST = 32
"""Frequencies that there must be, for a spread of a fifth."""


def camera_noise(images: Tensor, grain: Tensor | float, camera: Stated = "unknown") -> Tensor:
    """Variance that camera noise adds to a pixel, over the squared mean of the image; float[...].

    Its relative standard error is about sqrt(2 / frequencies), a hundredth for 128 x 128 pixels and 3 pixels a grain.

    Parameters
    ----------
    images
        real[..., H, W].
    grain
        Camera pixels in a grain, wavelength / window width, real[...] or one number.
    camera
        What states the noise where it cannot be read, grains being so small that the window passes all frequencies:
        what exposed the images, or "none" if nothing did.

    Raises
    ------
    RuleError
        If noise can be neither read nor is stated.
    """
    rows, columns = images.shape[-2:]
    flat = images.double()
    flat = flat / flat.mean((-2, -1), keepdim=True) - 1
    down, across = (torch.hann_window(n, dtype=torch.float64, device=images.device) for n in (rows, columns))
    weights = down[:, None] * across
    parts = torch.view_as_real(torch.fft.rfft2(flat * weights)).square()  # an absolute value takes thrice the time
    power = (parts[..., 0] + parts[..., 1]) / weights.square().sum()
    f, g = torch.fft.fftfreq(rows).double().abs(), torch.fft.rfftfreq(columns).double()
    highest = torch.maximum(f[:, None], g).to(images.device)
    beyond = highest > BEYOND / torch.as_tensor(grain, dtype=torch.float64, device=images.device)[..., None, None]
    count = beyond.expand(power.shape).sum((-2, -1))
    read, readable = torch.where(beyond, power, 0.0).sum((-2, -1)) / count.clamp_min(1), count >= FEWEST
    if readable.all():
        return read
    if camera == "unknown":
        reject("camera_noise grain", f"above {2 * BEYOND:.3g} pixels, on a camera of many", grain,
               "State the camera ([exposure] of a recipe or a setup), or open the aperture less.")  # fmt: skip
    stated = torch.zeros_like(read) if camera == "none" else camera.noise(images.double().mean((-2, -1)))
    return torch.where(readable, read, stated)
