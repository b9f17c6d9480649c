"""Where beams begin: a point of the source, the beam about it, and one ray of the beam's Wigner ensemble.

The ray of a collimated source starts evenly over its rectangle, and the beam's centre lies about the *ray*: that is the
ensemble of evenly spread centres, seen from the rays that start in the rectangle. Offsets beyond three deviations are
drawn again, which changes nothing where centres are even; wavevectors are not cut, since their spread is the physics:
a ray beyond the envelope widens its cone.
"""

import math

import numpy as np

from specklegen.kernels import kernel
from specklegen.kernels.beam_state import (
    CX,
    CY,
    CZ,
    DX,
    DY,
    DZ,
    MX,
    MY,
    MZ,
    PRODUCT,
    PX,
    PY,
    PZ,
    SLOPE,
    SPREAD,
    STRETCH,
    WIDTH,
    XX,
    XY,
    XZ,
    YX,
    YY,
    YZ,
    axes_about,
    kicked,
)
from specklegen.kernels.rng import normal_pair, uniforms
from specklegen.kernels.trigonometry import sincos_turns

# float64[SOURCE]: kind, lower and upper corner (a point: both its place), direction, half-width a, tangent.
KIND, LOWER, UPPER, DIRECTION, RADIUS, TANGENT, SOURCE = 0, 1, 4, 7, 10, 11, 12
COLLIMATED, POINT = 0, 1
_ONE = np.uint64(1)
_WAVE = 0


@kernel
def emit(key0, key1, path, source, mode, k, state):
    """Fill the state of a beam at its source; return the counter behind the draws."""
    counter = np.uint64(0)
    u, v, w, _ = uniforms(key0, key1, np.uint64(0), path, counter)
    counter += _ONE
    if int(source[KIND]) == COLLIMATED:
        mx, my, mz = source[DIRECTION], source[DIRECTION + 1], source[DIRECTION + 2]
    else:
        mz = 1.0 - 2.0 * u
        sine, cosine = sincos_turns(v)
        r = math.sqrt(max(0.0, 1.0 - mz * mz))
        mx, my = r * cosine, r * sine
    x, y, z, a, b, c = axes_about(mx, my, mz)
    state[XX], state[XY], state[XZ], state[YX], state[YY], state[YZ] = x, y, z, a, b, c
    state[MX], state[MY], state[MZ] = mx, my, mz
    state[DX], state[DY], state[DZ] = mx, my, mz
    state[WIDTH], state[STRETCH] = source[RADIUS], 1.0
    state[SLOPE] = state[SPREAD] = source[TANGENT]
    state[PRODUCT] = source[TANGENT] * source[TANGENT]
    # A rectangle is flat along one axis, whose number is in w's place of no use: each corner differs in two.
    if int(source[KIND]) == POINT:
        px, py, pz = source[LOWER], source[LOWER + 1], source[LOWER + 2]
    else:
        px = source[LOWER] + u * (source[UPPER] - source[LOWER])
        py = source[LOWER + 1] + v * (source[UPPER + 1] - source[LOWER + 1])
        pz = source[LOWER + 2] + w * (source[UPPER + 2] - source[LOWER + 2])
    state[PX], state[PY], state[PZ] = px, py, pz
    state[CX], state[CY], state[CZ] = px, py, pz
    if mode != _WAVE:
        return counter
    spread = 1.0 / (2.0 * source[RADIUS] / 3.0)  # root of 1 / (2 Sigma), Sigma = 2 (a / 3)^2
    if int(source[KIND]) == COLLIMATED:
        while True:
            u, v, _, _ = uniforms(key0, key1, np.uint64(0), path, counter)
            counter += _ONE
            gx, gy = normal_pair(u, v)
            if gx * gx + gy * gy <= 9.0:
                break
        s = source[RADIUS] / 3.0
        state[CX] -= s * (gx * x + gy * a)
        state[CY] -= s * (gx * y + gy * b)
        state[CZ] -= s * (gx * z + gy * c)
    while True:
        u, v, _, _ = uniforms(key0, key1, np.uint64(0), path, counter)
        counter += _ONE
        gx, gy = normal_pair(u, v)
        dx, dy, dz, there = kicked(state, gx * spread / k, gy * spread / k)
        if there:
            state[DX], state[DY], state[DZ] = dx, dy, dz
            return counter
