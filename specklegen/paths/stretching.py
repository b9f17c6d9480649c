"""Importance sampling of walks towards the far face of an absorbing slab that few would cross.

Deep in a slab of albedo a light falls as e^(-nu sigma_t z); what a photon of direction w at the depth z adds behind
the slab grows as e^(nu sigma_t z) h(w_z), h the slowest mode of the adjoint transfer equation:

    (1 - nu mu) h(mu) = a H(mu),    H = integral of rho(w . w') h(w'_z) dw' = sum_l (2 l + 1)/2 g_l h_l P_l(mu)

g_l and h_l the Legendre moments of rho and h. They follow from a symmetric tridiagonal matrix, whose largest eigenvalue
is 1/nu (Case and Zweifel, Linear Transport Theory, 1967, ch. 8); beside the diagonal it has

    (l + 1) / sqrt((2l + 1)(2l + 3)(1 - a g_l)(1 - a g_(l+1)))

Isotropic, a = 0.9: nu = 0.5254; a = 0.5: 0.9575.

A walk whose every step is drawn in proportion to that importance has no variance but that of the faces (Dwivedi, Ann.
Nucl. Energy 9, 359 (1982), for isotropic scattering; any phase function here). Every choice of nu and h that solves the
equation for *some* albedo leaves means as they are.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from specklegen.core.quadrature import gauss_legendre
from specklegen.core.values import remembered
from specklegen.kernels import lobes
from specklegen.kernels.lobes import Lobe
from specklegen.kernels.stretching import Stretch
from specklegen.paths.phase_tables import walk_lobes
from specklegen.scene.layers import Layer
from specklegen.scene.media import PlaneMedium, Slab, as_slab
from specklegen.scene.scatterers import Scatterer

_MOMENTS = 400
_ANGLES = 4096  # of a phase function in flatland
_SHALLOW = 4.0  # optical depth that enough paths cross, whatever they meet
_NODES = 2048  # of H
_LARGEST_RATE = 0.98  # beyond it nearly every direction drawn would be thrown away
_LEAST_ACCEPTED = 1e-5  # chance of a direction to be taken, wherever it comes from
_SEEN = 120.0  # relative variance up to which the 6144 paths of a pilot see what matters, 50 times
_WORTH = 1.0  # relative variance of paths that are not drawn across from which others are better
_HALVINGS = 40


@dataclass(frozen=True)
class Mode:
    """The slowest mode of a medium.

    Attributes
    ----------
    decay : float
        nu, at most 1.
    moments : float64[n]
        h_l, the first one 1.
    """

    decay: float
    moments: np.ndarray


@remembered(64)
def decay(medium: Slab | Layer) -> float:
    """Return nu: the transmitted light falls as e^(-nu OD); 0 without absorption, at most 1."""
    return 0.0 if medium.albedo == 1 else _mode(medium.albedo, _moments(walk_lobes(medium.scatterer)[0])).decay


@remembered(64)
def flat_decay(scatterer: Scatterer, albedo: float) -> float:
    """Return nu in flatland: the same matrix, of Fourier moments, 1/2 beside the diagonal but for the first one's root.

    Isotropic: ``nu^2 = 1 - a^2``.
    """
    if albedo == 1:
        return 0.0
    angles = 2 * np.pi * np.arange(_ANGLES) / _ANGLES
    density = sum(share * np.square(np.abs(each.amplitude(np.cos(angles), 2))) for each, share in scatterer.components)
    moments = np.fft.rfft(density)[:_MOMENTS].real
    loss = 1 - albedo * moments / moments[0]
    beside = np.append(math.sqrt(0.5), np.full(len(loss) - 2, 0.5)) / np.sqrt(loss[:-1] * loss[1:])
    return min(1.0, 1 / _largest(beside)[0])


def relative_variance(medium: PlaneMedium) -> float:
    """Var w / (E w)^2 of a path that is not drawn across a slab, where pilots cannot know it; 0 where they can."""
    if medium.albedo == 0 or medium.optical_depth <= _SHALLOW:
        return 0.0
    return crossing_variance(_decay_across(medium), medium.optical_depth)


def _decay_across(medium: PlaneMedium) -> float:
    """Mean nu of the layers, by their optical depths."""
    slab = as_slab(medium)
    if slab is not None:
        return decay(slab)
    falls = [layer.optical_depth * (decay(layer) if layer.albedo else 1.0) for layer in medium.layers]
    return min(math.fsum(falls) / medium.optical_depth, 1.0)


def crossing_variance(nu: float, depth: float) -> float:
    """Stretching for light that crosses an optical depth, in a medium where it falls as e^(-nu depth).

    Paths that absorb by a coin and start exponentially deep are as many at the optical depth t as the light there. A
    connection from there is worth e^(-(depth - t)). The contribution w of a path then has
    ``Var w / (E w)^2 ~ e^(nu depth) max(1 - nu, 1/depth)^2 / (2 - nu)``.
    """
    variance = _unaided_variance(nu, depth)
    return variance if variance > _SEEN else 0.0


def draws_across(medium: PlaneMedium) -> bool:
    """Return whether drawing paths across a slab is worth it: from a relative variance of one a path on.

    The same error of C_I then takes less time behind deep and absorbing slabs: a third at an optical depth of 20 for g
    0.9; a tenth if the albedo falls from 0.99 to 0.9. Above all its error rests on many paths.
    """
    slab = as_slab(medium)
    if slab is None or slab.polarisation != "scalar":
        return False
    return slab.albedo > 0 and _unaided_variance(decay(slab), slab.optical_depth) > _WORTH


def _unaided_variance(nu: float, depth: float) -> float:
    if depth <= _SHALLOW:
        return 0.0
    logarithm = nu * depth + 2 * math.log(max(1 - nu, 1 / depth)) - math.log(2 - nu)
    return math.exp(min(logarithm, 700.0))


def unstretched(medium: Slab) -> Stretch:
    """A walk that is left as it is."""
    return Stretch(0.0, medium.albedo, 1.0, 1.0, np.ones((2, 2)))


@remembered(32)
def stretch_along(medium: Slab, cosine: float) -> Stretch:
    """Stretching towards the far face of a slab, for light at an angle of this cosine to the axis."""
    lobe, aim = (_moments(each) for each in walk_lobes(medium.scatterer))
    albedo = _walked_albedo(medium.albedo, lobe)
    mode = _mode(albedo, lobe)
    s = np.arange(_NODES) / (_NODES - 1)
    scattered = _series(lobe * mode.moments, 1 - 2 * s * s)
    slope = -4 * s * legendre.legval(1 - 2 * s * s, legendre.legder(_factors(lobe * mode.moments)))
    rows = np.stack([scattered, slope], axis=1)
    once, first = (_series(each * mode.moments, np.array(cosine)) for each in (lobe, aim))
    return Stretch(mode.decay, medium.albedo / albedo, float(_importance(mode.decay, rows[:, 0]).max()),
                   float(first / once), rows)  # fmt: skip


@remembered(64)
def events_per_depth(medium: PlaneMedium) -> float:
    """Scatterings per optical depth of a path that is drawn across a slab: -a dnu/da, since a^B is the weight of B."""
    lobe = _moments(walk_lobes(medium.scatterer)[0])
    albedo, step = _walked_albedo(medium.albedo, lobe), 1e-4
    more, less = (_mode(min(albedo * (1 + way), 1 - 1e-12), lobe).decay for way in (step, -step))
    return (less - more) / (2 * step)


def _walked_albedo(albedo: float, moments: np.ndarray) -> float:
    """Albedo by whose mode paths are drawn: the medium's, or the least above it whose mode rejection can draw."""
    if _drawable(albedo, moments):
        return albedo
    low, high = albedo, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if _drawable(middle, moments) else (middle, high)
    return high


def _drawable(albedo: float, moments: np.ndarray) -> bool:
    mode = _mode(albedo, moments)
    scattered = _series(moments * mode.moments, 1 - 2 * np.linspace(0, 1, _NODES) ** 2)
    return mode.decay <= _LARGEST_RATE and scattered.min() > _LEAST_ACCEPTED * _importance(mode.decay, scattered).max()


def _importance(rate: float, scattered: np.ndarray) -> np.ndarray:
    """Return h over the albedo, at even steps of sqrt((1 - mu) / 2), from H there."""
    return scattered / (1 - rate * (1 - 2 * np.linspace(0, 1, len(scattered)) ** 2))


def _mode(albedo: float, moments: np.ndarray) -> Mode:
    loss = 1 - albedo * moments
    order = np.arange(len(loss))
    beside = order[1:] / np.sqrt((2 * order[1:] - 1.0) * (2 * order[1:] + 1) * loss[:-1] * loss[1:])
    largest, vector = _largest(beside)
    profile = vector / np.sqrt((2 * order + 1) * loss)
    return Mode(min(1.0, 1 / largest), profile / profile[0])


def _largest(beside: np.ndarray) -> tuple[float, np.ndarray]:
    """Largest eigenvalue of a symmetric matrix that has only this beside its diagonal, and its vector."""
    from scipy.linalg import eigh_tridiagonal

    last = len(beside)
    values, vectors = eigh_tridiagonal(np.zeros(last + 1), beside, select="i", select_range=(last, last))
    return float(values[0]), vectors[:, 0]


def _series(moments: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """Sum of ``(2 l + 1)/2 m_l P_l(mu)``."""
    return legendre.legval(mu, _factors(moments))


def _factors(moments: np.ndarray) -> np.ndarray:
    return (np.arange(len(moments)) + 0.5) * moments


def _moments(lobe: Lobe) -> np.ndarray:
    """Legendre moments g_l float64[n] of a phase function as it is drawn from, g_0 = 1."""
    if not len(lobe.rows):
        return np.append(1.0, np.full(_MOMENTS - 1, lobe.g)).cumprod()
    x, w = gauss_legendre(4)
    start, width = lobe.rows[:-1, lobes.NODE, None], np.diff(lobe.rows[:, lobes.NODE])[:, None]
    into = width * (1 + x) / 2
    weights = (width / 2 * w * (lobe.rows[:-1, lobes.DENSITY, None] + lobe.rows[:-1, lobes.SLOPE, None] * into)).ravel()
    cos = 1 - (start + into).ravel()
    out, before, now = np.empty(_MOMENTS), np.ones_like(cos), cos
    for order in range(_MOMENTS):
        out[order] = weights @ before
        before, now = now, ((2 * order + 3) * cos * now - (order + 1) * before) / (order + 2)
    return out / out[0]
