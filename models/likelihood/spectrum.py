"""The mean of a periodogram in closed form, for an object behind a slab: exact for a camera of any size.

An object o >= 0 of sum 1, its pixels s camera pixels apart, has the autocorrelation R; pairs of its points that lie d
pixels apart are seen with the weight C(d) of the memory effect; a grain has the autocorrelation P, P(0) = 1. An image
x (over its mean, less 1) has at the lag l the covariance sum_d R(d) C(d) P(l - d s), and its periodogram over M x N
pixels the mean

    S(f) = sum_l tri(l) e^(-2 pi i f l) sum_d R(d) C(d) P(l - d s) + noise,    tri(l) = (1 - |l_y| / M)(1 - |l_x| / N)

("debiased Whittle": Sykulski et al., Biometrika 106, 251 (2019), section 3; under a taper tri is its autocorrelation,
and F its |transform|^2: :mod:`~specklegen.models.retrieval.edges`). P is the transform of the window's overlap
T (Goodman, *Introduction to Fourier Optics*, 2005, section 6.3), which is a sum of few products of its two coordinates,

    T(u, v) = sum_r c_r q_r(u) q_r(v),    S = sum_r c_r E_r [R C] E_r^T,
    E_r(f, j) = integral q_r(u) F(f - u / grain) e^(-2 pi i u j s / grain) du,    F Fejer's kernel of M pixels

one product for square and Gaussian windows, a dozen for a disc. Coordinates of T are shifts in window widths, and u /
grain is a frequency in cycles a camera pixel. A pixel that collects light over its area multiplies T by sinc^2.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from specklegen.core.quadrature import gauss_legendre
from specklegen.models.retrieval.edges import shares_of, taper_kernel
from specklegen.scene.window import Profile, Window

_SMALLEST = 1e-6  # of T: beyond, it is left out
_PRODUCTS = 1e-4  # of the largest product of T: smaller ones are left out


@dataclass(frozen=True, eq=False)
class Factor:
    """One product of the overlap: c q(u) q(v).

    Attributes
    ----------
    weight : float
        c.
    nodes, values : float64[K]
        u, and q(u) times the weights of the quadrature.
    """

    weight: float
    nodes: np.ndarray
    values: np.ndarray


@lru_cache(maxsize=64)
def factors(profile: Profile, cycles: int, pixel: float = 0.0) -> tuple[Factor, ...]:
    """Products whose sum is the overlap of a window with itself, its integral 1.

    Parameters
    ----------
    profile
        Shape of the window.
    cycles
        Periods over a unit of u of the fastest function that is to be integrated.
    pixel
        Side of a camera pixel that collects light over its area, in grains; 0 for pixels that are points.
    """
    window = Window(profile, 1.0)
    reach = 1.0 if window.sharp else float(np.sqrt(-np.log(_SMALLEST)) / 2)
    nodes, weights = gauss_legendre(int(np.pi * cycles * reach / 2) + 24)
    nodes, weights = reach * (nodes + 1) / 2, reach * weights / 2  # from 0 on, where a square's overlap has its edge
    root = np.sqrt(weights)
    passed = window.overlap(nodes, nodes[:, None]) * np.outer(np.sinc(nodes * pixel), np.sinc(nodes * pixel)) ** 2
    shares, vectors = np.linalg.eigh(root[:, None] * passed * root)
    kept = np.abs(shares) > _PRODUCTS * np.abs(shares).max()
    shares, halves = shares[kept], vectors.T[kept] * root
    total = (shares * np.square(2 * halves.sum(1))).sum()  # P(0), the integral over all shifts
    both = np.concatenate([-nodes[::-1], nodes])
    values = np.concatenate([halves[:, ::-1], halves], axis=1)
    return tuple(Factor(float(share / total), both, value) for share, value in zip(shares, values, strict=True))


class Transforms(NamedTuple):
    """Fourier transforms along both axes as real numbers: from lags of an object to frequencies, and back.

    Attributes
    ----------
    rows : float[B, r, 2, F, J]
        Real and imaginary part, r products whose sum counts.
    columns : float[B, r, 2, G, K]
    """

    rows: Tensor
    columns: Tensor

    def __call__(self, lags: Tensor) -> Tensor:
        """Real part of the transforms float[B, ..., F, G] of lags float[B, ..., J, K]."""
        extra = [1] * (lags.ndim - 3)
        rows, columns = (x.reshape(len(x), *extra, *x.shape[1:]) for x in self)
        turned = (rows.flatten(-3, -2) @ lags[..., None, :, :]).unflatten(-2, (2, -1))
        sides = columns.mT
        return (turned[..., 0, :, :] @ sides[..., 0, :, :] - turned[..., 1, :, :] @ sides[..., 1, :, :]).sum(-3)

    def back(self, spectra: Tensor) -> Tensor:
        """Lags float[B, ..., J, K] of spectra float[B, ..., F, G]: the adjoint of the call."""
        return Transforms(self.rows.mT, self.columns.mT)(spectra)


def transforms(
    rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int], objects: tuple[int, int], step: Tensor,
    grain: Tensor, profile: Profile = "square", pixel: bool = False, taper: Tensor | float = 0.0,
) -> Transforms:  # fmt: skip
    """Transforms of both axes, computed in double precision and kept in that of ``step``.

    Parameters
    ----------
    rows, columns
        Frequencies of either axis in cycles a pixel, whole numbers over the sides of a tile.
    shape
        Of a tile, pixels.
    objects
        (h, w) of the objects.
    step, grain
        Camera pixels between object pixels, and in a grain, float[B].
    profile
        Shape of the window.
    pixel
        Whether pixels collect light over their area.
    taper
        Share of a tile's sides on the ramps of its taper, one number or float[B].
    """
    steps, grains = (x.detach().cpu().numpy().astype(np.float64) for x in (step, grain))
    reach = max(steps.max() * (n - 1) + side for n, side in zip(objects, shape, strict=True))
    kernels: list[list[np.ndarray]] = [[], []]
    for n, (size, share) in enumerate(zip(grains, shares_of(taper, len(grains)), strict=True)):
        terms = factors(profile, 16 * int(np.ceil(reach / size / 16)), 1 / size if pixel else 0.0)
        for axis, frequencies in enumerate((rows, columns)):
            kernel = _kernels(terms, frequencies.tobytes(), shape[axis], float(size), share, axis == 0)
            lags = np.arange(1 - objects[axis], objects[axis])
            angle = (-2 * np.pi * steps[n] / size) * terms[0].nodes[:, None] * lags
            both = kernel @ np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
            kernels[axis].append(both.reshape(len(terms), len(frequencies), 2, -1).swapaxes(1, 2))
    return Transforms(*(_stacked(parts).to(step) for parts in kernels))


def waves(frequencies: np.ndarray, lags: np.ndarray, step: Tensor) -> Tensor:
    """e^(-2 pi i f l s), float[B, 1, 2, F, J], of frequencies in cycles a pixel and lags of s pixels."""
    angle = -2 * torch.pi * step[:, None, None] * torch.from_numpy(np.outer(frequencies, lags)).to(step)
    return torch.stack([angle.cos(), angle.sin()], dim=1)[:, None]


@lru_cache(maxsize=8)
def _kernels(
    found: tuple[Factor, ...], frequencies: bytes, side: int, grain: float, taper: float, weighted: bool
) -> np.ndarray:
    """Kernel of the taper times the values of every factor, one below the other, float64[r F, K]."""
    kernel = taper_kernel(np.frombuffer(frequencies)[:, None] - found[0].nodes / grain, side, taper)
    return np.concatenate([kernel * factor.values * (factor.weight if weighted else 1.0) for factor in found])


def _stacked(parts: list[np.ndarray]) -> Tensor:
    """Stack float[r, ...], with zeros where one has fewer products than another."""
    most = max(map(len, parts))
    return torch.from_numpy(np.stack([np.pad(x, [(0, most - len(x)), (0, 0), (0, 0), (0, 0)]) for x in parts]))


def autocorrelation_of(objects: Tensor) -> Tensor:
    """R of objects float[..., h, w] of any sum, float[..., 2 h - 1, 2 w - 1], the zero lag in the middle."""
    rows, columns = objects.shape[-2:]
    whole = objects / objects.sum((-2, -1), keepdim=True).clamp_min(torch.finfo(objects.dtype).tiny)
    padded = (2 * rows, 2 * columns)
    lags = torch.fft.irfft2(torch.fft.rfft2(whole, s=padded).abs().square(), s=padded)
    return torch.fft.fftshift(lags, dim=(-2, -1))[..., 1:, 1:]
