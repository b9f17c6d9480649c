"""Cone against triangle and box: by hand, by an independent minimiser, and where touching decides."""

import warnings

import numpy as np
import pytest
from references.cone_triangle import first_depth
from wavetracing.cone_pairs import KINDS, boxes_in_cones, pairs, triangles_in_cones

from specklegen.core.errors import DoubtWarning
from specklegen.wavetracing import Cone, Geometry, Mesh
from specklegen.wavetracing.kernels.cones import CONE

WIDE = 1e4


def depth_of(a, b, tan_a, corners):
    triangle = Mesh(np.array(corners, float), np.array([[0, 1, 2]]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoubtWarning)  # a segment is a triangle without area
        scene = Geometry(triangle)
    cone = Cone(np.zeros(3), np.eye(3), a, b, tan_a, tan_a * b / a if a else tan_a)
    depth, face = scene.closest(cone)
    assert (face == 0) == np.isfinite(depth) == bool(len(scene.collect(cone)))
    return depth


@pytest.mark.parametrize(
    ("cone", "corners", "expected"),
    [
        ((1, 1, 0.1), [(-WIDE, -WIDE, 10), (WIDE, -WIDE, 10), (0, WIDE, 10)], 10),
        ((1, 1, 0.1), [(2, -1, 5), (2, 1, 5), (2, 0, 30)], 10),
        ((1, 1, 0.1), [(2, -1, 5), (2, 1, 5), (8, 0, 30)], np.inf),
        ((2, 0.5, 0.2), [(-4, 1, 3), (4, 1, 3), (0, 1, 40)], 10),
        ((0, 0, 0.5), [(6, -20, 0), (6, 20, 0), (-20, 0, 26)], 4),
        ((2, 0.5, 0.05), [(0, -9, 4), (0, -9, 4), (0, 9, 14)], 8.662068965517),
    ],
)
def test_depths_by_hand(cone, corners, expected):
    """The last is a segment: its figure has 13 digits."""
    assert depth_of(*cone, corners) == pytest.approx(expected, abs=5e-13)


def judge(count, seed, decades=0.0, chunk=50_000, spoil=0.0):
    """Pairs missed, pairs met falsely, the largest error of a depth over its scale, the share of hits left out of that.

    A pair is missed if a cone narrower, and a slab shorter, by 1e-6 of the scale still holds it; met falsely if a wider
    one does not. Depths are compared where those of the narrower and the wider cone agree to 1e-2: not where a corner
    touches the apex to the last bit, a
    kind that the share does not count. ``spoil`` widens the cone of the kernel, not of the minimiser: a wrong kernel.
    """
    rng = np.random.default_rng(seed)
    missed = false = compared = hits = 0
    worst = 0.0
    for first in range(0, count, chunk):
        n = min(chunk, count - first)
        cones, near, far, corners, scale = pairs(rng, n, decades)
        spoilt = cones.copy()
        spoilt[:, 12] *= 1 + spoil
        low, high = np.empty(n), np.empty(n)
        triangles_in_cones(spoilt, near, far, corners, low, high)
        a, t, delta, points = cones[:, 12], cones[:, 13], 1e-6 * scale, corners.reshape(n, 3, 3)
        _, narrow = first_depth(a - delta, t, near + delta, far - delta, points)
        _, wide = first_depth(a + delta, t, near - delta, far + delta, points)
        _, depth = first_depth(a, t, near, far, points)
        hit = np.isfinite(low)
        missed += int((~hit & np.isfinite(narrow)).sum())
        false += int((hit & ~np.isfinite(wide)).sum())
        stable = hit & np.isfinite(narrow) & np.isfinite(wide) & np.isfinite(depth)
        stable[stable] = narrow[stable] - wide[stable] < 1e-2 * scale[stable]
        usual = hit & (np.arange(n) % len(KINDS) != KINDS.index("at the apex"))
        hits, compared = hits + int(usual.sum()), compared + int((usual & stable).sum())
        worst = max(worst, float((np.abs(low[stable] - depth[stable]) / scale[stable]).max(initial=0)))
    return missed, false, worst, 1 - compared / hits


@pytest.mark.parametrize(("seed", "decades"), [(1, 0), (2, 12)])
def test_minimiser_agrees(seed, decades):
    """A depth is a root that two roundings of 1e-16 may move by their square root at a tangent: 1e-7 is above that."""
    missed, false, worst, left_out = judge(8_000, seed, decades)
    assert (missed, false) == (0, 0)
    assert worst < 1e-7
    assert left_out < 0.005


def test_the_comparison_has_power():
    """A cone wider by one part in a thousand is seen in both."""
    _, false, worst, _ = judge(8_000, 1, spoil=1e-3)
    assert false > 0
    assert worst > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(("count", "seed", "decades"), [(1_000_000, 3, 0), (100_000, 4, 12)])
def test_minimiser_agrees_a_million_times(count, seed, decades):
    missed, false, worst, left_out = judge(count, seed, decades)
    assert (missed, false) == (0, 0)
    assert worst < 1e-7
    assert left_out < 0.005


def test_an_end_at_the_apex_to_the_last_bit():
    """A corner that rounding puts just beyond the apex: the edge from it into the cone still begins there."""
    for spot in (-6.477319666973191, np.nextafter(-6.477319666973191, -10), np.nextafter(-6.477319666973191, 0)):
        corners = np.array([[0, 0, spot, 0.30250229, 2.16678343, 0.58914555, -0.32151812, 1.01791088, 1.00498398]])
        cone = np.zeros((1, CONE))
        cone[0, [3, 7, 11, 12, 13]] = 1, 1, 1, 1.7226989064958431, 0.2659586055756376
        low, high = np.empty((2, 1))
        triangles_in_cones(cone, np.array([-100.0]), np.array([50.0]), corners, low, high)
        assert low[0] == pytest.approx(spot, abs=1e-9)


@pytest.mark.parametrize(
    ("a", "t", "corners"),
    [
        (1.0579128861102294, 0.673696490109339, [[0, 0, -1.5703108174699458], [-0.875981353247911, 3.066137255925853,
         3.1101543520557984], [-5.745134223879191, -2.7758454273100845, -1.306437662002632]]),
        (1.8076592775536267, 0.972309487140929, [[0, 0, -1.8591398124367167], [6.354200477398507, -2.286134411363747,
         2.041622578685769], [-4.983792385235146, -0.1371007275848608, 2.5720937592834225]]),
        (1.0, 0.3, [[-7, 1, -1 / 0.3 - 2], [7, -1, -1 / 0.3 + 2], [3, 1, 40]]),
    ],
)  # fmt: skip
def test_a_triangle_through_the_apex_begins_there(a, t, corners):
    """Its edges, and the extremes of its section, may all miss the cone by their rounding: a corner, then an edge.

    A million random pairs had found the first two, which began 4 too late. In a slab behind the apex nothing changes.
    """
    cone = np.zeros((1, CONE))
    cone[0, [3, 7, 11, 12, 13]] = 1, 1, 1, a, t
    low, high = np.empty((2, 1))
    corners = np.array(corners)
    triangles_in_cones(cone, np.array([-100.0]), np.array([50.0]), corners.reshape(1, 9), low, high)
    assert low[0] == pytest.approx(-a / t, abs=1e-12)
    triangles_in_cones(cone, np.array([0.0]), np.array([50.0]), corners.reshape(1, 9), low, high)
    assert low[0] >= 0


def test_touching_is_a_hit():
    """A triangle that touches the cone's surface with a corner, an edge, or the end of the slab."""
    assert depth_of(1, 1, 0, [(1, 0, 5), (2, 1, 5), (2, -1, 5)]) == 5
    assert depth_of(1, 1, 0, [(1, -1, 5), (1, 1, 5), (2, 0, 5)]) == 5
    assert depth_of(1, 1, 0, [(1, 0, 0), (2, 1, -1), (2, -1, -1)]) == 0
    assert depth_of(1, 1, 0, [(1 + 1e-12, -1, 5), (1 + 1e-12, 1, 5), (2, 0, 5)]) == np.inf


def test_an_elliptic_cone_is_a_circular_one_stretched():
    """Turning the frame and moving the scene change nothing but rounding: depths of 10, coordinates of 100."""
    rng = np.random.default_rng(5)
    cones, near, far, corners, _ = pairs(rng, 4000)
    e = rng.uniform(1, 10, 4000)
    q, _ = np.linalg.qr(rng.normal(size=(4000, 3, 3)))
    q[np.linalg.det(q) < 0, 2] *= -1
    origin = rng.normal(0, 50, (4000, 3))
    stretched = corners.reshape(-1, 3, 3) / np.stack([np.ones(4000), e, np.ones(4000)], axis=1)[:, None]
    moved = np.einsum("nij,nvi->nvj", q, stretched) + origin[:, None]
    turned = np.empty((4000, CONE))
    turned[:, :3] = origin
    turned[:, 3:12] = (q * np.stack([np.ones(4000), e, np.ones(4000)], axis=1)[:, :, None]).reshape(-1, 9)
    turned[:, 12:] = cones[:, 12:]
    here, there, high = np.empty((3, 4000))
    triangles_in_cones(cones, near, far, corners, here, high)
    triangles_in_cones(turned, near, far, moved.reshape(-1, 9), there, high)
    sure = np.arange(4000) % len(KINDS) != KINDS.index("at the apex")  # where a last bit decides
    assert (np.isfinite(here) == np.isfinite(there))[sure].all()
    both = np.isfinite(here) & np.isfinite(there) & sure
    assert both.sum() > 1000
    # 1e-14 of rounding in coordinates of 100, and its root at a tangent
    assert np.abs(here[both] - there[both]).max() < 1e-6


@pytest.mark.parametrize("count", [100_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_no_box_rejects_a_hit(count):
    """A cone that meets a triangle meets its box, no later."""
    rng = np.random.default_rng(6)
    cones, near, far, corners, scale = pairs(rng, count, decades=6)
    low, high = np.empty((2, count))
    triangles_in_cones(cones, near, far, corners, low, high)
    points = corners.reshape(-1, 3, 3)
    lower, upper = points.min(axis=1), points.max(axis=1)
    boxes = np.concatenate([(lower + upper) / 2, (upper - lower) / 2 * (1 + 1e-15)], axis=1)
    boxed = np.empty(count)
    boxes_in_cones(cones, near, far, boxes, boxed)
    hit = np.isfinite(low)
    assert hit.sum() > count // 5
    assert np.isfinite(boxed[hit]).all()
    assert (boxed[hit] <= low[hit] + 1e-14 * scale[hit] * 50).all()
    assert np.isinf(boxed[~hit]).mean() > 0.4  # and rejects something


def test_a_half_space():
    """A cone of slope 1e8 is a half space: everything ahead is met, nothing behind."""
    scene = Geometry(Mesh([[9e5, 0, 1], [9e5, 1, 1], [9e5, 0, 2.0]], [[0, 1, 2]]))
    cone = Cone(np.zeros(3), np.eye(3), 1, 1, 1e8, 1e8)
    assert scene.closest(cone)[0] == 1
    behind = Cone(np.array([0, 0, 3.0]), np.eye(3), 1, 1, 1e8, 1e8)
    assert scene.closest(behind) == (np.inf, -1)
