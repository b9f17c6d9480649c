"""Thin soft strips anywhere in flatland: the exact field, scattering of every order included.

On the strips (u = 0, thin, perfectly reflecting) the jump q of the normal derivative solves

    (i/4) int H_0(k|r - r'|) q(r') ds' = -u_inc(r),    u(r) = u_inc(r) + (i/4) int H_0(k|r - r'|) q(r') ds'

for time e^{-i omega t}. This is the wave solver behind the comparisons of [Steinberg] Fig. 3. Strips may not touch.
Source: Colton and Kress, *Inverse Acoustic and Electromagnetic Scattering Theory*, section 3.6 (open arcs);
quadrature in `specklegen.oracles.straight_segments`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import hankel1

from specklegen.oracles.straight_segments import Segment, segment, single_layer

CHUNK = 1 << 21
"""Pairs of a point and a node treated at once; bounds the memory of fields."""


@dataclass(frozen=True)
class StripSolution:
    """The solved problem for one plane wave.

    Attributes
    ----------
    wavelength : float
    direction : float64[2]
    strips : tuple of Segment
    charges : complex128[n]
        q ds' at the nodes of all strips.
    """

    wavelength: float
    direction: np.ndarray
    strips: tuple[Segment, ...]
    charges: np.ndarray

    def field(self, points: np.ndarray) -> np.ndarray:
        """Total field complex128[P] at float64[P, 2], a few node distances away from every strip."""
        k = 2 * np.pi / self.wavelength
        nodes, u = np.concatenate([s.points for s in self.strips]), np.exp(1j * k * (points @ self.direction))
        rows = max(1, CHUNK // len(nodes))
        for first in range(0, len(points), rows):
            some = points[first : first + rows, None] - nodes
            u[first : first + rows] += 0.25j * hankel1(0, k * np.hypot(some[..., 0], some[..., 1])) @ self.charges
        return u

    def far_field(self, directions: np.ndarray) -> np.ndarray:
        """Amplitude g complex128[V] of u - u_inc -> g e^{i(kr - pi/4)} / sqrt(r) along unit vectors float64[V, 2]."""
        k, nodes = 2 * np.pi / self.wavelength, np.concatenate([s.points for s in self.strips])
        total = np.exp(-1j * k * (np.asarray(directions) @ nodes.T)) @ self.charges
        return 0.25j * np.sqrt(2 / (np.pi * k)) * total


def strip_solver(
    strips: Sequence[tuple[tuple[float, float], tuple[float, float]]], direction: tuple[float, float] = (0.0, 1.0),
    wavelength: float = 1.0, nodes: float = 8,
) -> StripSolution:  # fmt: skip
    """Solve soft strips, each given by its two end points, lit by e^{ik d.r}, with ``nodes`` nodes a wavelength.

    8 nodes a wavelength give 5e-14 where strips are a wavelength apart; memory is 16 (8 L)^2 bytes for a total length
    of L wavelengths.
    """
    d = np.asarray(direction, dtype=np.float64)
    parts = tuple(segment(a, b, wavelength, nodes) for a, b in strips)
    k = 2 * np.pi / wavelength
    matrix = np.vstack([np.hstack([_block(a, b, k) for b in parts]) for a in parts])
    matrix *= 0.25j
    light = np.exp(1j * k * (np.concatenate([s.points for s in parts]) @ d))
    densities = np.linalg.solve(matrix, -light)
    steps = np.concatenate([np.full(s.count, s.step) for s in parts])
    return StripSolution(wavelength, d, parts, densities * steps)


def _block(at: Segment, of: Segment, k: float) -> np.ndarray:
    if at is of:
        return single_layer(at, k)
    apart = at.points[:, None] - of.points
    return hankel1(0, k * np.hypot(apart[..., 0], apart[..., 1])) * of.step
