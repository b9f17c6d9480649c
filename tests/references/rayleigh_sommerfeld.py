"""The field behind a polygon, by the surface integral of Rayleigh and Sommerfeld.

    u(P) = (1/2 pi) int (z/R) (1/R - ik) (e^{ikR}/R) d^2r

over the opening, times the light there: the field that is the light in the opening and 0 beside it. Slow and literal:
2-D Gauss-Legendre quadrature over triangles; of any field given on a grid, sums. Also two closed forms, on the axis of
a disc and behind a disc stop.
Source: Born and Wolf, *Principles of Optics*, section 8.11; Osterberg, Smith, J. Opt. Soc. Am. 51, 1050 (1961).
"""

from collections.abc import Callable

import numpy as np

from specklegen.core.quadrature import gauss_legendre


def surface_field(
    triangles: np.ndarray,
    points: np.ndarray,
    wavelength: float = 1.0,
    order: int = 60,
    light: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Field complex128[P] at ``points`` float64[P, 3], z > 0, behind disjoint ``triangles`` float64[T, 3, 2]. ``light``
    is the field at float64[Q, 3] in the opening, 1 by default. ``order`` nodes along each side of a triangle: 60 give
    1e-12 for sides of 10 wavelengths, at z of a wavelength or more."""
    triangles, points = np.asarray(triangles, float), np.asarray(points, float)
    x, w = gauss_legendre(order)
    s, w = (x + 1) / 2, w / 2
    a, b = (grid.ravel() for grid in np.meshgrid(s, s, indexing="ij"))
    shares, weights = np.stack([1 - a, a * (1 - b), a * b], axis=-1), np.outer(w, w).ravel() * a
    k, total = 2 * np.pi / wavelength, np.zeros(len(points), complex)
    for corners in triangles:
        twice = abs(np.linalg.det([corners[1] - corners[0], corners[2] - corners[0]]))
        nodes = shares @ corners
        lit = weights if light is None else weights * light(np.column_stack([nodes, np.zeros(len(nodes))]))
        for n, (px, py, z) in enumerate(points):
            distance = np.sqrt((px - nodes[:, 0]) ** 2 + (py - nodes[:, 1]) ** 2 + z * z)
            kernel = z / distance * (1 / distance - 1j * k) * np.exp(1j * k * distance) / distance
            total[n] += twice * (lit @ kernel) / (2 * np.pi)
    return total


def propagated_field(
    field: np.ndarray, x: np.ndarray, y: np.ndarray, points: np.ndarray, wavelength: float = 1.0
) -> np.ndarray:
    """Field complex128[P] at ``points`` float64[P, 3], z > 0, behind a field complex128[H, W] on the plane z = 0. The
    same integral by the trapezoidal rule on a regular grid x float64[W], y float64[H], beyond which the field is dark:
    exact to the digits that it has where the grid resolves field and kernel together."""
    field, points = np.asarray(field), np.asarray(points, float)
    k, cell = 2 * np.pi / wavelength, (x[1] - x[0]) * (y[1] - y[0])
    propagated = np.empty(len(points), complex)
    for n, (px, py, z) in enumerate(points):
        distance = np.sqrt((px - x) ** 2 + (py - y[:, None]) ** 2 + z * z)
        kernel = z / distance * (1 / distance - 1j * k) * np.exp(1j * k * distance) / distance
        propagated[n] = cell * (kernel * field).sum() / (2 * np.pi)
    return propagated


def disc_axis(radius: float, z: float, wavelength: float = 1.0) -> complex:
    """Field on the axis behind a disc: e^{ikz} - (z/R) e^{ikR}, R to the rim."""
    k, rim = 2 * np.pi / wavelength, np.hypot(radius, z)
    return complex(np.exp(1j * k * z) - z / rim * np.exp(1j * k * rim))
