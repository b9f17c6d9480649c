"""Light of finite bandwidth through a wide slab: path lengths, their coherence, and the modes of the light.

Over a spectrum S the field at one view is a Gaussian process in the wavenumber k with the correlation

    C(dk) = E[w e^(i dk s)] / E[w],      |C|^2 is the intensity's         physics.md 8

s the optical path length inside the slab. The eigenvectors of ``S^(1/2) C S^(1/2)``, with eigenvalues mu_n, are modes
of light that do not interfere: the image is an incoherent sum over independent speckle

    I = sum_n mu_n |u_n|^2,     contrast^2 = sum_n mu_n^2

They are found from the same operator seen from the paths, ``w^(1/2) S^(s - s') w^(1/2) phi_n = mu_n phi_n`` with S^ the
Fourier transform of S, which needs no grid of wavenumbers. Each mode is a gate in time of flight, w(s) gamma_n(s) =
mu_n phi_n(s)^2, and its speckle has the memory effect of the paths that pass it:

    K_n(q) = E[w gamma_n(s) J0(q r)] / E[w gamma_n(s)]

Long paths come out far away, so late gates have the shorter memory-effect range; one K for all modes would understate
``|K|^2`` by a quarter at half range (``OD = 10``, ``g = 0.9``). The gates add up to 1, so the K_n
to K. What is neglected is the interference of different modes between different tilts: 1 % of |K|^2 at half range.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.lazy import torch
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed
from specklegen.core.statistics import BATCHES, jackknife
from specklegen.memory_effects.correlation import MemoryEffectCorrelation, axial_tracer, lateral_distance
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.steps import refracting_layers
from specklegen.scene.media import PlaneMedium

Spectrum = Literal["gaussian", "flat"]

_LENGTHS, _RADII = 768, 256
_SPAN = (1e-3, 1e3)  # smallest and largest lateral distance told apart, over thickness + transport length
MOST_MODES = 64


@dataclass(frozen=True)
class SpectralCorrelation:
    """Paths by the length they travel and how far sideways they come out.

    Attributes
    ----------
    excess : float64[n]
        Mean length of each bin less the thickness; 0 for single scattering.
    weights : float64[batches, n]
        Contribution that each batch found in each bin.
    radius : float64[m]
        Root mean square lateral distance of each of its bins.
    joint : float64[m, n]
        Contribution by lateral distance and length.
    paths : int
        Paths behind it.
    single_share : float
        Share of single scattering in the intensity.
    """

    excess: np.ndarray
    weights: np.ndarray
    radius: np.ndarray
    joint: np.ndarray
    paths: int
    single_share: float

    def __call__(self, dk: np.ndarray | float) -> np.ndarray:
        """C at differences of the wavenumber inside the slab, complex128 of any shape; C(0) = 1."""
        dk = np.asarray(dk, dtype=np.float64)
        share = self.weights.sum(axis=0)
        used = share > 0
        return (np.exp(1j * dk[..., None] * self.excess[used]) @ share[used]) / share.sum()

    def intensity(self, dk: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """|C|^2 and its standard error at dk float64[T], by the jackknife over batches."""
        waves = np.exp(1j * np.asarray(dk, dtype=np.float64)[:, None] * self.excess)
        sums = np.concatenate([self.weights @ waves.T, self.weights.sum(axis=1, keepdims=True)], axis=1)
        return jackknife(sums, lambda total: np.square(np.abs(total[:-1] / total[-1])))

    def contrast(self, width: float, spectrum: Spectrum = "gaussian") -> float:
        """Contrast of one beam's speckle in light of a full width in wavenumber inside the slab.

        Its square is the mean of |S^(s - s')|^2 over pairs of path lengths, the sum of all mu_n^2.
        """
        share = self.weights.sum(axis=0) / self.weights.sum()
        pairs = np.square(spectrum_transform(spectrum, width, self.excess[:, None] - self.excess))
        return float(np.sqrt(share @ pairs @ share))

    def joint_correlation(self, q: float, dk: np.ndarray) -> np.ndarray:
        """E[w J0(q r) e^(i dk s)] / E[w] between two tilts and two wavenumbers: what the modes approximate."""
        from scipy.special import j0

        share = j0(q * self.radius) @ self.joint
        return (np.exp(1j * np.asarray(dk)[..., None] * self.excess) @ share) / self.joint.sum()

    def half_width(self) -> float:
        """Difference of the wavenumber at which ``|C|^2`` falls to a half; inf where it never does."""
        mean = self.weights.sum(axis=0) @ self.excess / self.weights.sum()
        if not mean > 0:
            return float("inf")
        scan = np.geomspace(1e-3, 1e3, 400) / mean
        below = np.flatnonzero(np.square(np.abs(self(scan))) < 0.5)
        if len(below) == 0:
            return float("inf")
        low, high = (scan[below[0] - 1] if below[0] else 0.0), scan[below[0]]
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if np.square(np.abs(self(middle))) > 0.5 else (low, middle)
        return float(high)


@dataclass(frozen=True)
class LightModes:
    """Modes of the light that do not interfere, the strongest first.

    Attributes
    ----------
    shares : float64[N]
        mu_n, the share of the intensity in each mode.
    correlations : tuple of MemoryEffectCorrelation
        The memory effect of each mode.
    flat : float
        Share in modes too weak to show: it comes as an even brightness.
    """

    shares: np.ndarray
    correlations: tuple[MemoryEffectCorrelation, ...]
    flat: float = 0.0

    @property
    def contrast(self) -> float:
        """Contrast of speckle from one beam, sqrt(sum of squared shares)."""
        return float(np.sqrt(np.square(self.shares).sum()))


def estimate_spectral_correlation(
    medium: PlaneMedium, paths: int, seed: Seed, *, threads: int | None = None
) -> SpectralCorrelation:
    """Estimate C in transmission along the axis, from ``paths`` paths in 64 batches.

    Of a slab, or of layers without steps of the index. With the seed of :func:`estimate_correlation` it is made from
    the same paths.
    """
    if refracting_layers(medium):
        reject("estimate_spectral_correlation medium", "of one index, or a Slab behind its faces", medium,
               "Use equal indices.")  # fmt: skip
    tracer = axial_tracer(medium)
    bank = tracer.trace(seed, paths, threads=threads)
    weight = contributions(tracer.layout, bank)
    radius = lateral_distance(bank)
    single = bank.orders == 1
    excess = bank.entry[:, 2] + bank.length - bank.exit[:, 2]  # single scattering: 0, or the ways between faces
    transport = medium.mean_free_path / (1 - medium.scatterer.mean_cosine())
    far = _geometric(radius, medium.thickness + transport)
    late = _quantiles(excess, weight)
    batches = min(BATCHES, max(paths, 1))
    bounds = np.linspace(0, paths, batches + 1).astype(int)
    batch = np.searchsorted(bounds, bank.paths, side="right") - 1
    weights = np.bincount(batch * _LENGTHS + late, weight, batches * _LENGTHS).reshape(batches, _LENGTHS)
    joint = np.bincount(far * _LENGTHS + late, weight, _RADII * _LENGTHS).reshape(_RADII, _LENGTHS)
    total = weight.sum()
    return SpectralCorrelation(
        excess=_mean(np.bincount(late, weight * excess, _LENGTHS), joint.sum(axis=0)), weights=weights,
        radius=np.sqrt(_mean(np.bincount(far, weight * radius**2, _RADII), joint.sum(axis=1))), joint=joint,
        paths=paths, single_share=float(weight[single].sum() / total) if total else 0.0,
    )  # fmt: skip


def _geometric(values: np.ndarray, scale: float) -> np.ndarray:
    """Place on a geometric grid; the first bin is for 0 alone."""
    low, high = np.log(np.array(_SPAN) * scale)
    with np.errstate(divide="ignore"):
        place = (np.log(values) - low) / (high - low) * (_RADII - 1)
    return np.where(values > 0, np.clip(place, 0, _RADII - 2) + 1, 0).astype(np.int64)


def _quantiles(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Place in bins of equal weight; the first bin is for 0 alone."""
    order = np.argsort(np.where(values > 0, values, -1.0), kind="stable")
    later = values[order] > 0
    share = np.cumsum(weight[order] * later)
    place = np.empty(len(values), np.int64)
    total = share[-1] if len(share) and share[-1] > 0 else 1.0
    place[order] = np.where(later, np.clip(share / total * (_LENGTHS - 1), 0, _LENGTHS - 2) + 1, 0)
    return place


def _mean(sums: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.divide(sums, weights, out=np.zeros_like(sums), where=weights > 0)


def spectrum_transform(spectrum: Spectrum, width: float, length: np.ndarray) -> np.ndarray:
    """Fourier transform of a spectrum about its middle, 1 at length 0.

    Parameters
    ----------
    spectrum, width
        Shape, and full width (at half maximum) in wavenumber.
    length
        Differences of the optical path length.
    """
    if spectrum == "flat":
        return np.sinc(width * length / (2 * np.pi))
    return np.exp(-np.square(width * length) / (16 * np.log(2)))


def light_modes(
    correlation: SpectralCorrelation, width: float, spectrum: Spectrum = "gaussian", *, tolerance: float = 1e-3,
    most: int = MOST_MODES,
) -> LightModes:  # fmt: skip
    """Modes of light of a spectrum behind a slab.

    Parameters
    ----------
    correlation
        C of the slab.
    width
        Full width (at half maximum) of the spectrum in wavenumber inside the slab, at least 0.
    spectrum
        Its shape.
    tolerance
        Share of contrast^2 that may go lost with the weakest modes, whose mean stays as an even brightness.
    most
        Modes above which to refuse.
    """
    passed = correlation.joint.sum(axis=0)
    used = passed > 0
    share, excess = passed[used] / passed.sum(), correlation.excess[used]
    root = np.sqrt(share)
    transform = spectrum_transform(spectrum, width, excess[:, None] - excess)
    with one_torch_thread():
        decomposition = torch.linalg.eigh(torch.from_numpy(root[:, None] * transform * root))
    power, vectors = (part.numpy() for part in decomposition)
    power, vectors = np.clip(power[::-1], 0, None), vectors[:, ::-1]
    squares = np.cumsum(np.square(power))
    kept = int(np.searchsorted(squares, (1 - tolerance) * squares[-1])) + 1
    if kept > most:
        reject("light_modes width", f"narrow enough for {most} modes of light",
               f"{width:.3g}, which makes {kept} and leaves a contrast of {np.sqrt(squares[-1]):.2g}",
               "Use a narrower filter, or a thinner or less scattering layer.")  # fmt: skip
    gates = np.square(vectors[:, :kept]) / share[:, None]  # up to mu_n, which the kernels do not feel
    correlations = tuple(
        MemoryEffectCorrelation(
            radius=correlation.radius,
            weights=(correlation.joint[:, used] @ gate)[None],
            paths=correlation.paths,
            single_share=float(gate[0] * share[0] / (gate @ share)) if used[0] else 0.0,
        )
        for gate in gates.T
    )
    return LightModes(power[:kept], correlations, float(max(0.0, 1 - power[:kept].sum())))
