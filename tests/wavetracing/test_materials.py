"""Reflection and transmission of surfaces (ITU-R P.2040-4)."""

import numpy as np
import pytest
from references.wall import fresnel, wall_coefficients

from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.kernels import kernel
from specklegen.wavetracing import Absorber, Building, Conductor, Diffuse, Smooth, itu_permittivity
from specklegen.wavetracing.kernels.surfaces import power_coefficients
from specklegen.wavetracing.materials import LIGHT_SPEED


def test_concrete_at_one_gigahertz():
    eta = itu_permittivity("concrete", 1e9)
    assert eta == pytest.approx(5.24 + 0.83045j, abs=1e-4)
    te, tm = fresnel(eta, 1.0)
    assert abs(te) ** 2 == pytest.approx(0.15718, abs=1e-4)
    assert abs(tm) ** 2 == pytest.approx(0.15718, abs=1e-4)
    te, tm = fresnel(eta, 0.5)
    assert abs(te) ** 2 == pytest.approx(0.38712, abs=1e-4)
    assert abs(tm) ** 2 == pytest.approx(0.01268, abs=1e-4)


def test_a_pane_of_glass_at_five_gigahertz():
    eta = itu_permittivity("glass", 5e9)
    r, t, _, _ = wall_coefficients(eta, 6e-3, LIGHT_SPEED / 5e9, 1.0)
    assert abs(r) ** 2 == pytest.approx(0.51779, abs=1e-4)
    assert abs(t) ** 2 == pytest.approx(0.46332, abs=1e-4)


def test_a_wall_against_its_transfer_matrix():
    """Fields and their derivatives matched at both faces, TE and TM."""
    eta, thickness, wavelength = 4.2 + 0.3j, 0.37, 1.0
    k = 2 * np.pi / wavelength
    for cosine in (1.0, 0.7, 0.2):
        q = np.sqrt(eta - (1 - cosine**2))
        found = wall_coefficients(eta, thickness, wavelength, cosine)
        for weight, (r, t) in zip((1.0, eta), (found[:2], found[2:]), strict=True):
            # unknowns r, forward and backward inside, t; admittance q / weight inside, cosine outside
            x, y = np.exp(1j * k * q * thickness), q / weight
            matrix = np.array([[-1, 1, 1, 0], [cosine, y, -y, 0], [0, x, 1 / x, -1], [0, y * x, -y / x, -cosine]])
            expected = np.linalg.solve(matrix, np.array([1, cosine, 0, 0]))
            assert abs(r) == pytest.approx(abs(expected[0]), rel=1e-12)
            assert abs(t) == pytest.approx(abs(expected[3]), rel=1e-12)


def test_energy():
    """A wall without loss keeps all power; one with loss loses some; a thick lossy one is a half space."""
    cosine = np.linspace(0.01, 1, 50)
    r, t, r_tm, t_tm = wall_coefficients(3.0, 0.2, 1.0, cosine)
    assert np.abs(r) ** 2 + np.abs(t) ** 2 == pytest.approx(1, abs=1e-12)
    assert np.abs(r_tm) ** 2 + np.abs(t_tm) ** 2 == pytest.approx(1, abs=1e-12)
    r, t, _, _ = wall_coefficients(3.0 + 0.2j, 0.2, 1.0, cosine)
    assert (np.abs(r) ** 2 + np.abs(t) ** 2 < 1).all()
    r, t, _, _ = wall_coefficients(3.0 + 0.2j, 200.0, 1.0, cosine)
    assert np.abs(r - fresnel(3.0 + 0.2j, cosine)[0]).max() < 1e-12
    assert np.abs(t).max() < 1e-12


@kernel
def fill_power(materials, row, cosines, out):
    """Fill ``out`` float64[n, 2] with shares reflected and transmitted at ``cosines`` float64[n]."""
    for n in range(cosines.shape[0]):
        out[n, 0], out[n, 1] = power_coefficients(materials, row, cosines[n])


@pytest.mark.parametrize("thickness", [None, 0.3, 1e4])
def test_kernels_compute_the_same(thickness):
    """The mean of TE and TM; a wall of 1e4 wavelengths does not overflow."""
    material = Smooth(permittivity=5.24 + 0.83j, thickness=thickness)
    cosine = np.linspace(0, 1, 33)
    out = np.empty((33, 2))
    fill_power(material.row(2.0)[None], 0, cosine, out)
    if thickness is None:
        te, tm = fresnel(5.24 + 0.83j, cosine)
        expected = np.stack([(abs(te) ** 2 + abs(tm) ** 2) / 2, 0 * cosine], axis=1)
    else:
        r, t, r_tm, t_tm = wall_coefficients(5.24 + 0.83j, thickness, 2.0, cosine)
        expected = np.stack([abs(r) ** 2 + abs(r_tm) ** 2, abs(t) ** 2 + abs(t_tm) ** 2], axis=1) / 2
    assert out == pytest.approx(expected, abs=1e-13)


def test_building_materials():
    row = Building(name="concrete").row(LIGHT_SPEED / 1e9)
    assert row == pytest.approx([2, 5.24, 0.83045, 0], abs=1e-4)
    assert Building(name="glass", thickness=6e-3).row(0.06)[3] == pytest.approx(0.1)
    assert abs(fresnel(itu_permittivity("metal", 1e10), 1.0)[0]) == pytest.approx(1, abs=1e-3)
    with pytest.warns(DoubtWarning, match="50 to 100 GHz, not 5 GHz"):
        itu_permittivity("floorboard", 5e9)
    with pytest.raises(RuleError, match='one of "concrete"'):
        itu_permittivity("cheese", 1e9)
    with pytest.raises(RuleError, match="frequency"):
        itu_permittivity("wood", np.inf)


@pytest.mark.parametrize(
    ("name", "thickness", "reflected", "loss"),
    [("concrete", 0.2, 0.152271, 456.972062), ("brick", 0.2, 0.116877, 228.055099), ("wood", 0.1, 0.022409, 99.100082),
     ("glass", 0.01, 0.192810, 12.646834)],
)  # fmt: skip
def test_walls_at_140_gigahertz(name, thickness, reflected, loss):
    """Power that the first face reflects, and decibels that a wall takes, at right angles, by another program."""
    eta = itu_permittivity(name, 140e9)
    assert abs(fresnel(eta, 1.0)[0]) ** 2 == pytest.approx(reflected, abs=1e-5)
    through = wall_coefficients(eta, thickness, LIGHT_SPEED / 140e9, 1.0)[1]
    assert -20 * np.log10(abs(through)) == pytest.approx(loss, rel=5e-4)  # 17.98 there for 17.975


def test_which_row_of_a_material():
    """The narrower of two bands that hold a frequency; between bands, or beyond them, the nearest, with a doubt."""
    assert itu_permittivity("glass", 150e9).real == 6.5767
    assert itu_permittivity("glass", 300e9).real == 5.79
    assert itu_permittivity("asphalt", 30e9).real == 4.83
    for frequency, real in ((60e9, 3.91), (90e9, 4.15), (400e9, 4.15)):
        with pytest.warns(DoubtWarning, match=r"brick is stated for 1 to 40 and 110 to 330 GHz, not"):
            assert itu_permittivity("brick", frequency).real == real


def test_a_wrong_name_is_refused_where_it_is_written():
    with pytest.raises(RuleError, match=r'Building.name must be one of "concrete"'):
        Building(name="cheese")


def test_values():
    with pytest.raises(RuleError, match="Im >= 0"):
        Smooth(permittivity=2 - 0.1j)
    with pytest.raises(RuleError, match="albedo"):
        Diffuse(albedo=1.5)
    assert len({m.fingerprint() for m in (Absorber(), Conductor(), Diffuse(albedo=0.5), Smooth(permittivity=2))}) == 4
