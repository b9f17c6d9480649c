"""Fields by images and edges: free space, a mirror, half planes and wedges against their own theory, a strip."""

import warnings

import numpy as np
import pytest
from references.strip_solver import strip_solver
from references.wall import wall_coefficients
from references.wedge_series import wedge_series
from scipy.spatial.transform import Rotation
from wavetracing.solids import box

from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.wavetracing import Geometry, Mesh, PointEmitter, Smooth, coherent_paths, coherent_rays, wedge_field

AIR = Geometry(Mesh(np.empty((0, 3)), np.empty((0, 3), int)))
K = 2 * np.pi
UNIT = 4 * np.pi  # power at which |u| = 1 / r


def sheet(corners):
    return Mesh(np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]]))


def lamp(position, **options):
    return PointEmitter(np.array(position, float), 1.0, UNIT, **options)


def test_free_space():
    points = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 2.0]])
    assert coherent_rays(AIR, lamp([0, 0, 0]), points) == pytest.approx(np.exp(1j * K * np.array([5, 2])) / [5, 2])


@pytest.mark.parametrize(("polarisation", "sign"), [("soft", -1), ("hard", 1)])
def test_a_mirror_adds_an_image(polarisation, sign):
    ground = Geometry(sheet([[-500, -500, 0], [500, -500, 0], [500, 500, 0], [-500, 500, 0]]))
    points = np.array([[4.0, 1.0, 7.0], [30.0, -3.0, 2.0]])
    source = np.array([0, 0, 5.0])
    direct = np.linalg.norm(points - source, axis=1)
    image = np.linalg.norm(points - source * [1, 1, -1], axis=1)
    expected = np.exp(1j * K * direct) / direct + sign * np.exp(1j * K * image) / image
    found = coherent_rays(ground, lamp(source), points, diffractions=0, polarisation=polarisation)
    assert found == pytest.approx(expected, rel=1e-12)
    assert coherent_rays(ground, lamp(source), points * [1, 1, -1], 3, 0) == pytest.approx(0)


@pytest.mark.parametrize("turned", range(6))
def test_on_a_mirror(turned):
    """At points of its surface, in any orientation: nothing if it is soft, twice the light if it is hard."""
    turn = Rotation.random(random_state=turned).as_matrix() if turned else np.eye(3)
    ground = Geometry(sheet(np.array([[-60, -60, 0], [60, -60, 0], [60, 60, 0], [-60, 60, 0.0]]) @ turn.T))
    points, source = np.array([[5, -3, 0], [1, 10, 0], [-7.3, 4, 0.0]]), np.array([3.0, 2.0, 12.0])
    found = [
        coherent_rays(ground, lamp(turn @ source), points @ turn.T, diffractions=0, polarisation=p)
        for p in ("soft", "hard")
    ]
    assert np.abs(found[0]).max() < 1e-12
    assert np.abs(found[1]) == pytest.approx(2 / np.linalg.norm(points - source, axis=1), rel=1e-12)


def test_a_corner_of_two_mirrors_has_three_images():
    walls = [sheet([[0, -500, 0], [500, -500, 0], [500, 500, 0], [0, 500, 0]]),
             sheet([[0, -500, 0], [0, 500, 0], [0, 500, 500], [0, -500, 500]])]  # fmt: skip
    source, point = np.array([3.0, 0, 7.0]), np.array([[11.0, 2.0, 4.0]])
    expected = 0
    for sx in (1, -1):
        for sz in (1, -1):
            r = np.linalg.norm(point - source * [sx, 1, sz], axis=1)
            expected = expected + sx * sz * np.exp(1j * K * r) / r
    found = coherent_rays(Geometry(walls), lamp(source), point, reflections=2, diffractions=0)
    assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("polarisation", ["soft", "hard"])
def test_half_plane(polarisation):
    """A far source past a straight edge against the field of a plane wave; curvature leaves k r^2 / 2 R < 4e-4."""
    half = Geometry(sheet([[0, -1e7, 0], [1e6, -1e7, 0], [1e6, 1e7, 0], [0, 1e7, 0]]))
    incidence, far, r = np.deg2rad(70), 1e5, 3.0
    phi = np.deg2rad([10, 60, 100, 165, 200, 245, 255, 300, 350.0])
    source = far * np.array([np.cos(incidence), 0, np.sin(incidence)])
    points = r * np.stack([np.cos(phi), 0 * phi, np.sin(phi)], axis=1)
    found = coherent_rays(half, lamp(source), points, polarisation=polarisation)
    found *= far * np.exp(-1j * K * far)
    expected = wedge_field(2.0, phi, incidence, r, K, polarisation)
    assert np.abs(found - expected).max() < 1e-3
    geometric = coherent_rays(half, lamp(source), points, diffractions=0, polarisation=polarisation)
    assert np.abs(geometric * far * np.exp(-1j * K * far) - expected).max() > 0.05


@pytest.mark.parametrize("polarisation", ["soft", "hard"])
def test_boundaries_of_light_and_shadow(polarisation):
    """On a shadow or reflection boundary, and 1e-13 to 1e-10 beside, there is one field: by images, or by their half.

    A receiver exactly there had lost the whole geometric wave: 42 dB behind a knife edge, where 6 are right.
    """
    half = Geometry(sheet([[0, -1e5, 0], [1e4, -1e5, 0], [1e4, 1e5, 0], [0, 1e5, 0]]))
    source = np.array([40.0, 0, 30])
    shadow, image = -source / 50, np.array([-40.0, 0, 30]) / 50
    for ray, least in ((shadow, 0.4), (image, 0.4)):
        across = np.array([ray[2], 0, -ray[0]])
        points = 25 * ray + np.array([-1e-10, -1e-13, 0, 1e-13, 1e-10])[:, None] * across
        u = coherent_rays(half, lamp(source), points, 1, 1, polarisation) * 75
        assert np.abs(u - u[2]).max() < 1e-8  # du is k dx and less than that
        assert np.abs(u).min() > least
        bent = coherent_rays(half, lamp(source), points, 1, 0, polarisation) * 75
        assert np.abs(bent[0] - bent[-1]) > 0.9  # while geometric light alone jumps


def test_edge_of_a_solid():
    """The corner of a large box, n = 3/2, against the exact series for a plane wave; UTD itself is off by 4e-3."""
    scene = Geometry(box((4e5, 4e6, 4e5), (2e5, 0, -2e5)))
    incidence, far, r = np.deg2rad(45), 1e5, 5.0
    phi = np.deg2rad([20, 120, 200, 250.0])
    source = far * np.array([np.cos(incidence), 0, np.sin(incidence)])
    points = r * np.stack([np.cos(phi), 0 * phi, np.sin(phi)], axis=1)
    for polarisation in ("soft", "hard"):
        found = coherent_rays(scene, lamp(source), points, 1, 1, polarisation) * far * np.exp(-1j * K * far)
        expected = wedge_series(1.5, phi, incidence, r, K, polarisation)
        assert np.abs(found - expected).max() < 4e-3


@pytest.mark.parametrize("polarisation", ["soft", "hard"])
def test_reciprocity(polarisation):
    """Source and receiver may change places: by an edge, an edge and a mirror, two parallel edges; by others nearly."""
    strip = sheet([[-3, -50, 0], [3, -50, 0], [3, 50, 0], [-3, 50, 0]])
    mirror = sheet([[20, -50, -40], [20, 50, -40], [20, 50, 40], [20, -50, 40]])
    crossed = Geometry([strip, mirror])
    a, b = np.array([1.0, 2.0, 9.0]), np.array([-2.0, 5.0, -12.0])
    long = 5e7  # so that its ends send 1e-9 of what its sides do
    parallel = Geometry(sheet([[-3, -long, 0], [3, -long, 0], [3, long, 0], [-3, long, 0]]))
    cases = (crossed, 1, 1, 1e-9), (parallel, 0, 2, 1e-7), (crossed, 0, 2, 2e-2)
    for scene, mirrors, diffractions, tolerance in cases:
        there = coherent_rays(scene, lamp(a), b[None], mirrors, diffractions, polarisation)
        back = coherent_rays(scene, lamp(b), a[None], mirrors, diffractions, polarisation)
        assert abs(there[0]) > 1e-3
        assert there == pytest.approx(back, rel=tolerance)


def test_a_second_edge_improves_soft_slits():
    """Two soft slits of 5 between three strips, 150 behind, against the wave solver: intensities, l2.

    By one edge the error is 5e-3 and more, since what runs along the screen from edge to edge is left out.
    """
    strips = [((-30, 0), (-9.5, 0)), ((-4.5, 0), (4.5, 0)), ((9.5, 0), (30, 0))]
    x, long, far = np.linspace(-60, 60, 41) + 0.0137, 3e5, 1e7
    exact = np.abs(strip_solver(strips).field(np.stack([x, 0 * x + 150], axis=1))) ** 2
    scene = Geometry([sheet([[a, -long, 0], [b, -long, 0], [b, long, 0], [a, long, 0]]) for (a, _), (b, _) in strips])
    points = np.stack([x, 0 * x, 0 * x + 150], axis=1)
    errors = []
    for diffractions in (1, 2):
        found = np.abs(coherent_rays(scene, lamp([0, 0, -far]), points, 0, diffractions) * far) ** 2
        errors.append(np.linalg.norm(found - exact) / np.linalg.norm(exact))
    assert errors[0] < 1.5 * 5.5e-3
    assert errors[1] < 0.6 * errors[0]


def test_two_stages_against_the_wave_solver():
    """Slits, then a reflector (scene A of [Steinberg], Fig. 3): the first edge's wave is a line of light to the second.

    With the radius of a point source there instead, the second order would leave 2.2e-2.
    """
    strips = [((-30, 0), (-9.5, 0)), ((-4.5, 0), (4.5, 0)), ((9.5, 0), (30, 0)), ((16, 40), (22, 80))]
    x, long, far = np.linspace(-60, 60, 61) + 0.0137, 3e5, 1e7
    exact = np.abs(strip_solver(strips).field(np.stack([x, 0 * x + 150], axis=1))) ** 2
    scene = Geometry([sheet([[a, -long, y], [b, -long, z], [b, long, z], [a, long, y]]) for (a, y), (b, z) in strips])
    points = np.stack([x, 0 * x, 0 * x + 150], axis=1)
    errors = []
    for diffractions in (1, 2):
        found = np.abs(coherent_rays(scene, lamp([0, 0, -far]), points, 1, diffractions) * far) ** 2
        errors.append(np.linalg.norm(found - exact) / np.linalg.norm(exact))
    assert errors[0] > 4e-2
    assert errors[1] < 8.9e-3


def test_corners_are_doubted():
    """An edge of 20 whose Fresnel zone, seen from 200, is 28; seen from 50 it is 14."""
    plate = Geometry(sheet([[-10, -10, 0], [10, -10, 0], [10, 10, 0], [-10, 10, 0]]))
    with pytest.warns(DoubtWarning, match="4 of 4 edges are shorter .* coherent_rays has no rays"):
        coherent_rays(plate, lamp([0, 0, 50.0]), np.array([[1.0, 2, -200]]), 0, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DoubtWarning)
        coherent_rays(plate, lamp([0, 0, 50.0]), np.array([[1.0, 2, -50]]), 0, 1)


def test_a_point_near_an_edge_is_doubted_and_the_others_stay():
    """Within wavelength / 2 pi of an edge there is a value and a warning; no receiver spoils those of others."""
    half = Geometry(sheet([[0, -10, 0], [10, -10, 0], [10, 10, 0], [0, 10, 0]]))
    points = np.array([[-0.05, 0, -0.05], [-2.0, 1.0, -3.0]])
    with pytest.warns(DoubtWarning, match="paths to 1 points pass an edge within wavelength / 2 pi"):
        both = coherent_rays(half, lamp([-5, 0, 5.0]), points)
    assert np.isfinite(both).all()
    assert both[1] == coherent_rays(half, lamp([-5, 0, 5.0]), points[1:])[0]


def test_a_floor_leaves_out_what_it_says():
    """Paths in the order of their bounds: what 30 and 60 dB leave out is below that share, and fewer are computed."""
    rng = np.random.default_rng(2)
    blocks = [box(rng.uniform(4, 9, 3), [14.0 * i, 6.0 * (i % 2), 0]) for i in range(3)]
    scene, source = Geometry(blocks), lamp([-9.0, -7.0, 8.0])
    counts = []
    for point in rng.uniform([20, -12, -6], [40, 18, 9], (12, 3)):
        paths = [coherent_paths(scene, source, point, 1, 2, floor_db=floor) for floor in (30, 60, 300)]
        all_power = sum(np.abs(path.pair) ** 2 for path in paths[2]).sum()
        for found, share in zip(paths, (1e-3, 1e-6), strict=False):
            assert 1 - sum(np.abs(path.pair) ** 2 for path in found).sum() / all_power <= share
        counts.append([len(found) for found in paths])
    assert np.sum(counts, axis=0)[0] < 0.9 * np.sum(counts, axis=0)[2]


def test_light_goes_through_walls():
    """Through a sheet of glass as its coefficients say, from either side; past its edge there is no step."""
    pane = Smooth(permittivity=6.0 + 0.2j, thickness=0.07)
    scene = Geometry(Mesh([[0, -500, -500], [0, 500, -500], [0, 500, 4], [0, -500, 4.0]], [[0, 1, 2], [0, 2, 3]], pane))
    source, point = np.array([-9.0, 0, 0]), np.array([[7.0, 3.0, -5.0]])
    cosine = 16 / np.linalg.norm(point[0] - source)
    for polarisation, through in (("soft", 1), ("hard", 3)):
        coefficient = wall_coefficients(pane.permittivity, 0.07, 1.0, cosine)[through]
        coefficient *= np.exp(-2j * np.pi * 0.07 * cosine)
        direct = coherent_rays(AIR, lamp(source), point)
        for one, two in ((source, point), (point[0], source[None])):
            found = coherent_rays(scene, lamp(one), two, 0, 0, polarisation, "material")
            assert found == pytest.approx(coefficient * direct, rel=1e-9)
    beside = np.array([[9.0, 1.0, z] for z in (8 - 1e-7, 8 + 1e-7)])  # the shadow boundary of the edge, z = 8
    u = coherent_rays(scene, lamp(source), beside, 0, 1, "soft", "material")
    assert abs(u[0] - u[1]) < 1e-5 * abs(u[0])
    assert abs(np.diff(coherent_rays(scene, lamp(source), beside, 0, 0, "soft", "material"))[0]) > 0.01


def test_refused():
    half = Geometry(sheet([[0, -10, 0], [10, -10, 0], [10, 10, 0], [0, 10, 0]]))
    with pytest.raises(RuleError, match="diffractions must be at least 0 and at most 2"):
        coherent_rays(half, lamp([0, 0, 5]), np.zeros((1, 3)), diffractions=3)
    with pytest.raises(RuleError, match="floor_db"):
        coherent_rays(half, lamp([0, 0, 5]), np.zeros((1, 3)), floor_db=-3)
    with pytest.raises(RuleError, match="soft"):
        coherent_rays(half, lamp([0, 0, 5]), np.zeros((1, 3)), polarisation="TE")  # pyright: ignore
