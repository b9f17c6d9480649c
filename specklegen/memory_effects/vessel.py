"""Correlation of speckle in time above a vessel: g1 of the light that leaves each place of a surface.

    g1(d, tau) = E[w e^(-i k tau D(d)) e^(-2 x Y(d))] / E[w],
    D = sum (w_(b-1) - w_b) . V(x_b),    Y = sum m_b (1 - cos theta_b)

over the paths that leave at a distance d from the vessel's axis: those of the tissue, whatever d is, of which other
scatterings lie in the vessel (:mod:`specklegen.paths.vertices`). Paths and their mirror images weigh alike, so that g1
is real, E[w cos(k tau D) e^(-2 x Y)] / E[w], and the same on both sides of the vessel.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from specklegen.paths.vertices import VertexPaths

Profile = Literal["parabolic", "plug"]
"""Of a flow: Poiseuille's, which rests at the wall, or of one velocity."""
_ELEMENTS = 2**22  # of paths times lags at a time


class Vessel(NamedTuple):
    """A straight vessel, along the surface; lengths and times in the units of the medium and its motion.

    Attributes
    ----------
    depth : float
        Of its axis.
    speed : float
        Of its flow, on the axis.
    diffusion : float
        D of what is inside, beside the flow.
    tissue_diffusion : float
        D of what is outside.
    """

    depth: float
    radius: float
    speed: float
    profile: Profile = "parabolic"
    diffusion: float = 0.0
    tissue_diffusion: float = 0.0


@dataclass(frozen=True)
class LocalLight:
    """The light that leaves one place, path by path.

    Attributes
    ----------
    weight : float64[M]
        Share of the light, of sum 1 with ``rest``.
    turning : float64[M]
        k |D|: radians per unit of time.
    fading : float64[M]
        2 k^2 D Y, one over a unit of time.
    rest : float
        Share of the light that nothing moves.
    """

    weight: np.ndarray
    turning: np.ndarray
    fading: np.ndarray
    rest: float

    def field(self, lags: np.ndarray) -> np.ndarray:
        """g1 float64[n] at lags float64[n] of at least 0; at infinity what rests."""
        field = np.full(len(lags), self.rest)
        finite = np.flatnonzero(np.isfinite(lags))
        rows = max(1, _ELEMENTS // max(len(self.weight), 1))
        for part in np.array_split(finite, max(1, -(-len(finite) // rows))):
            lag = lags[part][:, None]
            field[part] += (np.cos(lag * self.turning) * np.exp(-lag * self.fading)) @ self.weight
        return field


def local_light(paths: VertexPaths, vessel: Vessel, distances: Sequence[float], wavelength: float) -> list[LocalLight]:
    """Light that leaves at distances from the axis of a vessel, to either side of it, by the same paths.

    Parameters
    ----------
    paths
        Of the tissue.
    vessel
        Along y.
    distances
        Of places from the vessel's axis, along the surface.
    wavelength
        Inside the medium.
    """
    k, count = 2 * np.pi / wavelength, len(paths)
    below = np.square(paths.depth - vessel.depth)
    within = np.flatnonzero(below < vessel.radius**2)  # of these some are in the vessel, wherever it lies
    owner, below, across, along = paths.path[within], below[within], paths.place[within, 0], paths.turn[within, 1]
    drop = paths.drop
    outside = vessel.tissue_diffusion * np.bincount(paths.path, drop, count)
    drop = (vessel.diffusion - vessel.tissue_diffusion) * drop[within]
    share = paths.weight / paths.weight.sum()

    def found(distance: float) -> LocalLight:
        turned, given = [], []
        sides = (distance, -distance) if distance else (0.0,)
        for side in sides:
            apart = np.square(across + side) + below
            inside = apart < vessel.radius**2
            speed = vessel.speed * (1 - apart / vessel.radius**2 if vessel.profile == "parabolic" else 1.0)
            turned.append(np.bincount(owner, np.where(inside, speed * along, 0.0), count))
            given.append(outside + np.bincount(owner, np.where(inside, drop, 0.0), count))
        turning, fading = k * np.abs(np.concatenate(turned)), 2 * k**2 * np.maximum(np.concatenate(given), 0.0)
        weight, moves = np.tile(share / len(sides), len(sides)), (turning > 0) | (fading > 0)
        return LocalLight(weight[moves], turning[moves], fading[moves], float(weight[~moves].sum()))

    return [found(float(distance)) for distance in distances]
