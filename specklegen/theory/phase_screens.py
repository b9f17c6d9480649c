"""Closed forms of thin screens: coherence, angular spectrum, and the generalised memory effect of a stack of them.

A beam of sine i meets screens m = 1 ... M at distances D_m before the exit plane. Between its field and that of a beam
of sine i' = i - delta, at points r apart on the exit plane, in the paraxial regime and up to phases,

    <E_i(X + r/2) E*_i'(X - r/2)> = exp(ik i . r) prod_m gamma_m(r - a_m),      a_m = D_m delta + s_m               (1)

s_m being how far screen m has moved between the two: a tilt shears the coherence, and every screen multiplies it. The
Fourier transform of (1) over r is what a far field sees at the view v, its mean f(v - i) and, over that, K_v(delta). As
``e^(sigma^2 rho)`` is a power series of Gaussians, the transform is a mixture of Gaussians: screen m deflects the light
n_m times, n_m a Poisson number of mean ``sigma_m^2``, each time by a Gaussian angle of variance ``2 / (k xi_m)^2`` an
axis,

    f(p) K(p, a) = sum_n P(n) N(p; T) exp{ -ik p . c - k^2 V / 2 },     e_m = 2 n_m / (k xi_m)^2,  T = sum e_m,
    c = sum e_m a_m / T,     V = sum e_m |a_m|^2 - |sum e_m a_m|^2 / T                                             (2)

N the normal density in the plane, n = 0 (the unscattered light) left out. Where all sigma_m >= 3 one component is left,
e_m = theta_m^2: the fixed-view variance V of Osnabrugge et al., Optica 4, 886 (2017), in discrete form.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, reduce
from typing import Annotated

import numpy as np

from specklegen.core.lazy import stats
from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH, SINE, WAVELENGTH
from specklegen.core.values import remembered
from specklegen.scene.scene import Scene
from specklegen.scene.screens import ScreenStack

_ENUMERATED = 2**16
"""Numbers of deflections that are all listed; of more, so many are drawn that their quadrature is off by about 1e-4."""
_DRAWN = 2**14
_TAIL = 1e-9  # share of the deflections left out
_QUICK = 2**14  # terms of ways that are not worth a look for equal ones
_TOGETHER = 2**20  # terms that are summed at a time
_GRID_WIDTH = 0.05  # of the variances that one term of a grid stands for, over themselves
_LARGE_MEAN, _NODES = 12.0, 12
"""Mean above which so many nodes stand for all numbers: K and f are then right to 1e-6 (tests)."""


@with_units
def coherence(
    stack: ScreenStack, wavelength: Annotated[float, WAVELENGTH], shift: Annotated[np.ndarray, LENGTH],
    ways: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Modulus of (1) over its value of two equal beams: field correlation over all views, float64[...].

    Parameters
    ----------
    stack, wavelength
        The screens, and the wavelength between them.
    shift
        float64[..., 2], the points' distance r on the exit plane.
    ways
        float64[..., M, 2], a_m; none by default.
    """
    shift = np.asarray(shift, np.float64)
    apart = shift[..., None, :] - (0.0 if ways is None else np.asarray(ways, np.float64))
    lost = -np.expm1(-np.square(apart).sum(-1) / np.square(stack.correlation_lengths))
    return np.exp(-(np.square(stack.phases(wavelength)) * lost).sum(-1))


@with_units
def tilt_ways(stack: ScreenStack, tilt: Annotated[np.ndarray, SINE]) -> np.ndarray:
    """a_m = D_m delta of tilts float64[..., 2], by the difference of their sines: float64[..., M, 2]."""
    return stack.distances[:, None] * np.asarray(tilt, np.float64)[..., None, :]


@with_units
def spread(stack: ScreenStack, wavelength: Annotated[float, WAVELENGTH]) -> tuple[float, float, float]:
    """Lateral walk R to the exit plane of strongly scattered light: its two variances an axis, and its pivot.

    Over all views ``Var R_x = sum theta_m^2 D_m^2``; at a fixed view that less
    ``(sum theta_m^2 D_m)^2 / sum theta_m^2``, and the mean ``<R> = (v - i) pivot``. ``|K| = exp{-(k delta)^2 Var / 2}``
    where all sigma >= 3.
    """
    angles = np.square([each.rms_angle(wavelength) for each in stack.stack.screens])  # type: ignore[union-attr]
    distance, total = stack.distances, angles.sum()
    pivot = float(angles @ distance / total) if total else 0.0
    over_all = float(angles @ distance**2)
    return over_all, float(angles @ np.square(distance - pivot)), pivot


@with_units
def index_correlation(
    stack: ScreenStack, wavelength: Annotated[float, WAVELENGTH], sines: Annotated[np.ndarray, SINE],
    others: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Field correlation left by the screens' index, of beams at sines float64[T] from the normal: [T, T].

    With ``others`` float64[S] it is that of each with each of these, [T, S].

    The phase of a rough face grows with the tilt, as if it were higher: prod_m exp{-[sigma_m(s) - sigma_m(s')]^2 / 2}.
    """
    phases = stack.phases(wavelength, sines)
    second = phases if others is None else stack.phases(wavelength, others)
    return np.exp(-0.5 * np.square(phases[:, :, None] - second[:, None, :]).sum(0))


@dataclass(frozen=True)
class Lobes:
    """The mixture (2) of a stack.

    Attributes
    ----------
    counts : float64[N, M]
        n_m, deflections by each screen.
    steps : float64[M]
        Variance of the angle along one axis that a deflection adds, 2 / (k xi_m)^2.
    shares : float64[N]
        P(n); their sum is the scattered share of the light, 1 - e^-OD.
    """

    counts: np.ndarray
    steps: np.ndarray
    shares: np.ndarray
    wavenumber: float

    @property
    def events(self) -> np.ndarray:
        """e_m, what each screen adds to the variance of the angle along one axis, float64[N, M]."""
        return self.counts * self.steps

    @property
    def variances(self) -> np.ndarray:
        """T of every term, float64[N]."""
        return self.events.sum(axis=1)

    @cached_property
    def together(self) -> tuple[np.ndarray, np.ndarray]:
        """Variances and shares of the terms of about one variance."""
        return gathered(self.variances, self.shares)

    def over_grid(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Density f over f(0) at p = (x, y), float64[..., len(y), len(x)] of sines [..., nx] and [..., ny].

        Every term is a product, and one stands for those within 5 per cent: right to 1e-4 of f(0).
        """
        variance, share = self._grid_terms
        along_x, along_y = (np.exp(-0.5 * np.square(axis)[..., None, :] / variance[:, None]) for axis in (x, y))
        return (along_y * share[:, None]).swapaxes(-1, -2) @ along_x

    @cached_property
    def _grid_terms(self) -> tuple[np.ndarray, np.ndarray]:
        variance, share = gathered(self.variances, self.shares / self.variances, _GRID_WIDTH)
        return variance, share / share.sum()

    @cached_property
    def mirrored(self) -> float:
        """|S_+ - S_-|^2 / f^2 at p = 0: correlation of an intensity with its mirror image about the beam, at most."""
        if not len(self.shares):
            return 0.0
        even, odd = (self.of_parity(parity).density(np.zeros(1))[0] for parity in (0, 1))
        return float(((even - odd) / (even + odd)) ** 2)

    def densities(self, sine: float) -> np.ndarray:
        """P(n) N(p; T) of every term at |p| = ``sine``, per unit of the plane of sines: float64[N]."""
        variance = self.variances
        return self.shares * np.exp(-0.5 * sine**2 / variance) / (2 * np.pi * variance)

    def density(self, sines: np.ndarray) -> np.ndarray:
        """Density f at |p| float64[...]: scattered share of the light per unit of the plane of sines."""
        sines = np.asarray(sines, np.float64)
        if not len(self.shares):
            return np.zeros(sines.shape)
        variance, share = self.together
        exponent = -0.5 * np.square(sines)[..., None] / variance
        return np.exp(exponent) @ (share / (2 * np.pi * variance))

    def spreads(self, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """V float64[..., N] and c float64[..., N, 2] of every term, for a_m float64[..., M, 2]."""
        events, total = self.events, self.variances
        middle = np.mean(ways, axis=-2, keepdims=True)
        apart = ways - middle  # small: V is a difference of two sums
        first = events @ apart
        squares = np.square(apart).sum(-1) @ events.T
        return np.maximum(squares - np.square(first).sum(-1) / total, 0.0), first / total[:, None] + middle

    @cached_property
    def walk_shares(self) -> np.ndarray:
        """<e_m / T> by the light that goes on along the beam, float64[M]: how far the pattern follows each screen."""
        weight = self.densities(0.0)
        return weight @ (self.events / self.variances[:, None]) / weight.sum() if weight.any() else 0 * self.steps

    def decorrelation(self, ways: np.ndarray) -> np.ndarray:
        """K(0, a), real, of a_m float64[..., M, 2]: float64[...]; equal ways are found once."""
        flat = np.reshape(ways, (-1, *ways.shape[-2:]))
        which = None
        if len(flat) * len(self.shares) > _QUICK:
            unique, which = np.unique(flat.reshape(len(flat), -1), axis=0, return_inverse=True)
            flat, which = unique.reshape(-1, *ways.shape[-2:]), which.reshape(-1)
        correlation = np.ones(len(flat))
        if len(self.shares):
            weight = self._weights(0.0)
            scale = -0.5 * self.wavenumber**2
            step = max(1, _TOGETHER // self.events.size)
            for first in range(0, len(flat), step):
                variance, _ = self.spreads(flat[first : first + step])
                correlation[first : first + step] = (weight * np.exp(scale * variance)).sum(-1) / weight.sum()
        return (correlation if which is None else correlation[which]).reshape(ways.shape[:-2])

    def _weights(self, sine: float) -> np.ndarray:
        """P(n) N(p; T) of every term at |p| = ``sine`` over the largest: where components underflow, ratios do not."""
        exponent = np.where(self.shares > 0, -0.5 * sine**2 / self.variances, -np.inf)
        return self.shares * np.exp(exponent - exponent.max()) / (2 * np.pi * self.variances)

    def of_parity(self, parity: int) -> "Lobes":
        """The terms of an even or odd number of deflections; half of each where nodes stand for many numbers."""
        if (self.counts % 1 != 0).any():
            return replace(self, shares=self.shares / 2)
        kept = self.counts.sum(axis=1) % 2 == parity
        return replace(self, counts=self.counts[kept], shares=self.shares[kept])

    def correlation(self, sine: np.ndarray, ways: np.ndarray) -> complex:
        """K(p, a) at p float64[2] for a_m float64[M, 2]; 1 where a_m is the same for all screens, up to a phase."""
        if not len(self.shares):
            return 1.0
        weight = self._weights(float(np.hypot(*sine)))
        variance, mean = self.spreads(ways)
        value = np.exp(-0.5 * self.wavenumber**2 * variance - 1j * self.wavenumber * (mean @ sine))
        return complex(weight @ value / weight.sum())


@with_units
@remembered(64)
def lobes(stack: ScreenStack, wavelength: Annotated[float, WAVELENGTH]) -> Lobes:
    """The mixture of Gaussian components of a stack."""
    wavenumber = 2 * np.pi / wavelength
    means = np.square(stack.phases(wavelength))
    counts, shares = _deflections(means)
    return Lobes(counts, 2 / np.square(wavenumber * stack.correlation_lengths), shares, wavenumber)


def scattered_intensity(scene: Scene) -> float:
    """Largest mean |u - m|^2 that the screens of a scene send to a view: f(0) times the window's area."""
    assert scene.thin is not None
    return float(lobes(scene.thin, scene.wavelength).density(np.zeros(1))[0]) * scene.beams.window.area


def _deflections(means: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers n float64[N, M] of Poisson means float64[M], all zeros left out, and their probabilities float64[N]."""
    seen = -math.expm1(-float(means.sum()))
    if seen == 0:
        return np.zeros((0, len(means))), np.zeros(0)
    each = [_poisson(float(mean)) for mean in means]
    if math.prod(len(numbers) for numbers, _ in each) <= _ENUMERATED:
        counts = np.stack([n.ravel() for n in np.meshgrid(*(numbers for numbers, _ in each), indexing="ij")], axis=1)
        shares = reduce(np.multiply.outer, [weights for _, weights in each]).ravel()
        scattered = counts.any(axis=1)
        counts, shares = counts[scattered], shares[scattered]
        return counts, shares * (seen / shares.sum())
    # The total is a Poisson number above 0, and each deflection falls to a screen by the screens' means.
    even = stats.qmc.Sobol(len(means), scramble=False).random(_DRAWN) + 0.5 / _DRAWN
    left = stats.poisson.ppf(1 - seen * (1 - even[:, 0]), means.sum()).clip(1)
    counts = np.zeros((_DRAWN, len(means)))
    for m in range(len(means) - 1):
        counts[:, m] = stats.binom.ppf(even[:, m + 1], left, means[m] / means[m:].sum())
        left = left - counts[:, m]
    counts[:, -1] = left
    return counts, np.full(_DRAWN, seen / _DRAWN)


@lru_cache(maxsize=256)
def _poisson(mean: float) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and weights of a Poisson distribution: all that matter, or of a large mean the nodes of Gauss.

    Golub and Welsch, Math. Comp. 23, 221 (1969), with the recurrence of the Charlier polynomials (DLMF 18.22).
    """
    if mean < _LARGE_MEAN:
        # Where little is scattered at all, the tail is that of what is: the first orders must be there.
        numbers = np.arange(max(float(stats.poisson.isf(_TAIL, mean)), 4.0) + 1)
        return numbers, stats.poisson.pmf(numbers, mean)
    order = np.arange(_NODES)
    beside = np.sqrt(mean * order[1:])
    numbers, vectors = np.linalg.eigh(np.diag(order + mean) + np.diag(beside, 1) + np.diag(beside, -1))
    return numbers, np.square(vectors[0])


def gathered(
    variance: np.ndarray, share: np.ndarray, width: float = 0.0, most: int = 400
) -> tuple[np.ndarray, np.ndarray]:
    """Terms of nearly one variance as one: within a relative width, and at most so many."""
    if len(variance) <= 1:
        return variance, share
    low, high = np.log(variance.min()), np.log(variance.max())
    bins = min(most, int((high - low) / width) + 1) if width else most
    if len(variance) <= bins:
        return variance, share
    place = np.minimum(((np.log(variance) - low) / max(high - low, 1e-300) * bins).astype(int), bins - 1)
    total = np.bincount(place, share, bins)
    mean = np.bincount(place, share * variance, bins)
    used = total > 0
    return mean[used] / total[used], total[used]
