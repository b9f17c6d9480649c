"""Diffraction of uniform light inside a beam's region: one wavevector from the pattern of straight edges.

|Psi|^2 is drawn by rejection under A^2 inside the disc |xi| < c and N sum_e |Psi_e|^2 outside [S. Steinberg, M. Pharr,
*Wave Tracing*, Eqs. 22-25, and `specklegen.wavetracing.kernels.patterns`]. Openings here are seen from ever new
directions, so no masses are computed: edge e is proposed under the larger envelope |e|^2 sinc^2(p|e|/2) 2/c, of mass
4 pi |e| / c, and a proposal that G(p) < 1/c turns down starts over from the choice of the component. The draws are as
exact; the tries are more, and cheap. Beams whose own field decides are those of
`specklegen.wavetracing.kernels.masked_beams`.
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.wavetracing.kernels.apertures import polygon_transform
from specklegen.wavetracing.kernels.patterns import draw_sinc

TRIES = 1024
"""Tries for each edge; then the draw fails."""
_DISC = 3.0  # c sqrt(A): the best value lies between 2.3 and 3.5 for compact openings
_TURN = 0.5 / math.pi
_ONE = np.uint64(1)


@inlined
def _powers(edges, x, y):
    """|sum_e Psi_e|^2 and sum_e |Psi_e|^2, both times |xi|^4, away from xi = 0, where the sum cancels."""
    real = imag = power = 0.0
    for e in range(edges.shape[0]):
        b = 0.5 * (x * edges[e, 2] + y * edges[e, 3])
        sine, _ = sincos_turns(b * _TURN)
        size = (x * edges[e, 3] - y * edges[e, 2]) * (sine / b if abs(b) > 1e-4 else 1.0 - b * b / 6.0)
        sine, cosine = sincos_turns((x * edges[e, 0] + y * edges[e, 1]) * _TURN)
        real += size * cosine
        imag += size * sine
        power += size * size
    return real * real + imag * imag, power


@kernel
def draw_polygon(key0, key1, path, counter, edges, area):
    """One xi of an opening's pattern: (x, y, counter behind the draws, tries, found or not).

    edges : float64[N, 4]   midpoint and vector of each edge, all loops in one sense
    area  : float           of the opening, positive
    """
    count = edges.shape[0]
    c = _DISC / math.sqrt(area)
    total = 0.0
    for e in range(count):
        total += math.sqrt(edges[e, 2] * edges[e, 2] + edges[e, 3] * edges[e, 3])
    disc = math.pi * c * c * area * area
    rims = count * 4.0 * math.pi * total / c
    tries = 0
    while tries < TRIES * count:
        u, keep, v, w = uniforms(key0, key1, np.uint64(0), path, counter)
        counter += _ONE
        u *= disc + rims
        tries += 1
        if u < disc:
            r = c * math.sqrt(v)
            sine, cosine = sincos_turns(w)
            x, y = r * cosine, r * sine
            value = polygon_transform(edges, area, x, y)
            if keep * area * area < value.real * value.real + value.imag * value.imag:
                return x, y, counter, tries, True
        else:
            target, chosen = (u - disc) / rims * total, 0
            length = math.sqrt(edges[0, 2] * edges[0, 2] + edges[0, 3] * edges[0, 3])
            while target > length and chosen < count - 1:
                target -= length
                chosen += 1
                length = math.sqrt(edges[chosen, 2] * edges[chosen, 2] + edges[chosen, 3] * edges[chosen, 3])
            if length == 0.0:
                continue
            s, counter = draw_sinc(key0, key1, path, counter)
            p = 2.0 * s / length
            share = min(1.0, abs(p) / c)
            alpha = math.asin(share)
            a, b, t, sign = uniforms(key0, key1, np.uint64(0), path, counter)
            counter += _ONE
            if a * abs(p) >= c * 0.5 * (alpha + share * math.sqrt(1.0 - share * share)):
                continue
            sine, cosine = sincos_turns(alpha * b * _TURN)
            while t > cosine * cosine:
                _, b, t, sign = uniforms(key0, key1, np.uint64(0), path, counter)
                counter += _ONE
                sine, cosine = sincos_turns(alpha * b * _TURN)
            q = abs(p) * cosine / sine
            q = q if sign < 0.5 else -q
            ex, ey = edges[chosen, 2] / length, edges[chosen, 3] / length
            x, y = p * ex + q * ey, p * ey - q * ex
            value, bound = _powers(edges, x, y)
            if keep * count * bound < value:
                return x, y, counter, tries, True
    return 0.0, 0.0, counter, tries, False
