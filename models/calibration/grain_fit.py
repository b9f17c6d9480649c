"""The grain of speckle of an object that nobody knows, from the camera frame itself.

The power of speckle behind a thin medium is that of the object times that of one point's speckle,

    S(f) = a |O(f)|^2 T(f; grain) + n^2,

T the autocorrelation of the window, which is 0 from one cycle a grain on; ``n^2`` the camera's white noise (Goodman,
*Introduction to Fourier Optics* (2005), section 6.3). A grain that is taken for too large has no light where there is
some. One taken for too small is no contradiction by itself: a smoother object explains the same power. But it leaves
the object freer, and then the object fits noise. So one half of the camera frame tells the object, brightness of at
least 0 on a frame, for every grain of a grid, and the other half how probable that is (Whittle's likelihood); then the
halves change places. The least sum is the grain that predicts best. Nothing is known of the object but its extent.

What else limits frequencies, defocus, a blur, too little light, passes for a larger grain.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import choice, host_tensor, whole_number
from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed, seed_words
from specklegen.models.learning.reconstructor import centred
from specklegen.scene.window import Profile, Window

STEP = 0.08
"""Between grains that are tried, in their logarithm."""
SMALLEST, LARGEST = 1.5, 6.0
"""Grains that are tried, in pixels: smaller ones leave no frequency to noise."""
HELD = 40.0
"""Nats above the least within which the grain lies in 19 of 20 photographs: counted on drawn ones."""
DOUBTED = 100.0
"""Nats above the least at which a stated grain is doubted; the most at a true one was 77 (docs/notes/measured.md)."""
SHAPES: tuple[Profile, ...] = ("disc", "square")
"""Of windows with an edge, which can be asked for."""
SMALLEST_EXTENT, LARGEST_EXTENT = 8, 128
"""Camera pixels of a frame."""
_FAR = 0.62  # cycles a pixel, in all directions, beyond which noise is read at first
_LAST = 0.7  # cycles a pixel: a corner alone has no more
_FIRST = 2.5  # cells of a tile's frequencies about zero that are left out
_STEPS, _RATE = 80, 0.1  # of Adam, on the logarithm of the brightness
_EVEN = 1e-6  # contrast that is rounding
_HANN = 2.25  # frequencies of a tile under a Hann window for one independent one
_STARTED = 60  # steps of error reduction


class MeasuredGrain(NamedTuple):
    """Speckle size that camera frames show.

    Attributes
    ----------
    grain : float64[B]
        Camera pixels in a grain, wavelength / window width.
    low, high : float64[B]
        Ends of the interval that holds it in 19 of 20 drawn camera frames.
    nats : float64[B, G]
        Of the grains :attr:`tried`, minus the log-likelihood of one half by what the other told, above the least.
    tried : float64[G]
        Camera pixels.
    """

    grain: np.ndarray
    low: np.ndarray
    high: np.ndarray
    nats: np.ndarray
    tried: np.ndarray

    __repr__ = short

    def against(self, grain: float) -> np.ndarray:
        """Nats by which a grain is less probable than the best, float64[B]; the nearest that was tried, if beyond."""
        return np.array([np.interp(np.log(grain), np.log(self.tried), each) for each in self.nats])


def fit_grain(images: Tensor, extent: int, profile: Profile = "disc", seed: Seed = 0) -> MeasuredGrain:
    """Grain of each of B camera frames of hidden objects, each over its envelope.

    0.2 CPU seconds each at 320 pixels a side. Raise a `RuleError` if a half of an image has no room for tiles of
    twice the extent, or shows no speckle.

    Parameters
    ----------
    images
        real[B, H, W].
    extent
        Camera pixels, 8 to 128, of a square frame that holds the object.
    profile
        Of the window, "disc" or "square": a Gaussian one has no edge, and is not told from a smoother object.
    seed
        Of the picture that phase retrieval starts at.
    """
    seen = host_tensor("fit_grain images", images).double()
    if seen.ndim != 3 or not len(seen):
        reject("fit_grain images", "of shape [images, rows, columns]", tuple(seen.shape))
    choice("fit_grain profile", profile, SHAPES)
    size = whole_number("fit_grain extent", extent, SMALLEST_EXTENT, LARGEST_EXTENT)
    tile = 2 * size
    if seen.shape[-2] < seen.shape[-1]:
        seen = seen.mT
    half = seen.shape[-2] // 2
    if min(half, seen.shape[-1]) < tile:
        reject("fit_grain images", f"of at least {2 * tile} x {tile} pixels", tuple(images.shape[-2:]),
               "Use a larger part of the camera, or a smaller extent.")  # fmt: skip
    tried = np.exp(np.arange(np.log(SMALLEST), np.log(LARGEST), STEP))
    passed = torch.stack([transfer(profile, float(grain), tile) for grain in tried]).float()
    parts = seen[:, :half], seen[:, half:]
    if not all((each.std((1, 2)) > _EVEN * each.mean((1, 2)).clamp_min(_EVEN)).all() for each in parts):
        reject("fit_grain images", "speckle in both halves of the frame", "a half without contrast")
    halves = [tile_power(each, tile) for each in parts]
    start = _first_image((halves[0] + halves[1]) / 2, size, seed)
    independent = seen.shape[-1] * half / tile**2 / _HANN
    total = np.zeros((len(seen), len(tried)))
    for one, other in (halves, halves[::-1]):
        expected, used = _explained(one, start, passed)
        ratio = other[:, None] / expected
        total += independent * ((ratio - 1 - ratio.log()) * used).sum((-2, -1)).double().numpy()
    nats = total - total.min(1, keepdims=True)
    ends = [_ends(each, np.log(tried)) for each in nats]
    grain, low, high = np.exp(np.array(ends)).T
    return MeasuredGrain(grain, low, high, nats, tried)


def transfer(profile: Profile, grain: float, tile: int) -> Tensor:
    """T at the frequencies of a tile, as wide as Hann's peak; float64[tile, tile // 2 + 1], 1 at frequency 0."""
    v, u = np.fft.fftfreq(tile)[:, None], np.fft.rfftfreq(tile)
    aside, window = (-0.8 / tile, 0.0, 0.8 / tile), Window(profile, 1 / grain)
    return torch.from_numpy(np.mean([window.overlap(u + x, v + y) for y in aside for x in aside], 0))


def tile_power(images: Tensor, tile: int) -> Tensor:
    """Mean periodogram of tiles that overlap by half, under a Hann window, float32[B, tile, tile // 2 + 1] (Welch)."""
    flat = images.double() / images.double().mean((-2, -1), keepdim=True)
    window = torch.hann_window(tile, dtype=torch.float64)
    weights = window[:, None] * window
    tiles = flat.unfold(-2, tile, tile // 2).unfold(-2, tile, tile // 2).flatten(1, 2)
    tiles = tiles - (tiles * weights).sum((-2, -1), keepdim=True) / weights.sum()
    power = torch.fft.rfft2(tiles * weights).abs().square().mean(1) / weights.square().sum()
    return power.float()


def _radius(tile: int) -> Tensor:
    return torch.hypot(torch.fft.fftfreq(tile)[:, None], torch.fft.rfftfreq(tile))


def _first_image(power: Tensor, size: int, seed: Seed) -> Tensor:
    """Phase retrieval's answer to the whole camera frame, brightest pixel 1, float32[B, size, size].

    Error reduction alone (Fienup 1982): with feedback, rounding of the frame led to another answer and another grain.
    """
    tile = power.shape[1]
    radius = _radius(tile)
    light = power - power[:, radius > _FAR].mean(1)[:, None, None]
    light = torch.where(radius > _FIRST / tile, light, light.clamp_min(0).amax((-2, -1), keepdim=True))
    amplitude = light.double().clamp_min(0).sqrt()
    away = torch.linspace(-1, 1, size).square()
    texture = np.random.default_rng(seed_words(seed)).uniform(0.5, 1.5, (size, size))
    image = torch.exp(-2 * (away[:, None] + away)) * torch.from_numpy(texture)
    image = image.expand(len(power), -1, -1)
    for _ in range(_STARTED):
        waves = torch.fft.rfft2(image, (tile, tile))
        waves = waves / waves.abs().clamp_min(1e-9) * amplitude
        image = torch.fft.irfft2(waves, (tile, tile))[:, :size, :size].clamp_min(0)
    image = centred(image.float())
    return image / image.amax((-2, -1), keepdim=True).clamp_min(1e-9)


def _explained(power: Tensor, start: Tensor, passed: Tensor) -> tuple[Tensor, Tensor]:
    """S of the objects that explain power float[B, F, G] best, for each of K grains, float[B, K, F, G]; what counts."""
    tile, count = power.shape[1], len(passed)
    radius, across = _radius(tile), torch.fft.rfftfreq(tile)
    used = torch.where((across == 0) | (across == 0.5), 0.5, 1.0) * ((radius > _FIRST / tile) & (radius < _LAST))
    brightness = start.clamp_min(1e-3).log()[:, None].repeat(1, count, 1, 1).requires_grad_()
    noise = power[:, radius > _FAR].mean(1).log()[:, None].repeat(1, count)
    with torch.no_grad():
        alone = torch.fft.rfft2(brightness.exp(), (tile, tile)).abs().square() * passed
        lit = ((power[:, None] - noise.exp()[..., None, None]) * used).sum((-2, -1))
        scale = (lit / (alone * used).sum((-2, -1))).clamp_min(1e-12).log()
    noise, scale = noise.requires_grad_(), scale.requires_grad_()

    def expected() -> Tensor:
        light = torch.fft.rfft2(brightness.exp(), (tile, tile)).abs().square() * passed
        return light * scale.exp()[..., None, None] + noise.exp()[..., None, None]

    parts = [{"params": [brightness], "lr": _RATE}, {"params": [noise, scale], "lr": _RATE / 5}]
    optimizer = torch.optim.Adam(parts, betas=(0.9, 0.9))
    slower = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda n: min(1.0, 1.5 * (1 - n / _STEPS)))
    with torch.enable_grad():
        for _ in range(_STEPS):
            optimizer.zero_grad()
            ratio = power[:, None] / expected()
            ((ratio - 1 - ratio.log()) * used).sum().backward()
            optimizer.step()
            slower.step()
    with torch.no_grad():
        return expected(), used


def _ends(nats: np.ndarray, grains: np.ndarray) -> tuple[float, float, float]:
    """Logarithm of the best grain, of a parabola through the least three, and ends of what is held."""
    best = int(np.clip(nats.argmin(), 1, len(nats) - 2))
    left, middle, right = nats[best - 1 : best + 2]
    bend = left - 2 * middle + right
    at = grains[best] + STEP * float(np.clip((left - right) / 2 / bend, -1, 1) if bend > 0 else 0.0)
    inside = np.flatnonzero(nats <= HELD)
    ends = []
    for last, beyond in ((inside[0], inside[0] - 1), (inside[-1], inside[-1] + 1)):
        if not 0 <= beyond < len(nats):
            ends.append(grains[last])
            continue
        share = (HELD - nats[last]) / (nats[beyond] - nats[last])
        ends.append(grains[last] + share * (grains[beyond] - grains[last]))
    return at, min(ends[0], at), max(ends[1], at)
