"""The correlation transfer equation against published figures, closed forms, Eq. 41 and Algorithm 1."""

import numpy as np
import pytest
from references import correlation_transfer
from references.correlation_transfer import exchange, field_correlation, quadruple, transmittance
from references.slab import double_to_single, slab_transmission
from references.slab_covariance import slab_covariance
from scipy.special import exp1

from specklegen.core.errors import RuleError
from specklegen.theory import slab

Q = np.array([0.5, 1, 1.491, 2.742, 4, 8])
TABLE = {  # C_I, its standard error
    1: ([0.879, 0.678, 0.531, 0.349, 0.276, 0.201], 0.0015), 5: ([0.908, 0.695, 0.473, 0.145, 0.048, 0.006], 0.0015),
    20: ([0.912, 0.697, 0.463, 0.105, 0.016, 0.0], 0.0025),
}  # fmt: skip


@pytest.mark.parametrize("optical_depth", TABLE)
def test_transmission_has_the_published_figures(optical_depth):
    expected, error = TABLE[optical_depth]
    # Rounded to 0.001, three of their standard errors, and the 0.003 that the table allows.
    np.testing.assert_allclose(field_correlation(Q, optical_depth) ** 2, expected, rtol=0, atol=3 * error + 0.0035)


def test_shares_of_single_scattering():
    for optical_depth, share in ((1, 0.373), (5, 0.027)):
        found = exchange(0.0, optical_depth, 1.0, 1.0)
        assert found.single.real / found.total.real == pytest.approx(share, abs=5e-4)  # three digits are given


@pytest.mark.parametrize(("albedo", "forward", "both"), [(1.0, 0.580, 0.728), (0.8, 0.935, 0.985)])
def test_reflection_has_the_published_figures(albedo, forward, both):
    """And with reversed paths at i = -v: those of one tilt are the forward ones of the other, mirrored."""
    q = 2.742
    assert field_correlation(q, 10, albedo=albedo, mode="reflection") ** 2 == pytest.approx(forward, abs=1e-3)
    still, tilted, mirrored = (exchange(kappa / 10, 10, 1.0, -1.0, albedo) for kappa in (0, q, 2 * q))
    single, multiple = still.single.real, still.multiple.real
    first, second = single + 2 * multiple, single + multiple + mirrored.multiple.real
    found = (single + 2 * tilted.multiple.real) ** 2 / (first * second)
    assert found == pytest.approx(both, abs=1e-3)  # three digits are given, of a Monte Carlo


@pytest.mark.slow
@pytest.mark.parametrize(("optical_depth", "error"), [(10, 1e-3), (20, 2e-4), (40, 6e-5)])
def test_thick_slabs_have_the_closed_form(optical_depth, error):
    """Diffusion with exponential depths: its measured errors, far below the 0.003 that physics.md gives it."""
    q = np.array([0.3, 1.5, 2.7, 5])
    exact = field_correlation(q, optical_depth) ** 2
    np.testing.assert_allclose(slab.memory_effect_thick_slab(q, optical_depth), exact, rtol=0, atol=error)


def test_extrapolation_brackets_the_truth():
    exact = field_correlation(Q, 10) ** 2
    plain = slab.memory_effect_diffusion(Q)
    longer = slab.memory_effect_diffusion(Q, extrapolation=slab.EXTRAPOLATION / 10)
    assert (longer < exact).all()
    assert (plain[:-1] > exact[:-1]).all()  # at q = 8 both are below 1e-3
    assert 0.04 < np.abs(plain - exact).max() < 0.045
    assert 0.04 < np.abs(longer - exact).max() < 0.05
    with pytest.raises(RuleError, match="memory_effect_diffusion extrapolation must be at least 0; got -1"):
        slab.memory_effect_diffusion(Q, extrapolation=-1)


@pytest.mark.parametrize(("optical_depth", "error"), [(5, 8e-4), (10, 5e-6), (50, 2e-5)])
def test_transmittance_has_its_closed_form(optical_depth, error):
    """The formula's constants have five digits; at OD 5 exponentially small terms count."""
    assert transmittance(optical_depth) == pytest.approx(slab_transmission(optical_depth), rel=error)


def test_thin_slabs_scatter_twice_as_they_should():
    """B2/B1 over all directions, from the first power of the albedo."""
    optical_depth, albedo = 1e-3, 1e-6
    nodes, weights, edges = correlation_transfer._panels(optical_depth, 0.0, 0.0)
    density = correlation_transfer.collision_density(0.0, edges, np.exp(-nodes), albedo)
    ratio = weights @ (density - np.exp(-nodes)) / (albedo * weights @ np.exp(-nodes))
    assert ratio == pytest.approx(double_to_single(optical_depth), rel=2 * optical_depth)


def test_the_kernel_is_the_exponential_integral_and_decays_sideways():
    depths = np.logspace(-12, 1.5, 50)
    np.testing.assert_allclose(correlation_transfer._kernel(0.0, depths), exp1(depths) / 2, rtol=1e-10)
    # Its integral over all depths is arctan(kappa)/kappa, the transform of a step of radiative transfer.
    x, w = np.polynomial.legendre.leggauss(200)
    depths, weights = 40 * ((1 + x) / 2) ** 4, 80 * ((1 + x) / 2) ** 3 * w
    for kappa in (0.5, 3.0):
        total = 2 * weights @ correlation_transfer._kernel(kappa, depths)
        assert total == pytest.approx(np.arctan(kappa) / kappa, rel=1e-8)


def tilted(sines, side):
    return np.array([sines, 0.1, side * np.sqrt(1 - 0.01 - sines**2)])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_single_scattering_is_that_of_eq_41(side):
    """Oblique, with turning phases: a column whose footprints hardly part, over its area."""
    lights = tilted(0.30, 1.0), tilted(0.30003, 1.0)
    views = tilted(0.5, side), tilted(0.50003, side)
    found = quadruple(2.0, mean_free_path=10.0, wavelength=1.0, lights=lights, views=views, albedo=0.9)
    width = 1e6
    column = slab_covariance(20.0, extinction=0.1, albedo=0.9, wavelength=1.0, width=width,
                             amplitude=lambda cos: np.full_like(cos, np.sqrt(1 / (4 * np.pi))), lights=lights,
                             views=views)  # fmt: skip
    irradiance = np.sqrt(lights[0][2] * lights[1][2])  # beams: per area of the face
    # The footprints part by 20 * 3e-5 of 1e6.
    assert found.single * 10 * 0.1 * 0.9 / (4 * np.pi) == pytest.approx(column * irradiance / width**2, rel=1e-8)
