"""Adding and doubling against closed forms, at optical depths where light is next to nothing."""

import numpy as np
import pytest
from references.correlation_transfer import exchange, transmittance
from references.slab import slab_transmission
from refusals import assert_refused
from zscore import assert_z, refute_z

from specklegen.oracles.adding_doubling import adding_doubling


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


# g1 of Brownian scatterers on the axis at x = .002 to .1, of random paths elsewhere (standard errors up to .0015).
MOVING = {(5.0, 0.0): [0.9352, 0.8507, 0.7360, 0.5729, 0.3289, 0.1832],
          (10.0, 0.0): [0.7958, 0.5889, 0.3853, 0.1975, 0.0531, 0.0154],
          (20.0, 0.0): [0.463, 0.194, 0.0648, 0.0132, 0.0007],
          (10.0, 0.9): [0.9969, 0.9923, 0.9848, 0.9705, 0.9324, 0.8808]}  # fmt: skip


def moving_field(depth, g, speed=1.0):
    """g1 at those x."""
    light = [
        adding_doubling(depth, albedo=1.0, g=g, nodes=48, motion=speed * x).transmitted
        for x in (0, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
    ]
    return np.array(light[1:]) / light[0]


@pytest.mark.parametrize(("depth", "g"), MOVING)
def test_moving_scatterers_by_random_paths_of_another_program(depth, g):
    assert_z(moving_field(depth, g)[: len(MOVING[depth, g])], MOVING[depth, g], 0.0015)


def test_power_against_a_motion_five_per_cent_faster():
    refute_z(moving_field(10.0, 0.0, 1.05), MOVING[10.0, 0.0], 0.0015)


@pytest.mark.parametrize("g", [0.0, 0.7])
def test_thin_moving_slabs_scatter_once(g):
    """g1 = e^(-2x (1 - i.v)) of single scattering, to both sides and at any view."""
    view, x = 0.6, 0.37
    rest, moved = (adding_doubling(1e-5, albedo=1.0, g=g, motion=motion, view=view) for motion in (0.0, x))
    assert moved.transmitted / rest.transmitted == pytest.approx(np.exp(-2 * x * (1 - view)), rel=3e-4)
    assert moved.reflected / rest.reflected == pytest.approx(np.exp(-2 * x * (1 + view)), rel=3e-4)


def test_isotropic_scatterers_that_move_far_leave_single_scattering_ahead():
    """x to infinity: on the axis what is scattered straight on alone does not decay."""
    rest, moved = (adding_doubling(2.0, albedo=1.0, g=0.0, motion=motion) for motion in (0.0, 60.0))
    single = 2.0 * np.exp(-2.0) / (4 * np.pi)
    # Double scattering within e^(-2x (1 - cosine)) of the axis is left too: about OD / (8x) of the single.
    assert single < moved.transmitted < single * (1 + 2.0 / (8 * 60.0) * 1.5)
    assert moved.transmitted < 0.5 * rest.transmitted


def test_bad_input_is_named():
    assert_refused(lambda: adding_doubling(0.0, albedo=1.0, g=0.0), "optical_depth must be greater than 0")
    assert_refused(lambda: adding_doubling(1.0, albedo=1.0, g=0.0, motion=-1.0), "motion must be finite and at least 0")
    assert_refused(lambda: adding_doubling(1.0, albedo=1.0, g=0.0, view=0.0), "view must be above 0 and at most 1")
