"""Beams with diffraction by UTD: against exact fields, near the edges too; images by `coherent_rays`."""

import numpy as np
import pytest
from references.wedge_series import half_plane, wedge_series
from wavetracing.screens import FAR, OUTLINE, screen, slit
from wavetracing.solids import box, soup, sphere
from zscore import assert_z

from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.oracles.slit_screen import slit_screen
from specklegen.wavetracing import (
    Absorber,
    CollimatedEmitter,
    Conductor,
    Diffuse,
    Geometry,
    Mesh,
    Plane,
    PointEmitter,
    Smooth,
    Transmitter,
    coherent_rays,
    coverage,
    perforated_screen,
    trace,
)

pytestmark = pytest.mark.filterwarnings("ignore:.*corners matter:specklegen.core.errors.DoubtWarning")

K = 2 * np.pi
AHEAD = np.array([0, 0, 1.0])


def power(fields, material):
    """Unpolarised intensity of a soft and a hard field at a metal edge: their mean; at a black one without images."""
    soft, hard = fields
    black = np.abs((soft + hard) / 2) ** 2
    return black if isinstance(material, Absorber) else (np.abs(soft) ** 2 + np.abs(hard) ** 2) / 2


def rows(found, n=0):
    """Mean over the rows of a receiver of the power density across the light, and its standard error."""
    image, error = found.fluence[n], found.fluence_error[n]
    return image.mean(axis=0), np.sqrt((error**2).sum(axis=0)) / len(image)


def over_pixels(values, pixels):
    return values.reshape(pixels, -1).mean(axis=1)


def half(material, size=FAR):
    """A half plane x > 0 at z = 0."""
    corners = size * np.array([[0, -1, 0], [1, -1, 0], [1, 1, 0], [0, 1, 0.0]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), material)


def sheet(half_size, z, material):
    corners = half_size * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) + [0, 0, z]
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), material)


@pytest.mark.parametrize("material", [Absorber(), Conductor()])
def test_half_plane(material):
    """Light of partial coherence, 3 to 30 wavelengths of offset 30 behind the edge: fringes, boundary and shadow.

    The ensemble of beams of half-width 30 is plane waves of directions N(0, 1 / 2 Sigma), averaged here by quadrature.
    """
    z, sigma = 30.0, 2 * (30.0 / 3) ** 2
    source = CollimatedEmitter([-60, -30, -10], [60, 30, -10], AHEAD, 30.0, 1.0, power=120 * 60)
    behind = Plane(center=np.array([0, 0, z]), shape=(10, 24), pitch=2.0)
    got, error = rows(trace(Geometry(half(material)), source, behind, 100_000, 1, diffraction="utd"))
    x = (np.arange(192) + 0.5) / 4 - 24
    phi, r = np.arctan2(-z, x) % (2 * np.pi), np.hypot(x, z)  # from the lit face of the metal
    nodes, weights = np.polynomial.hermite_e.hermegauss(21)
    exact = 0
    for node, weight in zip(nodes, weights / weights.sum(), strict=True):
        incidence = np.pi / 2 + np.arcsin(node / np.sqrt(2 * sigma) / K)
        exact += weight * power([half_plane(phi, incidence, r, K, b) for b in ("soft", "hard")], material)
    assert_z(got, over_pixels(exact, 24), error)
    with pytest.raises(AssertionError, match="z ="):
        assert_z(got, over_pixels(exact, 24)[::-1], error)


@pytest.mark.parametrize("material", [Absorber(), Conductor()])
def test_a_source_very_far_away_sees_no_screen_through(material):
    """Half a wavelength behind a half plane lit from 1e7 wavelengths away: shadow, as if lit from near."""
    x = (np.arange(64) + 0.5) / 16 - 2
    phi, r = np.arctan2(-0.5, x) % (2 * np.pi), np.hypot(x, 0.5)
    exact = over_pixels(power([half_plane(phi, np.pi / 2, r, K, b) for b in ("soft", "hard")], material), 8)
    scene = Geometry(half(material, 300.0))
    source = CollimatedEmitter([-6, -4, -1e7], [6, 4, -1e7], AHEAD, 1e8, 1.0, power=12 * 8)
    behind = Plane(center=[0, 0, 0.5], shape=(4, 8), pitch=0.5)
    got, error = rows(trace(scene, source, behind, 40_000, 1, diffraction="utd"))
    assert_z(got, exact, error)
    assert error.max() < 0.06


def test_slit_near_and_far():
    """Coherent light through a metal slit of 10, at Z = 10 and 50, where far fields are wrong by .26 to 2.4.

    Single diffraction is what UTD gives here: the exact slit differs by 3.2e-3 and 2.6e-3 in l2, up to 3 % in shadow.
    """
    source = CollimatedEmitter([-12, -8, -10], [12, 8, -10], AHEAD, 1e4, 1.0, power=24 * 16)
    planes = [Plane(center=np.array([0, 0, z]), shape=(4, 24), pitch=1.0) for z in (10.0, 50.0)]
    scene = Geometry(perforated_screen(OUTLINE, [slit(0, 10.0, 2000.0)], material=Conductor()))
    found = trace(scene, source, planes, 60_000, 3, diffraction="utd")
    assert found.ledger.total == 60_000
    x = (np.arange(96) + 0.5) / 4 - 12
    for n, z in enumerate((10.0, 50.0)):
        points = np.stack([x, 0 * x + z], axis=1)
        exact = over_pixels(power([slit_screen([(-5, 5)], 1.0, b).field(points) for b in ("soft", "hard")], None), 24)
        got, error = rows(found, n)
        assert_z(got, exact, error, slack=0.03 * exact)
        if z == 50:  # a slit wider by a fifth is seen
            wide = [slit_screen([(-6, 6)], 1.0, b).field(points) for b in ("soft", "hard")]
            with pytest.raises(AssertionError, match="z ="):
                assert_z(got, over_pixels(power(wide, None), 24), error, slack=0.03 * exact)
        far = trace(screen(slit(0, 10.0, 2000.0)), source, planes, 4000, 3, amplitude="uniform")
        assert np.linalg.norm(rows(far, n)[0] - exact) > 3 * np.linalg.norm(got - exact)


def test_slit_lit_aslant():
    """The same slit lit at 40 degrees, 50 behind it: beams against the exact mean of soft and hard."""
    angle, z = np.deg2rad(40), 50.0
    light, before, behind = np.array([np.sin(angle), 0, np.cos(angle)]), -10 * np.tan(angle), z * np.tan(angle)
    source = CollimatedEmitter(
        [before - 12, -8, -10], [before + 12, 8, -10], light, 1e4, 1.0, power=24 * 16 * np.cos(angle)
    )
    plane = Plane(center=np.array([behind, 0, z]), shape=(4, 24), pitch=1.0)
    scene = Geometry(perforated_screen(OUTLINE, [slit(0, 10.0, 2000.0)], material=Conductor()))
    got, error = rows(trace(scene, source, plane, 60_000, 3, diffraction="utd"))
    points = np.stack([behind + (np.arange(96) + 0.5) / 4 - 12, np.full(96, z)], axis=1)
    for lit, right in ((angle, True), (-angle, False)):
        fields = [slit_screen([(-5, 5)], 1.0, b, angle=lit).field(points) for b in ("soft", "hard")]
        exact = over_pixels(power(fields, None), 24)
        if right:
            assert_z(got, exact, error, slack=0.03 * exact)
        else:
            with pytest.raises(AssertionError, match="z ="):
                assert_z(got, exact, error, slack=0.03 * exact)


@pytest.mark.parametrize("material", [Absorber(), Conductor()])
def test_corner_of_a_block(material):
    """A wedge, n = 3/2, lit at 60 degrees: direct, reflected, and bent around the corner, 20 from the edge."""
    size, incidence, r = 4e4, np.deg2rad(60), 20.0
    direction = -np.array([np.cos(incidence), 0, np.sin(incidence)])
    middle = -80 * direction
    source = CollimatedEmitter(
        middle - [40, 20, 0], middle + [40, 20, 0], direction, 2000.0, 1.0, power=80 * 40 * abs(direction[2])
    )
    angles = np.deg2rad([20, 90, 118, 125, 200, 236, 244, 255, 265])
    planes = []
    for angle in angles:
        out = np.array([np.cos(angle), 0, np.sin(angle)])
        planes.append(Plane(center=r * out, normal=out, up=np.array([0, 1.0, 0]), shape=(8, 1), pitch=1.0))
    scene = Geometry(box((size, size, size), (size / 2, 0, -size / 2), material=material))
    found = trace(scene, source, planes, 100_000, 4, diffraction="utd")
    offsets = (np.arange(4) + 0.5) / 4 - 0.5
    for n, angle in enumerate(angles):
        exact = np.mean([
            power([wedge_series(1.5, angle + np.arctan(y / r), incidence, np.hypot(r, y), K, b)
                   for b in ("soft", "hard")], material) for y in offsets
        ])  # fmt: skip
        got, error = rows(found, n)
        assert_z(got, exact, error, slack=1e-3 * float(exact))


def test_point_source_and_knife_edge():
    """Coherent light of a point behind a half plane against all its rays: mean of soft and hard."""
    source = PointEmitter([0, 0, -40.0], 1.0, power=4 * np.pi, beam_angle=0.3)
    behind = Plane(center=np.array([0, 0, 30.0]), shape=(4, 10), pitch=5.0)
    scene = Geometry(half(Conductor()))
    found = trace(scene, source, behind, 300_000, 5, diffraction="utd")
    fine = behind.replace(shape=(8, 80), pitch=0.625).replace(shape=(4, 80))  # pixels of 5 along x alone
    exact = sum(0.5 * np.abs(coherent_rays(scene, source, fine.points, 0, 1, b)) ** 2 for b in ("soft", "hard"))
    got, error = rows(found)
    assert_z(got, over_pixels(exact.mean(axis=0), 10), error, slack=0.02 * over_pixels(exact.mean(axis=0), 10))


def test_an_edge_along_an_axis_lit_along_it():
    """A knife edge along y, lit at 60 degrees along it: rays that leave it stay in its sheet's plane to rounding."""
    source = PointEmitter([-8.0, -52.0, -30.0], 1.0, power=4 * np.pi, beam_angle=0.1)
    behind = Plane(center=[14.0, 43.0, 25.0], shape=(12, 1), pitch=8.0)
    scene, fine = Geometry(half(Conductor())), behind.replace(shape=(192, 16), pitch=0.5).points.copy()
    exact = float(np.mean([np.abs(coherent_rays(scene, source, fine, 0, 1, b)) ** 2 for b in ("soft", "hard")]))
    found = trace(scene, source, behind, 300_000, 2, diffraction="utd")
    image, error = rows(found)
    assert error[0] < 0.06 * exact
    assert_z(image, exact, error, slack=0.01 * exact)
    with pytest.raises(AssertionError, match="z ="):
        assert_z(image, exact / 0.74, error, slack=0.01 * exact)  # what meeting its own sheet again took off


@pytest.mark.parametrize("place", [[-3.0, 0, -1.5], [2.0, 0, -2.0]])
def test_a_point_nearer_to_an_edge_than_its_beams_are_wide(place):
    """Half of the rays that pass an edge so near have their nearest point behind the source: no less light for that."""
    source, scene = PointEmitter(place, 1.0, power=4 * np.pi, beam_angle=0.02), Geometry(half(Conductor()))
    assert source.beam_radius > 10 * np.hypot(place[0], place[2])
    shadow = Plane(center=[14.0, 0, 6.0], shape=(12, 4), pitch=3.0)
    fine = shadow.replace(shape=(96, 32), pitch=3.0 / 8).points.copy()
    exact = float(np.mean([np.abs(coherent_rays(scene, source, fine, 0, 1, b)) ** 2 for b in ("soft", "hard")]))
    image, error = rows(trace(scene, source, shadow, 300_000, 9, diffraction="utd"))
    got, error = image.mean(), np.sqrt((error**2).sum()) / 4
    assert error < 0.04 * exact
    assert_z(got, exact, error, slack=0.01 * exact)
    with pytest.raises(AssertionError, match="z ="):
        assert_z(got, exact / 0.78, error, slack=0.01 * exact)  # what a whole strip, less the rays behind, would give


@pytest.mark.parametrize("z", [-1.0, -12.0])
def test_a_source_aslant_to_its_light_before_an_edge(z):
    """Light at 60 degrees from a rectangle along the screen: part of it begins beyond the edge's point."""
    sigma, angle = 2 * (15.0 / 3) ** 2, np.deg2rad(60)
    direction = np.array([np.sin(angle), 0, np.cos(angle)])
    x = z * np.tan(angle)
    source = CollimatedEmitter([x - 60, -20, z], [x + 60, 20, z], direction, 15.0, 1.0, power=120 * 40 * direction[2])
    behind = Plane(center=[12.0, 0, 3.0], shape=(6, 4), pitch=2.0)
    got, error = rows(trace(Geometry(half(Conductor())), source, behind, 200_000, 2, diffraction="utd"))
    x = (np.arange(32) + 0.5) / 4 + 8
    nodes, weights = np.polynomial.hermite_e.hermegauss(21)
    exact = 0
    for node, weight in zip(nodes, weights / weights.sum(), strict=True):
        incidence = np.pi / 2 + angle + np.arcsin(node / np.sqrt(2 * sigma) / K)
        fields = [
            half_plane(np.arctan2(-3.0, x) % (2 * np.pi), incidence, np.hypot(x, 3), K, b) for b in ("soft", "hard")
        ]
        exact += weight * power(fields, Conductor())
    assert_z(got, over_pixels(exact, 4), error)


def test_by_a_mirror():
    """Light that a mirror turned by 90 degrees meets an edge as light that came straight."""
    turn = np.array([[np.cos(np.pi / 4), 0, -np.sin(np.pi / 4)], [0, 1, 0], [np.sin(np.pi / 4), 0, np.cos(np.pi / 4)]])
    corners = 400 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    mirror = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), Conductor()).placed([0, 0, -100.0], turn)
    straight = CollimatedEmitter([-40, -20, -100], [40, 20, -100], AHEAD, 15.0, 1.0, power=80 * 40)
    bent = CollimatedEmitter([-60, -20, -140], [-60, 20, -60], [1.0, 0, 0], 15.0, 1.0, power=80 * 40)
    behind = Plane(center=np.array([0, 0, 30.0]), shape=(10, 12), pitch=2.0)
    edge = half(Absorber())
    one, first = rows(trace(Geometry(edge), straight, behind, 60_000, 6, diffraction="utd"))
    two, second = rows(trace(Geometry([mirror, edge]), bent, behind, 60_000, 7, diffraction="utd"))
    assert_z(one, two, np.hypot(first, second))
    assert two.min() < 0.05
    assert two.max() > 0.9


def test_threads_and_order_do_not_matter():
    source = CollimatedEmitter([-9, -9, -10], [9, 9, -10], AHEAD, 20.0, 1.0)
    behind = Plane(center=np.array([0, 0, 20.0]), shape=(4, 4), pitch=2.0)
    scene = screen(slit(0, 10.0, 200.0))
    one, two = (trace(scene, source, behind, 5000, 1, diffraction="utd", threads=n) for n in (1, 2))
    assert (one.fluence[0] == two.fluence[0]).all()
    assert one.ledger == two.ledger
    assert one.ledger.edge_received != 0
    assert one.statistics == two.statistics


@pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")
@pytest.mark.parametrize("scene", ["soup", "box", "sphere", "mirrors", "inside"])
def test_every_beam_ends_once(scene):
    """Whatever the mesh, in integers; values are numbers, and light that cannot get out does not."""
    meshes = {
        "soup": Mesh(soup(30, 1).vertices * 40 - 20, soup(30, 1).faces, Conductor()),
        "box": box((10, 8, 6), material=Smooth(permittivity=3 + 0.1j)),
        "sphere": sphere(3, 8.0, material=Diffuse(albedo=0.7)),
        "mirrors": [sheet(9, -3, Conductor()), sheet(15, 12, Smooth(permittivity=4, thickness=0.3))],
        "inside": box((60, 60, 60), material=Smooth(permittivity=9 + 1j)),
    }[scene]
    source = CollimatedEmitter([-12, -12, -10], [12, 12, -10], AHEAD, 6.0, 1.0)
    behind = Plane(center=np.array([0, 0, 50.0]), shape=(8, 8), pitch=8.0)
    found = trace(Geometry(meshes), source, behind, 400, 3, diffraction="utd", max_events=8)
    assert found.ledger.total == 400
    for image in (*found.irradiance, *found.standard_error, *found.fluence, *found.fluence_error):
        assert np.isfinite(image).all()
    assert np.isfinite([found.ledger.edge_received, found.ledger.edge_absorbed]).all()
    if scene == "inside":
        assert not found.fluence[0].any()


def test_nothing_in_the_way():
    """Without edges UTD is rays: each in its pixel."""
    nothing = Geometry(Mesh(np.empty((0, 3)), np.empty((0, 3), int)))
    source = CollimatedEmitter([-2, -2, -10], [2, 2, -10], AHEAD, 1e6, 1.0)
    behind = Plane(center=np.array([0, 0, 20.0]), shape=(1, 1), pitch=8.0)
    found = trace(nothing, source, behind, 500, 1, diffraction="utd")
    assert found.ledger.received == 500
    assert found.irradiance[0][0, 0] == pytest.approx(1 / 64)


def test_coverage_by_utd():
    """A map behind a screen that is dark to rays has light, less the deeper."""
    wall = Geometry(box((0.5, 600.0, 600.0), (0, -300.0, 0), material=Absorber()))
    behind = Plane(center=np.array([12.0, -6.0, 0]), normal=np.array([1.0, 0, 0]), up=AHEAD, shape=(2, 2), pitch=6.0)
    antenna = Transmitter([-12.0, 4.0, 0], beam_angle=0.2)
    found = coverage(wall, antenna, behind, 1e9, beams=100_000, diffraction="utd").rss_dBm.filled(-200.0)
    near, deep = sorted(found.mean(axis=0))[::-1]
    assert -80 < deep < near - 3


def test_refused_and_doubted():
    source = CollimatedEmitter([-1, -1, -10], [1, 1, -10], AHEAD, 20.0, 1.0)
    behind = Plane(center=np.array([0, 0, 50.0]), shape=(1, 1), pitch=1.0)
    scene = screen(slit(0, 10.0, 2000.0))
    with pytest.raises(RuleError, match="in the modes 'ballistic' and 'ray'"):
        trace(scene, source, behind, 10, 0, mode="ray", diffraction="utd")
    with pytest.raises(RuleError, match="'auto' with UTD"):
        trace(scene, source, behind, 10, 0, diffraction="utd", amplitude="uniform")
    with pytest.warns(DoubtWarning, match=r"2 of 8 edges are shorter than the Fresnel zone .* no rays"):
        trace(scene, source, behind, 10, 0, diffraction="utd")
