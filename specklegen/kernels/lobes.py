"""Phase functions of any shape for walks in lock step: one table to draw from and to judge by.

The density f of v = 1 - cos(theta) is linear between nodes v_j: over each octave of v lie equally many, so that a node
is found from the bits of v, and a narrow phase function costs no more than a wide one. The same piecewise linear f is
drawn from and evaluated, each exactly, so that weights fit the draws to rounding. How far f is from the scatterer's own
is found when the table is made (:func:`specklegen.paths.phase_tables.walk_lobes`). A table of no rows stands for Henyey
and Greenstein's phase function, which has a closed form. So has that of von Mises and Fisher, f = kappa e^(-kappa v) /
(1 - e^(-2 kappa)): ordinary scattering draws from it and judges by it; its table is for steered scattering alone.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined
from specklegen.kernels.arithmetic import exponential, minus_log
from specklegen.kernels.phase_functions import henyey_greenstein

_TAU = 2.0 * math.pi
_FLOOR = 0.1  # of isotropic scattering: no connection is judged by a zero of the amplitude at one light or view

# Columns of a row.
NODE, DENSITY, SLOPE, BELOW = 0, 1, 2, 3


class Lobe(NamedTuple):
    """A phase function of three dimensions, as walks know it; helpers take its arrays one by one.

    Attributes
    ----------
    g : float
        Anisotropy of Henyey and Greenstein's phase function, where there are no rows. Beside rows a number above 1 is
        the concentration kappa of a von Mises-Fisher phase function.
    rows : float64[n, 4]
        NODE: v from 0 to 2, from the second one on with evenly spaced bits; DENSITY: f there, per v; SLOPE: df/dv up to
        the next node; BELOW: share of the light below.
    guide : int32[m]
        Last row whose share is at most k / m.
    places : int64[2]
        Bits of the second node, and log2 of the spacing of the bits.
    """

    g: float
    rows: np.ndarray
    guide: np.ndarray
    places: np.ndarray


@inlined
def density_of(rows, places, v):
    """Density f at v in [0, 2]."""
    place = ((np.float64(v).view(np.int64) - places[0]) >> places[1]) + np.int64(1)
    j = min(max(place, np.int64(0)), np.int64(rows.shape[0] - 2))
    return rows[j, DENSITY] + rows[j, SLOPE] * (v - rows[j, NODE])


@inlined
def sample_density(rows, guide, u):
    """Draw v from u in (0, 1), and return its density f too."""
    j = np.int64(guide[int(u * guide.shape[0])])
    while rows[j + 1, BELOW] <= u and j < rows.shape[0] - 2:
        j += 1
    # The root of a linear density's integral, in the form that loses no digits.
    f, rest = rows[j, DENSITY], u - rows[j, BELOW]
    root = math.sqrt(max(f * f + 2.0 * rows[j, SLOPE] * rest, 0.0))
    return min(rows[j, NODE] + 2.0 * rest / (f + root), rows[j + 1, NODE]), root


@inlined
def fisher_density(kappa, v):
    """Density of von Mises and Fisher's phase function at v in [0, 2], of arithmetic that vectorises."""
    return kappa / (1.0 - exponential(-2.0 * kappa)) * exponential(-kappa * v)


@inlined
def sample_fisher(kappa, u):
    """Draw v from u in (0, 1): ``1 - F(v) = (e^(-kappa v) - e^(-2 kappa)) / (1 - e^(-2 kappa))``."""
    return min(minus_log(u + (1.0 - u) * exponential(-2.0 * kappa)) / kappa, 2.0)


@inlined
def phase_function(g, rows, places, cos):
    """Phase function per steradian at the cosine of the scattering angle, where there are rows that of the table."""
    if rows.shape[0] == 0:
        return henyey_greenstein(g, cos)
    return density_of(rows, places, max(1.0 - cos, 0.0)) / _TAU


@inlined
def judged_phase_function(g, rows, places, cos):
    """Phase function that is never next to nothing, for Russian roulette."""
    if rows.shape[0] == 0:
        return henyey_greenstein(g, cos)
    if g > 1.0:
        return judged(fisher_density(g, max(1.0 - cos, 0.0)))
    return judged(density_of(rows, places, max(1.0 - cos, 0.0)))


@inlined
def judged(density):
    """Phase function by which roulette judges, from the density f."""
    return max(density, 0.5 * _FLOOR) / _TAU
