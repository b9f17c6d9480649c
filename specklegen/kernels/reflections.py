"""Reflecting faces in the walk of :mod:`specklegen.kernels.walk`.

* a flight that meets a face is reflected with the probability R of its angle and keeps its remaining length;
* the first leg may have been reflected m = 0, 1, ... times before the first collision, with probability a^m (1 - a),
  a = R e^(-OD / i_z) (all m up to the last image together are the weight);
* a vertex is connected to a view once for every number m of reflections of the last leg, by roulette one by one.

Legs that were reflected are unfolded in the records: vertex and direction are the images from which the leg is straight
(z measured along the leg's own side); so phases, depths and phase functions at the ends are those of a slab
without faces. What is left, R^(m/2) and the root of 1 - R of each light and view, is with them
(:mod:`specklegen.paths.faces`).
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined
from specklegen.kernels.fresnel import amplitudes, reflectance
from specklegen.kernels.jones import A_IM, A_RE, B_IM, B_RE, C_IM, C_RE, D_IM, D_RE, frame
from specklegen.kernels.lanes import AMOUNT, ORDER, OZ, PATH, POWER, WX, WY, WZ, X1, Y1, Z1, X, Y, Z
from specklegen.kernels.rng import uniforms

_FACES = np.uint64(0x40000000)  # dimensions of reflections: above all orders, below the coins of absorption
_INSIDE = 1.0 - 1e-12  # of the thickness: the deepest first vertex, so that its image tells its number


class Faces(NamedTuple):
    """Both faces of a slab.

    Attributes
    ----------
    inside, wall, outside : float
        Indices of refraction.
    images : int
        Largest number of reflections of the first and of the last leg.
    up : int
        1 where views are behind the upper face, else 0.
    """

    inside: float
    wall: float
    outside: float
    images: int
    up: int


class Mirror(NamedTuple):
    """Faces at the first and the last leg of a light.

    Attributes
    ----------
    images, views : int
        Largest number of reflections, and of views that roulette judges by after each number.
    again, crossing : float
        R at the reference direction, and 1 - R.
    chance : float
        Of light to collide on its first leg, times the sum over reflections of that leg.
    """

    images: int
    views: int
    again: float
    crossing: float
    chance: float


@inlined
def mirror_of(faces, layer, light, probes):
    """Return the Mirror of a light, of ``probes`` views before and after all reflections."""
    again = reflectance(light.z, faces.inside, faces.wall, faces.outside)
    share = again * math.exp(-layer.sigma_t * (layer.thickness / light.z))
    chance = -math.expm1(-layer.sigma_t * layer.thickness / light.z)
    total = _images_together(share, faces.images)
    return Mirror(faces.images, probes // (faces.images + 1), again, 1.0 - again, chance * total)


@inlined
def _images_together(share, images):
    total = 1.0
    for _ in range(images):
        total = 1.0 + share * total
    return total


@inlined
def reflect(where, thickness, faces, state, address, count):
    """Turn back the lanes that a face reflects; those that leave stay outside."""
    for i in range(count):
        z, wz = state[Z + i], state[WZ + i]
        if z >= 0.0 and z <= thickness:
            continue
        r = reflectance(abs(wz), faces.inside, faces.wall, faces.outside)
        if r >= 1.0:
            m = math.floor(z / thickness)
            z -= m * thickness
            if m % 2.0 != 0.0:
                z, wz = thickness - z, -wz
        elif r > 0.0:
            u = uniforms(where.key0, where.key1, where.sample, address[PATH + i], address[ORDER + i] + _FACES)[0]
            while (z < 0.0 or z > thickness) and u < r:
                z, wz = (-z if z < 0.0 else 2.0 * thickness - z), -wz
                u /= r
        state[Z + i], state[WZ + i] = z, wz


@inlined
def reflect_polarised(where, thickness, faces, spin, state, address, count):
    """Reflect polarised light, of matrices float64[CARRIED]: each reflection by what it leaves of the light there.

    A matrix is multiplied by both reflected amplitudes, and has the probability f = |r M|^2 / |M|^2; over the root of f
    it keeps |M|^2 = 2, and weights stay those of scalar light, both ways (:mod:`specklegen.kernels.jones`).
    """
    for i in range(count):
        z, wz = state[Z + i], state[WZ + i]
        if z >= 0.0 and z <= thickness:
            continue
        across_re, across_im, along_re, along_im = amplitudes(abs(wz), faces.inside, faces.outside)
        x, y = state[WX + i], state[WY + i]
        one, two = across_re * across_re + across_im * across_im, along_re * along_re + along_im * along_im
        if across_im != 0.0 or one >= 1.0:
            m = math.floor(z / thickness)
            z -= m * thickness
            times = abs(m)
            across_re, across_im = _power(across_re, across_im, times)
            along_re, along_im = _power(along_re, along_im, times)
            mirror_matrix(spin, i, x, y, wz, across_re, across_im, along_re, along_im, times % 2.0 != 0.0)
            if m % 2.0 != 0.0:
                z, wz = thickness - z, -wz
        elif one > 0.0 or two > 0.0:
            u = uniforms(where.key0, where.key1, where.sample, address[PATH + i], address[ORDER + i] + _FACES)[0]
            while z < 0.0 or z > thickness:
                lying = _share_along(spin, i, x, y, wz)
                share = two * lying + one * (1.0 - lying)
                if not u < share:
                    break
                u /= share
                scale = 1.0 / math.sqrt(share)
                mirror_matrix(spin, i, x, y, wz, scale * across_re, 0.0, scale * along_re, 0.0, True)
                z, wz = (-z if z < 0.0 else 2.0 * thickness - z), -wz
        state[Z + i], state[WZ + i] = z, wz


@inlined
def _power(re, im, times):
    """(re + i im)^times of a number of length 1, a whole number of times, by squares."""
    out_re, out_im = 1.0, 0.0
    while times >= 1.0:
        if times % 2.0 != 0.0:
            out_re, out_im = out_re * re - out_im * im, out_re * im + out_im * re
        re, im = re * re - im * im, 2.0 * re * im
        times = math.floor(times / 2.0)
    return out_re, out_im


@inlined
def _plane(x, y, z):
    """Cosine and sine of the angle from a direction's frame to the plane of it and the axis."""
    flat = math.sqrt(x * x + y * y)
    if flat == 0.0:
        return 1.0, 0.0
    e1x, e1y, e1z, e2x, e2y, e2z = frame(x, y, z)
    px, py = x * z / flat, y * z / flat
    return px * e1x + py * e1y - flat * e1z, px * e2x + py * e2y - flat * e2z


@inlined
def _share_along(spin, i, x, y, z):
    """Share of unpolarised light behind the matrix of a lane that lies in the plane of its direction and the axis."""
    c, d = _plane(x, y, z)
    p_re, p_im = c * spin[A_RE + i] + d * spin[C_RE + i], c * spin[A_IM + i] + d * spin[C_IM + i]
    q_re, q_im = c * spin[B_RE + i] + d * spin[D_RE + i], c * spin[B_IM + i] + d * spin[D_IM + i]
    return min(0.5 * (p_re * p_re + p_im * p_im + q_re * q_re + q_im * q_im), 1.0)


@inlined
def mirror_matrix(spin, i, x, y, z, across_re, across_im, along_re, along_im, turned):
    """Multiply the matrix of a lane of direction (x, y, z) by amplitudes across and along the plane with the axis.

    ``turned`` puts it into the frame of (x, y, -z): there the second axis is that of the image, with its sign changed.
    """
    c, d = _plane(x, y, z)
    sign = -1.0 if turned else 1.0
    for column in range(2):
        up_re, up_im, low_re, low_im = (
            (A_RE + i, A_IM + i, C_RE + i, C_IM + i) if column == 0 else (B_RE + i, B_IM + i, D_RE + i, D_IM + i)
        )
        p_re, p_im = c * spin[up_re] + d * spin[low_re], c * spin[up_im] + d * spin[low_im]
        s_re, s_im = c * spin[low_re] - d * spin[up_re], c * spin[low_im] - d * spin[up_im]
        p_re, p_im = along_re * p_re - along_im * p_im, along_re * p_im + along_im * p_re
        s_re, s_im = across_re * s_re - across_im * s_im, across_re * s_im + across_im * s_re
        spin[up_re], spin[up_im] = c * p_re - d * s_re, c * p_im - d * s_im
        spin[low_re], spin[low_im] = sign * (d * p_re + c * s_re), sign * (d * p_im + c * s_im)


@inlined
def reflect_first(where, layer, light, mirror, state, address, count):
    """Move the first vertices that a walk starts with behind reflections of the first leg, by their chances."""
    slant = layer.thickness / light.z
    share = mirror.again * math.exp(-layer.sigma_t * slant)
    total = _images_together(share, mirror.images)
    for i in range(count):
        u = total * uniforms(where.key0, where.key1, where.sample, address[PATH + i], _FACES)[0]
        m, part = 0, 1.0
        while m < mirror.images and u >= part:
            u -= part
            part *= share
            m += 1
        z = min(state[Z1 + i], layer.thickness * _INSIDE)
        state[AMOUNT + i] *= total / part
        state[POWER + i] *= part * mirror.crossing
        state[X1 + i] += m * slant * light.x
        state[Y1 + i] += m * slant * light.y
        state[Z1 + i] = m * layer.thickness + z
        state[X + i], state[Y + i] = state[X1 + i], state[Y1 + i]
        state[Z + i] = layer.thickness - z if m % 2 else z
        state[WZ + i] = -light.z if m % 2 else light.z


@inlined
def turn_over(thickness, state, count):
    """Unfold the directions in which paths leave their first vertices, as these are."""
    for i in range(count):
        if int(state[Z1 + i] / thickness) % 2:
            state[OZ + i] = -state[OZ + i]


@inlined
def unfolded(z, thickness, m, up):
    """Depth of a vertex's image from which a leg of m reflections leads straight through the upper or lower face."""
    if m == 0:
        return z
    if up:
        return z - m * thickness if m % 2 == 0 else -z - (m - 1) * thickness
    return z + m * thickness if m % 2 == 0 else (m + 1) * thickness - z
