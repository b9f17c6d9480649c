"""The envelope of narrow phase functions: how the mean intensity changes over views, and turns with the tilt.

    u_t(v) = A(i_t, v) F_t(v),     ln A^2(i, v) = P(|i|^2, |v|^2, i . v)

A slab is the same whichever way it is turned about its axis, so its mean intensity depends on those three alone. P has
second degree in them and is fitted to what pilot paths find at a few lights and views, A being 1 where the correlation
of the sampler is taken. Behind a narrow phase function P is about ``-|v - i|^2 / (2 theta^2)``: the light stays about
its beam, as behind a thin screen (:mod:`specklegen.samplers.screens.correlation`); behind a thick slab the two part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_PAIRS = np.triu_indices(3)
_HELD = 1e-4  # of the largest singular value: combinations that lights and views tell apart no better are left out


@dataclass(frozen=True)
class Envelope:
    """A^2 as a polynomial of second degree.

    Attributes
    ----------
    middle : float64[3]
        |i|^2, |v|^2 and i . v of the light and view at which it is 1.
    scale : float
        Unit of the three, for the sake of the fit.
    coefficients : float64[9]
        Of the three, and of their products in the order of a triangle's rows.
    """

    middle: np.ndarray
    scale: float
    coefficients: np.ndarray

    def intensity(self, lights: np.ndarray, views: np.ndarray) -> np.ndarray:
        """A^2 float64[...] of lights and views float64[..., 2], direction sines that broadcast."""
        x = [(each - at) / self.scale for each, at in zip(_invariants(lights, views), self.middle, strict=True)]
        return np.exp(sum(c * term for c, term in zip(self.coefficients, _terms(x), strict=True)))


def fit_envelope(lights: np.ndarray, views: np.ndarray, intensities: np.ndarray, middle: np.ndarray) -> Envelope:
    """Fit the polynomial by least squares of logarithms.

    Parameters
    ----------
    lights, views : float64[n, 2]
        Direction sines of pairs.
    intensities : float64[n]
        Mean intensities there over that of the middle, above 0.
    middle : float64[2, 2]
        Light and view at which the envelope is 1.
    """
    at = np.array(_invariants(*middle))
    apart = np.array(_invariants(lights, views)) - at[:, None]
    scale = float(np.abs(apart).max(initial=0.0)) or 1.0
    basis = np.array(_terms(list(apart / scale))).T
    coefficients = np.linalg.lstsq(basis, np.log(intensities), rcond=_HELD)[0]
    return Envelope(at, scale, coefficients)


def _invariants(lights: np.ndarray, views: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.square(lights).sum(-1), np.square(views).sum(-1), (lights * views).sum(-1)


def _terms(x: list[np.ndarray]) -> list[np.ndarray]:
    return [*x, *(x[i] * x[j] for i, j in zip(*_PAIRS, strict=True))]
