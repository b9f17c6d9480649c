"""The field behind an opening in a thin perfect screen by UTD: geometric light, and diffracted rays of each edge.

A plane wave that makes the angle beta with an edge leaves it on a cone of the same angle. The ray that reaches P, at
the distance d from the edge's line, starts at Q, d cot(beta) back along the edge; beyond its ends there is none.

    u(P) = w e^{ik d.P} + sum_e e^{ik d.Q} D_{s,h} e^{iks} / sqrt(s),   s = d / sin(beta),   n = 2

w is the winding number of the opening about the point that P's geometric ray comes from, counted with the sides of the
edges that the *diffraction angles* give: a receiver on a shadow boundary, where an edge term jumps by one half up or
down, sees the geometric light jump the other way at the very same rounded angle.

Light that ran from a parallel edge across the opening leaves as a second ray, by `specklegen.wavetracing.facing_edges`.

Not included: rays between edges that are not parallel, rays from corners (steps of the size of the edge's wave where Q
leaves the edge). An edge shorter than its Fresnel zone, 2 sqrt(lambda z), is mostly corners: there a warning says that
the field is wrong.
Source: Kouyoumjian and Pathak, Proc. IEEE 62, 1448 (1974); Keller, J. Opt. Soc. Am. 52, 116 (1962).
"""

from typing import Literal

import numpy as np

from specklegen.core.arguments import choice
from specklegen.core.errors import reject, warn_user
from specklegen.wavetracing.facing_edges import facing_edges
from specklegen.wavetracing.light import PlaneWave
from specklegen.wavetracing.opening import Rim
from specklegen.wavetracing.wedge import NEAREST, geometric_shares, wedge_coefficients

Polarisation = Literal["soft", "hard"]

FAR = 10.0
"""Distance in heights z from which on an edge is too far off for its corners to be warned of."""


def edge_ray_field(rim: Rim, light: PlaneWave, points: np.ndarray, polarisation: Polarisation) -> np.ndarray:
    """Return the field complex128[P] at ``points`` float64[P, 3], z > 0.

    Raise a `RuleError` if the polarisation is unknown, or a point lies within 1/k of an edge.

    Warns
    -----
    DoubtWarning
        If an edge nearer than 10 z is shorter than its Fresnel zone.
    """
    choice("field_on_plane polarisation", polarisation, ("soft", "hard"))
    k, d = light.wavenumber, light.direction
    seen_y = points[:, 1] - points[:, 2] * (d[1] / d[2])  # where the geometric ray crossed the screen
    height = float(np.median(points[:, 2]))
    zone, shortest = 2 * np.sqrt(light.wavelength * height / d[2]), np.inf
    covered, edge_waves = np.zeros(len(points)), np.zeros(len(points), complex)
    facing = facing_edges(rim, light)
    for edge, (start, end) in enumerate(zip(rim.starts, rim.ends, strict=True)):
        length = float(np.hypot(*(end - start)))
        if length == 0:
            continue
        along = np.append((end - start) / length, 0.0)
        metal = np.array([along[1], -along[0], 0.0])  # away from the opening
        relative = points - np.append(start, 0.0)
        x, above, t = relative @ metal, relative[:, 2], relative @ along
        distance = np.hypot(x, above)
        if distance.min() < FAR * height:
            shortest = min(shortest, length)
        # From the lit face of the metal (towards -z) over the opening to the dark face.
        phi = 2 * np.pi - np.arctan2(above, x)
        incidence = float(np.arctan2(d[2], -d @ metal))
        inside = geometric_shares(2.0, phi, incidence)[:, 0]
        up, down = (start[1] <= seen_y) & (seen_y < end[1]), (end[1] <= seen_y) & (seen_y < start[1])
        covered += np.where(up, inside, 0) - np.where(down, 1 - inside, 0)
        cosine = float(d @ along)
        sine = float(np.hypot(d @ metal, d[2]))
        origin = t - distance * (cosine / sine)
        hit = (origin >= 0) & (origin <= length)
        if not (k * distance[hit] >= NEAREST).all():
            reject(
                "field_on_plane plane", "at least wavelength / 2 pi away from every edge for method 'utd'",
                float(distance[hit].min()), 'Use "boundary".',
            )  # fmt: skip
        s = distance[hit] / sine
        pair = wedge_coefficients(2.0, phi[hit], incidence, s * sine**2, k, np.arctan2(sine, cosine))
        path = d[:2] @ start + origin[hit] * cosine + s
        edge_waves[hit] += pair[polarisation == "hard"] * np.exp(1j * k * path) / np.sqrt(s)
        beta = np.arctan2(sine, cosine)
        for wave in (w for w in facing if w.edge == edge):
            before = origin - wave.width * (cosine / sine)  # where it left the edge opposite
            seen = hit & (before >= wave.lower) & (before <= wave.upper)
            s, crossed = distance[seen] / sine, wave.width / sine
            reach = s * crossed / (s + crossed) * sine**2
            pair = wedge_coefficients(2.0, phi[seen], np.pi, reach, k, beta)[polarisation == "hard"]
            arriving = wave.hard if polarisation == "hard" else wave.soft
            edge_waves[seen] += arriving * pair * np.exp(1j * k * (origin[seen] * cosine + s)) / np.sqrt(s)
    if shortest < zone:
        warn_user(
            f"field_on_plane: an edge is {shortest:.3g} long and its Fresnel zone {zone:.3g}, so that its corners "
            'matter, which method "utd" lacks: use "boundary" or "spectrum", or a nearer plane',
        )  # fmt: skip
    return covered * light.field(points) + light.amplitude * edge_waves
