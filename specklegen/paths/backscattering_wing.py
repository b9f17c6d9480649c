"""Intensity of reversed paths away from exact backscattering: a bound from the phase function of the scatterer.

Far from v = -i the phase k (i + v) . (x_1 - x_B) between a path and its reverse leaves only paths whose ends lie close,
those of two scatterings before all others. With x_1 and x_2 a distance r apart along w, sigma_s its share per length,

    C_2 = sigma_s int dw |s(i.w) s(w.v) s(-i.w) s(-w.v)| int dr e^(-sigma_t r) cos(k r (i + v) . w)

against rho(i.v) of single scattering, or against double scattering without the phase. The inner integral is sigma /
(sigma^2 + (k (i + v) . w)^2); faces that end the flights of a thin medium act as sigma_t + 2/L for sigma, and the
largest over this range counts. By symmetry only |i + v| matters. Longer paths lose more to the phase than those of two
scatterings and are compared with an intensity of their own, so the total stays below, save where light is thrown back
twice; that is added by the share of the phase function behind. Isotropic scatterers: pi/2 / (k l |i + v|) of single
ones, 1 / (k l |i + v|) in flatland, and the higher orders measured beside Monte Carlo (tests/paths/test_reversal.py);
that excess is a fifth to all of this bound for anisotropies from -0.9 to 0.99; optical depths from 0.1 to 8.
"""

import numpy as np

from specklegen.core.cached_results import cached_result
from specklegen.core.quadrature import gauss_legendre
from specklegen.core.values import remembered
from specklegen.scene.scatterers import Dimensions, Scatterer

_ACROSS, _AROUND = 48, 512  # nodes along i + v, and on the circle around it: 1 % of the integrals


@remembered(256)
def excess_bound(
    scatterer: Scatterer, dimensions: Dimensions, turns: float, optical_depth: float, albedo: float, distance: float
) -> float:
    """Largest share of the intensity that reversed paths add, at most 1.

    Parameters
    ----------
    scatterer, albedo
        What every collision does.
    dimensions
        3, or 2 in flatland.
    turns
        Mean free path over the wavelength.
    optical_depth
        Of the shortest way through the medium.
    distance
        |i + v| of the pair of light and view that is nearest to backscattering, at most 2.
    """
    given = scatterer, dimensions, turns, optical_depth, albedo, distance
    return cached_result(float, ("reversed paths", *given), lambda: _excess_bound(*given))


def _excess_bound(
    scatterer: Scatterer, dimensions: Dimensions, turns: float, optical_depth: float, albedo: float, distance: float
) -> float:
    """Integrals of :func:`excess_bound`."""
    phase = 2 * np.pi * turns * distance
    if not phase > 1e-3 or optical_depth == 0:
        return 1.0
    single = _density(scatterer, distance**2 / 2 - 1, dimensions)
    thinnest = 1 + 2 / optical_depth
    rates = (1.0, np.sqrt(thinnest), thinnest)
    integrals = [_integrals(scatterer, dimensions, phase, rate, distance) for rate in rates]
    back = _back_half(scatterer, dimensions)
    shares = [
        # Light thrown back twice returns to where it was: three scatterings then have ends as close as two.
        min((crossed / single if single > 0 else np.inf) + (back / rate) ** 2 * crossed / double, crossed / double)
        for rate, (crossed, double) in zip(rates, integrals, strict=True)
    ]
    return float(min(albedo * max(shares), 1.0))


def _integrals(
    scatterer: Scatterer, dimensions: Dimensions, phase: float, rate: float, distance: float
) -> tuple[float, float]:
    """Double scattering with the phase between both ways, and without it, over all w; flights end at ``rate``."""
    # Half of i + v is one leg; i = half + rest, v = half - rest, |rest|^2 = 1 - half^2.
    half = min(distance / 2, 1.0)
    rest = np.sqrt(1 - half**2)
    width = rate / phase
    nodes, weights = gauss_legendre(_ACROSS)
    # u = width tan(t) spaces the nodes by the Lorentzian; u is the cosine between w and i + v.
    reach = np.arctan(1 / width)
    along = width * np.tan(reach * nodes)
    across = np.sqrt(np.clip(1 - along**2, 0, None))
    lorentzian = reach * weights * width  # width^2/(u^2 + width^2) du
    measure = reach * weights * (along**2 + width**2) / width  # du
    if dimensions == 3:
        # Closer by the axes of the lobes, at both ends of the half circle, by a cubic map.
        t, ring = gauss_legendre(_AROUND)
        angle, ring = np.pi / 4 * (2 + 3 * t - t**3), 2 * ring * np.pi * 0.75 * (1 - t**2)
        cosines = np.cos(angle)
    else:
        cosines, ring = np.array([1.0, -1.0]), np.ones(2)
        lorentzian, measure = (a / np.maximum(across, 1e-9) for a in (lorentzian, measure))
    # The nodes lie evenly about 0 in u and in the cosine: -cosine swaps the legs, -u and -cosine turn both round.
    seen = _density(scatterer, half * along[:, None] + rest * across[:, None] * cosines, dimensions)
    there = seen * seen[:, ::-1]
    back = there[::-1]
    crossed = float(lorentzian @ (np.sqrt(there * back) @ ring)) / rate
    double = float(measure @ ((there + back) @ ring)) / 2 / rate
    return crossed, max(double, np.finfo(float).tiny)


def _back_half(scatterer: Scatterer, dimensions: Dimensions) -> float:
    """Share of the scattered light that goes back."""
    t, weights = gauss_legendre(256)
    theta, weights = np.pi / 4 * (3 + t), np.pi / 4 * weights
    ring = 2 * np.pi * np.sin(theta) if dimensions == 3 else 2.0
    return float(min(weights @ (ring * _density(scatterer, np.cos(theta), dimensions)), 1.0))


def _density(scatterer: Scatterer, cos: np.ndarray | float, dimensions: Dimensions) -> np.ndarray:
    """Phase function of all types of particle together: its products bound those of amplitudes of any mixture."""
    cos = np.clip(cos, -1.0, 1.0)
    return np.asarray(
        sum(share * np.square(np.abs(each.amplitude(cos, dimensions))) for each, share in scatterer.components)
    )
