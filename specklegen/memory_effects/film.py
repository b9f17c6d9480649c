"""The correlation of the beams of a film, each at its time and tilt, behind a slab that moves: K(q, x) of every pair.

    C_tt' = E[w e^(-i k (i_t - i_t') . R) e^(i k (t - t') D) e^(-2 x(t - t') Y)] / E[w]

D the Doppler shift of what flows (:mod:`specklegen.paths.momentum`).
A sum of products of correlations, so Hermitian and positive semidefinite for any beams and times (x of steps that a
Gaussian process has). Connections of one R are put into classes of Y, so narrow that nobody sees them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import j0

from specklegen.memory_effects.oblique import ObliqueCorrelation
from specklegen.paths.momentum import CLASSES, momentum_classes
from specklegen.scene.motion import Motion, reduced_time


@dataclass(frozen=True)
class FilmCorrelation:
    """K(q, x) as connections, for beams at given times.

    Attributes
    ----------
    ways : ObliqueCorrelation
        With the momentum transfer of every connection.
    times : float64[T]
    axial : bool
        Whether light and view are along the axis: R then has no direction.
    doppler : float64[M] or None
        Doppler shift of each connection, where flows differ; their directions make one of R.
    """

    ways: ObliqueCorrelation
    motion: Motion
    times: np.ndarray
    axial: bool
    doppler: np.ndarray | None = None

    @property
    def weights(self) -> np.ndarray:
        """float64[M], contribution of each connection."""
        return self.ways.weights

    @property
    def paths(self) -> int:
        """Paths behind them."""
        return self.ways.paths

    def matrix(self, sines: np.ndarray, wavenumber: float) -> np.ndarray:
        """Matrix complex128[T, T] between beams at direction sines float64[T, 2]."""
        apart = (sines[:, None] - sines).round(15)  # of no unit, and at most 2
        x = reduced_time("CollimatedBeams.times", self.motion, 2 * np.pi / wavenumber, self.times[:, None] - self.times)
        # Only pairs that differ, and of those that are each other's conjugate one.
        turn = wavenumber * self._fastest * (self.times[:, None] - self.times)
        keys = np.concatenate([apart, _rounded(turn)[..., None], _rounded(x)[..., None]], axis=-1).reshape(-1, 4) + 0.0
        # The first of the three that is not 0 decides which of the two it is.
        first = np.take_along_axis(keys, (keys[:, :3] != 0).argmax(axis=1)[:, None], axis=1)[:, 0]
        flipped = (first < 0) & keys[:, :3].any(axis=1)
        keys[flipped, :3] = -keys[flipped, :3] + 0.0
        pairs, number = np.unique(keys, axis=0, return_inverse=True)
        values = np.empty(len(pairs), np.complex128)
        still = ~pairs[:, :3].any(axis=1)
        shares, turned = self._classes
        values[still] = [shares @ np.exp(-2 * one * turned) for one in pairs[still, 3]]
        for n in np.flatnonzero(~still):
            values[n] = self._pair(*(wavenumber * pairs[n, :2]), *pairs[n, 2:])
        full = values[number.ravel()]
        return np.where(flipped, full.conj(), full).reshape(x.shape)

    @property
    def _fastest(self) -> float:
        """Largest Doppler shift, 0 where none is asked for."""
        return 0.0 if self.doppler is None else float(np.abs(self.doppler).max(initial=0.0))

    def _pair(self, qx: float, qy: float, turn: float, x: float) -> complex:
        ways, total = self.ways, self.ways.weights.sum()
        turned = ways.transfer if ways.transfer is not None else np.zeros(len(ways.weights))
        kept = ways.weights * np.exp(-2 * x * turned)
        if self.doppler is not None and turn:
            kept = kept * np.exp(1j * turn * (self.doppler / self._fastest))
        if self.axial and self.doppler is None:
            return complex(kept @ j0(np.hypot(qx, qy) * np.hypot(*ways.displacement.T)) / total)
        return complex(kept @ np.exp(-1j * (ways.displacement @ np.array([qx, qy]))) / total)

    @property
    def _classes(self) -> tuple[np.ndarray, np.ndarray]:
        """Shares float64[n] of classes of Y, and the mean Y of each."""
        turned, weights = self.ways.transfer, self.ways.weights
        assert turned is not None
        bins = momentum_classes(turned)
        share = np.bincount(bins, weights, CLASSES)
        mean = np.divide(np.bincount(bins, weights * turned, CLASSES), share, where=share > 0, out=0 * share)
        return share / max(share.sum(), 1e-300), mean


def _rounded(values: np.ndarray) -> np.ndarray:
    """Values, those of one and the same difference the same: to 2^-49 of the largest, whatever their size."""
    largest = float(np.abs(values).max(initial=0.0))
    step = np.ldexp(1.0, np.frexp(largest)[1] - 49)
    return np.round(values / step) * step if largest > 0 and np.isfinite(largest) else values


def causal_root(correlation: np.ndarray) -> np.ndarray:
    """Root [T, T] of a correlation, lower triangular: frames that come later change none before.

    Frames that others determine, up to rounding, bring nothing of their own.
    """
    root = np.zeros_like(correlation)
    for n in range(len(correlation)):
        for m in range(n):
            if root[m, m].real > 0:
                root[n, m] = (correlation[n, m] - root[n, :m] @ root[m, :m].conj()) / root[m, m].real
        left = correlation[n, n].real - np.square(np.abs(root[n, :n])).sum()
        root[n, n] = np.sqrt(left) if left > 1e-12 * correlation[n, n].real else 0.0
    return root
