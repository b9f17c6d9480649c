"""Karhunen-Loeve modes of the memory effect: few independent fields for many correlated beams.

    K(i_j - i_l) = sum_r phi_r(j) phi_r(l)

Pivoted Cholesky finds the beams that determine all others, an eigenvalue decomposition then drops what is
left of the rank. Symmetric objects have equal eigenvalues, whose vectors any rounding turns; so the modes are
at last brought to the one triangular form at the pivots, and are the same on every machine. K is tabulated
once: a cubic spline, whose error falls with the fourth power of its step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from specklegen.core.lazy import LazyModule
from specklegen.core.parallel import one_torch_thread
from specklegen.samplers.stationary.correlation import MemoryEffectCorrelation

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")

Correlation = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Modes:
    """Modes over a set of beams.

    Attributes
    ----------
    values : float64[P, R]
        phi, each beam's intensity (the sum of its squares) 1.
    pivots : int[n]
        Beams that determine the others, n >= R.
    """

    values: np.ndarray
    pivots: np.ndarray

    def mixing(self, correlation: Correlation, wavevectors: np.ndarray) -> np.ndarray:
        """Root float64[R, R] that turns these modes into those of another K: phi A A^T phi^T is its matrix.

        Found at the pivots, and right for the other beams where their K's modes lie in the span of these.
        """
        gap = wavevectors[self.pivots][:, None] - wavevectors[self.pivots]
        matrix = torch.from_numpy(correlation(np.hypot(gap[..., 0], gap[..., 1])))
        with one_torch_thread():
            at_pivots = torch.linalg.pinv(torch.from_numpy(self.values[self.pivots]))
            values, vectors = torch.linalg.eigh(at_pivots @ matrix @ at_pivots.T)
            return ((vectors * values.clamp(min=0).sqrt()) @ vectors.T).numpy()  # symmetric: the only one


def tabulated(kernel: MemoryEffectCorrelation, largest: float) -> Correlation:
    """K as a cubic spline from 0 to ``largest``, with a node every 1/16 of the inverse mean distance."""
    if largest == 0 or not kernel.weights.any():
        return lambda q: np.ones_like(q)
    spread = np.sqrt(kernel.mean_square_radius)
    nodes = np.linspace(0, largest, int(np.clip(16 * largest * spread, 32, 4096)) + 1)
    return CubicSpline(nodes, kernel(nodes))


def karhunen_loeve(correlation: Correlation, wavevectors: np.ndarray, tolerance: float) -> Modes:
    """Modes of beams with lateral wavevectors float64[P, 2].

    What they leave out adds up to at most ``tolerance`` of the intensity, and every beam's intensity is
    then restored to 1.
    """
    size = len(wavevectors)
    residual = np.ones(size)
    factor = np.empty((0, size))
    pivots: list[int] = []
    while residual.sum() > 0.25 * tolerance * size and len(pivots) < size:
        pivot = int(residual.round(9).argmax())  # of equal ones the first, whatever the rounding
        gap = wavevectors - wavevectors[pivot]
        row = correlation(np.hypot(gap[:, 0], gap[:, 1])) - (factor[:, pivot, None] * factor).sum(axis=0)
        row = row / np.sqrt(residual[pivot])
        factor = np.concatenate([factor, row[None]])
        residual = np.clip(residual - row**2, 0, None)
        residual[pivot] = 0.0  # rounding must not choose it twice
        pivots.append(pivot)
    # The small Gram matrix has the factor's singular vectors at a fraction of the cost of its own decomposition.
    with one_torch_thread():
        rows = torch.from_numpy(factor)
        power, vectors = torch.linalg.eigh(rows @ rows.T)
        rank = max(1, int((power.cumsum(0) > 0.75 * tolerance * size).sum()))
        while rank < len(power) and power[-rank - 1] > 0.999 * power[-rank]:
            rank += 1  # equal eigenvalues stay together
        values = rows.T @ vectors.flip(1)[:, :rank]
        turn, triangle = torch.linalg.qr(values[pivots[:rank]].T)
        values = values @ (turn * triangle.diagonal().sign())
    return Modes((values / values.norm(dim=1, keepdim=True)).numpy(), np.array(pivots))
