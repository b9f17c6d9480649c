"""Polarisation along a walk: the two-by-two matrix of the field, handed on from scattering to scattering.

A scattering multiplies the part of the field that lies in the plane of both directions by S2; the part across it by S1
(Bohren and Huffman, *Absorption and Scattering of Light by Small Particles*, 1983, Eq. 3.12); here
``|S1|^2 + |S2|^2 = 2`` at every angle, so that the phase function is the scalar one. A walk carries the product M of
these matrices over x2 ... x_(B-1), between the frames of its first and its last direction. A frame is that of
:func:`specklegen.kernels.frames.deflect`: it follows from the direction alone. M is kept at |M|^2 = 2.

The angle of a scattering has the scalar phase function. Behind M, for unpolarised light along w_1, its azimuth has the
density

    f(phi) = |S M|^2 / |M|^2,    f(phi) + f(phi + pi/2) = 2:

an even azimuth is kept with probability f / 2 and turned by a quarter else, which draws f without a loop. M over the
root of f has |M|^2 = 2 again, and the weight of a path stays that of scalar light. It stays so backwards too: all f of
a path together are half of |product|^2, which a path and its reverse share.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined
from specklegen.kernels.frames import deflect
from specklegen.kernels.lanes import AZIMUTH, DROP, FLYING, LANES, ORDER, PATH, POLAR, WAITING, WX, WY, WZ
from specklegen.kernels.lobes import NODE, sample_density
from specklegen.kernels.phase_functions import sample_henyey_greenstein
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns

ENTRIES = 8
"""Of M, row by row, real before imaginary parts."""
A_RE, A_IM, B_RE, B_IM, C_RE, C_IM, D_RE, D_IM = (LANES * n for n in range(ENTRIES))
CARRIED = ENTRIES * LANES
# S1 and S2 of the last scattering, and the uniform that turns its azimuth.
ACROSS_RE, ACROSS_IM, ALONG_RE, ALONG_IM, TURN = (LANES * n for n in range(5))
STEP = 5 * LANES

_TURNS = np.uint64(0x60000000)  # dimensions of turned azimuths: above all orders and faces, below coins of absorption


class Jones(NamedTuple):
    """Input and output of a polarised walk.

    Attributes
    ----------
    matrices : float64[n, 4], float64[types, n, 4] through layers, or of no rows
        S1 and S2, real before imaginary parts, at the nodes of the walk's phase function, linear in 1 - cos between
        them, through layers those of :func:`amplitudes_of_type`; of no rows the projector, S2 = cos(theta) S1.
    carried : float64[2, CARRIED]
        Room for the matrices of the lanes: FLYING, and WAITING for a lane.
    step : float64[STEP]
        Room for what a step needs.
    found : float64[cap, ENTRIES]
        Output, M of each connection; left as it is where light is scattered once.
    """

    matrices: np.ndarray
    carried: np.ndarray
    step: np.ndarray
    found: np.ndarray


@inlined
def unpolarised(carried, count):
    """Put the unit matrix into the lanes of paths that wait."""
    for i in range(count):
        for n in range(ENTRIES):
            carried[WAITING, n * LANES + i] = 1.0 if n == 0 or n == ENTRIES - 2 else 0.0


@inlined
def start_matrix(carried, lane):
    """Put the unit matrix into a lane in flight."""
    for n in range(ENTRIES):
        carried[FLYING, n * LANES + lane] = 1.0 if n == 0 or n == ENTRIES - 2 else 0.0


@inlined
def write_matrix(carried, lane, out):
    """Fill float64[ENTRIES] with the matrix of a lane in flight."""
    for n in range(ENTRIES):
        out[n] = carried[FLYING, n * LANES + lane]


@inlined
def draw_turns(where, step, address, count):
    """Draw the uniforms that turn azimuths."""
    for i in range(count):
        step[TURN + i] = uniforms(
            where.key0, where.key1, where.sample, address[PATH + i], address[ORDER + i] + _TURNS
        )[0]  # fmt: skip


@inlined
def project(step, state, count):
    """Amplitudes of the projector at the angles that the lanes have drawn."""
    for i in range(count):
        cosine = 1.0 - state[DROP + i]
        across = math.sqrt(2.0 / (1.0 + cosine * cosine))
        step[ACROSS_RE + i], step[ACROSS_IM + i] = across, 0.0
        step[ALONG_RE + i], step[ALONG_IM + i] = across * cosine, 0.0


@inlined
def scatter_polarised(where, g, rows, guide, places, matrices, spin, step, state, address, count):
    """Turn every lane's direction, and its matrix float64[CARRIED] with it."""
    draw_turns(where, step, address, count)
    if rows.shape[0] == 0:
        for i in range(count):
            state[DROP + i] = sample_henyey_greenstein(g, state[POLAR + i])
    else:
        for i in range(count):
            state[DROP + i] = sample_density(rows, guide, state[POLAR + i])[0]
    if matrices.shape[0] == 0:
        project(step, state, count)
    else:
        for i in range(count):
            v = state[DROP + i]
            place = ((np.float64(v).view(np.int64) - places[0]) >> places[1]) + np.int64(1)
            j = min(max(place, np.int64(0)), np.int64(rows.shape[0] - 2))
            t = (v - rows[j, NODE]) / (rows[j + 1, NODE] - rows[j, NODE])
            for n in range(4):
                step[ACROSS_RE + n * LANES + i] = matrices[j, n] + t * (matrices[j + 1, n] - matrices[j, n])
    for i in range(count):
        turn_lane(spin, step, state, i)


@inlined
def amplitudes_of_type(matrices, kind, step, state, i):
    """S1 and S2 of one lane's particle at the angle that it has drawn, from its rows of ``matrices`` float64[t, n, 4].

    Rows are even in sin(theta / 2) up to a right angle and in -cos(theta / 2) beyond: :func:`node_place`.
    """
    last = matrices.shape[1] - 1
    place = node_place(state[DROP + i]) * last
    j = min(np.int64(place), np.int64(last - 1))
    t = place - j
    for n in range(4):
        step[ACROSS_RE + n * LANES + i] = matrices[kind, j, n] + t * (matrices[kind, j + 1, n] - matrices[kind, j, n])


@inlined
def node_place(one_minus_cos):
    """Place of a scattering angle among such rows, from 0 straight on to 1 back."""
    half = 0.5 * one_minus_cos
    if half <= 0.5:
        return math.sqrt(half) / math.sqrt(2.0)
    return 1.0 - math.sqrt(max(1.0 - half, 0.0)) / math.sqrt(2.0)


@inlined
def turn_lane(spin, step, state, i):
    """Draw the azimuth of one scattering, and turn direction and matrix."""
    sine, cosine = sincos_turns(state[AZIMUTH + i])
    a_re, a_im, b_re, b_im = spin[A_RE + i], spin[A_IM + i], spin[B_RE + i], spin[B_IM + i]
    c_re, c_im, d_re, d_im = spin[C_RE + i], spin[C_IM + i], spin[D_RE + i], spin[D_IM + i]
    # Rows along the plane of scattering and across it.
    p_re, p_im, q_re, q_im = (
        cosine * a_re + sine * c_re, cosine * a_im + sine * c_im, cosine * b_re + sine * d_re,
        cosine * b_im + sine * d_im,
    )  # fmt: skip
    r_re, r_im, s_re, s_im = (
        cosine * c_re - sine * a_re, cosine * c_im - sine * a_im, cosine * d_re - sine * b_re,
        cosine * d_im - sine * b_im,
    )  # fmt: skip
    along = p_re * p_re + p_im * p_im + q_re * q_re + q_im * q_im
    across = r_re * r_re + r_im * r_im + s_re * s_re + s_im * s_im
    one_re, one_im, two_re, two_im = step[ACROSS_RE + i], step[ACROSS_IM + i], step[ALONG_RE + i], step[ALONG_IM + i]
    one, two = one_re * one_re + one_im * one_im, two_re * two_re + two_im * two_im
    kept, turned = two * along + one * across, two * across + one * along  # as f of either azimuth
    stays = step[TURN + i] * (kept + turned) < kept
    p_re, r_re = (p_re if stays else r_re), (r_re if stays else -p_re)
    p_im, r_im = (p_im if stays else r_im), (r_im if stays else -p_im)
    q_re, s_re = (q_re if stays else s_re), (s_re if stays else -q_re)
    q_im, s_im = (q_im if stays else s_im), (s_im if stays else -q_im)
    cosine, sine = (cosine if stays else -sine), (sine if stays else cosine)
    scale = math.sqrt(2.0 / max(kept if stays else turned, 1e-300))
    one_re, one_im, two_re, two_im = scale * one_re, scale * one_im, scale * two_re, scale * two_im
    p_re, p_im = two_re * p_re - two_im * p_im, two_re * p_im + two_im * p_re
    q_re, q_im = two_re * q_re - two_im * q_im, two_re * q_im + two_im * q_re
    r_re, r_im = one_re * r_re - one_im * r_im, one_re * r_im + one_im * r_re
    s_re, s_im = one_re * s_re - one_im * s_im, one_re * s_im + one_im * s_re
    # The vector across the plane stays: its parts in the frame of the new direction.
    x, y, z = state[WX + i], state[WY + i], state[WZ + i]
    e1x, e1y, e1z, e2x, e2y, e2z = frame(x, y, z)
    nx, ny, nz = cosine * e2x - sine * e1x, cosine * e2y - sine * e1y, cosine * e2z - sine * e1z
    x, y, z = deflect(x, y, z, state[DROP + i], cosine, sine)
    state[WX + i], state[WY + i], state[WZ + i] = x, y, z
    e1x, e1y, e1z, e2x, e2y, e2z = frame(x, y, z)
    c, s = nx * e2x + ny * e2y + nz * e2z, -(nx * e1x + ny * e1y + nz * e1z)
    spin[A_RE + i], spin[A_IM + i] = c * p_re - s * r_re, c * p_im - s * r_im
    spin[B_RE + i], spin[B_IM + i] = c * q_re - s * s_re, c * q_im - s * s_im
    spin[C_RE + i], spin[C_IM + i] = s * p_re + c * r_re, s * p_im + c * r_im
    spin[D_RE + i], spin[D_IM + i] = s * q_re + c * s_re, s * q_im + c * s_im


@inlined
def frame(x, y, z):
    """Two vectors across a unit vector, those of :func:`specklegen.kernels.frames.deflect`, as six numbers."""
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return 1.0 + sign * x * x * a, sign * b, -sign * x, b, sign + y * y * a, -y
