"""Thick slabs that absorb nothing: what Chandrasekhar's *Radiative Transfer* (1960) prints of them, and paths."""

import numpy as np
import pytest
from scipy.stats import chi2

import specklegen as sg
from specklegen.core.quadrature import gauss_legendre
from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.oracles.vector_adding_doubling import rayleigh, vector_adding_doubling

FALSE_ALARM = 1e-6
HOPF, LIMB_POLARISATION = 0.7104461, 0.1171


def h_function():
    """H of isotropic particles without absorption, from 1/H(mu) = 1/2 of the integral of x H(x) / (mu + x)."""
    nodes, weights = gauss_legendre(64)
    x, w = (nodes + 1) / 2, weights / 2
    h = np.ones(64)
    for _ in range(60):
        h = np.sqrt(h / ((w * x * h / (x[:, None] + x)).sum(axis=1) / 2))
    return lambda mu: 1 / ((w * x * h / (np.asarray(mu)[..., None] + x)).sum(axis=-1) / 2)


H = h_function()


def test_hopfs_constant_and_the_law_of_darkening():
    assert H(1.0) == pytest.approx(2.9078, abs=1e-4)
    one, two = 20.0, 40.0
    first, second = (adding_doubling(depth, albedo=1.0, g=0.0, nodes=32).transmittance for depth in (one, two))

    def hopf(first):
        return (one * first - two * second) / 2 / (second - first)

    assert hopf(first) == pytest.approx(HOPF, abs=1e-4)
    assert abs(hopf(1.01 * first) - HOPF) > 0.1
    cosines = np.array([1.0, 0.8, 0.5, 0.2])
    limb = np.array([adding_doubling(20.0, albedo=1.0, g=0.0, nodes=32, view=mu).transmitted / mu for mu in cosines])
    np.testing.assert_allclose(limb / limb[0], H(cosines) / H(1.0), atol=1e-4)


def test_rayleigh_particles_polarise_at_the_limb():
    light = vector_adding_doubling(20.0, rayleigh, views=(1e-4,), nodes=16).transmitted[0, 0, :, 0]
    assert -light[1] / light[0] == pytest.approx(LIMB_POLARISATION, abs=3e-4)


def test_paths_darken_by_that_law():
    """Chi squared of ten bins of the angle; the square of H is refuted."""
    edges = np.linspace(1.0, 0.0, 11)
    slab = sg.Slab(thickness=20.0, mean_free_path=1.0, scatterer=sg.Isotropic())
    light = sg.reflectance_transmittance(slab, angles=np.arccos(edges), paths=200_000, seed=1)
    nodes, weights = gauss_legendre(8)
    mu = edges[1:, None] + (edges[:-1] - edges[1:])[:, None] * (nodes + 1) / 2

    def misfit(power):
        law = (mu * H(mu) ** power) @ weights
        scale = np.sum(light.transmitted * law / light.transmitted_error**2) / np.sum(
            np.square(law / light.transmitted_error))  # fmt: skip
        return np.square((light.transmitted - scale * law) / light.transmitted_error).sum()

    assert misfit(1.0) < chi2.isf(FALSE_ALARM, 9) < misfit(2.0)


@pytest.mark.slow
def test_a_face_of_water_makes_light_sent_back_forget_as_printed():
    """gamma 1.6 along the polarisation of Rayleigh particles (docs/measurements.md); 1.27 without the face."""
    wavelength, root = 1e-3, np.array([0.1, 0.2, 0.3, 0.5, 0.7])
    found = {}
    for index in (1.0, 1.33):
        slab = sg.Slab(thickness=150.0, mean_free_path=1.0, scatterer=sg.Rayleigh(), polarisation="vector",
                       motion=sg.Brownian(diffusion=1.0), faces=sg.Faces(inside=index))  # fmt: skip
        curve = sg.temporal_correlation(slab, wavelength=wavelength, lags=root**2 / 6 * (wavelength / 2 / np.pi) ** 2,
                                        mode="reflection", channel="co", paths=20_000, reverse=False)  # fmt: skip
        found[index] = -np.polyfit(root, np.log(curve.field.real), 1)[0]
    assert found[1.0] == pytest.approx(1.265, abs=0.04)
    assert found[1.33] == pytest.approx(1.644, abs=0.05)
