"""Smooth meshes reflect and cast shadows as curved bodies: against the exact series of a cylinder and a sphere."""

import warnings

import numpy as np
import pytest
from references.round_bodies import cylinder_series, sphere_series

from specklegen.core.errors import DoubtWarning
from specklegen.wavetracing import (
    Conductor,
    Geometry,
    Mesh,
    Plane,
    PointEmitter,
    Transmitter,
    coherent_paths,
    coherent_rays,
    coverage,
    trace,
)

pytestmark = pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")
RADIUS, FAR = 10.0, 3000.0
EVEN = np.eye(3)
ANGLES = np.deg2rad([0.3, 2, 5, 8, 9.5, 11, 13, 16, 20, 30, 45, 70, 100, 140, 175])


def cylinder(facets, radius=RADIUS, half=3000.0):
    """A closed cylinder about the z axis."""
    turn = 2 * np.pi * (np.arange(facets) + 0.5) / facets
    ring = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    low, high = (np.column_stack([np.vstack([ring, [0, 0]]), np.full(facets + 1, z)]) for z in (-half, half))
    i, j, up = np.arange(facets), (np.arange(facets) + 1) % facets, facets + 1
    sides = [np.stack(t, axis=1) for t in ((i, j, j + up), (i, j + up, i + up))]
    caps = [np.stack(t, axis=1) for t in ((j, i, 0 * i + facets), (i + up, j + up, 0 * i + facets + up))]
    return Mesh(np.vstack([low, high]), np.concatenate(sides + caps), Conductor())


def ball(splits, radius=RADIUS, at=(0.0, 0.0, 0.0)):
    """An icosahedron, each face split in four ``splits`` times."""
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.creation.icosphere(subdivisions=splits, radius=radius)
    return Mesh(mesh.vertices + np.array(at), mesh.faces, Conductor())


def around(r, tilt):
    return r * np.stack([np.cos(ANGLES), np.sin(ANGLES) * np.cos(tilt), np.sin(ANGLES) * np.sin(tilt)], axis=1)


def ratios(mesh, points, distance, polarisation, diffractions=1):
    """Field over that of the source alone."""
    lamp = PointEmitter([-distance, 0, 0], wavelength=1.0, power=4 * np.pi)
    away = np.linalg.norm(points + [distance, 0, 0], axis=1)
    field = coherent_rays(Geometry([mesh]), lamp, points, 0, diffractions, polarisation)
    return field * away / np.exp(2j * np.pi * away)


def worst(ours, exact):
    """Greatest relative error where the exact field is above -40 dB."""
    return (np.abs(ours - exact) / np.abs(exact))[np.abs(exact) > 0.01].max()


@pytest.mark.parametrize("polarisation", ["soft", "hard"])
@pytest.mark.parametrize("r", [15.0, 60.0])
def test_cylinder_of_256_facets(r, polarisation):
    """Amplitude and phase within 7 % of the series, in light and shadow; the other boundary is caught."""
    points, scene = around(r, 0.0), cylinder(256)
    ours = ratios(scene, points, FAR, polarisation)
    exact, other = (
        cylinder_series(points, FAR, RADIUS, hard) for hard in (polarisation == "hard", polarisation == "soft")
    )
    assert np.abs(exact).min() < 0.3
    assert worst(ours, exact) < 0.07
    assert worst(ours, other) > 0.5


def test_another_radius_is_caught():
    points = around(15.0, 0.0)
    assert (
        worst(ratios(cylinder(256, 1.05 * RADIUS), points, FAR, "hard"), cylinder_series(points, FAR, RADIUS, True))
        > 0.2
    )


def test_refinement_converges():
    """Mean errors of 16 facets (whose sides are edges), 64 and 256, soft, at 60 wavelengths."""
    points = around(60.0, 0.0)
    exact = cylinder_series(points, FAR, RADIUS, False)
    errors = [np.sqrt(np.mean(np.abs(ratios(cylinder(n), points, FAR, "soft") - exact) ** 2)) for n in (16, 64, 256)]
    assert errors[0] > 2 * errors[1] > 3 * errors[2]
    assert errors[2] < 0.03


@pytest.mark.parametrize("polarisation", ["soft", "hard"])
@pytest.mark.parametrize("r", [20.0, 60.0])
def test_sphere(r, polarisation):
    """Within 10 % of the series in amplitude, bright spot on the axis of the shadow included."""
    points = np.concatenate([[[r, 0, 0]], around(r, 0.7)])
    ours = np.abs(ratios(ball(4), points, 100.0, polarisation))
    exact = np.abs(sphere_series(points, 100.0, RADIUS, polarisation == "hard"))
    assert worst(ours, exact) < 0.1


@pytest.mark.parametrize("polarisation", ["soft", "hard"])
@pytest.mark.parametrize(("body", "change"), [("cylinder", 1e-4), ("ball", 3e-3)])
def test_facets_may_be_cut_turned_and_scaled(body, change, polarisation):
    """Each face in four or sixteen, not moved onto the curve; turned in space; in another unit.

    Cuts change the corners over which curvatures are averaged, and turns the half planes in which strings are sought:
    of a ball more than of a cylinder.
    """
    trimesh = pytest.importorskip("trimesh")
    whole = cylinder(256, half=500.0) if body == "cylinder" else ball(4)
    points, lamp = around(20.0, 0.3), np.array([-300.0, 40.0, 15.0])

    def field(vertices, faces, turn=EVEN, shift=0.0, unit=1.0):
        there = PointEmitter(unit * (turn @ lamp + shift), wavelength=unit, power=4 * np.pi)
        scene = Geometry([Mesh(unit * (vertices @ turn.T + shift), faces, Conductor())])
        return unit * coherent_rays(scene, there, unit * (points @ turn.T + shift), 0, 1, polarisation)

    expected, cut = field(whole.vertices, whole.faces), trimesh.Trimesh(whole.vertices, whole.faces, process=False)
    turn, shift = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0], np.array([5.0, -7.0, 11.0])
    turn *= np.sign(np.linalg.det(turn))
    for _ in range(2):
        cut = cut.subdivide()
        found = field(cut.vertices, cut.faces)
        assert np.abs(found - expected).max() < change * np.abs(expected).max()
    moved = field(whole.vertices, whole.faces, shift=shift, unit=1e-6)
    assert np.abs(moved - expected).max() < 1e-10 * np.abs(expected).max()
    turned = field(whole.vertices, whole.faces, turn, shift)
    assert np.abs(turned - expected).max() < change * np.abs(expected).max()
    assert np.abs(field(1.01 * whole.vertices, whole.faces) - expected).max() > 0.05 * np.abs(expected).max()


def test_exchange_of_source_and_point_above_a_mirror():
    ground = Mesh(
        [[-500, -500, -12], [500, -500, -12], [500, 500, -12], [-500, 500, -12]], [[0, 1, 2], [0, 2, 3]], Conductor()
    )
    scene = Geometry([ground, ball(3, 6.0)])
    a, b = np.array([-60.0, 2.0, 3.0]), np.array([45.0, -1.0, -5.0])
    one, two = (coherent_rays(scene, PointEmitter(p, 1.0), [q], 2, 1)[0] for p, q in ((a, b), (b, a)))
    assert abs(one - two) < 1e-4 * abs(one)
    met = [path.met for path in coherent_paths(scene, PointEmitter(a, 1.0), b, 2, 1)]
    assert {(("smooth", 1), ("smooth", 1)), (("reflection", 0), ("smooth", 1))} <= set(met)


def test_map_of_a_shadow():
    """Power behind a cylinder, over that of free space, against the mean of both series over a cell."""
    plane = Plane(center=[60.0, 0, 0], normal=[1, 0, 0], up=[0, 0, 1], shape=(1, 3), pitch=4.0)
    found = coverage(
        Geometry([cylinder(64)]), Transmitter([-FAR, 0, 0]), plane, 299792458.0, reflections=0, diffractions=1
    )
    fine = np.column_stack([np.full(300, 60.0), np.linspace(-6, 6, 600)[::2] + 0.01, np.zeros(300)])
    power = np.mean([np.abs(cylinder_series(fine, FAR, RADIUS, hard)) ** 2 for hard in (False, True)], axis=0)
    free = -20 * np.log10(4 * np.pi * (FAR + 60))  # of 1 mW
    assert np.abs(found.rss_dBm[0] - free - 10 * np.log10(power.reshape(3, -1).mean(axis=1))[[0, 1, 2]]).max() < 1.0


def test_kinks_are_no_smooth_bodies():
    """A prism of 16 sides has its edges; a box has no smooth side."""
    lamp, point = PointEmitter([-100.0, 0, 0], 1.0), [60.0, 0.1, 0.0]
    met = {
        name for path in coherent_paths(Geometry([cylinder(16, half=50.0)]), lamp, point, 0, 1) for name, _ in path.met
    }
    assert "smooth" not in met


def test_beams_doubt_smooth_bodies_and_rays_do_not():
    place = Plane(center=[30.0, 0, 0], normal=[1, 0, 0], up=[0, 0, 1], shape=(2, 2), pitch=10.0)
    scene, lamp = Geometry([cylinder(256, half=30.0)]), PointEmitter([-30.0, 0, 0], 1.0)
    with pytest.warns(DoubtWarning, match="flat facets of 1 smooth bodies"):
        trace(scene, lamp, place, 10, 0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        trace(scene, lamp, place, 10, 0, "ray")


def plate(at):
    corners = [[at, -20, -20], [at, 20, -20], [at, 20, 20], [at, -20, 20]]
    return Mesh(corners, [[0, 1, 2], [0, 2, 3]], Conductor())


@pytest.mark.parametrize("verb", ["coherent_rays", "coherent_paths", "coverage", "trace"])
@pytest.mark.parametrize(("other", "message"), [("cylinder", "2 smooth bodies stand"), ("plate", "4 sharp edges"),
                                                (None, None)])  # fmt: skip
def test_smooth_bodies_beside_others_are_doubted(verb, other, message):
    """Waves by two bodies, or by a body and an edge of another, are missing; a body alone has no such warning."""
    body = cylinder(64, half=30.0)
    aside = {"cylinder": Mesh(body.vertices + [0, 40, 0], body.faces, Conductor()), "plate": plate(30.0), None: None}
    scene = Geometry([mesh for mesh in (body, aside[other]) if mesh is not None])
    lamp, point = PointEmitter([-60.0, 3, 0], 1.0), np.array([80.0, 1, 2])
    plane = Plane(center=point, normal=[1, 0, 0], up=[0, 0, 1], shape=(1, 1), pitch=1.0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if verb == "coverage":
            coverage(scene, Transmitter(lamp.position), plane, 299792458.0, reflections=1, diffractions=1)
        elif verb == "trace":
            trace(scene, lamp, plane, 10, 0)
        else:
            {"coherent_rays": coherent_rays, "coherent_paths": coherent_paths}[verb](scene, lamp, point, 1, 1)
    said = " ".join(str(each.message) for each in caught)
    if verb == "trace":  # any smooth body is doubted
        assert f"flat facets of {1 + (other == 'cylinder')} smooth bodies" in said
        assert "use coherent_rays" in said
    elif message is None:
        assert "smooth bodies" not in said
    else:
        assert message in said
        assert f"{verb}: " in said


def test_one_meeting_on_a_path_misses_nothing():
    """Paths by one body or one edge at most are all there: no warning of two smooth bodies."""
    body = cylinder(64, half=30.0)
    scene = Geometry([body, Mesh(body.vertices + [0, 40, 0], body.faces, Conductor()), plate(30.0)])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for limits in ((1, 0), (0, 1)):
            coherent_rays(scene, PointEmitter([-60.0, 3, 0], 1.0), [[80.0, 1, 2]], *limits)
    assert "smooth bodies stand" not in " ".join(str(each.message) for each in caught)
