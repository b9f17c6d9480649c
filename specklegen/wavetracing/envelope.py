"""The envelope under which patterns of polygons are drawn, and its cost.

A^2 inside the disc |xi| < c, N sum_e |Psi_e|^2 outside (`specklegen.wavetracing.kernels.patterns`). Its mass over that
of the pattern, 4 pi^2 A, is the mean number of trials a draw:

    trials = (pi c^2 A^2 + N sum_e E_e) / (4 pi^2 A),   E_e = |e|^2 int sinc^2(p|e|/2) 2G(p) dp

Beyond p = c, where G = pi/(4|p|), the integral is closed: with X = c|e|/2,
int_X^inf sin^2(x)/x^3 dx = sin^2(X)/2X^2 + sin(2X)/2X - Ci(2X). Within, p = c sin(t) makes it smooth.
"""

from dataclasses import dataclass

import numpy as np

from specklegen.core.quadrature import gauss_legendre
from specklegen.wavetracing.opening import Rim


@dataclass(frozen=True)
class Envelope:
    """Proposal density of draws.

    Attributes
    ----------
    radius : float
        c, radians per unit length.
    cumulative : float64[N + 1]
        Running sum of the masses N E_e of the edges, and last of the disc.
    trials : float
        Mean trials a draw.
    """

    radius: float
    cumulative: np.ndarray
    trials: float


def edge_masses(lengths: np.ndarray, radius: float) -> np.ndarray:
    """Return E_e float64[N] of edges of ``lengths`` outside the disc, to 1e-12."""
    from scipy.special import sici

    x = radius * lengths / 2
    nodes, weights = gauss_legendre(32 + 2 * int(np.ceil(x.max())))
    t, weights = np.pi / 4 * (nodes + 1), np.pi / 4 * weights
    inner = (t / 2 + np.sin(2 * t) / 4) * np.cos(t) / np.sin(t) * weights  # G dp = (...)/(c sin t) c cos t dt
    within = np.square(np.sinc(x[:, None] * np.sin(t) / np.pi)) @ inner
    beyond = np.pi / 4 * (np.square(np.sin(x)) / (2 * x**2) + np.sin(2 * x) / (2 * x) - sici(2 * x)[1])
    return 4 * lengths**2 * (within + beyond)


def edge_envelope(rim: Rim) -> Envelope:
    """Return the envelope of least mass."""
    from scipy.optimize import minimize_scalar

    lengths = np.hypot(*rim.about_centre[:, 2:].T)
    lengths = np.maximum(lengths, 1e-12 * lengths.max())  # repeated corners
    count, area = len(lengths), rim.area

    def trials(log_radius: float) -> float:
        radius = np.exp(log_radius)
        return (np.pi * (radius * area) ** 2 + count * edge_masses(lengths, radius).sum()) / (4 * np.pi**2 * area)

    # The least mass lies at c sqrt(A) of 2 to 4 for compact openings, and lower for long ones.
    middle = np.log(3 / np.sqrt(area))
    best = minimize_scalar(trials, bounds=(middle - 8, middle + 4), method="bounded", options={"xatol": 1e-3})
    radius = float(np.exp(best.x))
    masses = np.append(count * edge_masses(lengths, radius), np.pi * (radius * area) ** 2)
    return Envelope(radius, np.cumsum(masses), float(best.fun))
