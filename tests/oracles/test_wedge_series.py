"""The wedge series and the half plane: against each other, frozen figures, mpmath, and their boundary conditions."""

import mpmath
import numpy as np
from references.wedge_series import half_plane, transition_function, wedge_series

K = 2 * np.pi


def test_half_plane_is_the_series_of_n_2():
    """Two formulae with nothing in common: 1e-12 is the rounding of Bessel functions at kr = 630 (measured 6e-13)."""
    phi, incidence = np.random.default_rng(0).uniform(0, 2 * np.pi, (2, 200))
    for r in (0.1, 1.0, 5.0, 100.0):
        for boundary in ("soft", "hard"):
            series = wedge_series(2.0, phi, incidence, r, K, boundary)
            assert np.abs(series - half_plane(phi, incidence, r, K, boundary)).max() < 1e-12


def test_frozen_figures():
    at = np.deg2rad(200), np.deg2rad(45), 5.0, K
    assert abs(wedge_series(1.5, *at, "soft") - (-1.16240951 - 0.34468425j)) < 7e-9
    assert abs(wedge_series(1.5, *at, "hard") - (-1.03268772 - 0.22107660j)) < 7e-9


def test_a_plane_mirror():
    """n = 1: the wave and its image, and nothing else."""
    phi, incidence = np.random.default_rng(1).uniform(0, np.pi, (2, 50))
    direct, image = (np.exp(-1j * K * 3 * np.cos(phi - s * incidence)) for s in (1, -1))
    assert np.abs(wedge_series(1.0, phi, incidence, 3.0, K, "soft") - (direct - image)).max() < 1e-12
    assert np.abs(wedge_series(1.0, phi, incidence, 3.0, K, "hard") - (direct + image)).max() < 1e-12


def test_oblique_half_plane_solves_the_wave_equation():
    """At beta = .7 the Laplacian over the field is -k^2: by differences of 4th order, 2 pi h = .06 gives 1e-6."""
    phi, r, z, h, beta = 4.0, 3.0, 1.2, 0.01, 0.7
    x, y = r * np.cos(phi), r * np.sin(phi)

    def u(dx, dy, dz):
        a, b = x + dx, y + dy
        return half_plane(np.arctan2(b, a) % (2 * np.pi), 0.9, np.hypot(a, b), K, "soft", beta, z + dz)

    steps = np.eye(3) * h
    laplacian = sum(
        (-u(*(2 * s)) + 16 * u(*s) - 30 * u(0, 0, 0) + 16 * u(*-s) - u(*(-2 * s))) / (12 * h * h) for s in steps
    )
    assert abs(laplacian / u(0, 0, 0) + K**2) < 1e-5 * K**2


def test_transition_function():
    """F-bar of the Faddeeva function, against mpmath over 18 decades."""
    x = 10.0 ** np.linspace(-12, 6, 60)
    assert np.abs(transition_function(x) / [exact_transition(v) for v in x] - 1).max() < 2e-14  # wofz: 1e-14


def exact_transition(x):
    with mpmath.workdps(30):
        root = mpmath.sqrt(mpmath.mpf(x))
        z = mpmath.exp(1j * mpmath.pi / 4) * root
        w = mpmath.exp(-z * z) * mpmath.erfc(-1j * z)
        return complex(mpmath.sqrt(mpmath.pi) * root * mpmath.exp(-1j * mpmath.pi / 4) * w)
