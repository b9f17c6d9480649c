"""Radiative transfer through a plane slab by adding and doubling: exact, without a random number, at any depth.

A layer reflects and transmits as two positive kernels, those of a layer so thin that light scatters in it at most once.
Two equal layers on top of each other make one of twice the depth. Sums of positive numbers lose no relative precision,
so that light of 1e-40 is as exact as light of 1. The direction of the axis is a node of weight 0: light arrives and is
seen there, and never scatters into it alone. Source: van de Hulst, *Multiple Light Scattering* (1980), ch. 4; Grant and
Hunt, Proc. R. Soc. A 313, 183 (1969).
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from specklegen.core.errors import reject
from specklegen.core.quadrature import gauss_legendre

THINNEST = 1e-8
"""Optical depth from which layers are doubled; a layer's double scattering is left out there."""


@dataclass(frozen=True)
class SlabLight:
    """Scattered light of a slab for unit irradiance along the axis.

    Attributes
    ----------
    transmitted, reflected : float
        Along the axis, behind the slab and straight back, per area of the face and steradian, single scattering
        included.
    transmittance, reflectance : float
        Shares of the light that leave by the two faces, unscattered light included.
    """

    transmitted: float
    reflected: float
    transmittance: float
    reflectance: float


def adding_doubling(optical_depth: float, *, albedo: float, g: float, nodes: int = 64) -> SlabLight:
    """Light of a slab of Henyey-Greenstein scatterers at normal incidence, seen along the axis.

    Parameters
    ----------
    optical_depth, albedo, g
        Of the slab; g to about 0.95 with 64 nodes.
    nodes
        Gauss nodes of the cosine, from 0 to 1.

    Raises
    ------
    RuleError
        For an optical depth that is not above 0.
    """
    if not optical_depth > 0:
        reject("adding_doubling optical_depth", "greater than 0", optical_depth)
    x, w = gauss_legendre(nodes)
    mu, w = np.append((1 + x) / 2, 1.0), np.append(w / 2, 0.0)
    order = np.arange(2 * nodes)
    moments = (order + 0.5) * np.power(float(g), order)
    ahead = (legendre.legvander(mu, order[-1]) * moments) @ legendre.legvander(mu, order[-1]).T  # per cosine
    back = (legendre.legvander(-mu, order[-1]) * moments) @ legendre.legvander(mu, order[-1]).T
    lost = w @ (ahead + back)  # 1, but for what the nodes do not resolve
    halvings = int(np.ceil(np.log2(max(optical_depth / THINNEST, 1.0))))
    depth = optical_depth / 2**halvings
    straight, scattered = np.exp(-depth / mu), -albedo * np.expm1(-depth / mu)
    through, returned = ahead / lost * scattered, back / lost * scattered
    for _ in range(halvings):
        through, returned, straight = _doubled(through, returned, straight, w)
    return SlabLight(
        transmitted=float(through[-1, -1] / (2 * np.pi)),
        reflected=float(returned[-1, -1] / (2 * np.pi)),
        transmittance=float((w @ through)[-1] + straight[-1]),
        reflectance=float((w @ returned)[-1]),
    )


def _doubled(
    through: np.ndarray, returned: np.ndarray, straight: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kernels [out, in] of scattered light, and what goes straight on, of two equal layers from those of one."""
    twice = (returned * w) @ returned
    again = np.linalg.solve(np.eye(len(w)) - twice * w, twice)  # two reflections, four, six, ...
    down = through + (again * w) @ through + again * straight
    up = (returned * w) @ down + returned * straight
    return (
        (through * w) @ down + through * straight + straight[:, None] * down,
        returned + (through * w) @ up + straight[:, None] * up,
        straight * straight,
    )
