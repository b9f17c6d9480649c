"""The literal walk through layers against published figures, and against adding."""

import pytest
from references.layered_walk import walk_layers
from zscore import assert_mean, refute_mean

from specklegen.oracles.adding_doubling import layered_light


def layer(thickness: float, absorption: float, scattering: float, g: float, index: float) -> tuple:
    """A layer as MCML describes it: cm, 1/cm."""
    extinction = absorption + scattering
    return thickness, 1 / extinction, scattering / extinction, g, index


TWO = [layer(0.01, 20, 200, 0.7, 1.3), layer(1e8, 10, 200, 0.9, 1.4)]
THREE = [layer(0.1, 1, 100, 0.9, 1.37), layer(0.1, 1, 10, 0.0, 1.37), layer(0.2, 2, 10, 0.7, 1.37)]


@pytest.mark.slow
def test_two_layers_of_different_indices_reflect_as_those_of_mcml():
    """Template of MCML, its first run: diffuse reflectance .1050, to half of the last digit."""
    found = walk_layers(TWO, paths=64 * 700, seed=1)
    assert found.specular == pytest.approx((0.3 / 2.3) ** 2, rel=1e-12)
    assert_mean(found.reflected, 0.1050, slack=5e-5)


def test_three_layers_are_those_of_mcml():
    """Sample of MCML, a million photons: .237544 and .0964896, themselves uncertain by some 4e-4."""
    found = walk_layers(THREE, paths=64 * 1000, seed=1)
    assert_mean(found.reflected, 0.237544, slack=4e-4)
    assert_mean(found.transmitted, 0.0964896, slack=3e-4)


def test_another_index_is_caught():
    refute_mean(walk_layers([(*TWO[0][:4], 1.4), TWO[1]], paths=64 * 700, seed=1).reflected, 0.1050, slack=5e-5)


def test_matched_layers_are_those_of_adding():
    layers = [(1.0, 1.0, 0.9, 0.7, 1.0), (2.0, 0.5, 0.99, 0.0, 1.0)]
    exact = layered_light([(1.0, 0.9, 0.7), (4.0, 0.99, 0.0)])
    found = walk_layers(layers, paths=64 * 1000, seed=2)
    assert_mean(found.reflected, exact.reflectance)
    assert_mean(found.transmitted, exact.transmittance)
    assert_mean(found.sums([])[:, 0] / 1000, exact.transmitted)
