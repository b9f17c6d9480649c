"""Light that runs from edge to edge across an opening: pairs of parallel edges that face each other.

Each edge sends a wave along the screen to the edge opposite, the distance w away, which diffracts it as a cylindrical
wave that comes from phi' = pi, and sends one back. Let alpha_j e^{ik cos(beta) t} be the wave that arrives at edge j,
t along it, k' = k sin(beta) and s = w / sin(beta). For the pair (i, j)

    alpha_j = e^{ik'w} / sqrt(s) [ u_i D(pi, phi'_i; s sin(beta)^2) + alpha_i D(pi, pi; (s/2) sin(beta)^2) ]

and the same with i and j exchanged: two linear equations hold diffraction of all orders. For soft screens the first
term is what single diffraction lacks most; hard edges send nothing along the screen at normal incidence.
A cylindrical wave keeps the spreading 1/sqrt(s) of a straight edge; sqrt(s'/(s (s + s'))) is that of a spherical one.
Source: Kouyoumjian and Pathak, Proc. IEEE 62, 1448 (1974); Keller, J. Appl. Phys. 28, 426 (1957) (slit, all orders).
"""

from dataclasses import dataclass

import numpy as np

from specklegen.wavetracing.light import PlaneWave
from specklegen.wavetracing.opening import Rim
from specklegen.wavetracing.wedge import NEAREST, wedge_coefficients

PARALLEL = 1e-9
"""Sine between edges that count as parallel."""


@dataclass(frozen=True)
class Facing:
    """Waves that arrive at an edge from the opposite one.

    Attributes
    ----------
    edge : int
        Where it arrives.
    width : float
        Distance w of the two edges.
    lower, upper : float
        Positions along this edge, from its start, that the other edge faces.
    soft, hard : complex
        alpha at the start of this edge, for light of amplitude 1 at the origin.
    """

    edge: int
    width: float
    lower: float
    upper: float
    soft: complex
    hard: complex


def facing_edges(rim: Rim, light: PlaneWave) -> list[Facing]:
    """Return the waves that run from edge to edge, two for each pair of parallel edges with nothing between them."""
    lengths = np.hypot(*(rim.ends - rim.starts).T)
    along = (rim.ends - rim.starts) / np.where(lengths > 0, lengths, 1)[:, None]
    metal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    waves = []
    for j in np.flatnonzero(lengths > 0):
        into = -metal[j]
        first, last = ((p - rim.starts[j]) @ np.stack([into, along[j]], axis=1) for p in (rim.starts, rim.ends))
        lower, upper = np.minimum(first[:, 1], last[:, 1]), np.maximum(first[:, 1], last[:, 1])
        overlaps = np.minimum(upper, lengths[j]) > np.maximum(lower, 0)
        opposite = (along @ along[j] < 0) & (np.abs(along @ into) < PARALLEL) & (first[:, 0] > 0) & overlaps
        if not opposite.any():
            continue
        nearest = float(first[opposite, 0].min())
        between = (np.maximum(first[:, 0], last[:, 0]) > 0) & (np.minimum(first[:, 0], last[:, 0]) < nearest) & overlaps
        between &= np.abs(along @ into) >= PARALLEL
        # Edges that join the two at their ends bound the opening, and stand in nobody's way.
        between &= (lower < lengths[j] * (1 - PARALLEL)) & (upper > lengths[j] * PARALLEL) & (upper > lower)
        if between.any():
            continue
        for i in np.flatnonzero(opposite & (first[:, 0] <= nearest * (1 + PARALLEL))):
            amplitudes = _arriving(light, rim.starts[j], along[j], metal[j], nearest)
            if amplitudes is not None:
                waves.append(Facing(int(j), nearest, float(lower[i]), float(upper[i]), *amplitudes))
    return waves


def _arriving(
    light: PlaneWave, start: np.ndarray, along: np.ndarray, metal: np.ndarray, width: float
) -> tuple[complex, complex] | None:
    """Alpha soft and hard at the start of an edge, or None where the two edges are within 1/k of each other."""
    k, d = light.wavenumber, light.direction
    cosine = float(d[:2] @ along)
    sine = float(np.hypot(d[:2] @ metal, d[2]))
    if k * sine * width < NEAREST:
        return None
    s, beta = width / sine, np.arctan2(sine, cosine)
    here, there = float(np.arctan2(d[2], -d[:2] @ metal)), float(np.arctan2(d[2], d[:2] @ metal))
    at_here, at_there = (np.exp(1j * k * (d[:2] @ p)) for p in (start, start - width * metal))
    step = np.exp(1j * k * sine * width) / np.sqrt(s)
    amplitudes = []
    for boundary in (0, 1):
        once = [wedge_coefficients(2.0, np.pi, phi, s * sine**2, k, beta)[boundary] * step for phi in (here, there)]
        again = wedge_coefficients(2.0, np.pi, np.pi, s / 2 * sine**2, k, beta)[boundary] * step
        # alpha_here = there's first wave + again alpha_there, and the other way round.
        sent, returned = at_there * once[1], at_here * once[0]
        amplitudes.append(complex((sent + again * returned) / (1 - again**2)))
    return amplitudes[0], amplitudes[1]
