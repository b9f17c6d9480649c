"""Camera noise, read off the image itself: beyond the window's band there is nothing else.

Speckle through a window of width W has no frequency above W / wavelength, one cycle a grain (Goodman, *Introduction to
Fourier Optics*, 2005, section 6.3). Photon and read noise are white. So the mean power of the frequencies above is the
noise's, whatever the gain of the camera, its photons and its background. Images are weighted by a Hann window first,
whose transform falls off so fast (Harris, *Proc. IEEE* 66, 51 (1978)) that no light leaks there.

The band is as round as the window. A square one fills all frequencies from two pixels a grain down; a disc leaves the
corners of their square to noise until grains are smaller than the root of two.

A Gaussian window has no such edge: of the power at zero frequency it passes ``exp(-4 (f grain)^2)``, 0.009 at 1.08
cycles a grain. It leaves to noise the frequencies beyond 1.9 cycles a grain, in all directions: the corners of the
spectrum from 2.8 pixels a grain on. Where nobody says which window it was, power that falls off towards the corners
tells.
"""

import math
from typing import Literal

import torch
from torch import Tensor

from specklegen.core.errors import reject
from specklegen.instrument.camera import Camera
from specklegen.scene.window import Profile, Window

Stated = Camera | Literal["none", "unknown"]
"""A camera that states its noise, none, or one that states nothing."""

BEYOND = 1.08
"""Frequencies that are taken, over the highest that the window passes; above 1 for the width of Hann's peak.

Along an axis, or where the window is known to be a disc in all directions."""
SOFT = 1.9
"""The same for a window without an edge, along every direction: it passes 5e-7 there."""
_FALSE_ALARM = 1e-7
"""Share of images behind a window with an edge whose power falls off to the corners as if there were none."""
_HANN = 2.25
"""Frequencies of an image under a Hann window for one independent one."""
_SILENT = 1e-3
"""Share of an image's variance below which power is no reason to suspect a window without an edge."""
READABLE = 2.4
"""Pixels in a grain from which on a camera of 32 pixels a side has enough of them, whatever the window."""
_TINY = 1e-300
FEWEST = 32
"""Frequencies that there must be, for a spread of a fifth."""


def camera_noise(
    images: Tensor, grain: Tensor | float, camera: Stated = "unknown", profile: Profile | None = None
) -> Tensor:
    """Variance that camera noise adds to a pixel, over the squared mean of the image; float[...].

    Its relative standard error is about ``sqrt(2 / frequencies)``, a hundredth for 128 pixels a side and 3 pixels a
    grain. Raise a `RuleError` if noise can be neither read nor is stated.

    Parameters
    ----------
    images
        real[..., H, W].
    grain
        Camera pixels in a grain, wavelength / window width, real[...] or one number.
    camera
        What states the noise where it cannot be read, grains being so small that the window passes all frequencies:
        what exposed the images, or "none" if nothing did.
    profile
        Of the window; by default the images tell, where noise is not far above what a Gaussian window leaks, 0.01 of
        the speckle's variance.
    """
    rows, columns = images.shape[-2:]
    flat = images.double()
    flat = flat / flat.mean((-2, -1), keepdim=True) - 1
    down, across = (torch.hann_window(n, dtype=torch.float64, device=images.device) for n in (rows, columns))
    weights = down[:, None] * across
    parts = torch.view_as_real(torch.fft.rfft2(flat * weights)).square()  # an absolute value takes thrice the time
    power = (parts[..., 0] + parts[..., 1]) / weights.square().sum()
    f, g = torch.fft.fftfreq(rows).double().abs(), torch.fft.rfftfreq(columns).double()
    far_from = torch.hypot if profile == "disc" else torch.maximum
    highest = far_from(f[:, None].expand(-1, len(g)), g.expand(rows, -1)).to(images.device)
    beyond = highest > BEYOND / torch.as_tensor(grain, dtype=torch.float64, device=images.device)[..., None, None]
    read, readable = _mean(power, beyond)
    if profile is None or not Window(profile, 1.0).sharp:
        across = torch.hypot(f[:, None], g).to(images.device)
        edge = SOFT / torch.as_tensor(grain, dtype=torch.float64, device=images.device)[..., None, None]
        far, enough = _mean(power, across > edge)
        if profile is None:
            count = (across > edge).expand(power.shape).sum((-2, -1)).clamp_min(1)
            leaks = enough & (read > _SILENT * flat.square().mean((-2, -1)))
            independent = count.double() / _HANN  # the mean of so many exponential variables is a gamma variable
            chance = torch.special.gammainc(independent, independent * far / read.clamp_min(_TINY))
            leaks &= chance < _FALSE_ALARM
            read = torch.where(leaks, far, read)
        else:
            read, readable = far, enough
    if readable.all():
        return read
    if camera == "unknown":
        least = (math.sqrt(2) if profile == "disc" else 2) * BEYOND
        reject("camera_noise grain", f"above {least:.3g} pixels, on a camera of many speckle grains", grain,
               "Describe the camera ([exposure] of a recipe or a setup), or use a smaller aperture.")  # fmt: skip
    stated = torch.zeros_like(read) if camera == "none" else camera.noise(images.double().mean((-2, -1)))
    return torch.where(readable, read, stated)


def _mean(power: Tensor, used: Tensor) -> tuple[Tensor, Tensor]:
    """Mean power float[...] of the frequencies used, and whether they are enough."""
    count = used.expand(power.shape).sum((-2, -1))
    return torch.where(used, power, 0.0).sum((-2, -1)) / count.clamp_min(1), count >= FEWEST
