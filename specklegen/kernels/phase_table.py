"""Particle types as tables: amplitude, power and sampling of every kind of scatterer, in 2D and 3D.

A :class:`PhaseTable` lists the particle types of a medium, one row each, and the materials made of them.
Every type has the integral of |s|^2 over all directions (4 pi, or 2 pi in flatland) equal to 1. Kinds:

    ISOTROPIC   1 / 4 pi                                      1 / 2 pi
    HENYEY      (1 - g^2) / (4 pi base^(3/2))                 (1 - g^2) / (2 pi base),    base = 1 + g^2 - 2 g cos
    FISHER      kappa e^(-kappa (1 - cos)) / (2 pi (1 - e^(-2 kappa)))    e^(kappa cos) / (2 pi I0(kappa))
    TABULATED   |s|^2, s complex and linear in theta between nodes

Kinds without a closed inverse (TABULATED, and FISHER in flatland) are drawn from bins of theta: one uniform
chooses the bin, by its share; another the place in it, by Newton's method on the share of the bin below it.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import spliced
from specklegen.kernels.phase_functions import (
    henyey_greenstein,
    henyey_greenstein_2d,
    sample_henyey_greenstein,
    sample_henyey_greenstein_2d,
)

ISOTROPIC_3D, HENYEY_3D, FISHER_3D, TABULATED_3D = 0, 1, 2, 3
ISOTROPIC_2D, HENYEY_2D, FISHER_2D, TABULATED_2D = 4, 5, 6, 7

# Gauss-Legendre on (0, 1). Five points integrate a quadratic times sin theta to rounding over a bin of h <= pi/16:
# they are exact up to x^9, and what follows is of the order of (h/2)^8/8! of the bin, times 1e-3.
_X, _W = np.polynomial.legendre.leggauss(5)
_X0, _X1, _X2, _X3, _X4 = (float(x) for x in (_X + 1) / 2)
_W0, _W1, _W2, _W3, _W4 = (float(w) for w in _W / 2)


class PhaseTable(NamedTuple):
    """Particle types and materials of a medium, in two or three dimensions.

    kinds             int64[n]          kind of each type (the dimension is part of it)
    parameters        float64[n, 2]     ISOTROPIC: power, amplitude; HENYEY: g, -; FISHER: kappa, power forward
    offsets           int64[n + 1]      first row of each type among the following three
    nodes             float64[K]        theta, from 0 upwards
    amplitudes        complex128[K]     s at the nodes (TABULATED)
    cumulative        float64[K]        share of |s|^2 below each node, from 0 to 1
    material_starts   int64[m + 1]      first type of each material
    shares            float64[n]        share of a type in sigma_s of its material
    shares_cumulative float64[n]        the same, summed within the material; the last is 1
    """

    kinds: np.ndarray
    parameters: np.ndarray
    offsets: np.ndarray
    nodes: np.ndarray
    amplitudes: np.ndarray
    cumulative: np.ndarray
    material_starts: np.ndarray
    shares: np.ndarray
    shares_cumulative: np.ndarray


@spliced
def choose_type(table, material, u):
    """Type of a particle of a material, by its share of sigma_s, from u in (0, 1); never one of share 0."""
    last = table.material_starts[material + 1] - 1
    t = table.material_starts[material]
    while t < last and table.shares_cumulative[t] <= u:
        t += 1
    return t


@spliced
def amplitude(table, t, cos):
    """Complex amplitude s of type t at the cosine of the scattering angle."""
    kind = table.kinds[t]
    if kind == ISOTROPIC_3D or kind == ISOTROPIC_2D:
        return complex(table.parameters[t, 1], 0.0)
    if kind == TABULATED_3D or kind == TABULATED_2D:
        return _interpolated(table, t, cos)
    return complex(math.sqrt(_closed_power(table, t, kind, cos)), 0.0)


@spliced
def power(table, t, cos):
    """|s|^2 of type t at the cosine of the scattering angle: its phase function."""
    kind = table.kinds[t]
    if kind == TABULATED_3D or kind == TABULATED_2D:
        s = _interpolated(table, t, cos)
        return s.real * s.real + s.imag * s.imag
    return _closed_power(table, t, kind, cos)


@spliced
def material_power(table, material, cos):
    """Phase function of a material: the sum of |s|^2 of its types, by their shares."""
    total = 0.0
    for t in range(table.material_starts[material], table.material_starts[material + 1]):
        total += table.shares[t] * power(table, t, cos)
    return total


@spliced
def sample(table, t, u, v):
    """1 - cos of a scattering angle of type t, from independent u, v in (0, 1).

    In flatland the angle is one of (0, pi): its side is for the caller to choose. Kinds with a closed
    inverse use u alone.
    """
    kind = table.kinds[t]
    if kind == ISOTROPIC_3D:
        return 2.0 * u
    if kind == HENYEY_3D:
        return sample_henyey_greenstein(table.parameters[t, 0], u)
    if kind == FISHER_3D:
        kappa = table.parameters[t, 0]
        return -math.log1p(u * math.expm1(-2.0 * kappa)) / kappa
    if kind == HENYEY_2D:
        return sample_henyey_greenstein_2d(table.parameters[t, 0], u)
    half = math.sin(0.5 * (math.pi * u if kind == ISOTROPIC_2D else _sample_bins(table, t, kind, u, v)))
    return 2.0 * half * half


@spliced
def _closed_power(table, t, kind, cos):
    if kind == ISOTROPIC_3D or kind == ISOTROPIC_2D:
        return table.parameters[t, 0]
    if kind == HENYEY_3D:
        return henyey_greenstein(table.parameters[t, 0], cos)
    if kind == HENYEY_2D:
        return henyey_greenstein_2d(table.parameters[t, 0], cos)
    return table.parameters[t, 1] * math.exp(-table.parameters[t, 0] * (1.0 - cos))


@spliced
def _row_below(values, first, last, x):
    """Largest row with values[row] <= x among first ... last - 1; ``first`` if there is none."""
    while last - first > 1:
        middle = (first + last) // 2
        if values[middle] <= x:
            first = middle
        else:
            last = middle
    return first


@spliced
def _interpolated(table, t, cos):
    theta = math.acos(min(1.0, max(-1.0, cos)))
    row = _row_below(table.nodes, table.offsets[t], table.offsets[t + 1] - 1, theta)
    below, above = table.nodes[row], table.nodes[row + 1]
    share = (theta - below) / (above - below)
    return (1.0 - share) * table.amplitudes[row] + share * table.amplitudes[row + 1]


@spliced
def _bin_density(table, t, kind, row, x):
    """Density per theta, to a factor, at the share x of bin ``row``."""
    theta = table.nodes[row] + x * (table.nodes[row + 1] - table.nodes[row])
    if kind == FISHER_2D:
        # Relative to the bin's start, so that no bin underflows: cos a - cos b = 2 sin((b+a)/2) sin((b-a)/2).
        start = table.nodes[row]
        drop = 2.0 * math.sin(0.5 * (theta + start)) * math.sin(0.5 * (theta - start))
        return math.exp(-table.parameters[t, 0] * drop)
    s = (1.0 - x) * table.amplitudes[row] + x * table.amplitudes[row + 1]
    density = s.real * s.real + s.imag * s.imag
    return density * math.sin(theta) if kind == TABULATED_3D else density


@spliced
def _bin_integral(table, t, kind, row, x):
    """Integral of :func:`_bin_density` from 0 to x."""
    return x * (
        _W0 * _bin_density(table, t, kind, row, x * _X0)
        + _W1 * _bin_density(table, t, kind, row, x * _X1)
        + _W2 * _bin_density(table, t, kind, row, x * _X2)
        + _W3 * _bin_density(table, t, kind, row, x * _X3)
        + _W4 * _bin_density(table, t, kind, row, x * _X4)
    )


@spliced
def _sample_bins(table, t, kind, u, v):
    """Theta of a type that is drawn from bins: u chooses the bin, v the place."""
    row = _row_below(table.cumulative, table.offsets[t], table.offsets[t + 1] - 1, u)
    wanted = v * _bin_integral(table, t, kind, row, 1.0)
    low, high, x = 0.0, 1.0, v
    for _ in range(100):
        excess = _bin_integral(table, t, kind, row, x) - wanted
        if excess > 0.0:
            high = x
        else:
            low = x
        slope = _bin_density(table, t, kind, row, x)
        step = excess / slope if slope > 0.0 else math.inf
        if abs(step) <= 1e-9 * x:  # the error after it is this one squared
            x = min(1.0, x - step)
            break
        x = x - step if low < x - step < high else 0.5 * (low + high)
    return table.nodes[row] + x * (table.nodes[row + 1] - table.nodes[row])
