"""The aperture operator by edges and triangles, Gaussian masses: against quadrature, each other, frozen figures."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from specklegen.core.errors import RuleError
from specklegen.wavetracing import aperture_transform, gaussian_mass
from specklegen.wavetracing.kernels.apertures import triangle_transform
from specklegen.wavetracing.opening import crossing, rim_of

TRIANGLE = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 2.0]])
XI = np.array([1.0, 0.5])


def square(side, at=(0.0, 0.0)):
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * side / 2 + at


def star(tips, outer, inner):
    angle, radius = np.arange(2 * tips) * np.pi / tips, np.tile([outer, inner], tips)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


FRAME = [square(6.0), square(2.0, (0.5, 0.3))[::-1]]  # with a hole
ISLANDS = [square(10.0), square(6.0)[::-1], square(3.0), square(2.0, (9.0, 0.0))]


def by_quadrature(triangle, values, xi, order=60):
    """Gauss-Legendre on the triangle as a folded square."""
    x, w = np.polynomial.legendre.leggauss(order)
    s, w = (x + 1) / 2, w / 2
    a, b = np.meshgrid(s, s, indexing="ij")
    shares = np.stack([1 - a, a * (1 - b), a * b], axis=-1)
    weight = w[:, None] * w * a * abs(np.linalg.det([triangle[1] - triangle[0], triangle[2] - triangle[0]]))
    return np.sum(weight * (shares @ values) * np.exp(-1j * (shares @ triangle) @ xi))


def triangles_transform(triangles, amplitudes, xi):
    """Psi(xi) complex128[...] of triangles float64[T, 3, 2], linear between amplitudes complex128[T, 3] at corners."""
    xi = np.asarray(xi, float)
    out = np.zeros(xi.size // 2, complex)
    triangle_transform(np.array(triangles), np.array(amplitudes, complex), xi.reshape(-1, 2), out)
    return out.reshape(xi.shape[:-1])


def test_frozen_figures():
    """Independent implementation, 8 digits behind the point."""
    assert abs(aperture_transform(TRIANGLE, XI) - (0.61089941 - 2.38329295j)) < 7e-9
    linear = triangles_transform(TRIANGLE[None], [[1, 0.5, 0.25j]], [XI, [0, 0]])
    assert np.abs(linear - [0.61003351 - 1.05755741j, 1.5 + 0.25j]).max() < 7e-9
    assert aperture_transform(TRIANGLE, [0.0, 0.0]) == 3.0


@pytest.mark.parametrize("length", [1e-9, 1e-6, 1e-3, 0.1, 1.0, 10.0, 30.0])
def test_triangles_against_quadrature(length):
    rng = np.random.default_rng(5)
    for angle in rng.uniform(0, 2 * np.pi, 6):
        xi = length * np.array([np.cos(angle), np.sin(angle)])
        values = rng.normal(size=3) + 1j * rng.normal(size=3)
        exact = by_quadrature(TRIANGLE, values, xi)
        assert abs(triangles_transform(TRIANGLE[None], values[None], xi)[()] - exact) < 3e-14  # measured 5e-15
        uniform = by_quadrature(TRIANGLE, np.ones(3), xi)
        assert abs(aperture_transform(TRIANGLE, xi) - uniform) < 3e-14


def test_wavevectors_across_an_edge_are_regular():
    """Where two corners have one phase, divided differences and sinc have their limits."""
    for xi in ([0.0, 5.0], [5.0, 0.0], [2.0, 3.0]):
        exact = by_quadrature(TRIANGLE, np.ones(3), np.array(xi))
        assert abs(aperture_transform(TRIANGLE, xi) - exact) < 3e-14  # mostly of the quadrature: measured 1e-14
        assert abs(triangles_transform(TRIANGLE[None], np.ones((1, 3)), xi) - exact) < 3e-14
        beside = aperture_transform(TRIANGLE, np.add(xi, 1e-9))
        assert abs(beside - exact) < 1e-7


@pytest.mark.parametrize("opening", [TRIANGLE, star(6, 6, 12**0.5), star(5, 6, 2.5), FRAME, ISLANDS])
def test_edges_and_triangulations_agree(opening):
    """Two formulae, to 1e-12. A triangulation that lost a triangle of 1e-9 of the area would be seen."""
    xi = np.random.default_rng(6).normal(scale=3.0, size=(40, 2))
    rim = rim_of("opening", opening)
    by_triangles = triangles_transform(rim.triangles, np.ones((len(rim.triangles), 3)), xi)
    assert np.abs(aperture_transform(opening, xi) - by_triangles).max() < 1e-12  # measured 2e-14
    assert aperture_transform(opening, [0, 0]).real == pytest.approx(rim.area, rel=1e-15)


def test_small_wavevectors_lose_nothing():
    """Psi -> A (1 - i xi.c): relative 1e-15 down to |xi| = 1e-300, far from the origin of coordinates too."""
    for length in (1e-3, 1e-8, 1e-100, 1e-300):
        value = aperture_transform(TRIANGLE, [length, 0.0])
        assert abs(value - 3.0 * (1 - 1j * length)) < 3 * length**2 + 2e-15
    far = aperture_transform(TRIANGLE + 1e6, [1e-9, 0.0])
    assert abs(far - 3.0 * np.exp(-1j * 1e-9 * (1e6 + 1))) < 1e-14


def test_babinet():
    """A square less its central square is the frame, and two halves are the whole."""
    xi = np.random.default_rng(7).normal(size=(20, 2))
    whole, stop = aperture_transform(square(6.0), xi), aperture_transform(square(2.0, (0.5, 0.3)), xi)
    assert np.abs(aperture_transform(FRAME, xi) - (whole - stop)).max() < 1e-13


def gaussian(points):
    return np.exp(-np.square(points).sum(axis=-1) / 8 + 0.3j * points[:, 0] ** 2)


def test_amplitudes_by_triangles_against_quadrature():
    """A curved Gaussian over a square: the error is below the tolerance of the linear pieces, and falls with it."""
    x, w = np.polynomial.legendre.leggauss(80)
    grid, weight = np.stack(np.meshgrid(4 * x, 4 * x), axis=-1).reshape(-1, 2), 16 * np.outer(w, w).ravel()
    xi = np.array([[0, 0], [0.5, 0.2], [-1, 1], [2, 0]])
    exact = np.exp(-1j * xi @ grid.T) @ (weight * gaussian(grid))
    light = np.sum(weight * np.abs(gaussian(grid)))
    errors = [
        np.abs(aperture_transform(square(8.0), xi, gaussian, tolerance=t) - exact).max() / light for t in (1e-2, 1e-3)
    ]
    assert errors[0] < 1e-2
    assert errors[1] < 1e-3
    assert errors[1] < errors[0] / 3


def test_uniform_edges_are_wrong_for_a_gaussian():
    """Why triangles: with u = 1 at the rim the pattern of a Gaussian as wide as half the opening is far off."""
    xi = np.array([[2.0, 0.3]])
    assert abs(aperture_transform(square(8.0), xi, gaussian)[0] - aperture_transform(square(8.0), xi)[0]) > 0.5


def test_gaussian_mass():
    assert gaussian_mass(TRIANGLE, [[2, 0.6], [0.6, 1]]) == pytest.approx(0.2104118268, abs=6e-11)
    half = np.array([[-1e3, 0], [1e3, 0], [1e3, 1e3], [-1e3, 1e3]])
    assert gaussian_mass(half, np.eye(2)) == pytest.approx(0.5, abs=1e-15)
    assert gaussian_mass(half, np.eye(2), (5.0, 0.0)) == pytest.approx(0.5, abs=1e-15)
    assert gaussian_mass(square(1e-3, (1e3, 0)), np.eye(2)) == 0.0


def test_gaussian_mass_of_boxes():
    """Against scipy's bivariate cumulative distribution, from inside, outside, a corner and an edge of the box."""
    covariance = np.array([[2.0, -0.9], [-0.9, 0.8]])
    for centre in ((0.2, -0.1), (3.0, 2.0), (1.0, 1.0), (1.0, 0.0)):
        corner = {(i, j): multivariate_normal(centre, covariance).cdf([i, j]) for i in (-1, 1) for j in (-1, 1)}
        exact = corner[1, 1] - corner[-1, 1] - corner[1, -1] + corner[-1, -1]
        assert gaussian_mass(square(2.0), covariance, centre) == pytest.approx(exact, abs=1e-9)


def test_masses_add():
    """A frame and its hole are the whole, wherever the mean lies."""
    for mean in ((0, 0), (0.5, 0.3), (5, 5)):
        parts = gaussian_mass(FRAME, np.eye(2), mean) + gaussian_mass(square(2.0, (0.5, 0.3)), np.eye(2), mean)
        assert parts == pytest.approx(gaussian_mass(square(6.0), np.eye(2), mean), abs=1e-14)


@pytest.mark.parametrize(
    ("opening", "match"),
    [
        ([[0, 0], [1, 0]], "n at least 3"),
        ([[0, 0], [1, 0], [np.nan, 1]], "finite everywhere"),
        (TRIANGLE[::-1], "positive area"),
        ([[0, 0], [1, 1], [1, 0], [0, 1]], r"cross neither themselves .* list corners in their order"),
        ([square(2.0), square(2.0, (1, 0.5))], "cross neither"),
        ([square(2.0), square(1.0)], "listed once; got 'a winding number of 2 at"),
        ([square(2.0), square(1.0, (5, 5))[::-1]], "got 'a winding number of -1 at"),
        ([[0, 1], [-1, 0], [0, 0], [0, -1], [-1, 0], [0, 0]], "got 'a winding number of -1 at"),
        ("mask", "loops of shape"),
        (3.0, "loops of shape"),
    ],
)
def test_bad_openings_are_refused(opening, match):
    with pytest.raises(RuleError, match=match):
        aperture_transform(opening, XI)


def test_other_bad_input_is_refused():
    with pytest.raises(RuleError, match="aperture_transform xi must be finite"):
        aperture_transform(TRIANGLE, [np.inf, 0])
    with pytest.raises(RuleError, match="resolved by"):
        aperture_transform(square(8.0), XI, lambda p: np.exp(1e6j * p[:, 0]))
    with pytest.raises(RuleError, match="positive definite"):
        gaussian_mass(TRIANGLE, [[1, 2], [2, 1]])


def test_crossing_edges_are_found_wherever_they_lie():
    """Against every pair of edges; those that touch, at a corner or along a side, do not cross."""
    rng = np.random.default_rng(8)
    for count in (3, 5, 9, 40):
        for _ in range(40):
            loop = rng.normal(size=(count, 2)) * [1.0, 10.0 ** rng.integers(-3, 4)]
            a, b = loop, np.roll(loop, -1, axis=0)
            along, to = (b - a)[:, None], loop - a[:, None]
            sides = along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]  # of each corner to each edge
            apart = (sides * np.roll(sides, -1, axis=1) < 0) & ~np.eye(count, dtype=bool)
            expected = apart & apart.T
            found = crossing(a, b)
            assert (found is not None) == expected.any()
            assert found is None or expected[found]
    turn = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    gear = np.stack([np.cos(turn), np.sin(turn)], axis=1) * (1 + 0.1 * np.sin(40 * turn))[:, None]
    assert crossing(gear, np.roll(gear, -1, axis=0)) is None
    beside = [square(2.0), square(2.0, (2, 0.5)), square(2.0, (0, 2))]
    assert rim_of("opening", beside).area == 12
    spiked = [[0, 0], [1, 0], [2, 0], [1, 0], [1, 1], [0.5, 0.5], [0, 1]]
    assert rim_of("opening", spiked).area == 0.75


@pytest.mark.parametrize("reach", [5e-324, 2.6820216838384305e-160, 1e-139])
def test_wavevectors_whose_squares_underflow_lose_nothing(reach):
    np.testing.assert_allclose(aperture_transform(TRIANGLE, [[0, reach], [reach, -reach]]), rim_of("t", TRIANGLE).area)


def test_an_opening_of_no_area_is_dark():
    assert abs(aperture_transform([[0, 0], [1, 1], [2, 2]], XI)) < 1e-15
