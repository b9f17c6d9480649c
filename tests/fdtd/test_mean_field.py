"""Coherent transmission of a random layer and its equivalent bulk medium, against the exact grid solution."""

import math

import numpy as np
import pytest
from refusals import assert_refused
from scipy.integrate import trapezoid
from scipy.stats import norm

from specklegen.core.errors import RuleError
from specklegen.fdtd import RandomLayer, coherent_transmission, equivalent_slab, phase_variance, sample_moments

FALSE_ALARM = 1e-6
WAVELENGTH = 0.6
# (n_points, dx, L_c, sigma_n, media): with and without much backscattering, thick and thin beside L_c
LAYERS = [(829, 0.01, 0.1, 0.1, 20_000), (1398, 0.01, 0.05, 0.1, 15_000), (1500, 0.002, 3.0, 0.03, 10_000),
          (1500, 0.002, np.inf, 0.03, 10_000), (3337, 0.01, 0.3, 0.03, 8_000)]  # fmt: skip


def depth_and_error(layer, media, seed=11):
    mean = coherent_transmission(layer, WAVELENGTH, "transfer_matrix", n_realizations=media, seed=seed)
    # E|mean - <t>|^2 splits over two parts; the modulus moves by one of them, at most by the whole
    return mean.optical_depth, 2 * mean.standard_error / abs(mean.amplitude)


@pytest.mark.parametrize("row", LAYERS)
def test_cumulant_against_the_exact_mean(row):
    n, dx, lc, sigma, media = row
    layer = RandomLayer(n_points=n, dx=dx, correlation_length=lc, rms_index=sigma)
    measured, error = depth_and_error(layer, media)
    predicted = coherent_transmission(layer, WAVELENGTH).optical_depth
    limit = norm.isf(FALSE_ALARM / (2 * len(LAYERS)))
    assert abs(measured - predicted) < limit * error
    # power: either scattering part, wrong by a fifth of the whole, is caught
    assert abs(measured - 1.2 * predicted) > limit * error or predicted < 1


def test_beers_law_in_its_regime_only():
    """Thick and weak: exp(-OD/2) with OD = sigma L. Thinner than L_c: a phase screen, no bulk medium."""
    thick = RandomLayer(n_points=1398, dx=0.01, correlation_length=0.05, rms_index=0.1)
    slab = equivalent_slab(thick, WAVELENGTH)
    measured, error = depth_and_error(thick, 15_000)
    assert slab.valid
    assert abs(measured - slab.optical_depth) < norm.isf(FALSE_ALARM / 2) * error
    # both parts are needed: without the backscattered power the depth is 23 % too small
    assert abs(measured - slab.forward_coefficient * slab.thickness) > norm.isf(FALSE_ALARM / 2) * error
    assert slab.optical_depth == pytest.approx(2, abs=0.01)
    assert slab.mean_free_path == pytest.approx(slab.thickness / slab.optical_depth)

    screen = RandomLayer(correlation_length=3.0)
    slab = equivalent_slab(screen, WAVELENGTH)
    measured, error = depth_and_error(screen, 4000)
    assert not slab.valid
    assert "thinner than 20 correlation lengths" in slab.reason
    assert abs(measured - slab.optical_depth) > 5 * error
    assert slab.optical_depth_of_layer == pytest.approx(coherent_transmission(screen, WAVELENGTH).optical_depth)


def test_finite_layer_tends_to_beers_law():
    """OD of the layer falls short of sigma L by int u c(u) (1 + cos 2ku) du: L_c/L of the forward part."""
    lc, x = 0.3, 2 * 2 * math.pi * 1.45 / WAVELENGTH * 0.3
    for cells in (5_000, 50_000):
        layer = RandomLayer(n_points=cells, dx=0.002, correlation_length=lc, rms_index=0.01)
        slab = equivalent_slab(layer, WAVELENGTH)
        short = 1 - slab.optical_depth_of_layer / slab.optical_depth
        expected = lc / layer.length * (1 + (1 - x**2) / (1 + x**2) ** 2) / (1 + 1 / (1 + x**2))
        # the grid has tan^2(theta/2) in place of (theta/2)^2: theta^2/6 = 1.5e-4 more
        assert short == pytest.approx(expected - 1.5e-4, abs=1e-4)


def test_forward_part_is_the_phase_variance():
    """Far from backscattering (k L_c >> 1) the depth is V, to b^2 and to the edges' share 1/(2 k L_c)^2."""
    layer = RandomLayer(correlation_length=3.0)
    depth = coherent_transmission(layer, WAVELENGTH).optical_depth
    assert depth == pytest.approx(phase_variance(layer, 2 * math.pi / WAVELENGTH), rel=5e-3)


def test_coefficients_by_quadrature():
    """sigma_f, sigma_b against the Fourier integral of the covariance itself."""
    layer = RandomLayer(n_points=4000, dx=0.001, correlation_length=0.1, rms_index=0.2)
    moments, k = layer.moments(), 2 * math.pi * 1.45 / WAVELENGTH
    u, c = np.arange(4000) * 0.001, moments.second - moments.mean**2
    slab = equivalent_slab(layer, WAVELENGTH)
    assert slab.forward_coefficient == pytest.approx(k**2 / 2 * trapezoid(c, u), rel=1e-4)
    assert slab.backward_coefficient == pytest.approx(k**2 / 2 * trapezoid(c * np.cos(2 * k * u), u), rel=1e-3)


def test_bad_input_is_refused():
    layer = RandomLayer(correlation_length=1, dx=0.1)
    assert_refused(lambda: equivalent_slab(layer, WAVELENGTH), "wavelength must be at least 8 cells")
    assert_refused(lambda: coherent_transmission(layer, math.nan), "wavelength must be at least 8 cells")
    for wrong, rule in ((math.inf, "wavelength must be finite"), ("x", "wavelength must be a number")):
        with pytest.raises(RuleError, match=rule):
            coherent_transmission(layer, wrong)
    assert_refused(lambda: phase_variance(layer, math.nan), "wavenumber must be at least 0 and finite")
    assert_refused(lambda: sample_moments(np.full((2, 3), math.nan)), "kappa must be finite everywhere")
    with pytest.raises(ValueError, match="method must be one of"):
        coherent_transmission(RandomLayer(correlation_length=1), WAVELENGTH, "guess")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="n_realizations must be at least 1"):
        coherent_transmission(RandomLayer(correlation_length=1), WAVELENGTH, "transfer_matrix", n_realizations=0)
