"""Elliptic cones: the envelopes of beams.

A cone holds 3 standard deviations of a Gaussian beam. In the frame (x, y, d) of its rows, at depth z along d,

    |(x, e y)| <= a + z t,   e = a / b,   t = max(tan_a, e tan_b),

so that it is circular once y is scaled, as queries need it. Where tan_a / a = tan_b / b, which every interaction
restores, t = tan_a and nothing is added; a beam that starts elliptic has tan_a a = tan_b b instead, and its cone is
wider than its envelope along one axis [S. Steinberg, M. Pharr, *Wave Tracing*, section on elliptic cones].
"""

from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.units import LENGTH
from specklegen.core.values import Array, NonNegative, Value, unit_vectors
from specklegen.wavetracing.kernels.cones import CONE


def transverse_frame(direction: np.ndarray, across: np.ndarray | None = None) -> np.ndarray:
    """Orthonormal rows (x, y, d) about a direction float64[3], right-handed.

    x is ``across`` made perpendicular to d; by default the coordinate axis that d is least along.
    """
    d = np.asarray(direction, float)
    d = d / np.linalg.norm(d)
    given = np.eye(3)[np.abs(d).argmin()] if across is None else np.asarray(across, float)
    x = given - (given @ d) * d
    x = x / np.linalg.norm(x)
    return np.array([x, np.cross(d, x), d])


class Region(Value):
    """An ellipsoid { r : (r - centre)^T matrix^-1 (r - centre) <= 1 } in which a beam interacts."""

    centre: Array  # float64[3]
    matrix: Array  # float64[3, 3], R diag(a^2, b^2, c^2) R^T


class Cone(Value):
    """An elliptic cone, the envelope of a beam.

    Attributes
    ----------
    origin : float64[3]
        Centre of the cross-section of depth 0 (a length).
    frame : float64[3, 3]
        Orthonormal rows: the two axes of the cross-section, and the direction of travel.
    a, b : float
        Semi-axes at depth 0 (a length); both 0 for a point, else both positive.
    tan_a, tan_b : float
        Tangents of the half opening angles, at least 0.
    least : float
        Smallest product a b tan_a tan_b after an interaction, 81 / (4 k^2) for a beam; 0 asks for none.

    Raises
    ------
    RuleError
        For a frame that is not orthonormal, or one semi-axis of 0.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.wavetracing import Cone
    >>> cone = Cone(origin=[0, 0, 0], frame=np.eye(3), a=1.0, b=1.0, tan_a=0.1, tan_b=0.1)
    >>> cone.contains([[0.0, 1.5, 10.0], [0.0, 2.5, 10.0]])  # its radius there is 2
    array([ True, False])
    """

    origin: Annotated[Array, LENGTH]
    frame: Array
    a: Annotated[NonNegative, LENGTH]
    b: Annotated[NonNegative, LENGTH]
    tan_a: NonNegative
    tan_b: NonNegative
    least: Annotated[NonNegative, LENGTH] = 0.0

    def __init__(self, origin, frame, a, b, tan_a, tan_b, least=0.0):
        super().__init__(origin=origin, frame=frame, a=a, b=b, tan_a=tan_a, tan_b=tan_b, least=least)

    @model_validator(mode="after")
    def _checked(self) -> Self:
        if self.origin.shape != (3,):
            reject("Cone.origin", "a point float64[3]", self.origin.shape)
        if self.frame.shape != (3, 3) or np.abs(self.frame @ self.frame.T - np.eye(3)).max() > 1e-9:
            reject("Cone.frame", "three orthonormal rows", self.frame, "Use transverse_frame(direction).")
        if (self.a == 0) != (self.b == 0):
            reject("Cone.b", "0 exactly where a is 0", self.b, "A cross-section is a point or an ellipse.")
        return self

    @property
    def ratio(self) -> float:
        """Stretch e = a / b; of a point, tan_a / tan_b."""
        if self.b > 0:
            return self.a / self.b
        return self.tan_a / self.tan_b if self.tan_b > 0 and self.tan_a > 0 else 1.0

    @property
    def slope(self) -> float:
        """Slope t = max(tan_a, e tan_b), by which the scaled cone widens along its axis."""
        return max(self.tan_a, self.ratio * self.tan_b)

    def packed(self) -> np.ndarray:
        """Return what kernels know of the cone, float64[CONE]; see `specklegen.wavetracing.kernels.cones`."""
        out = np.empty(CONE)
        out[:3] = self.origin
        out[3:12] = (self.frame * np.array([1.0, self.ratio, 1.0])[:, None]).ravel()
        out[12], out[13] = self.a, self.slope
        return out

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return whether points float64[..., 3] lie in the cone, on the side of its mouth; bool[...]."""
        x, y, z = np.moveaxis((np.asarray(points, float) - self.origin) @ self.frame.T, -1, 0)
        width = self.a + self.slope * z
        return (width >= 0) & (np.hypot(x, self.ratio * y) <= width)

    def region(self, depth: float, half_depth: float | None = None) -> Region:
        """Return the ellipsoid of the cross-section at a depth; half depth along the axis: by default semi-axis a.

        A region of interaction is [depth, depth + 2 a] long, hence this default.
        """
        a = self.a + depth * self.slope
        b = a / self.ratio
        c = a if half_depth is None else half_depth
        matrix = self.frame.T @ np.diag([a * a, b * b, c * c]) @ self.frame
        return Region(centre=self.origin + depth * self.frame[2], matrix=(matrix + matrix.T) / 2)

    def after(self, region: Region, direction: np.ndarray) -> "Cone":
        """Return the cone that leaves a region along ``direction`` float64[3].

        Its cross-section is the silhouette of the region's ellipsoid, a', b' = sqrt(eig P A P^T). The product T of
        the two tangents is kept: tan_a' = sqrt(T a'/b'), tan_b' = sqrt(T b'/a'). Where a' b' T falls below ``least``,
        both axes are scaled by the root of what is needed over what there is.
        """
        frame = transverse_frame(unit_vectors("Cone.after direction", np.asarray(direction, float)))
        values, vectors = np.linalg.eigh(frame[:2] @ region.matrix @ frame[:2].T)
        b, a = np.sqrt(np.maximum(values, 0.0))
        if not b > 0:
            reject("Cone.after region", "an ellipsoid seen with a positive area", region.matrix)
        product = self.tan_a * self.tan_b
        if a * b * product < self.least:
            if product == 0:
                reject("Cone.tan_a tan_b", "positive where the cone belongs to a beam", product)
            grow = np.sqrt(self.least / (a * b * product))
            a, b = a * grow, b * grow
        x = vectors[:, 1] @ frame[:2]
        rows = np.array([x, np.cross(frame[2], x), frame[2]])
        tan_a, tan_b = np.sqrt(product * a / b), np.sqrt(product * b / a)
        return Cone(region.centre, rows, float(a), float(b), float(tan_a), float(tan_b), self.least)
