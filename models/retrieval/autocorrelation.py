"""Autocorrelation of what is hidden, from camera images.

Within the memory effect a camera image is object * speckle, and the autocorrelation of speckle is a peak as wide as
a grain. So that of the image is that of the object, blurred by a grain, on a background. Beyond it the pair of
object points d apart is seen with the weight C_I(d) of the material (Bar et al. 2019, section 6):

    <I(v) I(v + s)> / <I>^2 - 1  =  [ (O (*) O) C_I ] * P,     P = |transform of the window's intensity|^2

(*) correlation, * convolution. Dividing by C_I undoes what the memory effect did, since C_I hardly changes over a
grain. Sources: Bertolotti et al., Nature 491, 232 (2012); Katz et al., Nature Photonics 8, 784 (2014).

Autocorrelations are real[..., n, n], their lags in pixels and in the order of an FFT: the zero lag first.
"""

from collections.abc import Callable

import numpy as np
import torch
from scipy.fft import next_fast_len
from torch import Tensor

from specklegen.core.arguments import real_tensor, whole_number
from specklegen.core.errors import reject
from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.models.retrieval.edges import pair_counts, shares_of, tapered

MemoryEffect = Callable[[np.ndarray], np.ndarray]
"""C_I of a slab at distances in object pixels, any shape."""

FLOOR = 0.1
"""Smallest C_I to divide by: below it there is more noise than object."""


def lags(window: int) -> np.ndarray:
    """Lags of one axis in pixels, int64[n]: ``0, 1, ..., n/2 - 1, -n/2, ..., -1``."""
    return np.fft.fftfreq(window, 1 / window).round().astype(np.int64)


def distances(window: int) -> np.ndarray:
    """Length of every lag in pixels, float64[n, n]."""
    return np.hypot(lags(window)[:, None], lags(window))


def ring(window: int) -> tuple[int, int]:
    """Lags between which the background is taken, outside the window: ``n/2 + 1`` to ``5n/8`` along either axis."""
    return window // 2 + 1, window * 5 // 8


def envelope(images: Tensor, sigma: float) -> Tensor:
    """Slow part of images real[..., H, W]: a Gaussian mean over ``sigma`` pixels, of the pixels that there are."""
    rows, columns = (_blur(n, sigma).to(images) for n in images.shape[-2:])
    return rows @ images @ columns.T


def _blur(n: int, sigma: float) -> Tensor:
    steps = torch.arange(n, dtype=torch.float64)
    weights = torch.exp(-0.5 * ((steps[:, None] - steps) / sigma) ** 2)
    return weights / weights.sum(1, keepdim=True)


def lag_means(fluctuations: Tensor, reach: tuple[int, int], taper: Tensor | float = 0.0) -> Tensor:
    """Mean product of all pairs of pixels at every lag up to ``reach``, real[B, ..., 2r + 1, 2c + 1].

    Zero-padded, so that nothing wraps (Wiener-Khinchin); lags in the order of an FFT, the zero lag first. A reach of
    one less than the sides (r, c) gives every lag that there is. Under a taper, of one share or one for each of B
    (:mod:`~specklegen.models.retrieval.edges`), lags with less than a tenth of the pairs along an axis fade out.
    """
    fluctuations = tapered(fluctuations, taper)
    shape = fluctuations.shape[-2:]
    padded = [int(next_fast_len(n + lag, real=True) or 0) for n, lag in zip(shape, reach, strict=True)]
    sums = torch.fft.irfft2(torch.fft.rfft2(fluctuations, s=padded).abs().square(), s=padded)
    device = fluctuations.device
    rows, columns = (torch.cat([torch.arange(r + 1), torch.arange(-r, 0)]).to(device) for r in reach)
    counts = [
        pair_counts(rows, shape[0], share)[:, None] * pair_counts(columns, shape[1], share)
        for share in (shares_of(taper, len(fluctuations)) if isinstance(taper, Tensor) else [taper])
    ]
    pairs = torch.stack(counts) if len(counts) > 1 else counts[0]
    pairs = pairs.reshape(-1, *[1] * (sums.ndim - 3), *pairs.shape[-2:]) if pairs.ndim > 2 else pairs
    return (sums[..., rows[:, None], columns] / pairs).to(sums)


def autocorrelation(
    images: Tensor, window: int, *, sigma: float | None = None, electrons: float = float("inf"), read_noise: float = 0.0
) -> Tensor:
    """Return the autocovariance of camera images over their squared mean, averaged over frames, float64[..., n, n].

    Images are zero-padded (Wiener-Khinchin), and each lag is divided by the number of its pixel pairs. Subtracted are
    the mean of a ring of lags just outside the window, and at the zero lag the variance of the camera's noise. Lags are
    in pixels and in the order of an FFT: the zero lag first. Without ``sigma`` the estimate is unbiased but for a share
    of 1 / speckles, since the mean of one image is not known.

    Parameters
    ----------
    images
        real[..., F, H, W]: F frames of the object through as many states of the medium.
    window
        Pixels a side of the result, n, even; at least twice the object, a grain included.
    sigma
        Pixels over which the envelope is estimated, many grains; each image is divided by it. By default
        there is none.
    electrons
        Photo-electrons that an image value of 1 stands for; by default infinite, no shot noise.
    read_noise
        Standard deviation of the readout, electrons.

    Raises
    ------
    RuleError
        If the window is odd, or images are dark or too small for the ring.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import autocorrelation
    >>> speckle = torch.empty(1, 1, 64, 64).exponential_(generator=torch.Generator().manual_seed(0))
    >>> autocorrelation(speckle, 16).shape
    torch.Size([1, 16, 16])
    """
    whole_number("autocorrelation window", window, 8)
    if real_tensor("autocorrelation images", images).ndim < 3:
        reject("autocorrelation images", "of shape [..., frames, rows, columns]", tuple(images.shape))
    shape = images.shape[-2:]
    inner, outer = ring(window)
    if window % 2:
        reject("autocorrelation window", "even", window)
    if min(shape) <= outer:
        reject("autocorrelation images", f"more than {outer} pixels a side", tuple(shape), "Use a smaller window.")
    images = images.double()
    slow = images.mean((-2, -1), keepdim=True) if sigma is None else envelope(images, sigma)
    if not (slow > 0).all():
        reject("autocorrelation images", "above 0 in the mean", float(slow.min()))
    noise = (images / electrons + (read_noise / electrons) ** 2) / slow**2
    flat = images / slow
    flat = flat - flat.mean((-2, -1), keepdim=True)
    every = lag_means(flat, (outer, outer))
    steps = torch.as_tensor(lags(2 * outer + 1), device=images.device).abs()
    reach = torch.maximum(steps[:, None], steps)
    background = every[..., (reach >= inner) & (reach <= outer)].mean(-1)
    kept = torch.as_tensor(lags(window), device=images.device)
    inside = every[..., kept[:, None], kept] - background[..., None, None]
    inside[..., 0, 0] -= noise.mean((-2, -1))
    return inside.mean(-3)


def memory_effect_of(correlation: MemoryEffectCorrelation, wavelength: float, pitch: float) -> MemoryEffect:
    """C_I of a slab over distances in pixels, ``pitch`` in direction sines."""
    wavenumber = 2 * np.pi / wavelength * pitch
    return lambda distance: np.square(correlation(wavenumber * np.asarray(distance, np.float64)))


def at_distances(memory_effect: MemoryEffect, distance: np.ndarray) -> Tensor:
    """C_I at distances in pixels, float64 of their shape; asked once of each that occurs."""
    unique, inverse = np.unique(distance, return_inverse=True)
    return torch.from_numpy(np.asarray(memory_effect(unique), np.float64)[inverse].reshape(distance.shape))


def memory_effect_at_lags(correlation: MemoryEffectCorrelation, wavelength: float, pitch: float, window: int) -> Tensor:
    """C_I of a material at every lag, float64[n, n].

    Parameters
    ----------
    correlation
        Of the material.
    wavelength
        Inside the medium.
    pitch
        Direction sine between camera pixels.
    window
        n.
    """
    return at_distances(memory_effect_of(correlation, wavelength, pitch), distances(window))


def taper(window: int, flat: float, end: float) -> Tensor:
    """Window over the lags, float64[n, n]: 1 up to ``flat`` pixels, then a cosine to 0 at ``end``.

    An object of diameter d has no lag above d; what is measured there is noise.
    """
    if not 0 <= flat < end:
        reject("taper", "0 <= flat < end", (flat, end))
    ramp = np.clip((distances(window) - flat) / (end - flat), 0, 1)
    return torch.from_numpy(0.5 + 0.5 * np.cos(np.pi * ramp))
