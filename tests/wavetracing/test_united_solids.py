"""One scene has one field, however it is written: cut, split, doubled, wound, turned; and edges that are none."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from wavetracing.solids import box

from specklegen.core.errors import DoubtWarning
from specklegen.wavetracing import (
    Building,
    Conductor,
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

CONCRETE, WOOD = Building(name="concrete"), Building(name="wood")


def block(lower, upper, material=None):
    lower, upper = np.array(lower, float), np.array(upper, float)
    return box(upper - lower, (lower + upper) / 2, material=material or Conductor())


def sheet(corners, material=None):
    return Mesh(np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]]), material or Conductor())


def cut(mesh, rng):
    """The same surface, a third of its triangles cut through a random point of theirs and at random points of sides."""
    vertices, faces = list(mesh.vertices), []
    sides: dict[tuple[int, int], int] = {}
    for a, b, _ in mesh.faces:
        key = (min(a, b), max(a, b))
        if key not in sides and rng.random() < 0.4:
            t = rng.uniform(0.1, 0.9)
            vertices.append((1 - t) * vertices[key[0]] + t * vertices[key[1]])
            sides[key] = len(vertices) - 1
    for triangle in mesh.faces:
        waiting = [tuple(triangle)]
        while waiting:
            corners = waiting.pop()
            for n in range(3):
                a, b, c = corners[n], corners[n - 2], corners[n - 1]
                m = sides.get((min(a, b), max(a, b)))
                if m is not None:
                    waiting += [(a, m, c), (m, b, c)]
                    break
            else:
                if rng.random() < 0.3:
                    vertices.append(rng.dirichlet(np.ones(3)) @ np.array([vertices[n] for n in corners]))
                    m = len(vertices) - 1
                    faces += [(corners[0], corners[1], m), (corners[1], corners[2], m), (corners[2], corners[0], m)]
                else:
                    faces.append(corners)
    return Mesh(np.array(vertices), np.array(faces), mesh.material)


def fields(meshes, source, points, limits=(1, 2), surfaces="material", wavelength=0.7):
    """Soft and hard fields at points, over the largest."""
    scene, lamp = Geometry(meshes), PointEmitter(source, wavelength, 4 * np.pi)
    return np.array([coherent_rays(scene, lamp, points, *limits, name, surfaces) for name in ("soft", "hard")])


def gap(one, two):
    return np.abs(one - two).max() / np.abs(two).max()


def random_scene(seed):
    """A block on the ground with another beside it, a source and points in the air."""
    rng = np.random.default_rng(seed)
    size = rng.uniform([12, 14, 8], [22, 26, 15])
    other = rng.uniform([5, 6, 4], [9, 12, 7])
    meshes = {
        "ground": [sheet([[-90, -90, 0], [90, -90, 0], [90, 90, 0], [-90, 90, 0]], WOOD)],
        "block": [block([0, 0, 0], size, CONCRETE)],
        "other": [block([size[0] + 6, 3, 0], [size[0] + 6 + other[0], 3 + other[1], other[2]], CONCRETE)],
    }
    source = np.array([-15, size[1] / 2, 0.8 * size[2]]) + rng.normal(0, 1.5, 3)
    points = rng.uniform([size[0] + 0.5, -12, 1], [size[0] + 30, size[1] + 12, 9], (8, 3))
    points = points[~((points > [size[0] + 5, 2, -1]) & (points < [size[0] + 16, 16, 8])).all(axis=1)]
    return rng, size, meshes, source, points


def written(law, seed):
    """Meshes of a random scene, and of the same scene by a law of invariance; source and points."""
    rng, (x, y, z), parts, source, points = random_scene(seed)
    plain = parts["ground"] + parts["block"] + parts["other"]
    other, rest = list(plain), parts["ground"] + parts["other"]
    if law == "cut":
        other = [cut(mesh, rng) for mesh in plain]
    elif law == "wound":
        other = [Mesh(m.vertices, np.where(rng.random((len(m.faces), 1)) < 0.5, m.faces[:, ::-1], m.faces), m.material)
                 for m in plain]  # fmt: skip
    elif law == "doubled":
        other = plain + parts["block"] + [cut(parts["block"][0], rng), *parts["ground"]]
    elif law == "touching":
        a, b = rng.uniform(0.2, 0.8, 2)
        pieces = [[0, 0, 0, x, a * y, z], [0, a * y, 0, b * x, y, z], [b * x, a * y, 0, x, y, z]]
        other = rest + [block(p[:3], p[3:], CONCRETE) for p in pieces]
    elif law == "overlapping":
        a, b = rng.uniform(0.4, 0.9), rng.uniform(0.1, 0.35)
        other = rest + [block([0, 0, 0], [x, a * y, z], CONCRETE), block([0, b * y, 0], [x, y, z], CONCRETE)]
        other.append(block([0.2 * x, 0.3 * y, 0.1 * z], [0.7 * x, 0.8 * y, 0.9 * z], CONCRETE))
    elif law == "sunk":
        other = rest + [block([0, 0, -3.3], [x, y, z], CONCRETE)]
    elif law == "without a floor":
        mesh = parts["block"][0]
        other = rest + [Mesh(mesh.vertices, mesh.faces[(mesh.vertices[mesh.faces][:, :, 2] > 0).any(axis=1)], CONCRETE)]
    return plain, other, source, points


LAWS = {
    "cut": 1e-6, "wound": 1e-6, "doubled": 1e-6, "touching": 1e-6, "overlapping": 1e-6, "without a floor": 1e-6,
    "sunk": 1e-3,  # waves of the ground's own rim run below it, too
}  # fmt: skip


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 9))])
def test_one_scene_has_one_field(law, seed):
    """Concrete blocks on wooden ground: fields by a mirror and two edges, as written and turned at random."""
    plain, other, source, points = written(law, seed)
    expected = fields(plain, source, points)
    assert np.abs(expected).min(axis=0).max() > 1e-4
    assert gap(fields(other, source, points), expected) < LAWS[law]
    turn, shift = Rotation.random(random_state=seed).as_matrix(), np.array([400.0, -70, 31])
    moved = [Mesh(mesh.vertices @ turn.T + shift, mesh.faces, mesh.material) for mesh in other]
    assert gap(fields(moved, turn @ source + shift, points @ turn.T + shift), expected) < LAWS[law]
    large = [Mesh(3 * mesh.vertices, mesh.faces, mesh.material) for mesh in other]
    thrice = fields(large, 3 * source, 3 * points, surfaces="perfect", wavelength=2.1)
    assert gap(3 * thrice, fields(other, source, points, surfaces="perfect")) < 1e-6


def test_a_thin_wall_tends_to_its_sheet():
    """Behind a metal wall of 0.1 and 0.01 wavelengths, the field of the sheet; before it the mirror is nearer."""
    wall = [block([-t / 2, -900, -900], [t / 2, 900, 0]) for t in (0.1, 0.01)]
    plane = sheet([[0, -900, -900], [0, 900, -900], [0, 900, 0], [0, -900, 0]])
    source = np.array([-40.0, 2, -3])
    behind, before = np.array([[30.0, -3, -8], [25, 0, -2], [30, 5, 1]]), np.array([[-20.0, 3, 6], [-30, -8, -6]])
    for points, coarse, fine in ((behind, 1e-3, 1e-4), (before, 0.2, 0.02)):
        expected = fields([plane], source, points, wavelength=1.0)
        assert gap(fields([wall[0]], source, points, wavelength=1.0), expected) < coarse
        assert gap(fields([wall[1]], source, points, wavelength=1.0), expected) < fine


def test_the_laws_have_power():
    """A block 1e-4 higher, and one split with a slit of 1e-3, are noticed."""
    plain, _, source, points = written("touching", 1)
    (x, y, z), ground = random_scene(1)[1], plain[0]
    expected = fields(plain[:2], source, points)
    for pieces in ([[[0, 0, 0], [x, y, z + 1e-4]]], [[[0, 0, 0], [x, y / 2 - 1e-3, z]], [[0, y / 2, 0], [x, y, z]]]):
        other = [ground, *(block(*piece, CONCRETE) for piece in pieces)]
        assert gap(fields(other, source, points), expected) > 1e-5


@pytest.mark.parametrize("law", ["cut", "touching", "overlapping"])
def test_one_scene_has_one_map(law):
    """Maps of paths to 1e-4 dB; of beams by z-tests, since other triangles draw other beams."""
    plain, other, source, _ = written(law, 2)
    plane = Plane(center=[35.0, 8.0, 1.5], shape=(2, 3), pitch=9.0)
    one, two = (coverage(Geometry(m), Transmitter(source), plane, 1e9, seed=1).rss_dBm for m in (plain, other))
    assert one.min() > -200
    assert two.data == pytest.approx(one.data, abs=1e-4)


def test_beams_see_one_block():
    """Past the top of a block of two that touch, or overlap: the power of one block; 16 times as much before."""
    source = PointEmitter([-40.0, 3, 4], 1.0, 4 * np.pi, beam_angle=0.1)
    behind = Plane(center=[40.0, 0, 0], normal=[1.0, 0, 0], up=[0, 0, 1.0], shape=(1, 1), pitch=12.0)
    pieces = {
        "one": [block([-10, -15, -6], [10, 15, 6])],
        "touching": [block([-10, -15, -6], [10, 0, 6]), block([-10, 0, -6], [10, 15, 6])],
        "overlapping": [block([-10, -15, -6], [10, 1, 6]), block([-10, -1, -6], [10, 15, 6])],
    }
    found = {name: trace(Geometry(meshes), source, behind, 60_000, 1, threads=1) for name, meshes in pieces.items()}
    flux = {name: (one.fluence[0][0, 0], one.fluence_error[0][0, 0]) for name, one in found.items()}
    for name in ("touching", "overlapping"):
        assert abs(flux[name][0] - flux["one"][0]) < 6 * np.hypot(flux[name][1], flux["one"][1])


@pytest.mark.parametrize(("name", "edges"), [
    ("on the ground", 12), ("touching", 12), ("overlapping", 12), ("a smaller one against a wall", 20),
    ("in a room", 20), ("a step", 17), ("a pillar in a room", 14), ("wood on concrete", 20),
])  # fmt: skip
@pytest.mark.parametrize("turned", [0, 1, 6])
def test_edges_of_solids_together(name, edges, turned):
    """Edges on the ground, in corners, within a wall or inside are none; pieces of one line are one; turned, too.

    Turned by the sixth rotation a library of exact booleans (manifold3d) leaves two bodies where there is one. Where
    unlike materials meet on a wall there is an edge: reflection ends there.
    """
    meshes = {
        "on the ground": [sheet([[-90, -90, 0], [90, -90, 0], [90, 90, 0], [-90, 90, 0]]), block([0, 0, 0], [9, 9, 9])],
        "touching": [block([0, 0, 0], [20, 15, 12]), block([0, 15, 0], [20, 30, 12])],
        "overlapping": [block([0, 0, 0], [20, 16, 12]), block([0, 14, 0], [20, 30, 12])],
        "a smaller one against a wall": [block([0, 0, 0], [20, 15, 12]), block([20, 3, 2], [30, 7, 9])],
        "in a room": [block([-50, -50, 0], [50, 50, 40]), block([0, 0, 0], [20, 30, 12])],
        "a step": [block([0, 0, 0], [20, 15, 12]), block([0, 15, 0], [20, 30, 12.2])],
        "a pillar in a room": [block([0, 0, 0], [20, 30, 12]), block([0, 5, 0], [7, 9, 12])],
        "wood on concrete": [block([0, 0, 0], [20, 30, 6], CONCRETE), block([0, 0, 6], [20, 30, 12], WOOD)],
    }[name]
    turn = Rotation.random(random_state=turned).as_matrix() if turned else np.eye(3)
    found = Geometry([Mesh(mesh.vertices @ turn.T, mesh.faces, mesh.material) for mesh in meshes]).edges
    assert len(found) == edges
    assert (found.wedge > 0.99).all()


def test_a_joint_of_materials_sends_what_reflection_lacks():
    """Glass beside metal in one plane: without the joint's wave the field jumps where the reflection changes."""
    left = sheet([[-60, -60, 0], [0, -60, 0], [0, 60, 0], [-60, 60, 0]], Building(name="glass"))
    right = sheet([[0, -60, 0], [60, -60, 0], [60, 60, 0], [0, 60, 0]], Building(name="metal"))
    source, points = np.array([-20.0, 3, 15.0]), np.array([[20.0 + x, 1.0, 15.0] for x in (-1e-7, 1e-7)])
    for limits, least, most in (((1, 0), 0.05, 1), ((1, 1), 0, 1e-5)):
        u = fields([left, right], source, points, limits)[0]
        assert least <= abs(u[1] - u[0]) / abs(u[0]) < most


def test_warnings_stay_away_from_sound_scenes():
    """Blocks that touch, overlap, or stand on the ground are sound."""
    plain, other, *_ = written("touching", 1)
    with pytest.warns(DoubtWarning, match="duplicate"):
        Geometry([*plain, plain[1]])
    assert Geometry(other).intake.duplicates == 0
    assert Geometry(other).intake.solids == 4
