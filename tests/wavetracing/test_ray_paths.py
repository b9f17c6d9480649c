"""Paths one by one: they add up to the field, and run where a plane mirror and a straight edge send them."""

import numpy as np
import pytest
from wavetracing.solids import box

from specklegen.core.errors import RuleError
from specklegen.wavetracing import Building, Conductor, Geometry, PointEmitter, coherent_paths, coherent_rays

pytestmark = pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")

BLOCK = Geometry(box((6.0, 40.0, 30.0), (0, 0, 0), material=Conductor()))
LAMP = PointEmitter([-25.0, 3.0, 4.0], 1.0, power=4 * np.pi)


@pytest.mark.parametrize("point", [[20.0, -2.0, 9.0], pytest.param([-9.0, 1.0, -3.0], marks=pytest.mark.slow)])
def test_paths_add_up_and_their_legs_are_straight(point):
    """In shadow and in light: amplitudes to rounding, phases by lengths, directions by Keller's cone."""
    paths = coherent_paths(BLOCK, LAMP, point, 1, 2, "hard")
    total = sum(path.amplitude for path in paths)
    assert total == pytest.approx(coherent_rays(BLOCK, LAMP, [point], 1, 2, "hard")[0], rel=1e-12)
    lengths = [path.length for path in paths]
    assert lengths == sorted(lengths)
    for path in paths:
        assert np.linalg.norm(path.departure) == pytest.approx(1)
        assert path.delay == pytest.approx(path.length / 299_792_458.0)
        if len(path.met) == 1 and path.met[0][0] == "diffraction":
            start, stop = BLOCK.edges.ends[path.met[0][1]]
            along = (stop - start) / np.linalg.norm(stop - start)
            assert path.departure @ along == pytest.approx(path.arrival @ along, abs=1e-12)
            # Both legs meet on the edge, and are as long together as the path.
            sides = np.stack([path.departure, path.arrival], axis=1)
            out, back = np.linalg.lstsq(sides, np.array(point) - LAMP.position, rcond=None)[0]
            assert out + back == pytest.approx(path.length)
            assert np.linalg.norm(np.cross(LAMP.position + out * path.departure - start, along)) < 1e-9


def test_a_mirror():
    """The image's length, the incoming side's angle, and the mesh that it is."""
    _, image = coherent_paths(BLOCK, LAMP, [-9.0, 1.0, -3.0], 1, 0)
    mirrored = np.array([3.0, 1.0, -3.0])  # in the face x = -3
    assert image.length == pytest.approx(np.linalg.norm(mirrored - LAMP.position))
    assert image.departure == pytest.approx((mirrored - LAMP.position) / image.length)
    assert image.arrival == pytest.approx(image.departure * [-1, 1, 1])
    assert image.met == (("reflection", 0),)
    assert image.amplitude == pytest.approx(-np.exp(2j * np.pi * image.length) / image.length)


def test_refused():
    with pytest.raises(RuleError, match="a finite point"):
        coherent_paths(BLOCK, LAMP, [[0.0, 0, 9]])
    with pytest.raises(RuleError, match="coherent_paths source"):
        coherent_paths(BLOCK, None, [0.0, 0, 99])


def test_exchange_in_a_street_whose_mirrors_are_met_at_their_borders():
    """Six concrete blocks in rows: light from edge to edge meets a wall just where it ends; fields agree to 1e-8."""
    spans = [(-60, -25, 12, 40, 20), (-15, 20, 12, 40, 28), (30, 60, 12, 40, 18),
             (-60, -25, -40, -12, 22), (-15, 20, -40, -12, 16), (30, 60, -40, -12, 30)]  # fmt: skip
    blocks = [
        box((b - a, d - c, h), ((a + b) / 2, (c + d) / 2, h / 2), material=Building(name="concrete"))
        for a, b, c, d, h in spans
    ]
    scene, lamp = Geometry(blocks), [-33.0, 0.0, 32.0]
    for point in ([45.0, -2.0, 1.5], [25.0, 25.0, 1.5], [-22.0, 30.0, 1.5], [70.0, 45.0, 1.5]):
        there, back = (
            sum(path.pair for path in coherent_paths(scene, PointEmitter(a, 0.0857), b, 1, 2, surfaces="material"))
            for a, b in ((lamp, point), (point, lamp))
        )
        assert (np.abs(there - back) < 1e-8 * np.abs(there)).all()
