"""Impulse responses: two rays over ground by hand, an edge by its dyadic, patterns and tables, exchange of antennas."""

import numpy as np
import pytest
from refusals import assert_refused

from specklegen.wavetracing import (
    AntennaTable,
    Conductor,
    Geometry,
    Mesh,
    PointEmitter,
    Smooth,
    coherent_paths,
    impulse_response,
    wedge_coefficients,
)

pytestmark = pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")

QUADS = np.array([[0, 1, 2], [0, 2, 3]])
SQUARE = np.array([[-900, -900, 0], [900, -900, 0], [900, 900, 0], [-900, 900, 0.0]])
ETA, WAVELENGTH = 5.24 + 0.83j, 0.3
K = 2 * np.pi / WAVELENGTH
GROUND = Geometry([Mesh(SQUARE, QUADS, Smooth(permittivity=ETA))])
UP, LEVEL = (lambda ways, v=v: np.tile(np.array(v, complex), (len(ways), 1)) for v in ((1, 0), (0, 1)))


def two_rays(high, low, apart, level):
    """Amplitudes of the two-ray model: e^{ikr} / r, and Fresnel's coefficient of the image; heights in metres."""
    straight, image = np.hypot(apart, high - low), np.hypot(apart, high + low)
    sine = (high + low) / image
    root = np.sqrt(ETA - (1 - sine**2))
    reflected = (sine - root) / (sine + root) if level else (ETA * sine - root) / (ETA * sine + root)
    r = np.array([straight, image])
    sign = -1 if level else 1  # of phi, as both antennas look at each other
    return sign * np.array([1, reflected]) * np.exp(1j * K * r) / r / np.sqrt(4 * np.pi), r


@pytest.mark.parametrize("level", [False, True])
def test_two_rays_over_ground(level):
    """Upright and level antennas: delays, amplitudes with their phases, angles; as xarray, too."""
    expected, r = two_rays(12.0, 2.0, 60.0, level)
    paths = coherent_paths(GROUND, PointEmitter([0, 0, 12.0], WAVELENGTH), [60.0, 0, 2.0], 1, 0, surfaces="material")
    # Upright antennas take the parts along theta, which are aslant: sent and taken as 1 all the same.
    found = impulse_response(paths, *([LEVEL, LEVEL] if level else [UP, UP]))
    assert found.delays == pytest.approx(r / 299_792_458.0, rel=1e-12)
    assert found.amplitudes == pytest.approx(expected, rel=1e-9)
    assert np.abs(impulse_response(paths, UP, LEVEL).amplitudes).max() < 1e-12  # no light changes over
    pytest.importorskip("xarray")
    data = found.to_xarray()
    assert data.amplitude.dims == ("path",)
    assert data.delay.attrs["units"] == "s"
    assert data.departure_theta.values == pytest.approx(np.pi / 2 + np.arctan2([10.0, 14.0], 60.0))
    assert data.arrival_theta.values == pytest.approx(np.pi / 2 + np.arctan2([10.0, -14.0], 60.0))


def test_the_two_ray_test_has_power():
    """A permittivity 1 % off is caught."""
    other = Geometry([Mesh(SQUARE, QUADS, Smooth(permittivity=1.01 * ETA))])
    paths = coherent_paths(other, PointEmitter([0, 0, 12.0], WAVELENGTH), [60.0, 0, 2.0], 1, 0, surfaces="material")
    assert not np.allclose(impulse_response(paths).amplitudes, two_rays(12.0, 2.0, 60.0, False)[0], rtol=1e-4)


def test_an_edge_by_its_dyadic():
    """Oblique light past a half plane: -(beta' beta D_s + phi' phi D_h) A e^{iks} of Kouyoumjian and Pathak."""
    sheet = Mesh([[0, -900, 0], [0, 900, 0], [0, 900, -900], [0, -900, -900.0]], QUADS, Conductor())  # below z = 0
    lamp, point = np.array([-9.0, 2.0, -3.0]), np.array([6.0, -5.0, -7.0])
    path = next(p for p in coherent_paths(Geometry([sheet]), PointEmitter(lamp, WAVELENGTH), point, 0, 1) if p.met)
    rho, sigma = np.hypot(9, 3), np.hypot(6, 7)
    q = np.array([0.0, 2 - 7 * rho / (rho + sigma), 0.0])
    assert path.points[1] == pytest.approx(q, abs=1e-9)
    came, goes = q - lamp, point - q
    r, s = np.linalg.norm(came), np.linalg.norm(goes)
    came, goes = came / r, goes / s
    # Angles from the face that the lamp sees, turning through -x, +z, +x.
    incidence, phi = np.arctan2(9, 3), 2 * np.pi - np.arctan2(6, 7)
    grows = lambda angle: np.array([-np.cos(angle), 0, np.sin(angle)])  # noqa: E731 - of (-sin, 0, -cos)
    soft, hard = wedge_coefficients(2.0, phi, incidence, r * s / (r + s) * (rho / r) ** 2, K, np.arcsin(rho / r))
    spread = np.sqrt(r / (s * (r + s))) * np.exp(1j * K * s)
    across_in, across_out = grows(incidence), grows(phi)
    beta_in, beta_out = np.cross(came, across_in), np.cross(goes, across_out)
    theta = np.array([np.cross(np.cross([0, 0, 1.0], came), came), np.cross([0, 0, 1.0], came)])
    theta /= np.linalg.norm(theta, axis=1, keepdims=True)
    for unit, vector in zip(theta, path.vectors, strict=True):
        sent = unit * np.exp(1j * K * r) / r / np.sqrt(4 * np.pi)
        expected = -(soft * (beta_in @ sent) * beta_out + hard * (across_in @ sent) * across_out) * spread
        assert vector == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def test_patterns_multiply_and_antennas_change_places():
    """A pattern is a factor of each path; emitter and receiver exchanged give the same amplitudes."""

    def wire(ways):
        return np.stack([gain(ways), 0.3j * ways[:, 0]], axis=1)

    def gain(ways):
        return np.hypot(ways[:, 0], ways[:, 1]) + 0.5 * ways[:, 0] - 0.2 * ways[:, 2]  # not even

    there = coherent_paths(GROUND, PointEmitter([0, 0, 12.0], WAVELENGTH), [60.0, 9, 2.0], 1, 0, surfaces="material")
    back = coherent_paths(GROUND, PointEmitter([60.0, 9, 2.0], WAVELENGTH), [0, 0, 12.0], 1, 0, surfaces="material")
    one, two = impulse_response(there, wire, UP), impulse_response(back, UP, wire)
    assert one.amplitudes == pytest.approx(two.amplitudes, rel=1e-9)
    only = impulse_response(there, lambda ways: wire(ways) * [1, 0], UP)
    assert only.amplitudes == pytest.approx(gain(one.departures) * impulse_response(there).amplitudes, rel=1e-12)


def test_a_table_is_linear_and_periodic():
    theta, phi = np.linspace(0, np.pi, 37), np.linspace(-np.pi, np.pi, 72, endpoint=False)
    both = np.meshgrid(theta, phi, indexing="ij")
    of = lambda t, p: np.stack([np.sin(t) * np.exp(1j * p), np.cos(t) + 0 * p], axis=-1)  # noqa: E731
    table = AntennaTable(theta=theta, phi=phi, values=of(*both))
    ways = np.random.default_rng(0).normal(size=(200, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    exact = of(np.arccos(ways[:, 2]), np.arctan2(ways[:, 1], ways[:, 0]))
    assert np.abs(table(ways) - exact).max() < 0.5 * (np.pi / 36) ** 2
    on_grid = np.array([[np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)]
                        for t, p in ((theta[5], phi[0]), (theta[9], phi[71]))])  # fmt: skip
    assert table(on_grid) == pytest.approx(table.values[[5, 9], [0, 71]], abs=1e-9)


def test_refused():
    paths = coherent_paths(GROUND, PointEmitter([0, 0, 12.0], WAVELENGTH), [60.0, 0, 2.0], 1, 0)
    assert impulse_response([]).amplitudes.shape == (0,)
    assert_refused(lambda: impulse_response([1]), "impulse_response paths")  # type: ignore[list-item]
    assert_refused(lambda: impulse_response(paths, [1, 0]), "a function of directions")  # type: ignore[arg-type]
    assert_refused(lambda: impulse_response(paths, lambda ways: ways), "impulse_response emitter")
    values = np.ones((3, 2, 2))
    for theta, phi, word in (
        ([0, 1, 2], [0, 1], "theta"), ([0, 90, 180], [0, 1], "theta"), ([0, 1, np.pi], [0, 7], "phi")
    ):  # fmt: skip
        assert_refused(lambda t=theta, p=phi: AntennaTable(theta=t, phi=p, values=values), f"AntennaTable.{word}")
    assert_refused(lambda: AntennaTable(theta=[0, np.pi], phi=[0.0], values=values), "AntennaTable.values")
