"""Coverage maps against Friis' formula, images in the ground, and shadow."""

import numpy as np
import pytest
from wavetracing.solids import box
from zscore import assert_z

from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.wavetracing import (
    Absorber,
    Conductor,
    Diffuse,
    Geometry,
    Mesh,
    Plane,
    PointEmitter,
    Transmitter,
    coherent_rays,
    coverage,
)
from specklegen.wavetracing.coverage_map import decibel_milliwatt, received_power
from specklegen.wavetracing.materials import LIGHT_SPEED

AIR = Geometry(Mesh(np.empty((0, 3)), np.empty((0, 3), int)))
WAVELENGTH = LIGHT_SPEED / 1e9


def sheet(half, z, material):
    corners = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) + [0, 0, z]
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), material)


def street(z=0.0, shape=(5, 5), pitch=40.0, center=(0, 0)):
    return Plane(center=np.array([*center, z]), shape=shape, pitch=pitch)


def mean_inverse_square(plane, source, order=12):
    """Mean over each cell of 1 / R^2."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    x, y = plane.coordinates
    u = x[:, None] + plane.pitch / 2 * nodes
    v = y[:, None] + plane.pitch / 2 * nodes
    dx, dy, dz = u + plane.center[0] - source[0], v + plane.center[1] - source[1], plane.center[2] - source[2]
    inverse = 1 / (dx[None, None] ** 2 + dy[:, :, None, None] ** 2 + dz**2)
    return np.einsum("iajb,a,b->ij", inverse, weights, weights) / 4


def test_friis():
    """1 mW at 1 GHz over 100 m; exact."""
    flux = 1e-3 / (4 * np.pi * 100**2)
    assert decibel_milliwatt(received_power(flux, WAVELENGTH)) == pytest.approx(-72.448, abs=5e-4)
    assert decibel_milliwatt(np.array([0.0]))[0] == -np.inf


def test_cells_of_a_map_of_rays_in_free_space():
    """The mean over each cell, against Friis; a map edge on to none of the beams."""
    plane, source = street(), [7.0, -11.0, 60.0]
    found = coverage(AIR, Transmitter(source), plane, 1e9, "ray", beams=150_000, seed=3)
    power = 1e-3 * 10 ** (found.rss_dBm.data / 10)
    expected = 1e-3 * (WAVELENGTH / (4 * np.pi)) ** 2 * mean_inverse_square(plane, source)
    error = power * found.error.data * np.log(10) / 10
    assert_z(power, expected, error)
    assert not found.rss_dBm.mask.any()
    with pytest.raises(AssertionError, match="z ="):
        assert_z(power * 1.12, expected, error)  # half a decibel


def test_phases_in_free_space_are_friis_at_the_middles():
    plane, source = street(), np.array([7.0, -11.0, 60.0])
    found = coverage(AIR, Transmitter(source), plane, 1e9, "phase")
    square = ((plane.points - source) ** 2).sum(axis=-1)
    expected = 20 * np.log10(WAVELENGTH / (4 * np.pi)) - 10 * np.log10(square)
    assert found.rss_dBm.data == pytest.approx(expected, abs=1e-9)
    assert found.ledger is None


@pytest.mark.filterwarnings("ignore:.*corners matter:specklegen.core.errors.DoubtWarning")
@pytest.mark.parametrize(
    ("frequency", "height", "loss"),
    [(1e9, -5, -0.57), (1e9, -1, 2.26), (1e9, 0, 6.02), (1e9, 1, 9.81), (1e9, 5, 20.01), (3e10, 5, 34.70)],
)
def test_knife_edge_by_phases(frequency, height, loss):
    """100 m before and 50 m behind the edge of a metal sheet, whose edge is ``height`` above the line of sight."""
    wide = 1e6
    corners = [[100, -wide, -wide], [100, wide, -wide], [100, wide, height], [100, -wide, height]]
    knife = Geometry(Mesh(np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]]), Conductor()))
    cell = Plane(center=[150, 0, 0.0], normal=[1.0, 0, 0], up=[0, 0, 1.0], shape=(1, 1), pitch=1e-3)
    source = Transmitter([0, 0, 0.0])
    there, free = (coverage(scene, source, cell, frequency, "phase").rss_dBm for scene in (knife, AIR))
    assert float((free - there)[0, 0]) == pytest.approx(loss, abs=0.02)


def test_ground_that_mirrors_adds_its_image():
    """Fringes of a cell of 120 wavelengths average out: the sum of both powers, within a few of the stated errors."""
    plane, source = street(z=30.0), np.array([0, 0, 60.0])
    scene = Geometry(sheet(1e5, 0.0, Conductor()))
    found = coverage(scene, Transmitter(source), plane, 1e9, samples=8, seed=4)
    power = 1e-3 * 10 ** (found.rss_dBm.data / 10)
    both = mean_inverse_square(plane, source) + mean_inverse_square(plane, -source)
    expected = 1e-3 * (WAVELENGTH / (4 * np.pi)) ** 2 * both
    error = power * found.error.data * np.log(10) / 10
    assert np.median(error / power) < 0.1
    assert (np.abs(power - expected) < 6 * error).all()  # errors of 8 points are known to a quarter
    assert np.abs(power - expected).sum() > 0


@pytest.mark.filterwarnings("ignore:.*corners matter:specklegen.core.errors.DoubtWarning")
def test_the_mean_of_a_cell_is_that_of_its_points():
    """Cells of a block's shadow and of light beside it: the map, against |u|^2 at 1000 points; 1 dB is noticed."""
    scene = Geometry(box((4.0, 60.0, 60.0), (0, 0, -20.0), material=Conductor()))
    source = Transmitter([-30.0, 0, 0.0])
    plane = Plane(center=[25.0, 0, 6.0], normal=[1.0, 0, 0], up=[0, 0, 1.0], shape=(6, 1), pitch=5.0)
    found = coverage(scene, source, plane, 1e9, samples=64)
    rng, count = np.random.default_rng(3), 1000
    z = plane.points[:, 0, None, 2] + rng.uniform(-2.5, 2.5, (6, count))
    points = np.stack([np.full_like(z, 25.0), rng.uniform(-2.5, 2.5, z.shape), z], axis=-1)
    lamp = PointEmitter(source.position, WAVELENGTH, 1e-3)
    both = [coherent_rays(scene, lamp, points, 1, 2, name, "material") for name in ("soft", "hard")]
    flux = np.mean(np.square(np.abs(both)), axis=0) * WAVELENGTH**2 / (4 * np.pi)
    power = 1e-3 * 10 ** (found.rss_dBm.data[:, 0] / 10)
    own = power * found.error.data[:, 0] * np.log(10) / 10
    error = np.hypot(own, flux.std(axis=1) / np.sqrt(count))
    z_score = (power - flux.mean(axis=1)) / error
    assert np.abs(z_score).max() < 6
    sharp = own < 0.03 * power
    assert sharp.sum() > 1
    assert (np.abs((power * 1.26 - flux.mean(axis=1)) / error) > 6)[sharp].all()
    assert found.rss_dBm.data.max() - found.rss_dBm.data.min() > 15


def test_waves_reach_where_rays_do_not():
    """Behind a screen rays leave the map empty and masked; waves bend in."""
    scene = Geometry(box((0.5, 6.0, 6.0), (0, 0, 0), material=Absorber()))
    behind = Plane(center=np.array([12.0, 0, 0]), normal=np.array([1.0, 0, 0]), shape=(1, 1), pitch=8.0)
    source = Transmitter([-12.0, 0, 0], beam_angle=0.2)
    ray = coverage(scene, source, behind, 1e9, "ray", beams=20_000)
    assert ray.rss_dBm.mask.all()
    assert (ray.rss_dBm.data == -np.inf).all()
    wave = coverage(scene, source, behind, 1e9)
    assert wave.ledger is None
    assert not wave.rss_dBm.mask.any()
    free = coverage(AIR, source, behind, 1e9)
    assert -40 < wave.rss_dBm[0, 0] - free.rss_dBm[0, 0] < -5


@pytest.mark.parametrize("method", ["wave", "phase"])
def test_what_paths_leave_out_is_doubted(method):
    scene = Geometry(sheet(50.0, 0.0, Diffuse(albedo=0.5)))
    with pytest.warns(DoubtWarning, match="has no light of diffuse surfaces"):
        coverage(scene, Transmitter([0, 0, 9.0]), street(4.0, (1, 1)), 1e9, method)


def test_too_near_for_a_wave():
    """Within wavelength / 2 pi of the antenna more would be received than is sent, 28 dB; at the source, NaN."""
    with pytest.raises(RuleError, match="wavelength / 2 pi = 47.7 m"):
        coverage(AIR, Transmitter([0, 0, 1.0]), street(shape=(1, 1)), 1e6, "phase")
    with pytest.raises(RuleError, match="1 / k away from the source"):
        coherent_rays(AIR, PointEmitter([0, 0, 1.0], 1.0), [[0.0, 0.0, 1.0]])


def test_refused():
    for changed, message in (
        ({"frequency": 0.0}, "frequency"),
        ({"method": "best"}, "method"),
        ({"gain": -1.0}, "gain"),
        ({"samples": 1}, "samples"),
        ({"reflections": 5}, "reflections"),
        ({"transmitter": [0, 0, 0]}, "a Transmitter"),
    ):
        arguments = {"transmitter": Transmitter([0, 0, 9]), "frequency": 1e9} | changed
        with pytest.raises(RuleError, match=message):
            coverage(AIR, plane=street(), **arguments)
