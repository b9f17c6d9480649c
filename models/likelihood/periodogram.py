"""Periodograms of camera images: the data of the likelihood.

With x the image over its mean less 1, on M x N pixels, the periodogram is

    I(f) = |sum_l x(l) e^(-2 pi i f l)|^2 / (M N),      f = (m / M, n / N)

Its values at different frequencies are nearly independent and exponentially distributed about their mean (Priestley,
*Spectral Analysis and Time Series*, 1981, section 6.2). A camera may be cut into tiles, and there may be several
frames: their periodograms are averaged, and ``looks`` counts them.
"""

from typing import NamedTuple, Self

import torch
from torch import Tensor

from specklegen.core.arguments import host_tensor, positive_number, real_number, whole_number
from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.models.retrieval.autocorrelation import envelope
from specklegen.models.retrieval.edges import tapered

_LEFT = 0.05
"""Largest share of a frequency's power that the removal of an envelope may take with it."""


class Periodogram(NamedTuple):
    """Measured values of B objects, at all frequencies of a tile's rows, and from 0 on of its columns.

    Attributes
    ----------
    power : float[B, M, N // 2 + 1]
        I(f), in the order of ``torch.fft.rfft2``; mean over frames and tiles.
    noise : float[B]
        What the camera's noise adds to every frequency.
    looks : float
        Periodograms that the mean is of.
    shape : (int, int)
        Of a tile, (M, N) pixels.
    lowest : float
        Frequency, in cycles a pixel, below which an envelope's removal left nothing to be used.
    taper : float or float64[B]
        Share of a tile's sides on the ramps of the taper that it was seen under; 0 for none.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import periodogram
    >>> found = periodogram(torch.rand(2, 3, 64, 64))  # 2 objects, 3 frames each
    >>> found.power.shape, found.looks
    (torch.Size([2, 64, 33]), 3.0)
    """

    power: Tensor
    noise: Tensor
    looks: float
    shape: tuple[int, int]
    lowest: float = 0.0
    taper: Tensor | float = 0.0

    __repr__ = short

    def select(self, which: Tensor | slice) -> Self:
        """Some of the objects."""
        taper = self.taper[which] if isinstance(self.taper, Tensor) else self.taper
        return self._replace(power=self.power[which], noise=self.noise[which], taper=taper)


def periodogram(
    images: Tensor, *, tile: int | None = None, background: float = 0.0, sigma: float | None = None,
    electrons: float = float("inf"), read_noise: float = 0.0, taper: Tensor | float = 0.0,
) -> Periodogram:  # fmt: skip
    """Periodogram of camera images.

    Parameters
    ----------
    images
        real[B, F, H, W]: F frames of each object through as many states of the medium.
    tile
        Longest side of a tile in pixels; cameras that are larger are cut into equal tiles. By default they are not cut:
        a whole camera has finer frequencies, tiles have fewer, of more looks each.
    background
        Image value without light, taken off first.
    sigma
        Pixels over which an envelope is estimated, many grains; each image is divided by it. By default there is none.
    electrons
        Photo-electrons that an image value of 1 stands for; by default infinite, no shot noise.
    read_noise
        Standard deviation of the readout, electrons.
    taper
        Share of a tile's sides on the ramps of a cosine taper (:mod:`~specklegen.models.retrieval.edges`), 0 to 1; one
        number, or one for each object. Uneven light leaks without one; by default there is none.

    Raises
    ------
    RuleError
        If the images are not of shape [B, F, H, W], not brighter than their background, or smaller than 8 pixels.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import periodogram
    >>> periodogram(torch.rand(2, 1, 64, 64), tile=32).shape  # four tiles of each image, of 32 x 32 pixels
    (32, 32)
    """
    images = host_tensor("periodogram images", images)
    if tile is not None:
        tile = whole_number("periodogram tile", tile, 8)
    background, electrons, read_noise = (
        real_number(f"periodogram {name}", value)
        for name, value in (("background", background), ("electrons", electrons), ("read_noise", read_noise))
    )
    sigma = None if sigma is None else positive_number("periodogram sigma", sigma)
    if images.ndim != 4 or not images.numel():
        reject("periodogram images", "of shape [objects, frames, rows, columns]", tuple(images.shape))
    if min(images.shape[-2:]) < 8:
        reject("periodogram images", "at least 8 pixels a side", tuple(images.shape[-2:]))
    if 0 < electrons < 1e-30 or read_noise > 1e30:
        reject("periodogram electrons, read_noise", "at least 1e-30, and at most 1e30", (electrons, read_noise))
    if not electrons > 0 or not read_noise >= 0:
        reject("periodogram electrons, read_noise", "above 0, and at least 0", (electrons, read_noise))
    if read_noise and electrons == float("inf"):
        reject("periodogram electrons", "given, since read_noise is", electrons)
    counted = images if images.dtype == torch.float64 else images.float()
    flat, slow, lowest = flattened(counted, background, sigma, "periodogram")
    noise = ((counted / electrons + (read_noise / electrons) ** 2) / slow.square()).mean((-3, -2, -1))
    shares = torch.as_tensor(taper, dtype=torch.float64)
    if shares.shape not in ((), (len(images),)) or not ((shares >= 0) & (shares <= 1)).all():
        reject("periodogram taper", f"from 0 to 1, one number or one for each of {len(images)} objects", taper)
    tiles = tapered(_tiles(flat, tile), shares)
    power = torch.fft.rfft2(tiles).abs().square().mean((1, 2)) / (tiles.shape[-2] * tiles.shape[-1])
    looks = float(tiles.shape[1] * tiles.shape[2])
    return Periodogram(power, noise, looks, (tiles.shape[-2], tiles.shape[-1]), lowest, shares)


def flattened(images: Tensor, background: float, sigma: float | None, owner: str) -> tuple[Tensor, Tensor, float]:
    """Images real[..., H, W] over their envelope, about 0; the envelope; and the lowest frequency that it left."""
    light = images - background
    mean = light.mean((-2, -1), keepdim=True)
    if not (mean > 0).all():
        reject(f"{owner} images", "brighter in the mean than their background", float(mean.min()))
    slow = mean if sigma is None else envelope(light, sigma)
    flat = light / slow
    # A Gaussian mean over sigma leaves the share exp(-2 (pi sigma f)^2) of an amplitude in the envelope.
    lowest = 0.0 if sigma is None else float((-torch.log(torch.tensor(_LEFT / 2)) / 2).sqrt() / torch.pi / sigma)
    return flat / flat.mean((-2, -1), keepdim=True) - 1, slow, lowest


def _tiles(images: Tensor, tile: int | None) -> Tensor:
    """Equal tiles real[B, F, T, m, n] of images real[B, F, H, W]; pixels that are left over at the far edges go."""
    counts = [1 if tile is None else -(-n // tile) for n in images.shape[-2:]]
    rows, columns = (n // count for n, count in zip(images.shape[-2:], counts, strict=True))
    kept = images[..., : rows * counts[0], : columns * counts[1]]
    return kept.unflatten(-1, (counts[1], columns)).unflatten(-3, (counts[0], rows)).movedim(-2, -3).flatten(2, 3)
