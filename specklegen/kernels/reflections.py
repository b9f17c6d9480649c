"""What reflecting faces do to the walk of :mod:`specklegen.kernels.walk`.

* a flight that meets a face is reflected with the probability R of its angle and keeps its remaining length;
* the first leg may have been reflected m = 0, 1, ... times before the first collision, with probability a^m (1 - a),
  a = R e^(-OD / i_z) (all m up to the last image together are the weight);
* a vertex is connected to a view once for every number m of reflections of the last leg, by roulette one by one.

Legs that were reflected are unfolded in the records: vertex and direction are the images from which the leg is straight
(z measured along the leg's own side), so that phases, depths and lobes at the ends are those of a slab without faces.
What is left, R^(m/2) and the root of 1 - R of each light and view, is with them (:mod:`specklegen.paths.faces`).
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined
from specklegen.kernels.fresnel import reflectance
from specklegen.kernels.lanes import AMOUNT, ORDER, OZ, PATH, POWER, WZ, X1, Y1, Z1, X, Y, Z
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
    """What the first and the last leg of a light find at the faces.

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
