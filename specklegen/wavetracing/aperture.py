"""The aperture operator: from the field in an opening to wavevectors, Psi(xi) = int u(r) e^{-i xi.r} d^2r.

xi = k (d_x, d_y) - k (i_x, i_y) is what diffraction adds to the wavevector in the plane of the opening, u the
amplitude of the light there less its plane phase. With uniform u the polygon's edges suffice, exactly; with any other
u the opening is cut into triangles on which u is linear. [Steinberg] Eqs. 22-24; formulae and how they avoid
cancellation in `specklegen.wavetracing.kernels.apertures`. Babinet: the transform of an opening is that of the beam
less those of what stands in it, by linearity.

The far field behind the opening is (k / 2 pi i) (e^{ikr} / r) cos(theta) Psi.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import finite_numbers, real_array
from specklegen.core.errors import reject
from specklegen.wavetracing.kernels.apertures import edge_transform, triangle_transform
from specklegen.wavetracing.opening import Opening, Rim, rim_of

Amplitude = complex | Callable[[np.ndarray], np.ndarray]
"""A number, or a function of points float64[P, 2] that returns complex128[P]."""

MOST_TRIANGLES = 1 << 18
"""Triangles that an amplitude may be resolved into."""


def aperture_transform(
    opening: Opening | Rim, xi: ArrayLike, amplitude: Amplitude = 1.0, *, tolerance: float = 1e-3
) -> np.ndarray:
    """Return Psi(xi) of an opening.

    Parameters
    ----------
    opening
        A loop float64[n, 2], or several: outer ones counter-clockwise, holes clockwise.
    xi
        float64[..., 2], wavevectors in the plane of the opening, radians per unit length.
    amplitude
        u: a number, exact to rounding for any xi; or a function of points float64[P, 2], which is taken as linear
        on triangles.
    tolerance
        Triangles are cut into four until u at the middles of their edges is linear to this share of the largest |u|.

    Returns
    -------
    complex128[...]
        An area times the unit of u. An opening of no area gives 0.

    Raises
    ------
    RuleError
        If the opening is not made of loops, xi not finite or not of two components, or the amplitude not finite or
        not resolved by 262 144 triangles.

    Examples
    --------
    >>> from specklegen.wavetracing import aperture_transform
    >>> square = [[-5, -5], [5, -5], [5, 5], [-5, 5]]
    >>> aperture_transform(square, [0.0, 0.0])  # its area
    array(100.+0.j)
    """
    rim = rim_of("aperture_transform opening", opening)
    xi = _wavevectors("aperture_transform xi", xi)
    flat = np.ascontiguousarray(xi.reshape(-1, 2))
    out = np.zeros(len(flat), np.complex128)
    if callable(amplitude) and not isinstance(amplitude, type):
        triangles, values = resolve(rim.triangles, amplitude, tolerance)
        triangle_transform(triangles - rim.centre, values, flat, out)
        out *= np.exp(-1j * (flat @ rim.centre))
    else:
        number: Any = amplitude
        factor = complex(finite_numbers("aperture_transform amplitude", number, 0))
        edge_transform(rim.about_centre, rim.area, *map(float, rim.centre), flat, out)
        out *= factor
    return out.reshape(xi.shape[:-1])


def gaussian_mass(polygon: Opening, covariance: ArrayLike, mean: ArrayLike = (0.0, 0.0)) -> float:
    """Return the mass of a normal distribution over a polygon, by Owen's T function.

    In whitened coordinates an edge at the distance h from the mean, seen from there between the angles theta_1 and
    theta_2 from its perpendicular: it adds
    sign(h) [(theta_2 - theta_1) / 2 pi - T(|h|, tan theta_2) + T(|h|, tan theta_1)].

    Parameters
    ----------
    polygon
        As an opening: holes take mass off.
    covariance
        float64[2, 2], symmetric and positive definite, an area.
    mean
        float64[2].

    Returns
    -------
    float
        Between 0 and 1, to 1e-15.

    Raises
    ------
    RuleError
        If the covariance is not positive definite, the mean not finite, the polygon not made of loops.

    Notes
    -----
    Owen, Ann. Math. Stat. 27, 1075 (1956).

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.wavetracing import gaussian_mass
    >>> square = [[-1, -1], [1, -1], [1, 1], [-1, 1]]
    >>> round(gaussian_mass(square, covariance=np.eye(2)), 3)  # within one sigma along both axes
    0.466
    """
    from scipy.special import owens_t

    rim = rim_of("gaussian_mass polygon", polygon)
    covariance, mean = real_array("gaussian_mass covariance", covariance), real_array("gaussian_mass mean", mean)
    if covariance.shape != (2, 2) or not np.isfinite(covariance).all() or not np.array_equal(covariance, covariance.T):
        reject("gaussian_mass covariance", "a finite symmetric matrix of shape (2, 2)", covariance)
    if not (np.linalg.eigvalsh(covariance) > 0).all():
        reject("gaussian_mass covariance", "positive definite", covariance)
    if mean.shape not in ((), (2,)) or not np.isfinite(mean).all():
        reject("gaussian_mass mean", "finite, of shape (2,)", mean)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance)).T
    a, b = (rim.starts - mean) @ whiten, (rim.ends - mean) @ whiten
    length = np.hypot(*(b - a).T)
    a, b, length = a[length > 0], b[length > 0], length[length > 0]
    along = (b - a) / length[:, None]
    h = a[:, 0] * along[:, 1] - a[:, 1] * along[:, 0]  # positive where the mean lies on the left
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # lines through the mean, or all but
        first, last = ((p * along).sum(axis=1) / np.abs(h) for p in (a, b))
        angle = (np.arctan(last) - np.arctan(first)) / (2 * np.pi)
        mass = np.sign(h) * (angle - owens_t(np.abs(h), last) + owens_t(np.abs(h), first))
    return float(np.clip(mass[h != 0].sum(), 0.0, 1.0))


def resolve(
    triangles: np.ndarray, amplitude: Callable[[np.ndarray], np.ndarray], tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Cut triangles into four until ``amplitude`` is linear on them: float64[T, 3, 2] and complex128[T, 3]."""
    if not 0 < tolerance < 1:
        reject("aperture_transform tolerance", "between 0 and 1", tolerance)
    done, left, largest = [], triangles, 0.0
    count = 0
    for depth in range(40):
        if not len(left):
            break
        corners = _values(amplitude, left)
        middles = (left + np.roll(left, -1, axis=1)) / 2
        between = _values(amplitude, middles)
        largest = max(largest, np.abs(corners).max(initial=0.0), np.abs(between).max(initial=0.0))
        bent = np.abs(between - (corners + np.roll(corners, -1, axis=1)) / 2).max(axis=1)
        # Two cuts at least: the middles of a wide triangle may all miss a narrow beam.
        fine = (bent <= tolerance * largest) & (depth >= 2)
        done.append((left[fine], corners[fine]))
        left, middles = left[~fine], middles[~fine]
        count += int(fine.sum())
        if count + 4 * len(left) > MOST_TRIANGLES:
            reject(
                "aperture_transform amplitude", f"resolved by {MOST_TRIANGLES} triangles", f"tolerance {tolerance:g}",
                "Raise the tolerance, or take off the plane part of the phase.",
            )  # fmt: skip
        inner = [np.stack([left[:, n], middles[:, n], middles[:, n - 1]], axis=1) for n in range(3)]
        left = np.concatenate([*inner, middles])
    return np.concatenate([t for t, _ in done]), np.concatenate([v for _, v in done])


def _values(amplitude: Callable[[np.ndarray], np.ndarray], corners: np.ndarray) -> np.ndarray:
    values = np.asarray(amplitude(corners.reshape(-1, 2)), dtype=np.complex128)
    if values.shape != (corners.size // 2,) or not np.isfinite(values).all():
        reject("aperture_transform amplitude", "finite, one value a point", values)
    return values.reshape(corners.shape[:2])


def _wavevectors(field: str, xi: ArrayLike) -> np.ndarray:
    xi = real_array(field, xi)
    if xi.ndim < 1 or xi.shape[-1] != 2 or not np.isfinite(xi).all():
        reject(field, "finite, of shape (..., 2)", xi)
    return xi
