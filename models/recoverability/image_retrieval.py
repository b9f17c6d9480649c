"""Phase retrieval from a camera image in one call: what the image itself says of the setup is found and used.

The light's envelope is fitted and divided out, and a taper keeps out what is left of it
(:mod:`~specklegen.models.retrieval.edges`); speckle size and camera noise are read off the band of frequencies
(:mod:`~specklegen.models.recoverability.band`), the object's extent off the autocorrelation
(:mod:`~specklegen.models.recoverability.extent`). What is given is not looked for. Then Katz et al., Nature Photonics
8, 784 (2014).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from specklegen.core.arguments import instance, positive_number
from specklegen.core.display.plot import Pictured, draw_images
from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed
from specklegen.core.shielded import shielded
from specklegen.measured.curve import MeasuredCurve
from specklegen.measured.files import Source
from specklegen.measured.measurement import Measurement, read_measurement
from specklegen.models.learning.inputs import LAGS, resampled_lags, without_background
from specklegen.models.recoverability.band import fit_band
from specklegen.models.recoverability.extent import find_extent
from specklegen.models.recoverability.photograph import LEAST, independent_frames
from specklegen.models.retrieval.autocorrelation import at_distances, distances, lag_means
from specklegen.models.retrieval.edges import taper_of, tapered
from specklegen.models.retrieval.measured_memory_effect import measured_memory_effect
from specklegen.models.retrieval.phase_retrieval import Retrieval, retrieve
from specklegen.models.retrieval.wiener import choice, lag_variance, weights

_ACROSS = 28
"""Object pixels across the extent that was found: the window of lags holds 32."""
_FINEST = 1 / 3  # of a grain: smaller object pixels would show nothing more


@dataclass(frozen=True, repr=False)
class ImageRetrieval(Pictured):
    """Object that phase retrieval made of a camera image, and what it was given or found.

    Attributes
    ----------
    image : float32[64, 64]
        Brightness, somewhere on the frame; the orientation is ambiguous by 180 degrees.
    error : float
        Relative squared error of the modulus of the best restart.
    pixel : float
        Camera pixels in an object pixel.
    grain : float
        Speckle size, camera pixels.
    extent : float
        Diameter of the object, camera pixels.
    noise : float
        Variance that the camera adds to a pixel, over the squared mean.
    taper : float
        Share of the sides on the ramps of the taper; 0 of even light.
    measured : Measurement
        Frames, envelope, illuminated region, and what had to be assumed.

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> from specklegen.models import Retrieval, retrieve_image
    >>> image = load_recipe("ground-glass").batch(0, "test", range(1))["image"][0]
    >>> found = retrieve_image(image, grain=3.0, retrieval=Retrieval(restarts=2))
    >>> found.image.shape, found.grain
    ((64, 64), 3.0)
    """

    image: np.ndarray
    error: float
    pixel: float
    grain: float
    extent: float
    noise: float
    taper: float
    measured: Measurement

    _named = {
        "speckle size, camera pixels": "grain", "object's diameter, camera pixels": "extent",
        "camera pixels in an object pixel": "pixel", "camera noise, variance over squared mean": "noise",
        "taper, share of the sides": "taper", "error of the modulus": "error",
    }  # fmt: skip

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Draw what was retrieved."""
        draw_images(axes, self.image[None], high=float(self.image.max()))


@shielded()
def retrieve_image(
    source: Source | Measurement, *, grain: float | None = None, extent: float | None = None,
    noise: float | None = None, pixel: float | None = None, envelope: Source | None = "fit",
    region: str | Sequence[int] | None = None, dark: Source | float | None = None,
    memory_effect: MeasuredCurve | None = None, retrieval: Retrieval | None = None, seed: Seed = 0,
) -> ImageRetrieval:  # fmt: skip
    """Retrieve the object behind a camera image, or frames of it, by phase retrieval (Katz et al. 2014).

    Parameters
    ----------
    source
        File, pattern, array [h, w] or [n, h, w], as :func:`~specklegen.measured.read_measurement` reads them, or what
        that returned. Frames that correlate by 0.5 or more are averaged; others show the object through other states
        of the medium, and their autocorrelations are averaged.
    grain
        Speckle size in camera pixels, wavelength / aperture; by default it is read off the band of frequencies.
    extent
        Diameter of the object on the camera, pixels; by default that of the autocorrelation.
    noise
        Variance that the camera adds to a pixel, over the squared mean; by default it is read beyond the band.
    pixel
        Camera pixels in a pixel of the result; by default 1 / 28 of the extent, and at least a third of a grain.
    envelope, region, dark
        As :func:`~specklegen.measured.read_measurement` takes them; ``envelope=None`` leaves uneven light to the taper.
    memory_effect
        C_I as it was measured, at distances on the camera in pixels; by default the object lies within the memory
        effect.
    retrieval
        Restarts and iterations; by default 20 restarts.
    seed
        Of the restarts.

    Raises
    ------
    RuleError
        If frames cannot be read, are smaller than 32 x 32 pixels or even, or the object is wider than 32 pixels.

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> from specklegen.models import Retrieval, retrieve_image
    >>> image = load_recipe("ground-glass").batch(0, "test", range(1))["image"][0]
    >>> found = retrieve_image(image, retrieval=Retrieval(restarts=2, steps=2))
    >>> found.image.shape
    (64, 64)
    """
    grain, extent, noise_given, pixel = (
        None if value is None else positive_number(f"retrieve_image {name}", value)
        for name, value in (("grain", grain), ("extent", extent), ("noise", noise or None), ("pixel", pixel))
    )
    if not isinstance(source, Measurement):
        source = read_measurement(source, dark=dark, envelope=envelope, region=region)
    source.require_speckle("retrieve_image source")
    images = source.images
    if min(images.shape[1:]) < LEAST:
        reject("retrieve_image source", f"frames of at least {LEAST} x {LEAST} pixels", images.shape[1:])
    images = images / images.mean((1, 2), keepdims=True)
    frames, pairs, _ = independent_frames(images)
    band = fit_band(frames, len(frames))
    if grain is None:
        grain = float(np.sqrt(band.grain[0] * band.grain[1]))
    level = 0.0 if noise == 0 else noise_given or (band.noise if pairs is None else pairs)
    light = torch.from_numpy(np.ascontiguousarray(frames))[None]
    taper = taper_of(light)
    flat = light - light.mean((-2, -1), keepdim=True)
    rows, columns = flat.shape[-2:]
    lags = lag_means(flat, (rows - 1, columns - 1), taper).mean(1)
    lags[:, 0, 0] -= level
    if extent is None:
        variance = float(lags[0, 0, 0].clamp_min(1e-12))
        extent = float(find_extent(lags[0].numpy(), tapered(flat, taper)[0].numpy(), variance).whole)
        extent = extent if pixel is None else min(extent, LAGS / 2 * pixel)
    pixel = pixel or max(extent / _ACROSS, _FINEST * grain)
    across = extent / pixel
    if across > LAGS / 2:
        reject("retrieve_image extent", f"at most {LAGS // 2} object pixels", across, "Take larger object pixels.")
    peak = lags[:, 0, 0].clamp_min(1e-12)
    near = torch.fft.fftshift(lags / peak[:, None, None], dim=(-2, -1))
    near = resampled_lags(near, torch.tensor([pixel], dtype=torch.float64), LAGS)
    near = torch.fft.ifftshift(without_background(near), dim=(-2, -1))
    if memory_effect is not None:
        curve = instance("retrieve_image memory_effect", memory_effect, MeasuredCurve)
        c_i = at_distances(measured_memory_effect(curve.at / pixel, curve.values), distances(LAGS))
        scatter = lag_variance(light, taper).mean(1) / light.shape[1] / peak.square()
        size = torch.tensor([grain / pixel], dtype=torch.float64)
        guess = choice(near, c_i, scatter, side=across, grain=size)[0]
        near = near * weights(near, c_i, scatter, side=across, grain=size, guess=guess)
    settings = retrieval or Retrieval()
    if settings.extent is None:
        settings = settings.replace(extent=max(across, 2.0))
    found = retrieve(near, settings, seed=seed)
    return ImageRetrieval(
        found.image[0].numpy(), float(found.error.min()), pixel, grain, extent, level, float(taper), source
    )
