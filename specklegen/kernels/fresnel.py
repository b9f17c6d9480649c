"""Fresnel reflection of unpolarised light at a face, plain or behind a thin wall.

    R(mu) = (R_s + R_p) / 2
    R_s = [(n mu - n' mu') / (n mu + n' mu')]^2,     R_p = [(n' mu - n mu') / (n' mu + n mu')]^2

mu is the cosine inside, mu' that beyond the face, of equal n sine. Behind a wall of two faces R_1, R_2, whose echoes
add up as powers, each polarisation has ``R = 1 - (1 - R_1)(1 - R_2) / (1 - R_1 R_2)``. Born and Wolf, *Principles of
Optics*, sec. 1.5.

Light that meets several faces without being scattered keeps its polarisation: its two halves are followed apart, and
the mean is taken behind the last face. Of scattered light, whose polarisation is not known, it is taken at each.
"""

import math

from specklegen.kernels import inlined, kernel


@inlined
def fresnel(mu, inside, outside):
    """R_s and R_p of one face: 1 where nothing goes through, exactly 0 between equal indices."""
    if inside == outside:
        return 0.0, 0.0
    ratio = inside / outside
    beyond = 1.0 - (1.0 - mu * mu) * ratio * ratio
    if beyond <= 0.0 or mu <= 0.0:
        return 1.0, 1.0
    nu = math.sqrt(beyond)
    s = (inside * mu - outside * nu) / (inside * mu + outside * nu)
    p = (outside * mu - inside * nu) / (outside * mu + inside * nu)
    return s * s, p * p


@inlined
def both_reflectances(mu, inside, wall, outside):
    """R_s and R_p of cosine mu inside, at a face towards ``outside`` through a wall (``wall`` = ``inside``: none)."""
    s, p = fresnel(mu, inside, wall)
    if s >= 1.0:
        return 1.0, 1.0
    ratio = inside / wall
    other_s, other_p = fresnel(math.sqrt(max(1.0 - (1.0 - mu * mu) * ratio * ratio, 0.0)), wall, outside)
    if s == 0.0 and p == 0.0 or other_s >= 1.0:
        return other_s, other_p
    through_s = (1.0 - s) * (1.0 - other_s) / (1.0 - s * other_s)
    return 1.0 - through_s, 1.0 - (1.0 - p) * (1.0 - other_p) / (1.0 - p * other_p)


@inlined
def reflectance(mu, inside, wall, outside):
    """R of unpolarised light at the same face."""
    s, p = both_reflectances(mu, inside, wall, outside)
    return 0.5 * (s + p)


@inlined
def amplitudes(mu, inside, outside):
    """Amplitudes of fields that one face reflects inside: real and imaginary parts across the plane, and in it.

    Behind the face lies the image of the light: what lies in the plane keeps the sign of its part along the face, so
    that both are one number straight on. Where all is reflected both have length 1, and e^(-i omega t) says their sign.
    """
    ratio = inside / outside
    beyond = 1.0 - (1.0 - mu * mu) * ratio * ratio
    if beyond > 0.0:
        nu = math.sqrt(beyond)
        across = (inside * mu - outside * nu) / (inside * mu + outside * nu)
        along = (inside * nu - outside * mu) / (inside * nu + outside * mu)
        return across, 0.0, along, 0.0
    kappa = math.sqrt(-beyond)
    # (a - ib) / (a + ib), and the same with the sign of its parts exchanged
    a, b = inside * mu, outside * kappa
    norm = a * a + b * b
    c, d = outside * mu, inside * kappa
    other = c * c + d * d
    return (a * a - b * b) / norm, -2.0 * a * b / norm, (d * d - c * c) / other, 2.0 * c * d / other


@kernel
def reflectances(cosines, inside, wall, outside, out):
    """Fill ``out`` float64[2, n] with R_s and R_p at cosines float64[n] inside."""
    for n in range(cosines.shape[0]):
        out[0, n], out[1, n] = both_reflectances(cosines[n], inside, wall, outside)
