"""Straight ways between the outside and a vertex in layers that refract, and what they make of the light.

A leg is one way of unscattered light from outside to a layer: which faces let it through, which turned it back. Light
of each direction takes it with an amplitude and a phase of its own (:mod:`specklegen.paths.legs`); what is left is the
way h within the layer of the vertex, from the face where it enters it last.
"""

from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.arithmetic import exponential
from specklegen.kernels.footprints import profile
from specklegen.kernels.phase_table import amplitude
from specklegen.kernels.trigonometry import sincos_turns

TOWARDS, AMOUNT, DECAY, PHASE, ALONG, ASIDE, SLOPE = 0, 3, 4, 5, 6, 7, 9
"""Columns of a direction and leg: unit vector from the vertex, in its layer; amplitude where the leg enters the layer;
amplitude's decay per h; phase there, and its growth per h, turns; lateral way to where the light crosses the outer
face, and its growth per h."""
COLUMNS = 11


class Legs(NamedTuple):
    """Legs in the order of the layers that they lead to, and what is known of some directions along them.

    Attributes
    ----------
    face : float64[L]
        Depth at which each enters its layer.
    first : int64[n + 1]
        Number of the first leg of each layer; that of all legs at the end.
    rows : float64[D, L, COLUMNS]
    """

    face: np.ndarray
    first: np.ndarray
    rows: np.ndarray


class Starts(NamedTuple):
    """Draw of first vertices: along the legs of one direction.

    Attributes
    ----------
    legs : Legs
        Of that direction, rows float64[1, L, COLUMNS].
    share, cumulative : float64[L]
        Probability of each leg; and summed.
    depth : float64[n]
        Optical depth of each layer along the direction's way through it.
    """

    legs: Legs
    share: np.ndarray
    cumulative: np.ndarray
    depth: np.ndarray


@inlined
def face_of(row, x, y, h):
    """Point where light of a row crosses the outer face."""
    return x + row[ASIDE] + h * row[SLOPE], y + row[ASIDE + 1] + h * row[SLOPE + 1]


@kernel
def leg_factors(table, legs, turns, records, column, sign, types, side, numbers, footprint, radius, out):
    """Fill ``out`` complex128[D, M] with one end of every connection at every direction of some legs.

    turns : float64[D, 2]        lateral phases of the directions, per unit length
    column, sign : position's column in the records; +1 where the direction that follows it arrives, -1 where it leaves
    types, side : int32[M, 2] and the column of the end's particle
    numbers : int16[M]           of the leg of each connection
    footprint, radius : beam profile on the entrance plane (radius 0: none)

    Connections of single scattering have no direction: they get no s.
    """
    for n in range(out.shape[0]):
        ax, ay = turns[n, 0], turns[n, 1]
        for m in range(out.shape[1]):
            leg = numbers[m]
            row = legs.rows[n, leg]
            x, y, z = records[m, column], records[m, column + 1], records[m, column + 2]
            h = abs(z - legs.face[leg])
            modulus = row[AMOUNT] * exponential(-row[DECAY] * h)
            if radius > 0.0 and modulus != 0.0:
                fx, fy = face_of(row, x, y, h)
                modulus *= profile(footprint, radius, fx, fy)
            if modulus == 0.0:
                out[n, m] = 0.0
                continue
            sine, cosine = sincos_turns(row[PHASE] + row[ALONG] * h - (ax * x + ay * y))
            value = modulus * complex(cosine, sine)
            wx, wy, wz = records[m, column + 3], records[m, column + 4], records[m, column + 5]
            if wx != 0.0 or wy != 0.0 or wz != 0.0:
                cos = sign * (wx * row[TOWARDS] + wy * row[TOWARDS + 1] + wz * row[TOWARDS + 2])
                value *= amplitude(table, types[m, side], cos)
            out[n, m] = value
