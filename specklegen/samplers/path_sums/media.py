"""Media that objects are looked at through, by path sums: every beam's fields, one medium after the other.

What :mod:`specklegen.synthesis.imaging` draws in batches from the memory effect is summed over the paths themselves.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from specklegen.core.most_recent import MostRecent
from specklegen.core.parallel import one_blas_thread
from specklegen.core.random_streams import Seed
from specklegen.instrument.lens import Lens
from specklegen.samplers.sampler import Contrast, Sampler, Where
from specklegen.synthesis.streams import Streams

_POWERS_BYTES = 2 * 2**30  # kept in a process: 64 media of 28 x 28 beams at 128 x 128 pixels


@dataclass(frozen=True)
class PathImaging:
    """Draws media and images objects through them: one medium of one scene. Made by the path-sum sampler.

    Attributes
    ----------
    sampler : Sampler
        Path sums of a scene whose lights are the beams of all pixels of the object under every tilt, one tilt after the
        other.
    unit : float
        Expected intensity of a beam of brightness 1, over which images are given.
    shape : (h, w)
        Of the object.
    divisions : int
        Views across a camera pixel, over which its intensity is averaged.
    shared : bool
        Whether many objects look through each medium, so that it is worth keeping.
    known : Contrast
        What tells the contrast of images.
    planes : tuple of Lens
        Lenses that image the medium, one a plane in focus; else the views are pixels.
    """

    sampler: Sampler
    unit: float
    tilts: int
    shape: tuple[int, int]
    divisions: int
    shared: bool
    known: Contrast
    planes: tuple[Lens, ...] = ()

    def __len__(self) -> int:
        return 1

    def at(self, places: object) -> "PathImaging":  # noqa: ARG002 - there is one
        """The medium."""
        return self

    def contrast(self, light: torch.Tensor, media: object = None) -> torch.Tensor:  # noqa: ARG002 - there is one
        """Expected contrast float64[B] of images of objects real[B, h, w] under polarised light."""
        return self.known.contrast(light)

    def media(self, streams: Streams) -> "PathMedia":
        """Draw one medium."""
        (words,) = streams.words.tolist()
        return PathMedia(self, tuple(map(tuple, words)))


@dataclass(frozen=True)
class PathMedia:
    """One medium by path sums.

    Attributes
    ----------
    seeds : tuple of tuple of int
        Of each polarisation.
    """

    imaging: PathImaging
    seeds: tuple[tuple[int, ...], ...]

    def __len__(self) -> int:
        return 1

    def shared(self) -> "PathMedia":
        """Prepare the part that many objects share, which is cached at the first of them."""
        return self

    def images(self, light: torch.Tensor) -> torch.Tensor:
        """Images over their expected value, float32[1, T, H, W], of an object real[1, h, w]; or of planes in focus."""
        if self.imaging.planes:
            return torch.from_numpy(_planes(self))[None].to(light.device)
        imaging, own = self.imaging, light[0].cpu().numpy().astype(np.float32).reshape(-1)
        lit = np.flatnonzero(own)
        powers = _kept_powers(self) if imaging.shared else _powers(self)
        seen = np.stack([np.tensordot(own[lit], power[lit].astype(np.float32), axes=1) for power in powers])
        scale = np.float32(1 / own.sum(dtype=np.float64))
        return torch.from_numpy(seen * scale)[None].to(light.device)

    def superposed(self, amplitudes: torch.Tensor, step: float) -> torch.Tensor:  # noqa: ARG002 - the scene has them
        """Image of interfering beams complex[1, h, w], float32[1, 1, H, W], over its mean where they do not overlap."""
        own = amplitudes[0].cpu().numpy()
        turned = own[::-1, ::-1].reshape(-1)  # an object's first pixel is the beam of the largest sines
        image = sum((_superposed(self, seed, turned) for seed in self.seeds), np.float64(0))
        mean = self.imaging.unit * float(np.square(np.abs(own)).sum()) * len(self.seeds)
        return torch.from_numpy(np.asarray(image / mean, np.float32))[None, None].to(amplitudes.device)


_CACHE: MostRecent[tuple, np.ndarray] = MostRecent(_POWERS_BYTES, 4096)
"""Intensities of the media that were looked through last."""


def _kept_powers(media: PathMedia) -> np.ndarray:
    """Intensities of a medium, rendered now if they are not there."""
    own = media.imaging
    key = own.sampler.scene, own.sampler.paths, own.unit, own.tilts, own.divisions, media.seeds
    return _CACHE.get(key, lambda: _powers(media))


def division_weights(count: int) -> np.ndarray:
    """Weights float64[count], sum 1, of views across a pixel for its mean: the open rule of three points, repeated.

    It is exact for cubic polynomials, and has no points on the pixel's edges, which neighbours would share.
    """
    return np.ones(1) if count == 1 else np.tile([0.375, 0.25, 0.375], count // 3) * 3 / count


def _pieces(media: PathMedia, seed: Seed) -> Iterator[tuple[Where, np.ndarray]]:
    """The fields of one polarisation: tile by tile on a grid in the far field, else all at once."""
    sampler = media.imaging.sampler
    renderer, sensor = sampler.prepare(seed, 1), sampler.scene.sensor
    if sensor.regular_grid is not None:
        yield from renderer.fields(0)
    else:
        (whole,) = renderer.media(1)
        rows, columns = sensor.shape
        yield (slice(0, len(sampler.scene.lights)), slice(0, rows), slice(0, columns)), whole.image


def _powers(media: PathMedia) -> np.ndarray:
    """Intensity of every beam, float16 or float32[tilts, h * w, H, W], mean over the polarisations.

    Half precision, of what is kept, holds a speckle to 5e-4 of itself, half of what the sum of fields allows, and twice
    the media.
    """
    imaging = media.imaging
    scene, n = imaging.sampler.scene, imaging.divisions
    weights = division_weights(n).astype(np.float32)
    rows, columns = (side // n for side in scene.sensor.shape)
    intensity = np.zeros((len(scene.lights), rows, columns), np.float32)
    with one_blas_thread():
        for seed in media.seeds:
            for (beams, down, across), field in _pieces(media, seed):
                power = np.square(field.real) + np.square(field.imag)
                power *= np.multiply.outer(weights[np.arange(down.start, down.stop) % n],
                                           weights[np.arange(across.start, across.stop) % n])  # fmt: skip
                first, left = down.start // n, across.start // n
                power = np.add.reduceat(power, _starts(down, n), axis=1)
                power = np.add.reduceat(power, _starts(across, n), axis=2)
                intensity[beams, first : first + power.shape[1], left : left + power.shape[2]] += power
    intensity /= len(media.seeds) * imaging.unit
    return intensity.astype(np.float16 if imaging.shared else np.float32).reshape(imaging.tilts, -1, rows, columns)


def _planes(media: PathMedia) -> np.ndarray:
    """Intensity of the one beam on every plane in focus, float32[planes, H, W], mean over the polarisations."""
    planes = media.imaging.planes
    intensity = np.zeros((len(planes), *planes[0].camera.shape))
    with one_blas_thread():
        for seed in media.seeds:
            whole = np.zeros((1, *media.imaging.sampler.scene.sensor.shape), np.complex64)
            for where, field in _pieces(media, seed):
                whole[where] = field
            for image, lens in zip(intensity, planes, strict=True):
                image += np.square(np.abs(lens.image(whole)[0]))
    return (intensity / (len(media.seeds) * media.imaging.unit)).astype(np.float32)


def _superposed(media: PathMedia, seed: Seed, amplitudes: np.ndarray) -> np.ndarray:
    """Intensity float64[H, W] of all beams together, averaged over the views across each pixel."""
    shape, n = media.imaging.sampler.scene.sensor.shape, media.imaging.divisions
    total = np.zeros(shape, complex)
    with one_blas_thread():
        for (beams, down, across), field in _pieces(media, seed):
            total[down, across] += np.tensordot(amplitudes[beams], field, axes=1)
    weights = division_weights(n)
    rows, columns = (side // n for side in shape)
    power = np.square(np.abs(total)).reshape(rows, n, columns, n)
    return np.einsum("rmcn,m,n->rc", power, weights, weights)


def _starts(span: slice, n: int) -> np.ndarray:
    """Return where, within a span of views, a camera pixel of ``n`` views begins; its first may be cut."""
    inner = np.arange(-(-span.start // n) * n, span.stop, n) - span.start
    return inner if len(inner) and inner[0] == 0 else np.concatenate([[0], inner])
