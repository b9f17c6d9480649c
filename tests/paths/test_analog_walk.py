"""The share of a beam that a slab lets through, against radiative transfer by adding and doubling."""

import pytest
from scenes import slab
from zscore import assert_z, refute_z

from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.paths.analog_walk import transmittance


@pytest.mark.parametrize(("depth", "g", "albedo"), [(2.0, 0.0, 1.0), (5.0, 0.9, 1.0), (5.0, 0.9, 0.95)])
def test_a_slab_lets_through_what_adding_and_doubling_says(depth, g, albedo):
    found, error = transmittance(slab(depth, g).replace(albedo=albedo), 20_000, 3)
    exact = adding_doubling(depth, albedo=albedo, g=g).transmittance
    assert_z([found], [exact], [error], degrees=19_999)
    refute_z([found], [exact + 0.03], [error], degrees=19_999)
