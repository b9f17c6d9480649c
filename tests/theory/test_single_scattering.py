"""Eq. 41 against brute-force quadrature, closed forms and Algorithm 1; and the divided differences beneath it."""

import numpy as np
import pytest
from references.slab_covariance import slab_covariance
from refusals import assert_refused
from scipy.linalg import expm

from specklegen.theory.single_scattering import _divided_exp, box_covariance

LOWER, UPPER = np.array([-1.0, -2.0, -1.5]), np.array([2.0, 1.0, 0.5])
AXIS = np.array([0.0, 0.0, 1.0])


def one(cos):
    return np.ones(np.shape(cos))


def complex_amplitude(cos):
    """Neither real nor symmetric, so that a missing conjugate or argument shows."""
    return np.exp(1j * (0.3 + 1.7 * cos)) * (1.2 + 0.5 * cos)


def random_directions(rng, *shape):
    vectors = rng.normal(size=shape)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def quadruples(rng, count, dimension):
    i1, i2, v1, v2 = random_directions(rng, 4, count, dimension)
    return {"lights": (i1, i2), "views": (v1, v2)}


def midpoint_rule(lower, upper, points, extinction, wavelength, lights, views):
    """Integral of Eq. 41 for one quadruple, by cells of equal size."""
    axes = [a + (np.arange(points) + 0.5) / points * (b - a) for a, b in zip(lower, upper, strict=True)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance = sum(
        np.where(u > 0, (upper - x) / u, (lower - x) / u).min(axis=-1) for u in (*(-i for i in lights), *views)
    )
    wave = 2 * np.pi / wavelength * ((lights[0] - views[0]) - (lights[1] - views[1]))
    return np.exp(1j * x @ wave - 0.5 * extinction * distance).mean() * np.prod(upper - lower)


@pytest.mark.parametrize(("dimension", "coarse"), [(2, 200), (3, 40)])
def test_a_box_in_any_directions_is_the_midpoint_rule(dimension, coarse):
    """Richardson: the rule's error falls as h^2, so from two grids it is known; kinks leave a part of it."""
    lower, upper = LOWER[:dimension], UPPER[:dimension]
    scene = {"extinction": 0.7, "wavelength": 1.5}
    drawn = quadruples(np.random.default_rng(0), 8, dimension)
    found = box_covariance(lower, upper, **scene, albedo=0.5, amplitude=one, **drawn)
    for n in range(8):
        rays = [v[n] for v in drawn["lights"]], [v[n] for v in drawn["views"]]
        first, second = (midpoint_rule(lower, upper, m, 0.7, 1.5, *rays) for m in (coarse, 2 * coarse))
        assert abs(found[n] - 0.35 * (4 * second - first) / 3) < 0.35 * abs(second - first)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_box_is_the_sum_of_phases_where_nothing_is_absorbed(dimension):
    """No attenuation: a product of sincs, to rounding, in spite of all the cuts; corners far from the origin."""
    lower, upper = LOWER[:dimension] + 40, UPPER[:dimension] + 40
    drawn = quadruples(np.random.default_rng(1), 50 if dimension == 2 else 10, dimension)
    tiny = 1e-15
    found = box_covariance(lower, upper, extinction=tiny, wavelength=0.1, amplitude=complex_amplitude, **drawn) / tiny
    (i1, i2), (v1, v2) = drawn["lights"], drawn["views"]
    turns = ((i1 - v1) - (i2 - v2)) / 0.1
    expected = np.exp(2j * np.pi * turns @ (lower + upper) / 2) * np.prod(
        (upper - lower) * np.sinc(turns * (upper - lower)), -1
    )
    expected *= complex_amplitude((i1 * v1).sum(-1)) * complex_amplitude((i2 * v2).sum(-1)).conj()
    # 5000 rad of phase, each rounded to 1e-16 of itself; |s|^2 up to 2.9.
    np.testing.assert_allclose(found, expected, rtol=0, atol=5e-12 * np.prod(upper - lower))


def test_normal_transmission_and_reflection_of_a_box():
    size, sigma, albedo, depth = UPPER - LOWER, 0.8, 0.6, 0.8 * 2.0
    area = size[0] * size[1]
    scene = {"extinction": sigma, "albedo": albedo, "wavelength": 1.0, "amplitude": complex_amplitude}
    found = box_covariance(LOWER, UPPER, lights=(AXIS, AXIS), views=([AXIS, -AXIS], [AXIS, -AXIS]), **scene)
    across = abs(complex_amplitude(1.0)) ** 2 * albedo * sigma * area * size[2] * np.exp(-depth)
    back = abs(complex_amplitude(-1.0)) ** 2 * albedo * area * (1 - np.exp(-2 * depth)) / 2
    np.testing.assert_allclose(found, [across, back], rtol=1e-13)
    wide = slab_covariance(size[2], width=np.sqrt(area), lights=(AXIS, AXIS), views=([AXIS, -AXIS], [AXIS, -AXIS]),
                           **scene)  # fmt: skip
    np.testing.assert_allclose(wide, [across, back], rtol=1e-13)


@pytest.mark.parametrize("slope", [5e-324, 7e-183, 1e-20, 1e-13])
@pytest.mark.parametrize("dimension", [2, 3])
def test_rays_all_but_along_a_face_are_those_along_it(slope, dimension):
    """They leave by that face from a sliver alone; corners of the box lie on it."""
    along, tilted = np.zeros((2, dimension))
    along[-1] = tilted[-1] = -1.0
    tilted[-2] = slope
    scene = {"extinction": 1.0, "wavelength": 1.0, "amplitude": complex_amplitude}
    view = np.eye(dimension)[0]

    def of(ray):
        return box_covariance(LOWER[:dimension], UPPER[:dimension], lights=(ray, -along), views=(view, view), **scene)

    # A slope of 1e-13 turns the phase by 4e-12 and lets 2e-13 of the box leave by the side.
    assert abs(of(tilted) - of(along)) < 1e-11 * np.prod(UPPER[:dimension] - LOWER[:dimension])


def test_the_matrix_over_lights_and_views_is_hermitian_positive_and_reciprocal():
    rng = np.random.default_rng(2)
    i, v = random_directions(rng, 2, 6, 2)
    scene = {"extinction": 0.3, "wavelength": 1.0, "amplitude": complex_amplitude}
    c = box_covariance([-5, -5], [5, 5], lights=(i[:, None], i), views=(v[:, None], v), **scene)
    swapped = box_covariance([-5, -5], [5, 5], lights=(-v[:, None], -v), views=(-i[:, None], -i), **scene)
    np.testing.assert_allclose(c, c.conj().T, rtol=0, atol=1e-12 * c.real.max())
    np.testing.assert_allclose(c, swapped, rtol=0, atol=1e-12 * c.real.max())
    assert np.linalg.eigvalsh(c).min() > -1e-12 * c.real.max()


def by_depth(thickness, sigma, width, k, lights, views, points):
    """Slab integral by the midpoint rule over depth, and over the window by its own midpoint rule."""
    z = (np.arange(points) + 0.5) / points * thickness
    y = ((np.arange(2 * points) + 0.5) / points - 1) * 2 * width
    x = np.stack(np.meshgrid(y, z, indexing="ij"), axis=-1)
    value = np.ones(x.shape[:-1], complex)
    for i, v, sign in zip(lights, views, (1, -1), strict=True):
        inside = np.clip((width / 2 - np.abs(x[..., 0] - x[..., 1] * i[0] / i[1])) / (2 * width / points) + 0.5, 0, 1)
        out = np.where(v[1] > 0, thickness - x[..., 1], -x[..., 1]) / v[1]
        value *= inside / np.sqrt(i[1]) * np.exp(1j * sign * k * x @ (i - v) - sigma / 2 * (x[..., 1] / i[1] + out))
    return value.sum() * thickness / points * 2 * width / points


@pytest.mark.parametrize("views", [(0.2, 0.5), (3.3, 2.8), (0.2, 2.8)])
@pytest.mark.parametrize("tilts", [(0.1, 0.15), (0.4, -0.3)])
def test_a_slab_with_footprints_that_part(tilts, views):
    """Thickness 4, width 2: the second pair of footprints parts inside the slab. Error of the rule about 1/points."""
    rays = [np.stack([np.sin(angles), np.cos(angles)], axis=-1) for angles in (tilts, views)]
    found = slab_covariance(4.0, extinction=0.3, wavelength=3.0, width=2.0, amplitude=one, lights=tuple(rays[0]),
                            views=tuple(rays[1]))  # fmt: skip
    first, second = (0.3 * by_depth(4.0, 0.3, 2.0, 2 * np.pi / 3, *rays, points) for points in (400, 800))
    assert abs(found - second) < 2 * abs(second - first) + 1e-4


def test_divided_differences_are_those_of_the_matrix_exponential():
    """exp of a bidiagonal matrix has exp[f_0 ... f_3] in its corner; gaps from 1e-6 to 30, equal nodes too."""
    rng = np.random.default_rng(5)
    gap = np.array([0.0, 1e-6, 1e-2, 1.0, 30.0])[rng.integers(0, 5, 100)]
    f = 1j * gap[:, None] * rng.normal(size=(100, 4)) - np.minimum(gap, 1)[:, None] * rng.random((100, 4))
    matrices = np.zeros((100, 4, 4), complex)
    matrices[:, range(4), range(4)] = f
    matrices[:, [0, 1, 2], [1, 2, 3]] = 1
    np.testing.assert_allclose(_divided_exp(f), expm(matrices)[:, 0, 3], rtol=0, atol=1e-15)


@pytest.mark.parametrize(("change", "message"), [
    ({"extinction": -1.0}, "box_covariance extinction must be at least 0; got -1"),
    ({"albedo": 1.1}, "box_covariance albedo must be at most 1"),
    ({"wavelength": np.nan}, "box_covariance wavelength must be greater than 0"),
    ({"upper": LOWER}, "box_covariance upper must be above lower"),
    ({"lights": (AXIS[:2], AXIS[:2])}, r"box_covariance lights must be two arrays of shape \(\.\.\., 3\)"),
    ({"views": (2 * AXIS, AXIS)}, "box_covariance views must be unit vectors"),
])  # fmt: skip
def test_refusals(change, message):
    right = {"lower": LOWER, "upper": UPPER, "extinction": 1.0, "wavelength": 1.0, "amplitude": one}
    right |= {"lights": (AXIS, AXIS), "views": (AXIS, AXIS)} | change
    assert_refused(lambda: box_covariance(right.pop("lower"), right.pop("upper"), **right), message)
