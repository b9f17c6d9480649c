"""The memory effect of a forward-scattering slab by wave optics: random phase screens and free space between them.

    E -> H_(dz/2) [ e^(i phi_n) H_(dz/2) E ],     <|phi^(q)|^2> = (dz / l) |s(cos theta)|^2 (dq / k)^2 / cos theta

with sin theta = |q| / k, and H the exact angular spectrum e^(i k_z dz) without its evanescent part. A screen's phase is
Gaussian with the spectrum of the slab's own scatterers, of whatever phase function, and scatters dz / l of the light.
Nothing here knows of paths, of segments or of their far field: fields of different tilts pass the same screens, and
their correlation is read off. docs/physics.md 10.

Light is never scattered backwards and loses nothing by its slant (no 1 / cos theta), so this judges slabs of
``L / l* <= 0.2`` only: there its |K| agrees with random walks within 0.02; within 0.013 where ``L / l* <= 0.1``. Layers
one behind the other are slabs one behind the other.

Brownian scatterers that have moved for a lag tau leave ``e^(-D q^2 tau) = e^(-x (q/k)^2)`` of the amplitude of a
screen's component at the transverse wavevector q, ``x = D k^2 tau``; what is lost comes back as another screen's. Over
all views of one beam, tilted by nothing, that is exp{-OD [1 - <e^(-x sin^2 theta)>]}, the mean over the phase function.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import fft2, ifft2

from specklegen.core.arguments import array_from_zero
from specklegen.core.errors import reject
from specklegen.scene.media import PlaneMedium
from specklegen.scene.scatterers import Scatterer

MOST_TRANSPORT = 0.2  # L / l*
MOST_SCATTERED = 0.25  # of the light, by one screen
RMS_ANGLES = 4  # that the grid must hold, unless it holds all directions
_FINE, _NEAR = 8, 12  # points a bin, and bins, within which the middle of a lobe is averaged


@dataclass(frozen=True)
class MultiSlice:
    """Correlation of a slab's speckle with that under tilted light.

    Attributes
    ----------
    sines : float64[T]
        Tilts as direction sines along x.
    all_views : float64[R, T]
        |K| of the field at the exit face, over all views together, of each realization.
    on_axis : float64[R, T]
        C_I = |K|^2 about the axis, what a far-field camera sees, of each realization.
    """

    sines: np.ndarray
    all_views: np.ndarray
    on_axis: np.ndarray


class _Part(NamedTuple):
    """One layer: its screens, all alike, and the way from the middle between two of them to the next.

    Attributes
    ----------
    screens : int
        How many.
    half : complex64[n, n]
        Transfer of half a step.
    amplitude : float32[n, n]
        Root of the power of a screen's phase in each bin.
    """

    screens: int
    half: np.ndarray
    amplitude: np.ndarray


def multi_slice(
    slab: PlaneMedium, *, wavelength: float, pitch: float, size: int, bins: list[int], realizations: int = 1,
    seed: int = 0, reach: float = 0.1, motion: float = 0.0,
) -> MultiSlice:  # fmt: skip
    """Correlate the fields of tilted plane waves behind random phase screens.

    Raise a `RuleError` for a slab outside the domain of this method, or a grid that does not hold the scattered light.

    Parameters
    ----------
    slab
        Slab or layers, of albedo 1 and at most 0.2 transport lengths thick; their scatterers may be of any kind.
    wavelength
        Inside the slab.
    pitch, size
        Distance of the points of a square grid, and their number along a side. The grid is periodic.
    bins
        Tilts in whole bins of its transform, wavelength / (pitch size) in sines.
    realizations, seed
        Number of slabs, and the seed of the first.
    reach
        Radius, in sines, of the views about the axis that ``on_axis`` joins.
    motion
        x = D k^2 tau >= 0: the tilted beams come a lag tau after the other, which they then need not differ from (a
        tilt of 0 bins is the correlation in time alone). The screens at lag 0 are the same for all motions.
    """
    _check(slab, wavelength, pitch)
    if not 0 <= motion < np.inf:
        reject("multi_slice motion", "finite and at least 0", motion)
    parts, sines = _parts(slab, wavelength, pitch, size), np.fft.fftfreq(size, pitch / wavelength)
    power = np.square(sines) + np.square(sines)[:, None]
    views = (power < reach**2) & (power > 0)  # without what was not scattered
    kept = [np.exp(-motion * power).astype(np.float32)] if motion else []
    curves = [_realization(_screens([seed, n], parts, kept), [0, *bins], views, sines) for n in range(realizations)]
    tilts = np.array(bins) * wavelength / (pitch * size)
    return MultiSlice(tilts, np.array([every for every, _ in curves]), np.array([axis for _, axis in curves]))


def slice_views(
    slab: PlaneMedium, *, wavelength: float, pitch: float, size: int, bins: list[tuple[int, int]],
    realizations: int = 1, seed: int = 0,
) -> Iterator[np.ndarray]:  # fmt: skip
    """Far fields of tilted plane waves behind random phase screens, of one realization after the other.

    Parameters
    ----------
    slab, wavelength, pitch, size, realizations, seed
        As of :func:`multi_slice`; the screens are the same.
    bins
        Tilts (x, y) in whole bins of the grid's transform.

    Yields
    ------
    complex64[T, size, size]
        (1 / wavelength) sum E e^(-ik s.x) dA of every tilt at the sines s of ``np.fft.fftfreq(size, pitch /
        wavelength)``, rows along y. Light that was not scattered lies in the tilt's own bin.
    """
    _check(slab, wavelength, pitch)
    parts = _parts(slab, wavelength, pitch, size)
    for n in range(realizations):
        yield np.array(_spectra(_screens([seed, n], parts), size, bins)) * np.float32(pitch**2 / wavelength)


def slice_film(
    slab: PlaneMedium, *, wavelength: float, pitch: float, size: int, motions: ArrayLike, seed: int = 0
) -> np.ndarray:
    """Far fields of light along the axis behind random phase screens that move, at instants one after the other.

    Raise a `RuleError` as :func:`multi_slice`, and for motions that fall.

    Parameters
    ----------
    slab, wavelength, pitch, size, seed
        As of :func:`multi_slice`.
    motions
        float64[F], x = D k^2 t of each instant, rising.

    Returns
    -------
    complex64[F, size, size]
        As :func:`slice_views` yields them; light that was not scattered lies in bin 0.
    """
    _check(slab, wavelength, pitch)
    steps = np.diff(array_from_zero("slice_film motions", motions))
    if (steps < 0).any():
        reject("slice_film motions", "rising", motions)
    sines = np.fft.fftfreq(size, pitch / wavelength)
    power = np.square(sines) + np.square(sines)[:, None]
    kept = [np.exp(-step * power).astype(np.float32) for step in steps]
    screens = _screens([seed, 0], _parts(slab, wavelength, pitch, size), kept)
    return np.array(_spectra(screens, size, [(0, 0)] * (len(kept) + 1))) * np.float32(pitch**2 / wavelength)


def slice_coherence(slab: PlaneMedium, *, wavelength: float, pitch: float, size: int) -> np.ndarray:
    """Mean E(x) E*(x + r) of scattered light behind the screens of :func:`slice_views`, of one tilt: float64[n, n].

    Gaussian screens of phase covariance R leave exp(sum R(r) - R(0)) of a plane wave's coherence over r, however far
    they are apart; exp(-R(0)) of that was not scattered. ``r`` is as in ``np.fft.fftfreq(size, 1 / (size pitch))``,
    rows along y. Times the autocorrelation of a window and transformed it is what views see on average.

    Parameters
    ----------
    slab, wavelength, pitch, size
        As of :func:`multi_slice`.
    """
    _check(slab, wavelength, pitch)
    phases = [
        part.screens * np.asarray(fft2(np.square(part.amplitude.astype(np.float64)))).real
        for part in _parts(slab, wavelength, pitch, size)
    ]
    phase = sum(phases[1:], phases[0])
    return np.exp(phase - phase[0, 0]) - np.exp(-phase[0, 0])


def _parts(medium: PlaneMedium, wavelength: float, pitch: float, size: int) -> list[_Part]:
    """Layers one after the other."""
    sines, parts = np.fft.fftfreq(size, pitch / wavelength), []
    power = np.square(sines) + np.square(sines)[:, None]
    cosine = np.sqrt(np.clip(1 - power, 0, None))
    for layer in medium.layers:
        count = int(np.ceil(layer.optical_depth / MOST_SCATTERED))
        step = layer.thickness / count
        half = np.where(power < 1, np.exp(1j * np.pi / wavelength * step * (cosine - 1)), 0)
        amplitude = np.sqrt(_spectrum(layer.scatterer, sines) * (step / layer.mean_free_path))
        parts.append(_Part(count, half.astype(np.complex64), amplitude.astype(np.float32)))
    return parts


def _check(slab: PlaneMedium, wavelength: float, pitch: float) -> None:
    transport = sum(layer.optical_depth * (1 - layer.scatterer.mean_cosine()) for layer in slab.layers)
    if slab.refracts:
        reject("multi_slice slab.faces", "matched, and layers of one index", slab.faces)
    if slab.albedo != 1:
        reject("multi_slice slab.albedo", "1", slab.albedo)
    if transport > MOST_TRANSPORT * (1 + 1e-9):
        reject("multi_slice slab", f"of at most {MOST_TRANSPORT} transport lengths", transport,
               "Light scattered to large angles is lost in this method: use random paths.")  # fmt: skip
    held, needed = wavelength / (2 * pitch), min(1.0, RMS_ANGLES * np.sqrt(transport))
    if held < needed * (1 - 1e-9):
        reject("multi_slice pitch", f"at most {wavelength / (2 * needed):.4g}, which holds {RMS_ANGLES} rms angles",
               pitch, "A coarser grid aliases scattered light.")  # fmt: skip


def _spectrum(scatterer: Scatterer, sines: np.ndarray) -> np.ndarray:
    """Share of scattered light in each bin, float64[n, n]; bins in the middle of the phase function are averaged."""

    def density(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        power = x**2 + y**2
        cosine = np.sqrt(np.clip(1 - power, 1e-6, None))
        return np.where(power < 1, np.square(np.abs(scatterer.amplitude(cosine))) / cosine, 0)

    share = density(sines, sines[:, None])
    width = sines[1] - sines[0]
    near = np.flatnonzero(np.abs(sines) < (_NEAR + 0.5) * width)
    fine = (sines[near][:, None] + (np.arange(_FINE) + 0.5) / _FINE * width - width / 2).ravel()
    middle = density(fine, fine[:, None]).reshape(len(near), _FINE, len(near), _FINE).mean(axis=(1, 3))
    share[np.ix_(near, near)] = middle
    return share * width**2


def _screens(
    seed: list[int], parts: list[_Part], kept: Sequence[np.ndarray] = ()
) -> Iterator[tuple[list[np.ndarray], np.ndarray]]:
    """Factors e^(i phi) of each screen at one instant after the other, and half a step beside it: complex64[n, n].

    ``kept`` are float32[n, n], what motion leaves of the phases' amplitudes from each instant to the next.
    """
    at_rest, moved = np.random.default_rng(seed), np.random.default_rng([*seed, 1])

    def noise(rng: np.random.Generator, amplitude: np.ndarray) -> np.ndarray:
        real, imaginary = rng.standard_normal((2, *amplitude.shape), dtype=np.float32)
        return (real + 1j * imaginary) * amplitude

    for count, half, amplitude in parts:
        for n in range(0, count, 2):  # the real and the imaginary part of one transform are two screens
            phases = [noise(at_rest, amplitude)]
            for share in kept:
                phases.append(phases[-1] * share + noise(moved, amplitude) * np.sqrt(1 - share**2))
            both = [np.asarray(fft2(phase)) for phase in phases]
            yield [np.exp(1j * phase.real) for phase in both], half
            if n + 1 < count:
                yield [np.exp(1j * phase.imag) for phase in both], half


def _spectra(
    screens: Iterator[tuple[list[np.ndarray], np.ndarray]], size: int, bins: list[tuple[int, int]]
) -> list[np.ndarray]:
    """Transforms complex64[n, n] of plane waves of tilts (x, y) in bins, each at its instant or the last."""
    unit = np.exp(2j * np.pi * np.arange(size) / size).astype(np.complex64)
    fields = [np.outer(unit[np.arange(size) * y % size], unit[np.arange(size) * x % size]) for x, y in bins]
    behind = np.ones((), np.complex64)
    for factors, half in screens:
        for number, field in enumerate(fields):
            factor = factors[min(number, len(factors) - 1)]
            field[...] = np.asarray(ifft2(np.asarray(fft2(field)) * (behind * half))) * factor
        behind = half
    return [np.asarray(fft2(field)) * behind for field in fields]


def _realization(screens, bins, views, sines):
    """|K| over all views, and C_I about the axis, of each tilt but the first: float64[T] each."""
    unshifted = _spectra(screens, len(sines), [(tilt, 0) for tilt in bins])
    spectra = [np.roll(each, -tilt, axis=1) for each, tilt in zip(unshifted, bins, strict=True)]
    every = np.array([_joined(spectra[0], other) for other in spectra[1:]])
    where = np.broadcast_to(sines, views.shape)[views]
    axis = [_axis(spectra[0][views], other[views], where) for other in spectra[1:]]
    return every, np.array(axis)


def _power(field: np.ndarray) -> float:
    return float(np.square(np.abs(field)).sum(dtype=np.float64))


def _joined(one: np.ndarray, other: np.ndarray) -> float:
    """|K| over all views."""
    return float(abs((one * other.conj()).sum(dtype=np.complex128)) / np.sqrt(_power(one) * _power(other)))


def _axis(one: np.ndarray, other: np.ndarray, x: np.ndarray) -> float:
    """C_I of two patterns of views x whose correlation turns evenly with x, as the pattern moves on the exit face."""
    product = (one * other.conj()).astype(np.complex128)
    scale = _power(one) * _power(other)

    def power(slope: np.ndarray) -> np.ndarray:
        return np.square(np.abs(np.exp(-1j * slope[:, None] * x) @ product)) / scale

    reach = np.abs(x).max()
    slopes = np.linspace(-1, 1, 401) * 60 / reach
    best = slopes[power(slopes).argmax()]
    return float(power(best + np.linspace(-0.3, 0.3, 61) / reach).max())
