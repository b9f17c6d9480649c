"""The ledger, threads, modes, and what surfaces do with beams."""

import numpy as np
import pytest
from references.wall import wall_coefficients
from scipy.stats import norm
from wavetracing.screens import HEXAGRAM, screen, slit
from wavetracing.solids import box, soup, sphere
from zscore import assert_z

from specklegen.core.errors import DoubtWarning, RuleError
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
    trace,
)

AHEAD = np.array([0, 0, 1.0])
NOTHING = Mesh(np.empty((0, 3)), np.empty((0, 3), int))


def window(half, z=-10.0, radius=30.0, wavelength=1.0, direction=AHEAD):
    return CollimatedEmitter([-half, -half, z], [half, half, z], direction, radius, wavelength, power=4 * half**2)


def wall(half, z, **options):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) * half + [0, 0, z]
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), **options)


RECEIVER = Plane(center=np.array([0, 0, 50.0]), shape=(16, 16), pitch=4.0)


@pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")
@pytest.mark.parametrize("mode", ["wave", "ballistic", "ray"])
@pytest.mark.parametrize("scene", ["soup", "box", "sphere", "screen", "mirrors", "inside"])
def test_every_beam_ends_once(mode, scene):
    """Whatever the mesh; crossings and pixels agree with the ledger, in integers where no matt surface is connected."""
    meshes = {
        "soup": Mesh(soup(300, 1).vertices * 40 - 20, soup(300, 1).faces, Conductor()),
        "box": box((10, 8, 6), material=Smooth(permittivity=3 + 0.1j)),
        "sphere": sphere(3, 8.0, material=Diffuse(albedo=0.7)),
        "screen": screen(slit(-7), HEXAGRAM + [6, 0]).meshes[0],
        "mirrors": [wall(9, -3, material=Conductor()), wall(15, 12, material=Smooth(permittivity=4, thickness=0.3))],
        "inside": box((60, 60, 60), material=Smooth(permittivity=9 + 1j)),
    }[scene]
    beams = 2000
    found = trace(Geometry(meshes), window(12, radius=6.0), RECEIVER, beams, 3, mode=mode, max_events=12)
    assert found.ledger.total == beams
    counts = found.irradiance[0] * RECEIVER.pitch**2 * beams / (4 * 12**2)
    if scene != "sphere" or mode == "ballistic":
        assert np.abs(counts - counts.round()).max() < 1e-9
        assert counts.sum() == pytest.approx(found.statistics.crossings)
    assert found.ledger.received <= found.statistics.crossings
    assert np.isfinite(found.standard_error[0]).all()
    if scene == "inside":
        assert found.ledger.escaped == found.ledger.received == 0


def test_nothing_in_the_way():
    """No screen: what crosses is what was sent, with the spread of the beams; rays go straight."""
    for mode in ("wave", "ballistic", "ray"):
        found = trace(Geometry(NOTHING), window(8), RECEIVER, 1000, 0, mode=mode)
        assert found.ledger.received == 1000
        assert found.statistics.regions == found.statistics.open == 0
    image = trace(Geometry(NOTHING), window(8), RECEIVER, 40_000, 0, mode="ray").irradiance[0]
    assert image[6:10, 6:10].sum() * 16 == pytest.approx(4 * 64)
    assert_z(image[6:10, 6:10], 1.0, np.sqrt(15 / 40_000))  # a sixteenth of the beams in each of 16 pixels


def test_a_closed_screen_takes_everything():
    found = trace(Geometry(wall(1e4, 0)), window(8), RECEIVER, 5000, 0)
    assert found.ledger.absorbed == 5000
    assert found.statistics.open == 0


def test_mirrors_keep_a_beam_until_it_is_stopped():
    found = trace(Geometry(box((60, 60, 60), material=Conductor())), window(8), RECEIVER, 200, 0, max_events=9)
    assert found.ledger.stopped == 200
    assert found.statistics.surface + found.statistics.matter + found.statistics.open == 9 * 200


@pytest.mark.parametrize("mode", ["wave", "ballistic", "ray"])
@pytest.mark.parametrize("size", [(60.0, 60.0, 60.0), (10.0, 8.0, 6.0)])
@pytest.mark.parametrize("material", [Conductor(), Diffuse(albedo=0.95), Smooth(permittivity=9, thickness=None)])
def test_nothing_gets_out_of_a_closed_box(mode, size, material):
    """From a wall, too, where half of a beam's cross-section lies behind it: no beam passes, none fails.

    Ballistic beams had taken that half for an opening: 96 % of them left a box of mirrors within 24 events.
    """
    least = min(size)
    source = window(0.2 * least, z=-0.15 * least, radius=max(1.0, 0.1 * least))
    inside = Plane(center=np.array([0, 0, 0.3 * least]), shape=(1, 1), pitch=0.5 * least)
    outside = Plane(center=np.array([0, 0, 0.8 * least]), shape=(1, 1), pitch=1e3)
    found = trace(Geometry(box(size, material=material)), source, [inside, outside], 400, 3, mode=mode, max_events=24)
    assert not found.fluence[1].any()
    assert found.ledger.escaped == found.ledger.received == found.ledger.failed == 0
    assert found.ledger.total == 400
    assert found.fluence[0].all()  # light there is


def test_a_tight_guide_ends():
    """Between mirrors a wavelength apart, where every cone is wider than the guide, rays go on; no beam is lost."""
    plates = [wall(1e7, z, material=Conductor()).placed(rotation=np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]))
              for z in (-0.5, 0.5)]  # fmt: skip
    source = CollimatedEmitter([-0.4, -5, -10], [0.4, 5, -10], AHEAD, 2.0, 1.0)
    found = trace(Geometry(plates), source, RECEIVER, 500, 0, max_events=20)
    assert found.ledger.total == 500
    assert found.statistics.surface > 500
    assert found.statistics.open == found.ledger.failed == 0


def test_no_region_where_a_ray_grazes():
    """A sheet seen edge on to 1e-9 rad: no number that is not finite, every beam ends."""
    for tilt in (0.0, 1e-9, 1e-3):
        turn = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
        upright = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
        sheet = wall(50.0, 0, material=Conductor()).placed([0, 0, 60.0], turn @ upright)
        found = trace(Geometry(sheet), window(8), RECEIVER, 600, 1)
        assert found.ledger.total == 600
        assert np.isfinite(found.fluence[0]).all()


def test_a_ray_passes_though_the_beam_sees_a_wall():
    """Past a corner of blocks a ray may pass where all is closed as the mean of its beam sees it: it goes on unbent."""
    blocks = [box((40, 30, 20), (x, y, 10)) for x in (-26, 26) for y in (-21, 21)]
    source = PointEmitter([-38, 0, 4.0], 0.33, beam_angle=0.05)
    found = trace(Geometry(blocks), source, RECEIVER, 1500, 0)
    assert found.statistics.open > 100
    assert found.ledger.failed == 0
    assert found.ledger.total == 1500


@pytest.mark.parametrize("wavelength", [0.33, 0.06])
def test_nothing_gets_into_a_solid(wavelength):
    """Past the corners of mirror blocks, where rays turn beside their walls: no crossing of any receiver inside.

    An event on the wall itself, from where a turned ray went on behind it, had let 5 % of these beams in.
    """
    blocks = [box((40, 30, 20), (x, y, 10), material=Conductor()) for x in (-26, 26) for y in (-21, 21)]
    inside = [Plane(center=np.array([x, y, z]), shape=(1, 1), pitch=29.9)
              for x in (-26, 26) for y in (-21, 21) for z in (1.5, 10.0, 19.0)]  # fmt: skip
    source = PointEmitter([-38, 0, 4.0], wavelength, beam_angle=0.05)
    found = trace(Geometry(blocks), source, inside, 4000, 1)
    assert found.statistics.open > 500
    assert [int(image.sum() > 0) for image in found.irradiance] == 12 * [0]


def test_statistics_of_regions():
    """An edge in the cone makes a region of the beam's own cross-section; without one a surface is a surface."""
    beams = 300
    found = trace(Geometry(wall(1e4, 0, material=Conductor())), window(8, radius=30.0), RECEIVER, beams, 0).statistics
    assert found.surface == beams
    assert found.regions == found.matter == found.open == 0
    plate = trace(Geometry(wall(9.0, 0, material=Conductor())), window(8, radius=30.0), RECEIVER, beams, 0).statistics
    assert plate.regions == plate.matter == plate.uniform == beams
    assert plate.surface == 0
    assert plate.region_area == pytest.approx(np.pi * 30.0**2, rel=0.05)
    ray = trace(Geometry(wall(9.0, 0)), window(8, radius=30.0), RECEIVER, beams, 0, mode="ray").statistics
    assert ray.surface > 0
    assert ray.regions == ray.matter == ray.open == 0


def test_a_tilted_mirror_sends_light_aside():
    """A conductor at 45 degrees, wider than the beams: everything arrives on a receiver at its side."""
    turn = np.array([[np.cos(np.pi / 4), 0, -np.sin(np.pi / 4)], [0, 1, 0], [np.sin(np.pi / 4), 0, np.cos(np.pi / 4)]])
    mirror = wall(400, 0, material=Conductor()).placed(rotation=turn)
    aside = Plane(center=np.array([60.0, 0, 0]), normal=np.array([1.0, 0, 0]), shape=(40, 40), pitch=4.0)
    found = trace(Geometry(mirror), window(20, z=-80.0, radius=40.0), aside, 3000, 1)
    assert found.ledger.received == 3000
    rows = found.irradiance[0].sum(axis=1) > 0
    assert 10 <= rows.sum() <= 14  # 40 wide on pixels of 4, and the spread of the beams


def test_shares_of_a_dielectric_wall():
    """Reflected and transmitted counts against the coefficients of a 6 mm glass pane (here in wavelengths)."""
    pane = Smooth(permittivity=6.31 + 0.11j, thickness=0.1)
    back = Plane(center=np.array([0, 0, -20.0]), shape=(200, 200), pitch=4.0)
    front = Plane(center=np.array([0, 0, 20.0]), shape=(200, 200), pitch=4.0)
    count = 40_000
    found = trace(Geometry(wall(1e3, 0, material=pane)), window(8), [back, front], count, 5, mode="ray")
    r, t, _, _ = wall_coefficients(pane.permittivity, 0.1, 1.0, 1.0)
    shares = [image.sum() * 16 / (4 * 64) for image in found.irradiance]
    for got, share in zip(shares, (abs(r) ** 2, abs(t) ** 2), strict=True):
        assert_z(got, share, np.sqrt(share * (1 - share) / count))
    with pytest.raises(AssertionError, match="z ="):
        assert_z(shares[0], abs(r) ** 2 * 1.05, np.sqrt(abs(r) ** 2 / count))


def test_lambert_surface():
    """Shares of light scattered through squares above a spot: view factors of a patch to a rectangle."""
    count, albedo, height = 40_000, 0.6, 1000.0
    above = [Plane(center=np.array([0, 0, -height]), shape=(1, 1), pitch=2 * x * height) for x in (0.5, 1.0, 3.0)]
    spot = Geometry(wall(1e4, 0, material=Diffuse(albedo=albedo)))
    found = trace(spot, window(1, z=-1.0), above, count, 2, mode="ray")
    for x, plane, image in zip((0.5, 1.0, 3.0), above, found.irradiance, strict=True):
        root = np.sqrt(1 + x * x)
        share = albedo * 4 / np.pi * x / root * np.arctan(x / root)
        got = image.sum() * plane.pitch**2 / 4
        assert_z(got, share, np.sqrt(share * (1 - share) / count))
    assert found.ledger.absorbed + found.ledger.received + found.ledger.escaped == count


def test_threads_and_order_do_not_matter():
    scene = screen(HEXAGRAM)
    found = [trace(scene, window(8), RECEIVER, 9000, 4, threads=n) for n in (1, 2, 3)]
    for other in found[1:]:
        for name in ("irradiance", "standard_error", "fluence", "fluence_error"):
            assert (getattr(found[0], name)[0] == getattr(other, name)[0]).all()
        assert found[0].ledger == other.ledger
        assert found[0].statistics == other.statistics
    assert trace(scene, window(8), RECEIVER, 9000, 5).statistics != found[0].statistics


@pytest.mark.parametrize(("s", "ratio"), [(2, 1.3176), (7, 1.7266), (20, 1.9008)])
def test_ballistic_rays_inject_energy(s, ratio):
    """Power behind a slit of width 5 over what geometry sends: 2 - (mean over the slit of a beam's own mass in it).

    Rays of the Wigner ensemble send exactly what geometry does. A figure of the paper (Fig. 8).
    """
    c = np.linspace(-2.5, 2.5, 20_001)
    mass = (norm.cdf((2.5 - c) / s) - norm.cdf((-2.5 - c) / s)).mean()
    assert 2 - mass == pytest.approx(ratio, abs=1e-4)
    half, count = 2.5 + 6 * s, 6000
    source = CollimatedEmitter([-half, -half, -10], [half, half, -10], AHEAD, 3 * s, 1.0)
    scene, share = screen(slit(0, 5, 4000)), 2.5 / half
    behind = Plane(center=np.array([0, 0, 1.0]), shape=(1, 1), pitch=1e6)
    # What passes does not depend on where it goes, so the quicker pattern serves.
    found = trace(scene, source, behind, count, 1, mode="ballistic", amplitude="uniform")
    got = found.ledger.received
    p = share * ratio
    # Of those few that leave along the screen some miss the receiver, 1e6 wide: fewer than one.
    assert_z(got / count, p, np.sqrt(p * (1 - p) / count))
    with pytest.raises(AssertionError, match="z ="):
        assert_z(got / count, share, np.sqrt(share * (1 - share) / count))
    waves = trace(scene, source, behind, count, 1, amplitude="uniform")
    assert_z(waves.statistics.open / count, share, np.sqrt(share * (1 - share) / count))


def test_point_source_spreads_evenly():
    """Power over a plane ahead against the solid angle of its pixels."""
    count = 60_000
    source = PointEmitter([0, 0, 0.0], 1.0, power=1.0, beam_angle=0.02)
    plane = Plane(center=np.array([0, 0, 1e4]), shape=(8, 8), pitch=2.5e3)
    for mode in ("wave", "ray"):
        found = trace(Geometry(NOTHING), source, plane, count, 7, mode=mode)
        edge = (np.arange(9) - 4) * 2.5e3
        x, y = np.meshgrid(edge, edge)
        corner = np.arctan2(x * y, 1e4 * np.sqrt(x * x + y * y + 1e8))
        solid = corner[1:, 1:] - corner[1:, :-1] - corner[:-1, 1:] + corner[:-1, :-1]
        p = solid / (4 * np.pi)
        assert_z(found.irradiance[0] * 2.5e3**2, p, np.sqrt(p / count))


def test_arguments_are_refused():
    scene = Geometry(wall(10, 0))
    for changed, message in (
        ({"beams": 0}, "beams"),
        ({"mode": "particle"}, "mode"),
        ({"amplitude": "flat"}, "amplitude"),
        ({"max_events": -1}, "max_events"),
        ({"seed": -1}, "seed"),
    ):
        arguments = {"beams": 10, "seed": 0} | changed
        with pytest.raises(RuleError, match=message):
            trace(scene, window(1), RECEIVER, **arguments)
    with pytest.raises(RuleError, match="out of the rectangle"):
        window(1, direction=np.array([1.0, 0, 0]))
    with pytest.raises(RuleError, match="above lower"):
        CollimatedEmitter([0, 0, 0], [1, 1, 1], AHEAD, 1.0, 1.0)
    with pytest.raises(RuleError, match="beam_radius"):
        window(1, radius=0.5)
    with pytest.raises(RuleError, match="beam_angle"):
        PointEmitter([0, 0, 0], 1.0, beam_angle=1.0)


def test_edges_below_a_wavelength_are_doubted():
    with pytest.warns(DoubtWarning, match="4 of 8 edges are shorter than a wavelength"):
        trace(screen(slit(0, 0.5, 0.5)), window(1), RECEIVER, 10, 0)


def test_materials_at_their_defaults():
    assert Mesh(NOTHING.vertices, NOTHING.faces).material == Absorber()
