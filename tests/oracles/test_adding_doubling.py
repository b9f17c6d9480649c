"""Adding and doubling against closed forms, at optical depths where light is next to nothing."""

import numpy as np
import pytest

from specklegen.core.errors import RuleError
from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.theory.correlation_transfer import exchange, transmittance
from specklegen.theory.slab import slab_transmission


@pytest.mark.parametrize("depth", [10.0, 100.0])
def test_without_absorption_it_is_the_closed_form_of_milne(depth):
    found = adding_doubling(depth, albedo=1.0, g=0.0)
    assert found.transmittance == pytest.approx(slab_transmission(depth), rel=1e-4)  # four digits of 1.6788, 1.4208
    assert found.transmittance + found.reflectance == pytest.approx(1, abs=1e-6)  # 1e-16 of rounding in 1e10 layers


@pytest.mark.parametrize(("depth", "albedo"), [(1.0, 0.5), (10.0, 0.9), (30.0, 0.5)])
def test_isotropic_light_is_that_of_the_integral_equation(depth, albedo):
    """To 1e-4, where the panels' quadrature of the integral equation has lost some digits to e^-20."""
    found = adding_doubling(depth, albedo=albedo, g=0.0)
    assert found.transmittance == pytest.approx(transmittance(depth, albedo), rel=1e-4)
    both = exchange(0.0, optical_depth=depth, albedo=albedo, source=1.0 + 0j, sensor=1.0 + 0j)
    total = albedo * (both.single + both.multiple).real / (4 * np.pi)
    assert found.transmitted == pytest.approx(total, rel=1e-4)


def test_thin_slabs_scatter_once():
    depth, g = 1e-5, 0.8
    forward = (1 - g * g) / (4 * np.pi * (1 - g) ** 3)
    found = adding_doubling(depth, albedo=0.7, g=g)
    assert found.transmitted == pytest.approx(0.7 * depth * forward, rel=1e-3)  # OD log(1/OD) of double scattering
    assert found.reflected == pytest.approx(0.7 * depth * (1 - g * g) / (4 * np.pi * (1 + g) ** 3), rel=1e-2)


def test_more_nodes_change_nothing():
    few, many = (adding_doubling(100.0, albedo=0.5, g=0.9, nodes=n).transmitted for n in (64, 96))
    assert few == pytest.approx(many, rel=1e-5)
    assert 1e-28 < few < 1e-26


def test_bad_input_is_named():
    with pytest.raises(RuleError, match="optical_depth must be greater than 0"):
        adding_doubling(0.0, albedo=1.0, g=0.0)
