"""Walks of light from the entrance face to the exit, at any lag of a film, on the cells of the exit plane.

    K(q; x) = sum_p w_p e^(-i q . R_p - 2 x Y_p) / sum_p w_p

over connections p, by one non-uniform transform for all q of a lattice: with it the product of two fields on the
entrance face walks to the exit face, where J_tt' = P * (E_t E_t'^*).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from specklegen.memory_effects.film import FilmCorrelation
from specklegen.scene.motion import Motion, reduced_time

_PRECISION = 1e-9  # of transforms, over the sum of the weights


@dataclass(frozen=True)
class Walks:
    """Connections from face to face.

    Attributes
    ----------
    displacement : float64[M, 2]
    weights : float64[M]
    transfer : float64[M] or None
        Momentum transfer Y of each connection, of media that move.
    motion : Motion or None
    """

    displacement: np.ndarray
    weights: np.ndarray
    transfer: np.ndarray | None = None
    motion: Motion | None = None

    def reduced(self, wavelength: float, lags: np.ndarray) -> np.ndarray:
        """Return x float64[...] of lags of time; 0 of media at rest."""
        if self.motion is None:
            return np.zeros(np.shape(lags))
        return reduced_time("CoherentObject.times", self.motion, wavelength, lags)

    def spectrum(self, period: tuple[int, int], size: tuple[float, float], reduced: float = 0.0) -> np.ndarray:
        """Return K complex128[Y, X] at the wavevectors of a transform over cells of a size along (y, x).

        ``reduced`` is x of the lag.
        """
        from finufft import nufft2d1

        kept = self.weights / max(self.weights.sum(), 1e-300)
        if reduced:
            assert self.transfer is not None, "media that move have their paths' transfer"
            kept = kept * np.exp(-2 * reduced * self.transfer)
        x, y = (2 * np.pi * np.mod(self.displacement[:, n] / (period[1 - n] * size[1 - n]), 1.0) for n in (0, 1))
        return np.asarray(nufft2d1(y, x, kept.astype(complex), period, isign=-1, eps=_PRECISION, modeord=1, nthreads=1))


def walks_of(correlation: Any) -> Walks:
    """Return the walks of a correlation of the stationary sampler, behind its analyser if it has one."""
    if isinstance(correlation, FilmCorrelation):
        return Walks(correlation.ways.displacement, correlation.weights, correlation.ways.transfer, correlation.motion)
    transfer, motion = correlation.transfer, getattr(correlation, "motion", None)
    return Walks(correlation.displacement, correlation.weights, transfer, motion)
