"""Geometry of imaging through a batch of media: windows, beams, cameras, and cells of the exit plane behind them.

Everything that decides a shape or a phase is float64.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from specklegen.core.lazy import torch
from specklegen.scene.window import Profile
from specklegen.synthesis.exit_grid import GUARD, SUPPORT
from specklegen.synthesis.modes import Lattice

if TYPE_CHECKING:
    from specklegen.synthesis.correlations import Places

_LONGEST = 2**40  # beyond what any memory holds


class Cells(NamedTuple):
    """Cells of the exit plane along (y, x): how many, and their distances.

    Attributes
    ----------
    number : int64[M, 2]
    size : float64[M, 2]
    """

    number: torch.Tensor
    size: torch.Tensor


@dataclass(frozen=True)
class Sight:
    """Windows, beams and cameras of M media.

    Attributes
    ----------
    wavelength : float
        Inside the media.
    profile :
        Of the window.
    shape : (h, w)
        Of the object; a beam is an object of one pixel.
    camera : (H, W)
        Pixels.
    center : (float, float)
        Direction sines (x, y) of the camera's middle.
    integrated : bool
        Whether pixels average over their area.
    width : float64[M]
        Of the window.
    object_pitch, camera_pitch : float64[M]
        Direction sines between pixels.
    base : float64[M, T, 2]
        Direction sines (x, y) of the base tilts, added to all the object's beams.
    like : float64[M, T, 2] or None
        Of media that move between the tilts: sines by which K sees every base tilt besides.
    kept : float64[M, T, T] or None
        And what is left of K in any case.
    bound : (int, int) or None
        No fewer cells along (y, x) than any medium has, where they are not to be asked of the device.
    """

    wavelength: float
    profile: Profile
    shape: tuple[int, int]
    camera: tuple[int, int]
    center: tuple[float, float]
    integrated: bool
    width: torch.Tensor
    object_pitch: torch.Tensor
    camera_pitch: torch.Tensor
    base: torch.Tensor
    like: torch.Tensor | None = None
    kept: torch.Tensor | None = None
    bound: tuple[int, int] | None = None

    def __len__(self) -> int:
        return len(self.width)

    @property
    def device(self) -> torch.device:
        """Device of the numbers."""
        return self.width.device

    @property
    def wavenumber(self) -> float:
        """2 pi / wavelength."""
        return 2 * np.pi / self.wavelength

    def at(self, places: Places) -> Sight:
        """Return the sight of some of the media."""
        rows = {name: value[places] for name, value in vars(self).items() if isinstance(value, torch.Tensor)}
        return replace(self, **rows)

    @cached_property
    def one(self) -> Sight:
        """Sight of the first medium where all are seen in the same way, else of all; on the CPU."""
        rows = [value for value in vars(self).values() if isinstance(value, torch.Tensor)]
        alike = len(self) > 1 and all(bool((value == value[:1]).all()) for value in rows)
        return self.at(slice(0, 1)) if alike else self

    def on(self, device: torch.device | str) -> Sight:
        """Return a copy on another device."""
        rows = {name: value.to(device) for name, value in vars(self).items() if isinstance(value, torch.Tensor)}
        return replace(self, **rows)

    @property
    def lattice(self) -> Lattice:
        """The beams as the memory effect sees them."""
        seen_as = self.base if self.like is None else self.base + self.like
        k = self.wavenumber
        return Lattice(self.shape, k * self.object_pitch, k * seen_as, self.kept)

    @property
    def pixel(self) -> torch.Tensor:
        """Side of a camera pixel over the wavelength, float64[M]; 0 for a point."""
        return self.camera_pitch / self.wavelength if self.integrated else torch.zeros_like(self.camera_pitch)

    def object_sines(self, axis: int) -> torch.Tensor:
        """Direction sines float64[M, n] of the object's rows (axis 0) or columns: they fall, as images are turned."""
        return -centred(self.shape[axis], self.object_pitch)

    def views(self, axis: int) -> torch.Tensor:
        """Direction sines float64[M, T, n] of the camera's rows (axis 0) or columns, less those of the base tilts."""
        grid = centred(self.camera[axis], self.camera_pitch) + self.center[1 - axis]
        return grid[:, None] - self.base[:, :, 1 - axis, None]

    @cached_property
    def cells(self) -> Cells:
        """Cells of the exit plane, fine enough for every beam and every view."""
        spans = [
            self.object_pitch * (n - 1) + self.camera_pitch * (m - 1)
            for n, m in zip(self.shape, self.camera, strict=True)
        ]
        span = torch.stack(spans, -1) + (self.base.amax(1) - self.base.amin(1)).flip(1)  # (x, y) to (y, x)
        grain = (self.wavelength / self.width)[:, None]
        # Views half a grain apart, and a guard between the last and the first one's copy.
        period = fast_length(torch.ceil((span + GUARD * grain) / (grain / 2)).to(torch.int64) + 1)
        size = self.wavelength / (period * (grain / 2))
        count = torch.ceil(SUPPORT[self.profile] * self.width[:, None] / size - 1e-9).to(torch.int64).clamp(min=1)
        return Cells(count, size)

    @cached_property
    def most_cells(self) -> tuple[int, int]:
        """Most cells along (y, x) of any of the media, or the bound."""
        if self.bound is not None:
            return self.bound
        rows, columns = self.cells.number.amax(0).tolist()
        return rows, columns


def centred(count: int, pitch: torch.Tensor) -> torch.Tensor:
    """Sines float64[M, count] about 0."""
    number = torch.arange(count, dtype=torch.float64, device=pitch.device) - (count - 1) / 2
    return number * pitch[:, None]


@lru_cache(maxsize=2)
def _smooth(primes: tuple[int, ...]) -> np.ndarray:
    """Numbers up to ``_LONGEST`` without other prime factors, int64, ascending."""
    numbers = np.ones(1, np.int64)
    for prime in primes:
        new = numbers
        while len(new := new[new <= _LONGEST // prime] * prime):
            numbers = np.append(numbers, new)
    return np.sort(numbers)


@lru_cache(maxsize=8)
def _on(device: torch.device, primes: tuple[int, ...]) -> torch.Tensor:
    return torch.from_numpy(_smooth(primes)).to(device)


def fast_length(least: torch.Tensor) -> torch.Tensor:
    """Fast length of a transform of at least so many points, int64[...]: ``scipy.fft.next_fast_len``."""
    return _next(least, (2, 3, 5, 7, 11))


def lags_between(count: torch.Tensor) -> torch.Tensor:
    """Length of the grid of lags along each axis, int64[...]: at least twice the cells, and a multiple of eight.

    Transforms of such lengths are the fastest: one of 168 points a side takes little more than half the time of one of
    162.
    """
    return 8 * _next((count + 3) // 4, (2, 3, 5, 7))


def _next(least: torch.Tensor, primes: tuple[int, ...]) -> torch.Tensor:
    lengths = _on(least.device, primes)
    return lengths[torch.searchsorted(lengths, least).clamp(max=len(lengths) - 1)]  # not to ask a device
