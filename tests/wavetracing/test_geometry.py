"""Queries of whole scenes against brute force; rays, edges; scenes that are not as they should be."""

import warnings

import numpy as np
import pytest
from wavetracing.cone_pairs import triangles_in_cones
from wavetracing.solids import box, soup, sphere

from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.wavetracing import Cone, Geometry, Mesh, perforated_screen
from specklegen.wavetracing.cones import transverse_frame


def random_cone(rng):
    d = rng.normal(size=3)
    d /= np.linalg.norm(d)
    a, e, t = 10 ** rng.uniform(-3, -0.7), rng.uniform(1, 4), 10 ** rng.uniform(-3, 0)
    return Cone(rng.uniform(-0.5, 1.5, 3), transverse_frame(d), a, a / e, t, t / e)


def by_force(scene, cone, near, far):
    corners = scene.vertices[scene.faces].reshape(-1, 9)
    n = len(corners)
    low, high = np.empty((2, n))
    triangles_in_cones(np.tile(cone.packed(), (n, 1)), np.full(n, near), np.full(n, far), corners, low, high)
    least = np.full(sum(len(mesh.faces) for mesh in scene.meshes), np.inf)
    np.minimum.at(least, scene.number, low)  # of the parts of each triangle that others cut
    return least


@pytest.mark.parametrize("seed", range(10))
def test_cones_find_what_brute_force_finds(seed):
    """The same triangles, and the same least depth to the bit: both come from one function of the triangle."""
    rng = np.random.default_rng(seed)
    scene = Geometry(soup(int(10 ** rng.uniform(0, 4)), seed))
    found = 0
    for n in range(40):
        cone = random_cone(rng)
        near, far = (0.0, np.inf) if n % 2 else (rng.uniform(0, 0.5), rng.uniform(0.5, 2))
        low = by_force(scene, cone, near, far)
        depth, face = scene.closest(cone, near, far)
        assert depth == low.min()
        if np.isfinite(depth):
            assert low[face] == depth
        assert scene.collect(cone, near, far).tolist() == np.flatnonzero(np.isfinite(low)).tolist()
        found += int(np.isfinite(low).sum())
    assert found > 0


@pytest.mark.slow
def test_cones_find_what_brute_force_finds_among_a_million():
    rng = np.random.default_rng(99)
    scene = Geometry(soup(1_000_000, 99, size=0.02))
    for _ in range(20):
        cone = random_cone(rng)
        low = by_force(scene, cone, 0, np.inf)
        assert scene.closest(cone)[0] == low.min()
        assert scene.collect(cone).tolist() == np.flatnonzero(np.isfinite(low)).tolist()


@pytest.mark.parametrize("count", [50_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_everything_in_one_cone(count):
    """Nothing is cut off: a half space ahead of all triangles collects them all."""
    scene = Geometry(soup(count, 3))
    cone = Cone(np.array([0, 0, -20.0]), np.eye(3), 1e3, 1e3, 1e8, 1e8)
    assert (scene.collect(cone) == np.arange(count)).all()


def test_rays_find_what_brute_force_finds():
    """Against Moeller and Trumbore's test of every triangle, in NumPy."""
    rng = np.random.default_rng(0)
    scene = Geometry(soup(500, 0, size=1.0))
    origins, directions = rng.uniform(-1, 2, (400, 3)), rng.normal(size=(400, 3))
    distance, face = scene.ray(origins, directions)
    a, b, c = (scene.vertices[scene.faces[:, n]] for n in range(3))
    e1, e2 = b - a, c - a
    for n in range(400):
        p = np.cross(directions[n], e2)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1 / (e1 * p).sum(axis=1)
            s = origins[n] - a
            u = (s * p).sum(axis=1) * inverse
            q = np.cross(s, e1)
            v = q @ directions[n] * inverse
            t = (e2 * q).sum(axis=1) * inverse
        t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
        assert distance[n] == pytest.approx(t.min(), rel=1e-9)
        assert face[n] == (scene.number[t.argmin()] if np.isfinite(t.min()) else -1)
    assert 50 < (face >= 0).sum() < 350


def test_a_closed_box_leaks_nothing():
    """A million rays from inside a turned box, among them some at its corners and edges, all meet it."""
    rng = np.random.default_rng(1)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    walls = box((3, 2, 1)).placed([10, -5, 7], q * np.sign(np.linalg.det(q)))
    scene = Geometry(walls)
    origins = rng.uniform(-0.49, 0.49, (1_000_000, 3)) * [3, 2, 1] @ (q * np.sign(np.linalg.det(q))).T + [10, -5, 7]
    directions = rng.normal(size=(1_000_000, 3))
    aimed = 100_000  # at points of edges and at corners
    ends = walls.vertices[walls.faces]
    which, side = rng.integers(0, 12, aimed), rng.integers(0, 3, aimed)
    s = np.where(rng.uniform(size=aimed) < 0.2, 0.0, rng.uniform(size=aimed))[:, None]
    target = ends[which, side] + s * (ends[which, (side + 1) % 3] - ends[which, side])
    directions[:aimed] = target - origins[:aimed]
    distance, face = scene.ray(origins, directions)
    assert (face >= 0).all()
    assert np.isfinite(distance).all()
    open_box = Geometry(Mesh(walls.vertices, walls.faces[:-1]))
    assert (open_box.ray(origins, directions)[1] < 0).any()


def test_threads_do_not_change_rays():
    scene = Geometry(sphere(3))
    rng = np.random.default_rng(2)
    o, d = rng.normal(size=(50_000, 3)) * 2, rng.normal(size=(50_000, 3))
    one, two = scene.ray(o, d, threads=1), scene.ray(o, d, threads=2)
    assert (one[0] == two[0]).all()
    assert (one[1] == two[1]).all()


def test_edges_of_a_box():
    """Twelve wedges of 90 degrees, n = 3/2; diagonals are no edges."""
    scene = Geometry(box())
    assert len(scene.edges) == 12
    assert scene.edges.wedge == pytest.approx(1.5)
    assert not scene.edges.boundary.any()
    assert np.linalg.norm(scene.edges.ends[:, 1] - scene.edges.ends[:, 0], axis=1) == pytest.approx(1)


def test_edges_of_a_prism_and_of_a_notch():
    """A 60 degree prism has n = 5/3, whichever way its faces are wound; so has a fold of two open sheets."""
    points = np.array([[0, 0], [1, 0], [0.5, np.sqrt(3) / 2]])
    vertices = np.concatenate([np.c_[points, np.zeros(3)], np.c_[points, np.ones(3)]])
    faces = [[0, 2, 1], [3, 4, 5]]
    for n in range(3):
        m = (n + 1) % 3
        faces += [[n, m, m + 3], [n, m + 3, n + 3]]
    prism = Geometry(Mesh(vertices, np.array(faces)))
    assert sorted(prism.edges.wedge.round(6)) == pytest.approx([1.5] * 6 + [5 / 3] * 3, abs=1e-6)
    inverted = Geometry(Mesh(vertices, np.array(faces)[:, ::-1]))
    assert sorted(inverted.edges.wedge) == pytest.approx(sorted(prism.edges.wedge))
    assert inverted.intake.turned == 8
    for sides in (np.array(faces)[2:6], np.array(faces)[2:6, ::-1]):
        fold = Geometry(Mesh(vertices, sides)).edges
        assert sorted(fold.wedge) == pytest.approx([5 / 3] + 6 * [2.0])
        assert (fold.boundary == (fold.wedge == 2)).all()


def test_edges_are_welded_and_turned():
    """Two triangles with vertices of their own, and opposite orientations, make one wedge."""
    vertices = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    for second in ([3, 4, 5], [4, 3, 5]):
        scene = Geometry(Mesh(vertices, np.array([[0, 1, 2], second])))
        assert scene.edges.boundary.sum() == 4
        assert len(scene.edges) == 5
    smooth = Geometry(sphere(5))
    assert len(smooth.edges) == 0  # less than 5 degrees from face to face


def test_screen_with_holes():
    """All corners of the outline and the holes are edges of half planes; the triangulation adds none."""
    angle = 2 * np.pi * np.arange(12) / 12
    star = np.stack([np.cos(angle), np.sin(angle)], axis=1) * np.where(np.arange(12) % 2, 2.0, 6.0)[:, None]
    mesh = perforated_screen(np.array([[-20, -20], [20, -20], [20, 20], [-20, 20.0]]), [star, star / 6 + [12, 0]])
    scene = Geometry(mesh)
    assert len(scene.edges) == 28
    assert scene.edges.boundary.all()
    assert scene.edges.wedge == pytest.approx(2)
    a, b, c = (mesh.vertices[mesh.faces[:, n]] for n in range(3))
    area = np.cross(b - a, c - a)[:, 2] / 2
    assert (area > 0).all()
    hole = 0.5 * 12 * 6 * 2 * np.sin(np.pi / 6)
    assert area.sum() == pytest.approx(1600 - hole * (1 + 1 / 36), rel=1e-12)
    _, through = scene.ray([[0, 0, -1], [12, 0, -1], [8, 8, -1.0]], [0, 0, 1])
    assert (through < 0).tolist() == [True, True, False]
    with pytest.raises(RuleError, match="inside and apart"):
        perforated_screen(np.array([[0, 0], [1, 0], [0, 1.0]]), [star])


def test_bad_meshes_are_refused():
    good = box()
    for bad in (np.nan, np.inf):
        vertices = good.vertices.copy()
        vertices[3, 1] = bad
        with pytest.raises(RuleError, match="finite everywhere.*vertex 3"):
            Mesh(vertices, good.faces)
    for bad in (-1, 8):
        faces = good.faces.copy()
        faces[5, 2] = bad
        with pytest.raises(RuleError, match="from 0 to 7.*face 5"):
            Mesh(good.vertices, faces)
    with pytest.raises(RuleError, match="a Mesh, or a sequence of them"):
        Geometry([])
    with pytest.raises(RuleError, match="finite"):
        Geometry(good).ray([[0, 0, np.nan]], [[0, 0, 1.0]])
    with pytest.raises(RuleError, match="positive length"):
        Geometry(good).ray([[0, 0, 0.0]], [[0, 0, 0.0]])


def test_odd_meshes_are_warned_of_with_counts():
    good = box()
    with pytest.warns(DoubtWarning, match="2 duplicate triangles were dropped"):
        doubled = Geometry(Mesh(good.vertices, np.concatenate([good.faces, good.faces[:2][:, [1, 2, 0]]])))
    assert len(doubled) == 12
    assert len(doubled.edges) == 12
    line = Mesh(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]]), np.array([[0, 1, 2]]))
    with pytest.warns(DoubtWarning, match="1 triangles have no area"):
        scene = Geometry(line)
    assert scene.closest(Cone(np.array([1.5, 0, -1]), np.eye(3), 0.1, 0.1, 0, 0))[0] == 1
    points = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 1, 0], [-1, -1, 0.0]])
    fins = Mesh(points, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))
    assert len(Geometry(fins).edges) == 6  # between the three no air is wider than a half space
    halves = [Mesh(np.array([[0, 0, 0], [0, 1, 0], [s, 0, 0.0]]), np.array([[0, 1, 2]])) for s in (1, -1)]
    assert len(Geometry(halves).edges) == 3  # the common one is flat, and gone; two others are one line


def test_gaps_are_warned_of():
    """Two halves of a square, 1e-7 of its size apart: not welded, two boundary edges; welded, or a slit, none."""

    def halves(gap):
        points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, gap], [1, 1, gap], [0, 1, gap]]
        return Geometry(Mesh(np.array(points, float), np.array([[0, 1, 2], [3, 4, 5]])))

    with pytest.warns(DoubtWarning, match="2 boundary edges nearly coincide"):
        assert len(halves(1e-7).edges) == 6
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(halves(1e-11).edges) == 4
        assert len(halves(1e-3).edges) == 6


def test_empty_scene():
    scene = Geometry(Mesh(np.empty((0, 3)), np.empty((0, 3), int)))
    cone = Cone(np.zeros(3), np.eye(3), 1, 1, 0.1, 0.1)
    assert scene.closest(cone) == (np.inf, -1)
    assert len(scene.collect(cone)) == 0
    assert scene.ray([0, 0, 0.0], [0, 0, 1.0])[1] == -1
    assert len(scene.edges) == 0


def test_memory():
    """At most 250 bytes a triangle; nodes and corners of a large mesh."""
    scene = Geometry(sphere(6))
    assert len(scene) == 32768
    own = sum(m.vertices.nbytes + m.faces.nbytes for m in scene.meshes)
    assert (scene.memory + own) / len(scene) < 250
