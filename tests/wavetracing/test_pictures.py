"""Pictures of lit scenes: Lambert's law, images in mirrors, light past an edge, and counted rays as a judge."""

import numpy as np
import pytest
from refusals import assert_refused
from wavetracing.solids import box
from zscore import assert_z, refute_z

from specklegen.wavetracing import (
    Absorber,
    Conductor,
    Diffuse,
    Geometry,
    Mesh,
    Plane,
    PointEmitter,
    picture,
    trace,
    wedge_coefficients,
)

pytestmark = pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")

QUADS = np.array([[0, 1, 2], [0, 2, 3]])
FLOOR = Mesh([[-50, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0.0]], QUADS, Diffuse(albedo=0.5))
ABOVE = Plane(center=[0, 0, 40], shape=(6, 8), pitch=2.0)  # light that travels to +z: looks at the floor


def wall(x, low, high, material, side=50.0) -> Mesh:
    return Mesh([[x, -side, low], [x, side, low], [x, side, high], [x, -side, high]], QUADS, material)


def on_floor(plane):
    return plane.points * [1, 1, 0]


def law(lamp, points, power=1.0):
    """Radiance of the floor under a lamp: rho P |cos| / 4 pi^2 r^2."""
    r = np.linalg.norm(points - lamp, axis=-1)
    return 0.5 / np.pi * power * lamp[2] / (4 * np.pi * r**3)


def test_lambert_and_an_image_in_a_mirror():
    lamp = np.array([3.0, 1.0, 7.0])
    source = PointEmitter(lamp, 0.01, power=2.0)
    floor, points = Geometry([FLOOR]), on_floor(ABOVE)
    assert picture(floor, source, ABOVE, samples=1) == pytest.approx(law(lamp, points, 2.0), rel=1e-12)
    mirrored = Geometry([FLOOR, wall(20.0, 0.0, 30.0, Conductor())])
    both = law(lamp, points, 2.0) + law(np.array([37.0, 1.0, 7.0]), points, 2.0)
    # Paths end a little off the floor: 4e-7 of the scene's size.
    assert picture(mirrored, source, ABOVE, reflections=1, samples=1) == pytest.approx(both, rel=3e-5)
    assert picture(mirrored, source, ABOVE, samples=1) == pytest.approx(law(lamp, points, 2.0), rel=1e-12)


def test_a_block_casts_its_shadow_and_is_seen():
    """The top of a block hides the floor; its shadow ends where the line past its border meets the floor."""
    scene = Geometry([FLOOR, box((2.0, 40.0, 4.0), (0, 0, 2.0), material=Diffuse(albedo=1.0))])
    plane = Plane(center=[0, 0, 40], shape=(1, 400), pitch=0.05)
    seen = picture(scene, PointEmitter([-8.0, 0, 12.0], 0.01), plane, samples=1)[0]
    x = plane.points[0, :, 0]
    top = np.abs(x) < 1
    assert seen[top] == pytest.approx(8 / (4 * np.pi**2 * ((x[top] + 8) ** 2 + 64) ** 1.5), rel=1e-4)
    edge = -8 + 9 * 12 / 8  # the lamp, past (1, 4)
    assert not seen[(x > 1) & (x < edge - 0.06)].any()
    assert (seen[x > edge + 0.06] > 0).all()


def test_light_past_a_black_edge():
    """Deep in the shadow of a screen there is the edge's wave alone: |u_i D A|^2 |cos|, of the direct wave's terms.

    The screen is so wide that its sides send less than 1e-3 of it.
    """
    lamp, wavelength = np.array([-20.0, 0.0, 10.0]), 0.3
    scene = Geometry([FLOOR, wall(0.0, 0.0, 14.0, Absorber(), 300.0)])
    plane = Plane(center=[6.0, 0.2, 40], shape=(1, 5), pitch=1.0)
    found = picture(scene, PointEmitter(lamp, wavelength), plane, diffractions=1, samples=1)[0]
    k = 2 * np.pi / wavelength
    for value, point in zip(found, on_floor(plane)[0], strict=True):
        rho, sigma = np.hypot(20, 4), np.hypot(point[0], 14)
        y = lamp[1] + (point[1] - lamp[1]) * rho / (rho + sigma)
        r, s = np.hypot(rho, y - lamp[1]), np.hypot(sigma, point[1] - y)
        # Angles from the lit face, which hangs down from the edge.
        pair = wedge_coefficients(
            2.0, 2 * np.pi - np.arctan2(point[0], 14), np.arctan2(20, 4), r * s / (r + s) * (rho / r) ** 2, k,
            np.arcsin(rho / r),
        )  # fmt: skip
        direct = np.abs(sum(pair) / 2) ** 2
        expected = 0.5 / np.pi / (4 * np.pi) * direct / (r * s * (r + s)) * 14 / s
        assert value == pytest.approx(expected, rel=1e-3)


def test_counted_rays_agree():
    """The same power falls on the floor, ray by ray: z-tests of 12 cells; 4 % too much is caught."""
    block = box((6.0, 6.0, 6.0), (6.0, 0, 3.0), material=Absorber())
    lamp = PointEmitter([-3.0, 2.0, 9.0], 0.01, beam_angle=0.001)
    plane = Plane(center=[-4.0, 0, 0], shape=(3, 4), pitch=3.0)
    beams = 400_000
    counted = trace(Geometry([Mesh(FLOOR.vertices, QUADS), block]), lamp, plane, beams, 5, "ray")
    camera = plane.replace(center=np.array([-4.0, 0, 40]))
    seen = 2 * np.pi * picture(Geometry([FLOOR, block]), lamp, camera, samples=8)
    assert_z(counted.irradiance[0], seen, counted.standard_error[0], slack=2e-3 * seen.max())
    total, error = counted.irradiance[0].sum(), np.sqrt(np.square(counted.standard_error[0]).sum())
    assert_z(total, seen.sum(), error)
    refute_z(1.04 * total, seen.sum(), error)


def test_refused():
    plane, floor = ABOVE, Geometry([FLOOR])
    for n in (0, 1):
        assert_refused(lambda n=n: picture(floor, PointEmitter([1, 1, 1e-3], 0.01), plane, n, samples=1), "1 / k away")
    assert_refused(lambda: picture(floor, PointEmitter([0, 0, 9], 0.01), plane, samples=0), "picture samples")
    assert_refused(lambda: picture(floor, None, plane), "picture source")  # type: ignore[arg-type]
    assert_refused(lambda: picture(FLOOR, PointEmitter([0, 0, 9], 0.01), plane), "picture geometry")  # type: ignore[arg-type]
