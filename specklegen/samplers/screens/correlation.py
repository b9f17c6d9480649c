"""The memory-effect correlation and the envelope of a stack of screens, in closed form.

    u_t(v) = E(v - i_t) F_t(v),     F_t(v) = sum_x b(x) G_t(x) e^(-ik(v - i_t) . x),     E[G_t G*_t'] = K(i_t - i_t')

K is that of a fixed view: a mixture of Gaussians in the tilt, hence of exponentials in the square of the lateral walk r
(:mod:`specklegen.theory.phase_screens`, Eq. 2). E is the root of the phase function f, and turns with the tilt: behind
a thin medium the light stays about its beam. Its phase is that of the walk's mean, <R> = pivot (v - i).

Of one weak screen alone the field is not circular: with S_+ and S_- the parts of f of even and odd order,

    u = [(S_+^(1/2) + S_-^(1/2)) F(v) + (S_+^(1/2) - S_-^(1/2)) F*(2 i - v)] / 2^(1/2)

so that an image is correlated with its mirror image about the beam, wholly where sigma is small.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from specklegen.core.values import remembered
from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.scene.screens import ScreenStack
from specklegen.theory.phase_screens import Lobes, gathered, index_correlation, lobes, tilt_ways

_NODES = 2048  # of the tables that fields are made with
_CIRCULAR = 1e-3  # share of the mirrored field that nobody sees
_WIDTH = 0.02  # of the variances that are gathered into one, over themselves
GATHERED_ERROR = 2e-5
"""Error of C_I that gathered terms leave, at most: (width / 2)^2 max x^2 e^-2x."""


@dataclass(frozen=True)
class ScreenCorrelation(MemoryEffectCorrelation):
    """K of a stack of screens, a mixture of Gaussians in the tilt; it also holds what the screens' index takes.

        K(q) = sum_n w_n e^(-q^2 r_n^2 / 4) / sum_n w_n

    ``radius`` r_n and ``weights`` w_n are those of the terms: the lateral walk of each is Gaussian.

    Attributes
    ----------
    moved : float64[T, M, 2] or None
        How far each screen has moved at each beam of :meth:`correlation`.
    """

    stack: ScreenStack | None = None
    wavelength: float = float("nan")
    moved: np.ndarray | None = None

    def __call__(self, q: np.ndarray | float) -> np.ndarray:
        """K at lateral wavevector differences q (radians per unit length), any shape; K(0) = 1."""
        radius, share = self._mixture
        return np.exp(-0.25 * np.square(np.asarray(q, np.float64)[..., None] * radius)) @ share

    def on_grid(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """K float64[k, ny, nx] at all differences along x float64[k, nx] and y float64[k, ny], a sum of products."""
        radius, share = self._mixture
        along, across = (np.exp(-0.25 * np.square(axis[:, None] * radius[:, None])) for axis in (x, y))
        return (across * share[:, None]).swapaxes(1, 2) @ along

    def _lost(self, q: np.ndarray) -> np.ndarray:
        return -np.expm1(-0.25 * np.square(q * self.radius))

    def matrix(self, sines: np.ndarray, wavenumber: float) -> np.ndarray:
        """Matrix float64[T, T] of K between beams at direction sines float64[T, 2]; positive semidefinite."""
        assert self.stack is not None
        kept = index_correlation(self.stack, self.wavelength, np.hypot(*np.reshape(sines, (-1, 2)).T))
        if not self.weights.any():
            return kept
        if self.moved is None:
            return super().matrix(sines, wavenumber) * kept
        ways = tilt_ways(self.stack, sines) + self.moved
        return lobes(self.stack, self.wavelength).decorrelation(ways[:, None] - ways) * kept


@remembered(64)
def screen_correlation(stack: ScreenStack, wavelength: float) -> ScreenCorrelation:
    """K of a stack at the view along the beam; its weights add up to f(0)."""
    terms = lobes(stack, wavelength)
    variance, _ = terms.spreads(np.stack([stack.distances, 0 * stack.distances], axis=1))
    weight = terms.densities(0.0)
    walking = variance > 1e-12 * variance.max(initial=0.0)
    rest = float(weight[~walking].sum())
    variance, weight = gathered(variance[walking], weight[walking], _WIDTH)
    total = rest + weight.sum()
    return ScreenCorrelation(radius=np.append(0.0, np.sqrt(2 * variance)), weights=np.append(rest, weight)[None],
                             paths=1, single_share=float(rest / total) if total else 1.0, source="closed form",
                             stated_error=GATHERED_ERROR, stack=stack, wavelength=wavelength)  # fmt: skip


def drifts(stack: ScreenStack, wavelength: float, moved: np.ndarray) -> np.ndarray:
    """Shift of the pattern by screens that have moved float64[T, M, 2], float64[T, 2]: the mean over deflections."""
    return np.einsum("m,tmc->tc", lobes(stack, wavelength).walk_shares, moved)


class Envelope(NamedTuple):
    """Factors of F of every tilt at every view, and of the conjugate of its mirror image; over the root of f(0).

    Attributes
    ----------
    direct : complex64[T, H, W]
    mirrored : complex64[T, H, W] or None
        None where the field is circular.
    """

    direct: np.ndarray
    mirrored: np.ndarray | None


def envelope(
    stack: ScreenStack, wavelength: float, beams: np.ndarray, views: np.ndarray, drift: np.ndarray | None = None
) -> Envelope:
    """Envelope of beams float64[T, 3] at views float64[H, W, 3], unit vectors.

    ``drift`` float64[T, 2] is how far the screens have carried the pattern of each beam (:func:`drifts`).
    """
    terms = lobes(stack, wavelength)
    wavenumber, pivot = terms.wavenumber, terms.walk_shares @ stack.distances
    apart = views[None, ..., :2] - beams[:, None, None, :2]
    walk = pivot * beams[:, :2] if drift is None else pivot * beams[:, :2] + drift
    along = np.einsum("thwc,tc->thw", apart, walk)
    # In the order of the light's way: over all gaps along the beam, then by the walk about it.
    turned = stack.distances[0] * (beams[:, 2] - 1)[:, None, None] - along
    gain = views[None, ..., 2] / np.sqrt(beams[:, 2])[:, None, None] * np.exp(1j * wavenumber * turned)
    sine = np.hypot(apart[..., 0], apart[..., 1])
    single = lambda gain: gain.astype(np.complex64)  # noqa: E731 - as the fields that it multiplies
    if not len(terms.shares):
        return Envelope(single(0 * gain), None)
    whole = len(stack.screens) > 1
    even, odd = (0 if whole else profile(terms, sine, terms.of_parity(parity)) / np.sqrt(2) for parity in (0, 1))
    if whole or not (np.abs(even - odd) > _CIRCULAR * (even + odd)).any():
        return Envelope(single(gain * profile(terms, sine)), None)
    return Envelope(single(gain * (even + odd)), single(gain * (even - odd)))


def tabulated(stack: ScreenStack, wavelength: float) -> int:
    """Count the terms that are added up for the envelope of a beam: of one screen in two parts as well."""
    return _NODES * len(lobes(stack, wavelength).together[0]) * (2 if len(stack.screens) == 1 else 1)


def profile(terms: Lobes, sines: np.ndarray, part: Lobes | None = None) -> np.ndarray:
    """Root of f, or of a part of it, over f(0), at |p| float64[...]: interpolated in a table."""
    reach = np.linspace(0.0, float(sines.max(initial=0.0)) * (1 + 1e-12) + 1e-300, _NODES)
    table = np.sqrt((part or terms).density(reach) / terms.density(np.zeros(1)))
    return np.interp(sines, reach, table)
