"""Endpoint factors of connections: attenuation, phase, decay, beam profile and scattering towards lights and views.

Connections are taken side by side, one quantity after the other in one array, so that the loops over them become
vector instructions. What does not, the way through voxels and tabulated or mixed particles, has loops of its own.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import ROOM, inlined, kernel
from specklegen.kernels.arithmetic import exponential, fma
from specklegen.kernels.footprints import profile
from specklegen.kernels.phase_table import (
    FISHER_2D,
    FISHER_3D,
    HENYEY_2D,
    HENYEY_3D,
    ISOTROPIC_2D,
    ISOTROPIC_3D,
    amplitude,
    closed_amplitude,
)
from specklegen.kernels.sums import gather
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.kernels.volume import EXTRA, exit_distance, is_homogeneous, optical_depth

# Where each quantity starts, ROOM values each: vertex, direction beside it; towards one light or view: unit vector,
# distance, optical depth, modulus, phase in turns, and the value found.
X, Y, Z, WX, WY, WZ, DX, DY, DZ, AWAY, DEPTH, MODULUS, TURNS, REAL, IMAGINARY = (ROOM * n for n in range(15))


class Targets(NamedTuple):
    """Ends of connections.

    Attributes
    ----------
    near : int
        1 where ``vectors`` are points, 0 where they are directions away from the medium (of light: reversed).
    vectors, turns : float64[V, 3]
        And the phase of a direction, e^(-2 pi i turns . x) per unit length; not read of points. Without any (V = 0)
        phases are left out, of points too.
    """

    near: int
    vectors: np.ndarray
    turns: np.ndarray


@kernel
def endpoint_factors(volume, table, records, column, sign, types, side, targets, wavelength, footprint, radius, out):
    """Fill ``out`` complex128[V, M] with xi tau s b of one end of every connection at every light or view.

    column, sign : position's column in the records; +1 where the direction that follows it arrives, -1 where it leaves
    types, side : int32[M, 2] and the column of the end's particle
    targets : Targets
    footprint, radius : beam profile on the entrance plane (radius 0: none)

    Connections of single scattering have no direction: they get no s.
    """
    near_field, views, turns = targets
    bounds, cells, extinction = volume.bounds, volume.cells, volume.extinction
    kind = table.kinds[0] if table.kinds.shape[0] == 1 else -1
    alike = kind < 0 and (table.kinds == HENYEY_3D).all()
    asymmetry = np.empty(ROOM)
    phased = turns.shape[0] > 0
    state = np.empty(15 * ROOM)
    for first in range(0, records.shape[0], ROOM):
        count = min(ROOM, records.shape[0] - first)
        gather(records, first, count, column, 6, state, 0)
        if alike:
            for m in range(count):
                asymmetry[m] = table.parameters[types[first + m, side], 0]
        for n in range(views.shape[0]):
            px, py, pz = views[n, 0], views[n, 1], views[n, 2]
            for m in range(count):
                state[MODULUS + m] = 1.0
            if radius > 0.0:
                for m in range(count):
                    x, y, z = state[X + m], state[Y + m], state[Z + m]
                    state[MODULUS + m] = face_profile(bounds, footprint, radius, px, py, pz, x, y, z)
            if near_field:
                towards_point(px, py, pz, wavelength, cells[EXTRA, 0] == 2, state, count)
            else:
                ax, ay, az = (turns[n, 0], turns[n, 1], turns[n, 2]) if phased else (0.0, 0.0, 0.0)
                towards_direction(px, py, pz, ax, ay, az, state, count)
            attenuate(bounds, cells, extinction, state, count)
            if alike:
                scattered = True
                for m in range(count):
                    scatter_one(HENYEY_3D, asymmetry[m], 0.0, sign, state, m)
            else:
                scattered = scatter(kind, table.parameters[0, 0], table.parameters[0, 1], sign, state, count)
            if phased:
                for m in range(count):
                    sine, cosine = sincos_turns(state[TURNS + m])
                    state[REAL + m], state[IMAGINARY + m] = state[MODULUS + m] * cosine, state[MODULUS + m] * sine
            else:
                for m in range(count):
                    state[REAL + m], state[IMAGINARY + m] = state[MODULUS + m], 0.0
            for m in range(count):
                out[n, first + m] = complex(state[REAL + m], state[IMAGINARY + m])
            if scattered:
                continue
            for m in range(count):
                wx, wy, wz = state[WX + m], state[WY + m], state[WZ + m]
                if wx != 0.0 or wy != 0.0 or wz != 0.0:
                    cos = sign * (wx * state[DX + m] + wy * state[DY + m] + wz * state[DZ + m])
                    out[n, first + m] *= amplitude(table, types[first + m, side], cos)


@inlined
def towards_direction(px, py, pz, ax, ay, az, state, count):
    """The far field in one direction, of phase (ax, ay, az) in turns per unit length."""
    for m in range(count):
        state[DX + m], state[DY + m], state[DZ + m] = px, py, pz
        state[AWAY + m] = math.inf
        state[TURNS + m] = -fma(ax, state[X + m], fma(ay, state[Y + m], az * state[Z + m]))


@inlined
def towards_point(px, py, pz, wavelength, flat, state, count):
    """A point: the field decays as 1/r, as 1/sqrt(r) in flatland. On a vertex (measure zero) it is left out."""
    for m in range(count):
        dx, dy, dz = px - state[X + m], py - state[Y + m], pz - state[Z + m]
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        inverse = 1.0 / r if r > 0.0 else 0.0
        state[DX + m], state[DY + m], state[DZ + m] = dx * inverse, dy * inverse, dz * inverse
        state[AWAY + m] = r
        state[MODULUS + m] *= math.sqrt(inverse) if flat else inverse
        state[TURNS + m] = r / wavelength


@inlined
def attenuate(bounds, cells, extinction, state, count):
    """Times e^(-tau/2) of the way through the medium."""
    for m in range(count):
        out = exit_distance(
            bounds, state[X + m], state[Y + m], state[Z + m], state[DX + m], state[DY + m], state[DZ + m]
        )  # fmt: skip
        state[DEPTH + m] = min(state[AWAY + m], out)
    if is_homogeneous(cells):
        sigma = extinction[0]
        for m in range(count):
            state[DEPTH + m] *= sigma
    else:
        for m in range(count):
            state[DEPTH + m] = optical_depth(
                bounds, cells, extinction, state[X + m], state[Y + m], state[Z + m],
                state[DX + m], state[DY + m], state[DZ + m], 0.0, state[DEPTH + m],
            )  # fmt: skip
    for m in range(count):
        state[MODULUS + m] *= exponential(-0.5 * state[DEPTH + m])


@inlined
def scatter(kind, first, second, sign, state, count):
    """Times s, where all particles are of one kind that has a closed form; whether that was so."""
    # A loop for each: a kind that the compiler knows makes it a vector loop.
    if kind == ISOTROPIC_3D or kind == ISOTROPIC_2D:
        scatter_by(ISOTROPIC_3D, first, second, sign, state, count)
    elif kind == HENYEY_3D:
        scatter_by(HENYEY_3D, first, second, sign, state, count)
    elif kind == HENYEY_2D:
        scatter_by(HENYEY_2D, first, second, sign, state, count)
    elif kind == FISHER_3D or kind == FISHER_2D:
        scatter_by(FISHER_3D, first, second, sign, state, count)
    else:
        return False
    return True


@inlined
def scatter_by(kind, first, second, sign, state, count):
    """Times s of one kind."""
    for m in range(count):
        scatter_one(kind, first, second, sign, state, m)


@inlined
def scatter_one(kind, first, second, sign, state, m):
    """Times s of one kind, for one connection."""
    wx, wy, wz = state[WX + m], state[WY + m], state[WZ + m]
    cos = sign * (wx * state[DX + m] + wy * state[DY + m] + wz * state[DZ + m])
    s = closed_amplitude(kind, first, second, cos)
    state[MODULUS + m] *= s if wx * wx + wy * wy + wz * wz > 0.0 else 1.0


@inlined
def face_profile(bounds, footprint, radius, px, py, pz, x, y, z):
    """Profile b of the ray through x against (px, py, pz) = -i, at the entrance plane; per area of that plane."""
    t = (z - bounds[0, 2]) / -pz
    return profile(footprint, radius, x + t * px, y + t * py) / math.sqrt(-pz)


@kernel
def single_factors(table, records, types, near_light, lights, near_view, views, out):
    """Fill ``out`` complex128[T, V, M] with s(i . v) of single scattering, directions taken at each vertex."""
    for t in range(lights.shape[0]):
        for v in range(views.shape[0]):
            for m in range(records.shape[0]):
                row = records[m]
                ix, iy, iz = away(near_light, lights[t, 0], lights[t, 1], lights[t, 2], row[0], row[1], row[2])
                vx, vy, vz = away(near_view, views[v, 0], views[v, 1], views[v, 2], row[0], row[1], row[2])
                out[t, v, m] = amplitude(table, types[m, 0], -(ix * vx + iy * vy + iz * vz))


@inlined
def away(near_field, px, py, pz, x, y, z):
    """Unit vector from x towards a direction or a point."""
    if not near_field:
        return px, py, pz
    dx, dy, dz = px - x, py - y, pz - z
    r = math.sqrt(dx * dx + dy * dy + dz * dz)
    if r == 0.0:
        return 0.0, 0.0, 1.0
    return dx / r, dy / r, dz / r
