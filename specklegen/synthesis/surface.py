"""Films of a surface that an objective images, whose speckle forgets in its own way at each place.

Light that has scattered often leaves places of a face more than a wavelength apart independently of each other; place
by place it is a Gaussian process in time, of the g1 of the paths that leave there. An objective of a circular pupil
spreads each place over a grain:

    E(u, t) = sum_x h(u - x) a(x, t),    <a(x, t) a*(x', t')> = delta_xx' g1(x, t - t'),    sum |h|^2 = 1

so that K^2 of an exposure at u is that of the mean of g1 over the grain (Goodman, *Speckle Phenomena in Optics*, 2007).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.lazy import torch
from specklegen.synthesis.gaussian_noise import complex_normals

if TYPE_CHECKING:
    from specklegen.synthesis.streams import Streams

GRAINS_BESIDE = 4
"""Grains beside the camera on every side, so that what leaves its opposite sides does not meet."""
_JITTER = 1e-10  # of every frame's power, new in each: far above rounding, 1e-5 of an amplitude


def padded(shape: tuple[int, int], pixels_per_grain: float) -> tuple[int, int, int]:
    """Rows and columns of the face that is drawn, and how many of them lie beside the camera on either side."""
    beside = int(np.ceil(GRAINS_BESIDE * pixels_per_grain))
    return shape[0] + 2 * beside, shape[1] + 2 * beside, beside


@dataclass(frozen=True)
class SurfaceFilm:
    """Frames of a surface, of one medium.

    Attributes
    ----------
    field : float64[n, L]
        g1 of n kinds of place, at L lags, the first of which is 0.
    between : int64[F, F]
        Which lag lies between two frames.
    kind : int64[H', W']
        Kind of every place of the face, one a pixel, beside the camera too.
    shape : (H, W)
        Of the camera.
    pixels_per_grain : float
        Pixels in a grain, wavelength / (2 aperture).
    integrated : bool
        Whether pixels average over their area; otherwise they are points.
    precise : bool
        Whether fields are complex128, as tests want them.
    """

    field: np.ndarray
    between: np.ndarray
    kind: np.ndarray
    shape: tuple[int, int]
    pixels_per_grain: float
    integrated: bool = False
    precise: bool = False

    @cached_property
    def pupil(self) -> np.ndarray:
        """Transmission of the objective for each spatial frequency, float64[H', W']: a disc, of mean square 1."""
        down, across = (np.fft.fftfreq(side) for side in self.kind.shape)
        passed = np.hypot(down[:, None], across) < 0.5 / self.pixels_per_grain
        return passed / np.sqrt(passed.mean())

    @cached_property
    def _spread(self) -> np.ndarray:
        """Transform of |h|^2, the share of each place in a pixel."""
        return np.fft.fft2(np.square(np.abs(np.fft.ifft2(self.pupil))))

    @cached_property
    def area(self) -> np.ndarray:
        """Transfer function of a pixel for the intensity, float64[H', W']."""
        down, across = (np.sinc(np.fft.fftfreq(side)) for side in self.kind.shape)
        return down[:, None] * across

    @cached_property
    def beta(self) -> float:
        """K^2 that is left of a speckle at rest by the area of pixels."""
        if not self.integrated:
            return 1.0
        alike = np.square(np.abs(np.fft.ifft2(np.square(self.pupil))))  # of two places so far apart
        spectrum = np.fft.fft2(alike).real
        return float((spectrum * np.square(self.area)).sum() / spectrum.sum())

    def seen(self, places: np.ndarray) -> np.ndarray:
        """Means over the grain about each pixel float64[..., H, W] of what each kind of place has float64[..., n]."""
        return self._cut(np.fft.ifft2(np.fft.fft2(places[..., self.kind]) * self._spread).real)

    def contrast_squared(self, weights: np.ndarray) -> np.ndarray:
        """K^2 float64[E, H, W] of exposures, of which lag l has weight float64[E, L]; for each pixel alone.

        Of pixels with an area as if g1 were one over each, which is less than a grain.
        """
        squared = np.zeros((len(weights), *self.shape))
        for lag in np.flatnonzero(weights.any(axis=0)):
            squared += weights[:, lag, None, None] * np.square(self.seen(self.field[:, lag]))
        return self.beta * squared

    @cached_property
    def roots(self) -> np.ndarray:
        """Lower triangular roots float64[n, F, F] of the covariance of frames, of each kind of place."""
        whole = self.field[:, self.between]
        return np.linalg.cholesky(whole + _JITTER * np.eye(whole.shape[-1]))

    def _cut(self, images: np.ndarray) -> np.ndarray:
        first = [(side - own) // 2 for side, own in zip(self.kind.shape, self.shape, strict=True)]
        return images[..., first[0] : first[0] + self.shape[0], first[1] : first[1] + self.shape[1]]

    def images(self, seed: tuple[int, ...], device: torch.device) -> torch.Tensor:
        """Intensities real[F, H, W] of mean 1 of one polarisation, drawn under a seed; frame f of its own number."""
        frames = len(self.between)
        kinds = self.kind.ravel()
        order = np.argsort(kinds, kind="stable")
        ends = np.searchsorted(kinds[order], np.arange(len(self.field) + 1))
        kind_of_number, real = (torch.complex128, np.float64) if self.precise else (torch.complex64, np.float32)
        draw = lambda frame: complex_normals(seed, frame, (kinds.size,), kind_of_number, device)  # noqa: E731
        put = lambda numbers: torch.from_numpy(numbers.astype(real)).to(device)  # noqa: E731
        white = torch.view_as_real(torch.stack([draw(frame) for frame in range(frames)]))
        sorted_places = torch.from_numpy(order).to(device)
        white = white[:, sorted_places].flatten(1)
        roots = put(self.roots)
        parts = [roots[n] @ white[:, 2 * ends[n] : 2 * ends[n + 1]] for n in range(len(self.field))]
        drawn = torch.empty((frames, kinds.size, 2), dtype=white.dtype, device=device)
        drawn[:, sorted_places] = torch.cat(parts, 1).unflatten(1, (-1, 2))
        face = torch.view_as_complex(drawn).unflatten(1, self.kind.shape)
        seen = torch.fft.ifft2(torch.fft.fft2(face) * put(self.pupil))
        power = seen.real.square() + seen.imag.square()
        if self.integrated:
            power = torch.fft.ifft2(torch.fft.fft2(power) * put(self.area)).real.clamp_min(0)
        return self._cut(power)  # type: ignore[arg-type, return-value]


@dataclass(frozen=True)
class SurfaceImaging:
    """One medium whose surface is imaged: draws its films; see :class:`specklegen.samplers.sampler.Imager`.

    Attributes
    ----------
    level : float
        Contrast that is told of it, of polarised light.
    """

    film: SurfaceFilm
    level: float

    def __len__(self) -> int:
        return 1

    def at(self, places: object) -> SurfaceImaging:  # noqa: ARG002 - there is one
        """The medium."""
        return self

    def contrast(self, light: torch.Tensor, media: object = None) -> torch.Tensor:  # noqa: ARG002 - there is one
        """The contrast that is stated, float64[B]."""
        return torch.full((len(light),), self.level, dtype=torch.float64, device=light.device)

    def media(self, streams: Streams) -> SurfaceMedia:
        """Draw one medium."""
        (words,) = streams.words.tolist()
        return SurfaceMedia(self.film, tuple(map(tuple, words)))


@dataclass(frozen=True)
class SurfaceMedia:
    """One medium as it was drawn: a seed of each polarisation."""

    film: SurfaceFilm
    seeds: tuple[tuple[int, ...], ...]

    def __len__(self) -> int:
        return 1

    def images(self, light: torch.Tensor) -> torch.Tensor:
        """Frames float32[1, F, H, W] over their expected value, mean over the polarisations."""
        drawn = [self.film.images(seed, light.device) for seed in self.seeds]
        return torch.stack(drawn).mean(0)[None]
