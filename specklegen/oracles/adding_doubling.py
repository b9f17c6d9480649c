"""Radiative transfer through a plane slab by adding and doubling: exact, without a random number, at any depth.

A layer reflects and transmits as two positive kernels, those of a layer so thin that light scatters in it at most once.
Two equal layers on top of each other make one of twice the depth; different ones are added in the same way. Sums of
positive numbers lose no relative precision, so that light of 1e-40 is as exact as light of 1. The direction of the axis
is a node of weight 0: light arrives and is seen there, and never scatters into it alone. Source: van de Hulst,
*Multiple Light Scattering* (1980), ch. 4; Grant and Hunt, Proc. R. Soc. A 313, 183 (1969).

Scatterers that move take ``e^(-2x (1 - cos theta))`` off the field's correlation at every scattering,
``x = D k^2 tau``: their phase function times that is the phase function of a correlation that obeys radiative transfer
too (Ackerson et al., J. Thermophys. Heat Transfer 6, 577 (1992)), so that ratios of such light at x and at 0 are g1.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from specklegen.core.errors import reject
from specklegen.core.quadrature import gauss_legendre

Kernels = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Scattered light behind and before a layer [out, in], and what goes straight on [in]."""
THINNEST = 1e-8
"""Optical depth from which layers are doubled; a layer's double scattering is left out there."""


@dataclass(frozen=True)
class SlabLight:
    """Scattered light of a slab for unit irradiance along the axis.

    Attributes
    ----------
    transmitted, reflected : float
        Along the axis, behind the slab and straight back, or in the directions of another cosine, per area of the
        face and steradian, single scattering included.
    transmittance, reflectance : float
        Shares of the light that leave by the two faces, unscattered light included.
    """

    transmitted: float
    reflected: float
    transmittance: float
    reflectance: float


def adding_doubling(
    optical_depth: float, *, albedo: float, g: float, nodes: int = 64, motion: float = 0.0, view: float = 1.0
) -> SlabLight:
    """Light of a slab of Henyey-Greenstein scatterers at normal incidence, seen along the axis.

    Parameters
    ----------
    optical_depth, albedo, g
        Of the slab; g to about 0.95 with 64 nodes.
    nodes
        Gauss nodes of the cosine, from 0 to 1.
    motion
        x = D k^2 tau, of Brownian scatterers that have moved for a lag tau; all light is then what is left of its
        correlation with that at lag 0.
    view
        Cosine, above 0, of the angle between the axis and the views.
    """
    if not optical_depth > 0:
        reject("adding_doubling optical_depth", "greater than 0", optical_depth)
    return layered_light([(optical_depth, albedo, g)], nodes=nodes, motion=motion, view=view)


def layered_light(
    layers: Sequence[tuple[float, float, float]], *, nodes: int = 64, motion: float = 0.0, view: float = 1.0
) -> SlabLight:
    """Light of layers of one refractive index, each (optical depth, albedo, g), from the one that light enters first.

    A layer is put on top of all that lie below it, from the last to the first. Motion and view: as above.
    """
    if not 0 <= motion < np.inf:
        reject("adding_doubling motion", "finite and at least 0", motion)
    if not 0 < view <= 1:
        reject("adding_doubling view", "above 0 and at most 1", view)
    x, w = gauss_legendre(nodes)
    mu, w = np.concatenate([(1 + x) / 2, [1.0, view]]), np.append(w / 2, [0.0, 0.0])
    *above, (depth, albedo, g) = layers
    through, returned, straight = _layer(depth, albedo, g, mu, w, motion)
    for depth, albedo, g in reversed(above):
        through, returned, straight = _added(_layer(depth, albedo, g, mu, w, motion), (through, returned, straight), w)
    return SlabLight(
        transmitted=float(through[-1, -2] / (2 * np.pi)), reflected=float(returned[-1, -2] / (2 * np.pi)),
        transmittance=float((w @ through)[-2] + straight[-2]), reflectance=float((w @ returned)[-2]),
    )  # fmt: skip


def _moving(g: float, motion: float, orders: int) -> np.ndarray:
    """Legendre moments of the phase function times e^(-2x (1 - cosine)), float64[orders]: the product of two series.

    The phase function is the series of its own first moments, as at rest, so that x = 0 leaves every digit.
    """
    order = np.arange(orders)
    moments = np.power(float(g), order)
    if not motion:
        return moments
    cosine, weight = gauss_legendre(2 * orders)
    waves = legendre.legvander(cosine, orders - 1)
    lobe = waves @ ((order + 0.5) * moments)
    return (weight * lobe * np.exp(-2 * motion * (1 - cosine))) @ waves


def _layer(depth: float, albedo: float, g: float, mu: np.ndarray, w: np.ndarray, motion: float) -> Kernels:
    orders = 2 * (len(mu) - 2)
    here, mirrored = (legendre.legvander(side, orders - 1) * (np.arange(orders) + 0.5) for side in (mu, -mu))
    waves = legendre.legvander(mu, orders - 1).T

    def lobes(moments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (here * moments) @ waves, (mirrored * moments) @ waves  # per cosine

    ahead, back = lobes(_moving(g, 0.0, orders))
    lost = w @ (ahead + back)  # 1, but for what the nodes do not resolve
    if motion:
        ahead, back = lobes(_moving(g, motion, orders))
    halvings = int(np.ceil(np.log2(max(depth / THINNEST, 1.0))))
    depth /= 2**halvings
    straight, scattered = np.exp(-depth / mu), -albedo * np.expm1(-depth / mu)
    layer = ahead / lost * scattered, back / lost * scattered, straight
    for _ in range(halvings):
        layer = _added(layer, layer, w)
    return layer


def _added(top: Kernels, below: Kernels, w: np.ndarray) -> Kernels:
    """Kernels of a homogeneous layer on top of others, for light from above."""
    through, returned, straight = top
    onward, sent_back, on = below
    twice = (returned * w) @ sent_back
    again = np.linalg.solve(np.eye(len(w)) - twice * w, twice)  # two reflections, four, six, ...
    down = through + (again * w) @ through + again * straight
    up = (sent_back * w) @ down + sent_back * straight
    return (
        (onward * w) @ down + onward * straight + on[:, None] * down,
        returned + (through * w) @ up + straight[:, None] * up,
        straight * on,
    )
