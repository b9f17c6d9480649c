"""Particle types as tables: amplitude, power and sampling of every kind of scatterer, in 2D and 3D.

A :class:`PhaseTable` lists the particle types of a medium, one row each, and the materials made of them. The integral
of ``|s|^2`` over all directions is 1 for every type. Kinds:

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

from specklegen.kernels import inlined, spliced
from specklegen.kernels.arithmetic import exponential
from specklegen.kernels.phase_functions import amplitude as henyey_greenstein_amplitude
from specklegen.kernels.phase_functions import (
    henyey_greenstein,
    henyey_greenstein_2d,
    sample_henyey_greenstein,
    sample_henyey_greenstein_2d,
)

ISOTROPIC_3D, HENYEY_3D, FISHER_3D, TABULATED_3D = 0, 1, 2, 3
ISOTROPIC_2D, HENYEY_2D, FISHER_2D, TABULATED_2D = 4, 5, 6, 7

# Gauss-Legendre on (0, 1): five points integrate a quadratic times sin theta to 2e-15 over a bin of pi/16.
_X, _W = np.polynomial.legendre.leggauss(5)
_POINTS, _WEIGHTS = tuple(((_X + 1) / 2).tolist()), tuple((_W / 2).tolist())


class PhaseTable(NamedTuple):
    """Particle types and materials of a medium, in two or three dimensions.

    kinds             int64[n]          kind of each type (the dimension is part of it)
    parameters        float64[n, 2]     ISOTROPIC: power, amplitude; HENYEY: g, -; FISHER: kappa, power forward
    offsets           int64[n + 1]      first row of each type among the following three
    nodes             float64[K]        theta, from 0 upwards;
    amplitudes        complex128[K]     s at the nodes (TABULATED)
    cumulative        float64[K]        share of |s|^2 below each node, from 0 to 1;
    guides            int64[n, m + 1]   last of the nodes at or below theta = k pi / m of each type (TABULATED)
    material_starts   int64[m + 1]      first type of each material;
    shares            float64[n]        share of a type in sigma_s of its material
    shares_cumulative float64[n]        the same, summed within the material; the last is 1
    """

    kinds: np.ndarray
    parameters: np.ndarray
    offsets: np.ndarray
    nodes: np.ndarray
    amplitudes: np.ndarray
    cumulative: np.ndarray
    guides: np.ndarray
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
    if kind == TABULATED_3D or kind == TABULATED_2D:
        return _interpolated(table, t, cos)
    return complex(closed_amplitude(kind, table.parameters[t, 0], table.parameters[t, 1], cos), 0.0)


@inlined
def closed_amplitude(kind, first, second, cos):
    """Amplitude of a kind with a closed form, of arithmetic that vectorises where ``kind`` is a constant."""
    if kind == HENYEY_3D:
        return henyey_greenstein_amplitude(first, cos)
    if kind == HENYEY_2D:
        return math.sqrt(henyey_greenstein_2d(first, cos))
    if kind == FISHER_3D or kind == FISHER_2D:
        return math.sqrt(second * exponential(-first * (1.0 - cos)))
    return second


@spliced
def power(table, t, cos):
    """|s|^2 of type t at the cosine of the scattering angle: its phase function."""
    kind = table.kinds[t]
    if kind == TABULATED_3D or kind == TABULATED_2D:
        s = _interpolated(table, t, cos)
        return s.real * s.real + s.imag * s.imag
    return _closed_power(kind, table.parameters[t, 0], table.parameters[t, 1], cos)


@spliced
def sample(table, t, u, v):
    """Return ``1 - cos`` of a scattering angle of type t, from independent u, v in ``(0, 1)``.

    In flatland the angle is one of (0, pi): its side is for the caller to choose. Kinds with a closed
    inverse use u alone.
    """
    kind = table.kinds[t]
    if kind == TABULATED_3D or kind == TABULATED_2D or kind == FISHER_2D:
        row = _row_below(table.cumulative, table.offsets[t], table.offsets[t + 1] - 1, u)
        start, stop = table.nodes[row], table.nodes[row + 1]
        below, above = table.amplitudes[row], table.amplitudes[row + 1]
        half = math.sin(0.5 * _place(kind, table.parameters[t, 0], start, stop, below, above, v))
        return 2.0 * half * half
    return _closed_sample(kind, table.parameters[t, 0], u)


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
    cells = table.guides.shape[1] - 1
    cell = min(int(theta * (cells / math.pi)), cells - 1)
    # Rounding may put theta a hair outside its cell.
    row = max(table.guides[t, cell] - 1, table.offsets[t])
    last = min(table.guides[t, cell + 1] + 2, table.offsets[t + 1] - 1)
    row = _row_below(table.nodes, row, last, theta)
    below, above = table.nodes[row], table.nodes[row + 1]
    share = (theta - below) / (above - below)
    return (1.0 - share) * table.amplitudes[row] + share * table.amplitudes[row + 1]


@inlined
def _closed_power(kind, first, second, cos):
    if kind == HENYEY_3D:
        return henyey_greenstein(first, cos)
    if kind == HENYEY_2D:
        return henyey_greenstein_2d(first, cos)
    if kind == FISHER_3D or kind == FISHER_2D:
        return second * math.exp(-first * (1.0 - cos))
    return first


@inlined
def _closed_sample(kind, first, u):
    if kind == ISOTROPIC_3D:
        return 2.0 * u
    if kind == HENYEY_3D:
        return sample_henyey_greenstein(first, u)
    if kind == FISHER_3D:
        return -math.log1p(u * math.expm1(-2.0 * first)) / first
    if kind == HENYEY_2D:
        return sample_henyey_greenstein_2d(first, u)
    half = math.sin(0.5 * math.pi * u)
    return 2.0 * half * half


@inlined
def _bin_density(kind, kappa, start, width, below, above, x):
    """Density per theta, to a factor, at the share x of the bin that starts at theta = ``start``."""
    theta = start + x * width
    if kind == FISHER_2D:
        # Relative to the bin's start, so that no bin underflows: cos a - cos b = 2 sin((b+a)/2) sin((b-a)/2).
        return math.exp(-2.0 * kappa * math.sin(0.5 * (theta + start)) * math.sin(0.5 * (theta - start)))
    s = (1.0 - x) * below + x * above
    density = s.real * s.real + s.imag * s.imag
    return density * math.sin(theta) if kind == TABULATED_3D else density


@inlined
def _bin_integral(kind, kappa, start, width, below, above, x):
    """Integral of :func:`_bin_density` from 0 to x."""
    total = 0.0
    for point, weight in zip(_POINTS, _WEIGHTS):  # noqa: B905
        total += weight * _bin_density(kind, kappa, start, width, below, above, x * point)
    return x * total


@inlined
def _place(kind, kappa, start, stop, below, above, v):
    """Theta in a bin, below which lies the share v of the bin's light: Newton's method, kept in a bracket."""
    width = stop - start
    wanted = v * _bin_integral(kind, kappa, start, width, below, above, 1.0)
    low, high, x = 0.0, 1.0, v
    for _ in range(100):
        excess = _bin_integral(kind, kappa, start, width, below, above, x) - wanted
        if excess > 0.0:
            high = x
        else:
            low = x
        slope = _bin_density(kind, kappa, start, width, below, above, x)
        step = excess / slope if slope > 0.0 else math.inf
        if abs(step) <= 1e-9 * x:  # the error after it is this one squared
            x = min(1.0, x - step)
            break
        x = x - step if low < x - step < high else 0.5 * (low + high)
    return start + x * width
