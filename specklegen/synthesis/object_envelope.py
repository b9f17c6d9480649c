"""Light that stays about its beam, in images of hidden objects: an envelope as products of maps of camera and object.

    I(v) = sum_j O_j E^2(i_j, v) |F_j(v)|^2,     E^2(i, v) = sum_n g_n(v) P_n(i)

E^2 is smooth over the object, so that a few Legendre polynomials P_n of the beams' directions hold it: each costs one
image of the object times P_n. They are fitted at Gauss nodes, as many as bring the error below :data:`TOLERANCE`.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import legvander

from specklegen.core.quadrature import gauss_legendre

TOLERANCE = 4e-3
"""Error of E^2, over its peak, that the polynomials may leave."""
MOST_DEGREE = 8

Squared = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""E^2 float64[T, B, H, W] at views x float64[W] and y float64[H] of the beams at points x points of the object, rows
first, over its half sides."""


def degree_of(squared: Squared, x: np.ndarray, y: np.ndarray, *, point: bool = False) -> int | None:
    """Least total degree of the polynomials that hold E^2 over object and camera; None where more than 8 would do.

    Parameters
    ----------
    squared
        The envelope.
    x, y
        Direction sines of the camera's columns and rows.
    point
        Whether the object is one pixel, and any degree will do.
    """
    few_x, few_y = (axis[np.unique(np.linspace(0, len(axis) - 1, 9).astype(int))] for axis in (x, y))
    ends = np.array([-1.0, 0.0, 1.0])
    exact = squared(few_x, few_y, ends)
    for degree in range(MOST_DEGREE + 1):
        points, fit, orders = _fit(degree)
        held = np.einsum("tbhw,bn->tnhw", squared(few_x, few_y, points), fit)
        at = _values(_square(ends), orders)
        if point or np.abs(np.einsum("tnhw,bn->tbhw", held, at) - exact).max() <= TOLERANCE:
            return degree
    return None


def gains_of(squared: Squared, x: np.ndarray, y: np.ndarray, degree: int) -> np.ndarray:
    """Maps g_n of the camera, float64[T, P, H, W], of an envelope at views x float64[W] and y float64[H]."""
    points, fit, _ = _fit(degree)
    return np.einsum("tbhw,bn->tnhw", squared(x, y, points), fit)


@lru_cache(maxsize=16)
def over_object(shape: tuple[int, int], degree: int) -> np.ndarray:
    """Polynomials float64[P, h, w] over the pixels of an object."""
    # The object's pixel (row, column) sends its light along minus its position: object_sines.
    along = [-np.linspace(-1, 1, n) if n > 1 else np.zeros(1) for n in shape]
    pixels = np.stack(np.meshgrid(along[1], along[0]), axis=-1).reshape(-1, 2)
    return np.ascontiguousarray(_values(pixels, _fit(degree)[2]).T.reshape(-1, *shape))


def product_count(degree: int) -> int:
    """Number P of the polynomials of a total degree."""
    return (degree + 1) * (degree + 2) // 2


@lru_cache(maxsize=MOST_DEGREE + 1)
def _fit(degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes float64[b] of either axis, what turns values on their square into coefficients, float64[b * b, N], and
    orders int64[N, 2].
    """
    points, weights = gauss_legendre(degree + 1)
    orders = np.array([[a, total - a] for total in range(degree + 1) for a in range(total, -1, -1)])
    norm = ((2 * orders + 1) / 2).prod(axis=1)
    return points, np.outer(weights, weights).reshape(-1, 1) * _values(_square(points), orders) * norm, orders


def _square(points: np.ndarray) -> np.ndarray:
    """Points (x, y) of a square, float64[n * n, 2], rows first."""
    return np.stack(np.meshgrid(points, points), axis=-1).reshape(-1, 2)


def _values(points: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Products of Legendre polynomials at points float64[B, 2]: float64[B, N]."""
    along = [legvander(points[:, axis], int(orders.max())) for axis in (0, 1)]
    return along[0][:, orders[:, 0]] * along[1][:, orders[:, 1]]
