"""Media of one material: their sampler is made once on the host, and the fields of each are drawn on the device.

Films draw the fields of every frame; partially coherent light has an object of its own, the beams of its source.
"""

import math
from dataclasses import dataclass

import torch

from specklegen.coherence.partially_coherent import COHERENT, REACH, shared_speckle
from specklegen.datasets.batched import optics
from specklegen.datasets.batched.fused import fused
from specklegen.datasets.batched.samplers import Samplers, render, sampler_of, together
from specklegen.datasets.recipes.multi_image import DynamicSlab
from specklegen.datasets.recipes.partially_coherent import PartiallyCoherent
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.split import Split


@dataclass(frozen=True)
class FreshMedia:
    """The sampler of all media of a recipe, on the device, and what their fields are drawn with.

    Attributes
    ----------
    samplers : Samplers
        One.
    names : tuple of str
        Names of the parameters.
    envelope : float32[1, y, x]
    mixing : complex64[N, R, R]
        Of the modes of light; not looked at where there is one.
    lags : (int, int)
    """

    samplers: Samplers
    names: tuple[str, ...]
    envelope: torch.Tensor
    mixing: torch.Tensor
    lags: tuple[int, int]

    def images(self, keys: torch.Tensor, kept: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        """Images float32[B, F, H, W] of objects float32[B, h, w] over their expected value; see :func:`spectra`."""
        return render(self.samplers, torch.zeros_like(keys[:, 0, 0, 0]), spectra(self, keys, kept), light)


def fresh_media(recipe: Recipe, seed: int, split: Split, device: torch.device) -> FreshMedia:
    """Prepare one medium as the CPU does, and bring what all share to the device."""
    ready = recipe.prepare(seed, split, 0)
    sampler = sampler_of(ready)
    envelope, mixing = sampler.envelope[None].to(device), sampler.mixing.to(device)
    return FreshMedia(together([ready], device), tuple(ready.parameters), envelope, mixing, sampler.lags)


def frames_of(recipe: Recipe) -> int:
    """Frames of a sample."""
    return recipe.dynamics.frames if isinstance(recipe, DynamicSlab) else 1


def chunk(media: FreshMedia, frames: int, most: int, most_bytes: int) -> int:
    """Samples rendered at once: a power of two of at most ``most``, whose tensors take at most ``most_bytes``."""
    modes, rank = len(media.mixing), media.samplers.modes.shape[2]
    (rows, columns), pairs = media.lags, rank * (rank + 1) // 2
    h, w = (media.samplers.transforms[name].shape[axis] for name, axis in (("object_rows", 2), ("object_columns", 1)))
    bytes_each = rows * columns * (8 * rank * modes * frames + 12 * pairs * frames + 4 * pairs)
    bytes_each += 4 * pairs * h * (w + columns)
    return 2 ** int(math.log2(max(1, min(most, most_bytes // bytes_each))))


def spectra(media: FreshMedia, keys: torch.Tensor, kept: torch.Tensor) -> torch.Tensor:
    """Draw media: their spectra complex64[B, F, pairs, n, m].

    Parameters
    ----------
    media
        What they share.
    keys : int64[B, halves, F, 2]
        Of both polarisations, frame by frame.
    kept : float64[B]
        Correlation of the fields of one frame with the next.
    """
    count, halves, frames, _ = keys.shape
    modes, rank = len(media.mixing), media.samplers.modes.shape[2]
    rows, columns = (torch.full((count * halves,), n, device=keys.device) for n in media.envelope.shape[1:])
    drawn = optics.fields(
        keys.flatten(0, 1), kept.repeat_interleave(halves), rows, columns, media.envelope, modes * rank, [*media.lags]
    )
    drawn = torch.view_as_complex(drawn).view(count, halves, frames, modes, rank, -1)
    if modes > 1:
        drawn = media.mixing @ drawn
    drawn = drawn.swapaxes(1, 2).reshape(count * frames, halves * modes, rank, *media.lags)
    found = optics.spectra(drawn).unflatten(0, (count, frames))
    return found / halves if halves > 1 else found


@dataclass(frozen=True)
class Source:
    """Partially coherent light on the device.

    Attributes
    ----------
    sines : float64[n]
        Of its beams along either axis.
    shared : float64[2n - 1, 2n - 1]
        W^(s)^2 of two beams by their difference, 0 first.
    wavelength, width : float
    """

    sines: torch.Tensor
    shared: torch.Tensor
    wavelength: float
    width: float


def source_of(recipe: PartiallyCoherent, device: torch.device) -> Source:
    """Bring the lattice of a recipe's beams to the device."""
    count, pitch = recipe.lattice
    wavelength, width, profile = recipe._window
    shared = torch.from_numpy(shared_speckle((count, count), pitch, wavelength, width, profile))
    place = torch.arange(count, dtype=torch.float64) - (count - 1) / 2
    return Source((place * pitch).to(device), torch.fft.ifftshift(shared).to(device), wavelength, width)


def beams(source: Source, length: torch.Tensor) -> torch.Tensor:
    """Brightness float64[B, n, n] of beams at coherence lengths float64[B], sum 1: ``gaussian_brightness``."""
    length = length.clamp(max=COHERENT * source.width)
    return gaussian_beams(source.sines, source.wavelength / (2 * torch.pi * length))


@fused(
    "gaussian_beams(Tensor sines, Tensor spread) -> Tensor",
    lambda sines, spread: sines.new_empty((len(spread), len(sines), len(sines))),
    kernels=2,
)
def gaussian_beams(sines: torch.Tensor, spread: torch.Tensor) -> torch.Tensor:
    """Gaussians float64[B, n, n] of spreads float64[B] over a lattice of sines float64[n], cut off, of sum 1."""
    along = (sines / spread[:, None]).square()
    square = along[:, :, None] + along[:, None]
    found = torch.where(square <= REACH**2, torch.exp(-square / 2), 0.0)
    return found / found.sum((1, 2), keepdim=True)


def effective_modes(source: Source, brightness: torch.Tensor) -> torch.Tensor:
    """N_eff float64[B] of beams float64[B, n, n]: ``effective_source_modes``."""
    pairs = torch.fft.irfft2(torch.fft.rfft2(brightness, source.shared.shape).abs().square(), source.shared.shape)
    return brightness.sum((1, 2)).square() / (pairs.clamp(min=0) * source.shared).sum((1, 2))
