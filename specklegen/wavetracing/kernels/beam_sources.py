"""Starts of beams: a point of the source, the beam about it, and one ray of the beam's Wigner ensemble.

The ray of a collimated source starts evenly over its rectangle, and the beam's centre lies about the *ray*: that is the
ensemble of evenly spread centres, seen from the rays that start in the rectangle. Offsets beyond three deviations are
drawn again, which changes nothing where centres are even; wavevectors are not cut, since their spread is the physics:
a ray beyond the envelope widens its cone. A laser is one beam, whose centre stands still; its rays start about it.
"""

import math

import numpy as np

from specklegen.kernels import kernel
from specklegen.kernels.rng import normal_pair, uniforms
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.wavetracing.kernels import beam_state as beam
from specklegen.wavetracing.kernels.beam_state import axes_about, kicked

# float64[SOURCE]: kind, lower and upper corner (a point: both its place), direction, half-width a, tangent.
KIND, LOWER, UPPER, DIRECTION, RADIUS, TANGENT, SOURCE = 0, 1, 4, 7, 10, 11, 12
COLLIMATED, POINT, LASER = 0, 1, 2
_ONE = np.uint64(1)
_WAVE, _BALLISTIC = 0, 1


@kernel
def emit(key0, key1, path, source, mode, k, state):
    """Fill the state of a beam at its source; return the counter behind the draws."""
    counter = np.uint64(0)
    u, v, w, _ = uniforms(key0, key1, np.uint64(0), path, counter)
    counter += _ONE
    kind = int(source[KIND])
    if kind != POINT:
        mx, my, mz = source[DIRECTION], source[DIRECTION + 1], source[DIRECTION + 2]
    else:
        mz = 1.0 - 2.0 * u
        sine, cosine = sincos_turns(v)
        r = math.sqrt(max(0.0, 1.0 - mz * mz))
        mx, my = r * cosine, r * sine
    x, y, z, a, b, c = axes_about(mx, my, mz)
    state[beam.XX], state[beam.XY], state[beam.XZ], state[beam.YX], state[beam.YY], state[beam.YZ] = x, y, z, a, b, c
    state[beam.MX], state[beam.MY], state[beam.MZ] = mx, my, mz
    state[beam.DX], state[beam.DY], state[beam.DZ] = mx, my, mz
    state[beam.WIDTH], state[beam.STRETCH] = source[RADIUS], 1.0
    state[beam.SLOPE] = source[TANGENT]
    state[beam.PRODUCT] = source[TANGENT] * source[TANGENT]
    # A rectangle is flat along one axis, whose number is in w's place of no use: each corner differs in two.
    if kind != COLLIMATED:
        px, py, pz = source[LOWER], source[LOWER + 1], source[LOWER + 2]
    else:
        px = source[LOWER] + u * (source[UPPER] - source[LOWER])
        py = source[LOWER + 1] + v * (source[UPPER + 1] - source[LOWER + 1])
        pz = source[LOWER + 2] + w * (source[UPPER + 2] - source[LOWER + 2])
    state[beam.PX], state[beam.PY], state[beam.PZ] = px, py, pz
    state[beam.CX], state[beam.CY], state[beam.CZ] = px, py, pz
    s = source[RADIUS] / 3.0
    if kind == LASER and mode != _BALLISTIC:
        u, v, _, _ = uniforms(key0, key1, np.uint64(0), path, counter)
        counter += _ONE
        gx, gy = normal_pair(u, v)
        state[beam.PX] += s * (gx * x + gy * a)
        state[beam.PY] += s * (gx * y + gy * b)
        state[beam.PZ] += s * (gx * z + gy * c)
    if mode != _WAVE:
        return counter
    spread = 1.0 / (2.0 * source[RADIUS] / 3.0)  # root of 1 / (2 Sigma), Sigma = 2 (a / 3)^2
    if kind == COLLIMATED:
        while True:
            u, v, _, _ = uniforms(key0, key1, np.uint64(0), path, counter)
            counter += _ONE
            gx, gy = normal_pair(u, v)
            if gx * gx + gy * gy <= 9.0:
                break
        state[beam.CX] -= s * (gx * x + gy * a)
        state[beam.CY] -= s * (gx * y + gy * b)
        state[beam.CZ] -= s * (gx * z + gy * c)
    while True:
        u, v, _, _ = uniforms(key0, key1, np.uint64(0), path, counter)
        counter += _ONE
        gx, gy = normal_pair(u, v)
        dx, dy, dz, there = kicked(state, gx * spread / k, gy * spread / k)
        if there:
            state[beam.DX], state[beam.DY], state[beam.DZ] = dx, dy, dz
            return counter
