"""One medium made ready: its material, what images objects through it, and what was drawn for it.

Samples of one medium share all of this; a few media are kept in each process.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from threading import Lock
from typing import TYPE_CHECKING, Protocol

import numpy as np

from specklegen.core.lazy import LazyModule
from specklegen.core.parallel import one_blas_thread
from specklegen.core.random_streams import Seed
from specklegen.core.values import remembered
from specklegen.datasets.recipes.parts.viewing import division_weights
from specklegen.datasets.split import Split
from specklegen.planning.plan import Plan
from specklegen.planning.planning import plan
from specklegen.samplers.sampler import Where
from specklegen.samplers.screens.objects import ScreenObjects
from specklegen.samplers.stationary.objects import ObjectSampler
from specklegen.samplers.stationary.superposition import superposed_image
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid

if TYPE_CHECKING:
    import torch

    from specklegen.datasets.recipes.recipe import Recipe
else:
    torch = LazyModule("torch")

KEPT = 64
"""Media kept in a process."""
_KEPT_BYTES = 4 * 2**20  # above this what a medium is kept as would fill the memory with few media
_POWERS_BYTES = 2 * 2**30  # of path sums, kept in a process: 64 media of 28 x 28 beams at 128 x 128 pixels


class Fields(Protocol):
    """What a medium makes of every beam of an object, from which any object's images follow."""

    @property
    def mean(self) -> float:
        """Expected intensity of a beam of brightness 1, in the unit of :meth:`intensities`."""
        ...

    def intensities(self, brightness: np.ndarray) -> np.ndarray:
        """Images float32[frames * tilts, H, W] of an object real[h, w]."""
        ...

    def superposed(self, amplitudes: np.ndarray, step: float) -> tuple[np.ndarray, float]:
        """Image float32[H, W] of interfering beams complex[h, w] from the smallest sines, and its mean over media."""
        ...


class Contrast(Protocol):
    """What says the contrast of images."""

    def contrast(self, brightness: np.ndarray) -> float:
        """Expected contrast of images of an object real[h, w] under polarised light."""
        ...


@dataclass(frozen=True)
class StationaryFields:
    """Fields of the stationary sampler, one a frame.

    Attributes
    ----------
    sampler : ObjectSampler or ScreenObjects
    media : tuple of Tensor
        Fields or spectra.
    """

    sampler: ObjectSampler | ScreenObjects
    media: tuple[torch.Tensor, ...]

    @property
    def mean(self) -> float:
        """Expected intensity of a beam of brightness 1."""
        return self.sampler.mean

    def intensities(self, brightness: np.ndarray) -> np.ndarray:
        """Frames one after the other."""
        images = [self.sampler.images(medium, brightness).cpu().numpy() for medium in self.media]
        return images[0] if len(images) == 1 else np.concatenate(images)

    def superposed(self, amplitudes: np.ndarray, step: float) -> tuple[np.ndarray, float]:
        """Of the first frame, under the first tilt; see `specklegen.samplers.stationary.superposition`."""
        image, mean = superposed_image(self.sampler, self.media[0], amplitudes, step)
        return image.cpu().numpy(), mean


def stationary_fields(
    sampler: ObjectSampler | ScreenObjects, media: list[torch.Tensor], *, share: bool
) -> StationaryFields:
    """Bring media into the form that their samples share: spectra where many objects look through them."""
    if share and sampler.spectra_bytes * len(media) <= _KEPT_BYTES:
        media = [sampler.spectra(medium) for medium in media]
    return StationaryFields(sampler, tuple(media))


@dataclass(frozen=True)
class PathSumFields:
    """Fields of path sums: the intensity of every beam at every pixel, summed when an object is looked at.

    Attributes
    ----------
    scene : Scene
        Its lights are the beams of all pixels of the object under every tilt, one tilt after the other.
    paths : int
    unit : float
        Expected intensity of a beam of brightness 1, in which intensities are given.
    seeds : tuple of seeds
        Of each polarisation.
    tilts : int
    divisions : int
        Views across a camera pixel, over which its intensity is averaged.
    share : bool
        Whether many objects look through the medium, so that it is worth keeping.
    """

    scene: Scene
    paths: int
    unit: float
    seeds: tuple[Seed, ...]
    tilts: int
    divisions: int
    share: bool

    mean = 1.0

    def intensities(self, brightness: np.ndarray) -> np.ndarray:
        """Every beam's intensity, times its brightness, added up; in units of ``unit``."""
        light = np.asarray(brightness, np.float32).reshape(-1)
        lit = np.flatnonzero(light)
        powers = _KEPT_POWERS.found(self) if self.share else _powers(self)
        return np.stack([np.tensordot(light[lit], power[lit].astype(np.float32), axes=1) for power in powers])

    def superposed(self, amplitudes: np.ndarray, step: float) -> tuple[np.ndarray, float]:  # noqa: ARG002
        """Every beam's field, times its amplitude, added up; the mean is that of beams which do not overlap."""
        turned = amplitudes[::-1, ::-1].reshape(-1)  # an object's first pixel is the beam of the largest sines
        image = sum((_superposed(self, seed, turned) for seed in self.seeds), np.float64(0))
        mean = self.unit * float(np.square(np.abs(amplitudes)).sum())
        return np.asarray(image / len(self.seeds), np.float32), mean


@remembered(16)
def planned_sums(scene: Scene, paths: int) -> Plan:
    """Path sums of a scene, beam by beam."""
    return plan(scene, paths=paths, sampler="paths", streamed=True)


class _KeptPowers:
    """Intensities of the media that were looked through last, up to a number of bytes."""

    def __init__(self, most: int) -> None:
        self._most, self._lock = most, Lock()
        self._kept: OrderedDict[PathSumFields, np.ndarray] = OrderedDict()

    def found(self, fields: PathSumFields) -> np.ndarray:
        """Return a medium's intensities, rendered now if they are not there."""
        with self._lock:
            if fields in self._kept:
                self._kept.move_to_end(fields)
                return self._kept[fields]
        powers = _powers(fields)
        with self._lock:
            self._kept[fields] = powers
            while len(self._kept) > 1 and sum(each.nbytes for each in self._kept.values()) > self._most:
                self._kept.popitem(last=False)
        return powers


_KEPT_POWERS = _KeptPowers(_POWERS_BYTES)


def _pieces(fields: PathSumFields, seed: Seed) -> Iterator[tuple[Where, np.ndarray]]:
    """The fields of one polarisation: tile by tile on a grid in the far field, else all at once."""
    scene = fields.scene
    draws = planned_sums(scene, fields.paths).chosen.prepare(seed, 1)
    if isinstance(scene.sensor, FarFieldGrid):
        yield from draws.pieces(0)
    else:
        (whole,) = draws.images(1)
        rows, columns = scene.sensor.shape
        yield (slice(0, len(scene.lights)), slice(0, rows), slice(0, columns)), whole.image


def _powers(fields: PathSumFields) -> np.ndarray:
    """Intensity of every beam, float16[tilts, h * w, H, W], mean over the polarisations.

    Half precision keeps a speckle to 5e-4 of itself, half of what the sum of fields allows, and twice the media.
    """
    n = fields.divisions
    weights = division_weights(n).astype(np.float32)
    rows, columns = (side // n for side in fields.scene.sensor.shape)
    found = np.zeros((len(fields.scene.lights), rows, columns), np.float32)
    with one_blas_thread():
        for seed in fields.seeds:
            for (beams, down, across), field in _pieces(fields, seed):
                power = np.square(field.real) + np.square(field.imag)
                power *= np.multiply.outer(weights[np.arange(down.start, down.stop) % n],
                                           weights[np.arange(across.start, across.stop) % n])  # fmt: skip
                first, left = down.start // n, across.start // n
                power = np.add.reduceat(power, _starts(down, n), axis=1)
                power = np.add.reduceat(power, _starts(across, n), axis=2)
                found[beams, first : first + power.shape[1], left : left + power.shape[2]] += power
    found /= len(fields.seeds) * fields.unit
    return found.astype(np.float16).reshape(fields.tilts, -1, rows, columns)


def _superposed(fields: PathSumFields, seed: Seed, amplitudes: np.ndarray) -> np.ndarray:
    """Intensity float64[H, W] of all beams together, averaged over the views across each pixel."""
    shape, n = fields.scene.sensor.shape, fields.divisions
    total = np.zeros(shape, complex)
    with one_blas_thread():
        for (beams, down, across), field in _pieces(fields, seed):
            total[down, across] += np.tensordot(amplitudes[beams], field, axes=1)
    weights = division_weights(n)
    rows, columns = (side // n for side in shape)
    power = np.square(np.abs(total)).reshape(rows, n, columns, n)
    return np.einsum("rmcn,m,n->rc", power, weights, weights)


def _starts(span: slice, n: int) -> np.ndarray:
    """Where, within a span of views, a camera pixel of ``n`` views begins; its first may be cut."""
    inner = np.arange(-(-span.start // n) * n, span.stop, n) - span.start
    return inner if len(inner) and inner[0] == 0 else np.concatenate([[0], inner])


@dataclass(frozen=True)
class MediumRealization:
    """A medium, ready to be looked through.

    Attributes
    ----------
    fields : Fields
    sampler : Contrast
        What knows the contrast in advance: the stationary model, where it is near enough.
    parameters : dict
        What was drawn for the medium, and what follows from it.
    tilts : float64[T, 2]
        Tilts of the illumination, radians.
    contrast : float
        What polarisation leaves of the contrast.
    """

    fields: Fields
    sampler: Contrast
    parameters: dict[str, float]
    tilts: np.ndarray
    contrast: float

    @property
    def media(self) -> tuple[torch.Tensor, ...]:
        """Fields or spectra of the stationary sampler, one a frame."""
        assert isinstance(self.fields, StationaryFields)
        return self.fields.media

    def images(self, brightness: np.ndarray) -> np.ndarray:
        """Expected intensity over its mean, float32[frames * tilts, H, W]."""
        scale = np.float32(1 / (self.fields.mean * brightness.sum(dtype=np.float64)))
        return self.fields.intensities(brightness) * scale

    def superposed(self, amplitudes: np.ndarray, step: float) -> np.ndarray:
        """Intensity of interfering beams over its mean, float32[H, W]; complex[h, w] amplitudes, ``step`` apart."""
        image, mean = self.fields.superposed(amplitudes, step)
        return image * np.float32(1 / mean)

    def expected_contrast(self, brightness: np.ndarray) -> float:
        """Expected contrast of the images, noise aside, as :attr:`sampler` has it."""
        return self.contrast * self.sampler.contrast(brightness)


@lru_cache(maxsize=KEPT)
def medium_realization(recipe: "Recipe", seed: int, split: Split, medium: int) -> MediumRealization:
    """Prepare a medium of a recipe, or take the one that is there."""
    return recipe.prepare(seed, split, medium)
