"""Mean trials of a draw from a polygon's pattern: the mass of its envelope over that of the pattern, 4 pi^2 A.

    trials = (pi c^2 A^2 + N sum_e E_e) / (4 pi^2 A),   E_e = |e|^2 int sinc^2(p|e|/2) 2G(p) dp

See `specklegen.wavetracing.kernels.patterns`. Beyond p = c, where G = pi/(4|p|), the integral is closed: with
X = c|e|/2, int_X^inf sin^2(x)/x^3 dx = sin^2(X)/2X^2 + sin(2X)/2X - Ci(2X). Within, p = c sin(t) makes it smooth.
"""

import numpy as np
from scipy.special import sici

from specklegen.wavetracing.kernels.patterns import disc_radius
from specklegen.wavetracing.opening import rim_of


def edge_masses(lengths, radius):
    """Return E_e float64[N] of edges of ``lengths`` outside the disc, to 1e-12."""
    x = radius * lengths / 2
    nodes, weights = np.polynomial.legendre.leggauss(32 + 2 * int(np.ceil(x.max())))
    t, weights = np.pi / 4 * (nodes + 1), np.pi / 4 * weights
    inner = (t / 2 + np.sin(2 * t) / 4) * np.cos(t) / np.sin(t) * weights  # G dp = (...)/(c sin t) c cos t dt
    within = np.square(np.sinc(x[:, None] * np.sin(t) / np.pi)) @ inner
    beyond = np.pi / 4 * (np.square(np.sin(x)) / (2 * x**2) + np.sin(2 * x) / (2 * x) - sici(2 * x)[1])
    return 4 * lengths**2 * (within + beyond)


def mean_trials(opening, radius=None):
    """Return the mean trials of a draw, with the disc of the kernels, or of another radius."""
    rim = rim_of("opening", opening)
    lengths, area = np.hypot(*rim.about_centre[:, 2:].T), rim.area
    c = disc_radius(lengths.sum(), area, len(lengths)) if radius is None else radius
    return (np.pi * (c * area) ** 2 + len(lengths) * edge_masses(lengths, c).sum()) / (4 * np.pi**2 * area)
