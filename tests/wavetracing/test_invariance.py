"""Fields and maps do not know how a scene is turned, moved, scaled, wound or cut into triangles."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from wavetracing.solids import box
from zscore import assert_z

from specklegen.wavetracing import (
    Building,
    Conductor,
    Cone,
    Geometry,
    Mesh,
    Plane,
    PointEmitter,
    Transmitter,
    coherent_rays,
    coverage,
    trace,
)

pytestmark = pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")

BLOCK = box((6.0, 40.0, 30.0), (0, 0, 0), material=Conductor())
SOURCE = np.array([-25.0, 3.0, 4.0])
POINTS = np.array([[20.0, -2.0, 9.0], [8.0, 5.0, 21.0], [-9.0, 1.0, -3.0], [12.0, 14.0, 17.5]])


def with_junctions(mesh):
    """The same surface, one half of some sides cut, so that a vertex of one face lies within a side of another."""
    faces, vertices = [], list(mesh.vertices)
    for n, (a, b, c) in enumerate(mesh.faces):
        if n % 3:
            faces.append((a, b, c))
        else:
            vertices.append((vertices[a] + vertices[b]) / 2)
            m = len(vertices) - 1
            faces += [(a, m, c), (m, b, c)]
    return Mesh(np.array(vertices), np.array(faces), mesh.material)


def wound(mesh, turned):
    faces = mesh.faces.copy()
    faces[turned] = faces[turned][:, ::-1]
    return Mesh(mesh.vertices, faces, mesh.material)


def fields(mesh, source=SOURCE, points=POINTS, wavelength=1.0):
    """Soft by a mirror and an edge, hard by two edges."""
    lamp, scene = PointEmitter(source, wavelength, power=4 * np.pi), Geometry(mesh)
    paths = (1, 1, "soft"), (0, 2, "hard")
    return np.array([coherent_rays(scene, lamp, points, *each) for each in paths])


@pytest.fixture(scope="module")
def expected():
    return fields(BLOCK)


MESHES = {
    "inverted": wound(BLOCK, slice(None)),
    "every third face turned": wound(BLOCK, slice(None, None, 3)),
    "T-junctions": with_junctions(BLOCK),
    "T-junctions, mixed": wound(with_junctions(BLOCK), slice(None, None, 4)),
}


@pytest.mark.parametrize("name", MESHES)
def test_any_mesh_of_one_block_has_one_field(name, expected):
    """Winding and triangulation leave fields by mirrors and two edges as they are, to 1e-9."""
    assert np.abs(expected).max(axis=1).min() > 1e-3
    assert np.abs(fields(MESHES[name]) - expected).max() < 1e-9


def test_a_block_that_is_another_is_noticed(expected):
    assert np.abs(fields(box((6.0, 40.0, 30.01), material=Conductor())) - expected).max() > 1e-6


def test_turned_moved_and_scaled(expected):
    """A scene turned as a whole and moved; and one of twice the size at twice the wavelength: half the field."""
    turn, shift = Rotation.random(random_state=3).as_matrix(), np.array([100.0, -7.0, 31.0])
    moved = Mesh(BLOCK.vertices @ turn.T + shift, BLOCK.faces, BLOCK.material)
    assert np.abs(fields(moved, turn @ SOURCE + shift, POINTS @ turn.T + shift) - expected).max() < 1e-8
    large = Mesh(2 * BLOCK.vertices, BLOCK.faces, BLOCK.material)
    assert np.abs(2 * fields(large, 2 * SOURCE, 2 * POINTS, 2.0) - expected).max() < 1e-9


def test_source_and_receiver_change_places(expected):
    """By mirrors and one or two edges that are not parallel, too."""
    for n, point in enumerate(POINTS):
        back = fields(BLOCK, point, SOURCE[None])[:, 0]
        assert np.abs(back - expected[:, n]).max() < 1e-9


TURN, SHIFT = Rotation.random(random_state=8).as_matrix(), np.array([30.0, -7.0, 11.0])


def test_what_cones_reach_does_not_know_the_axes():
    """Depths and triangles that cones of one block meet, turned, moved, and twice as large."""
    scene, rng = Geometry(BLOCK), np.random.default_rng(4)
    moved, large = (
        Geometry(Mesh(vertices, BLOCK.faces, BLOCK.material))
        for vertices in (BLOCK.vertices @ TURN.T + SHIFT, 2 * BLOCK.vertices)
    )
    hits = 0
    for _ in range(120):
        frame, origin = Rotation.random(random_state=rng.integers(1 << 30)).as_matrix(), rng.normal(0, 25, 3)
        a, b, tangent = *rng.uniform(0.5, 4, 2), rng.uniform(0, 0.4)
        a, b = max(a, b), min(a, b)
        shape = (tangent, tangent * b / a)
        cones = (Cone(origin, frame, a, b, *shape), Cone(TURN @ origin + SHIFT, frame @ TURN.T, a, b, *shape),
                 Cone(2 * origin, frame, 2 * a, 2 * b, *shape))  # fmt: skip
        depth, turned, twice = (g.closest(c)[0] for g, c in zip((scene, moved, large), cones, strict=True))
        if np.isinf(depth):
            assert np.isinf(turned)
            assert np.isinf(twice)
        else:
            hits += 1
            assert (turned, twice) == pytest.approx((depth, 2 * depth), abs=1e-9)
        met = [g.collect(c).tolist() for g, c in zip((scene, moved, large), cones, strict=True)]
        assert met[0] == met[1] == met[2]
    assert hits > 20


def test_maps_by_phases_do_not_know_the_axes():
    """Around a block: to 1e-6 dB turned and moved, at twice the size and half the frequency."""
    maps = []
    for turn, shift, size in ((np.eye(3), np.zeros(3), 1.0), (TURN, SHIFT, 2.0)):
        scene = Geometry(Mesh(size * BLOCK.vertices @ turn.T + shift, BLOCK.faces, BLOCK.material))
        plane = Plane(
            center=turn @ (size * np.array([15.0, 2.0, 3.0])) + shift, normal=turn[:, 0], up=turn[:, 2],
            shape=(2, 3), pitch=14.0 * size,
        )  # fmt: skip
        found = coverage(scene, Transmitter(turn @ (size * SOURCE) + shift), plane, 1e9 / size, "phase").rss_dBm
        maps.append(found.filled(-999))
    assert maps[0].min() > -300
    assert maps[1] == pytest.approx(maps[0], abs=1e-6)  # lambda^2 / r^2 is the same


def beams_past(mesh, seed=1, turn=None, shift=0.0, size=1.0):
    """Power flux past one side of a block and its error, float64[2, 2] each."""
    turn = np.eye(3) if turn is None else turn
    scene = Geometry(Mesh(size * mesh.vertices @ turn.T + shift, mesh.faces, mesh.material))
    lamp = PointEmitter(turn @ (size * SOURCE) + shift, size, power=4 * np.pi * size**2, beam_angle=0.1)
    plane = Plane(
        center=turn @ (size * np.array([15.0, 2.0, 26.0])) + shift, normal=turn[:, 0], up=turn[:, 2],
        shape=(2, 2), pitch=14.0 * size,
    )  # fmt: skip
    found = trace(scene, lamp, plane, 30_000, seed, max_events=6, threads=1)
    return found.fluence[0], found.fluence_error[0]


def test_beams_do_not_know_winding_triangles_or_axes():
    """Wound otherwise: the same beams, to the bit. Cut otherwise, turned and moved, twice as large: others, alike."""
    flux, error = beams_past(BLOCK)
    assert np.array_equal(beams_past(MESHES["every third face turned"])[0], flux)
    others = [
        beams_past(MESHES["T-junctions, mixed"], 2), beams_past(BLOCK, 3, TURN, SHIFT),
        beams_past(BLOCK, 4, size=2.0),
    ]  # fmt: skip
    for other, noise in others:
        assert_z(other, flux, np.hypot(error, noise))
    higher, noise = beams_past(box((6.0, 40.0, 44.0), material=Conductor()), 5)
    with pytest.raises(AssertionError, match="z ="):  # a block whose top is 7 higher is noticed
        assert_z(higher, flux, np.hypot(error, noise))


def test_maps_by_beams_do_not_know_winding():
    plane = Plane(center=[15.0, 2.0, 14.0], normal=[1.0, 0, 0], up=[0, 0, 1.0], shape=(4, 4), pitch=6.0)
    maps = [
        coverage(Geometry(mesh), Transmitter(SOURCE), plane, 1e9, "ray", beams=3000).rss_dBm.filled(-999)
        for mesh in (BLOCK, MESHES["inverted"], MESHES["every third face turned"])
    ]
    assert maps[0].max() > -200
    assert np.array_equal(maps[0], maps[1])
    assert np.array_equal(maps[0], maps[2])


@pytest.mark.parametrize("method", ["ray", "wave", "phase"])
def test_a_map_on_a_floor_is_the_map_just_above(method):
    """1e-9 above a floor of metal, and on it; turned at random."""
    turn = Rotation.random(random_state=5).as_matrix()
    floor = Mesh(
        np.array([[-60, -60, 0], [60, -60, 0], [60, 60, 0], [-60, 60, 0.0]]) @ turn.T,
        np.array([[0, 1, 2], [0, 2, 3]]), Conductor(),
    )  # fmt: skip
    source = Transmitter(turn @ [3.0, 2.0, 12.0])
    found = [
        coverage(
            Geometry(floor), source,
            Plane(center=turn @ [0, 0, z], normal=turn[:, 2], up=turn[:, 1], shape=(3, 3), pitch=10.0),
            1e9, method, beams=4000,
        ).rss_dBm.filled(-999)
        for z in (0.0, 1e-9)
    ]  # fmt: skip
    assert found[0].min() > -200
    assert found[0] == pytest.approx(found[1], abs=1e-3)


@pytest.mark.slow
def test_concrete_by_phases_and_by_waves():
    """Over ground of concrete: direct light and its image, whose fringes a cell averages, within 1 dB; metal is not."""
    ground = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) * 3e4
    faces, source = np.array([[0, 1, 2], [0, 2, 3]]), Transmitter([0, 0, 40.0])
    cells = Plane(center=[90.0, 0, 20.0], normal=[0, 0, 1.0], shape=(1, 1), pitch=60.0)
    fine = Plane(center=[90.0, 0, 20.0], normal=[0, 0, 1.0], shape=(30, 30), pitch=2.0)
    power = []
    for material in (Building(name="concrete"), Conductor()):
        scene = Geometry(Mesh(ground, faces, material))
        wave = coverage(scene, source, cells, 1e9, beams=60_000).rss_dBm.data[0, 0]
        phase = 10 * np.log10(np.mean(10 ** (coverage(scene, source, fine, 1e9, "phase").rss_dBm.data / 10)))
        assert phase == pytest.approx(wave, abs=1)
        power.append(phase)
    assert power[1] - power[0] > 1
