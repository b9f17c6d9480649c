"""Counter-based random numbers: Philox 4x32-10.

Every draw is a pure function of an address: a 64-bit key made from (seed, stream), and a counter
(dimension, path, sample). No state is kept, so a path is the same whatever thread, block or order
traced it.

Source: Salmon, Moraes, Dror, Shaw, *Parallel random numbers: as easy as 1, 2, 3* (SC11).
"""

import math

import numpy as np

from specklegen.kernels import ROOM, inlined, kernel
from specklegen.kernels.arithmetic import minus_log
from specklegen.kernels.trigonometry import sincos_turns

_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_32 = np.uint64(32)
_TO_UNIT = 2.0**-32
_HALF = 2.0**-33


@inlined
def philox(key0, key1, c0, c1, c2, c3):
    """Four 32-bit words (held in uint64) for a key of two and a counter of four such words."""
    for _ in range(10):
        p0 = (c0 & _LOW) * _M0  # a product of 32-bit numbers is one instruction, and drops what is above them
        p1 = (c2 & _LOW) * _M1
        c0, c1, c2, c3 = (p1 >> _32) ^ (c1 ^ key0), p1, (p0 >> _32) ^ (c3 ^ key1), p0
        key0 += _W0
        key1 += _W1
    return c0 & _LOW, c1 & _LOW, c2 & _LOW, c3 & _LOW


@inlined
def open_unit(word):
    """Map a word of 32 bits to the middle of its cell of ``(0, 1)``: never 0 or 1."""
    return word * _TO_UNIT + _HALF


@inlined
def uniforms(key0, key1, sample, path, dimension):
    """Four uniforms in (0, 1) for path ``path`` of sample ``sample`` at ``dimension`` (all uint64)."""
    a, b, c, d = philox(key0, key1, dimension, path & _LOW, path >> _32, sample)
    return open_unit(a), open_unit(b), open_unit(c), open_unit(d)


@inlined
def normal_pair(u, v):
    """Two standard normals from two uniforms (Box-Muller)."""
    radius = math.sqrt(2.0 * minus_log(u))
    sine, cosine = sincos_turns(v)
    return radius * cosine, radius * sine


@kernel
def fill_normals(key0, key1, sample, out):
    """Fill ``out`` float32/float64[n, 2] with standard normals, pair m from block m // 2."""
    k0, k1, sample = np.uint64(key0), np.uint64(key1), np.uint64(sample)
    pairs = out.shape[0]
    normals = np.empty(4 * ROOM)  # contiguous, or the loop would not vectorise
    for first in range(0, (pairs + 1) // 2, ROOM):
        count = min(ROOM, (pairs + 1) // 2 - first)
        for n in range(count):
            u0, u1, u2, u3 = uniforms(k0, k1, sample, np.uint64(first + n), np.uint64(0))
            normals[n], normals[ROOM + n] = normal_pair(u0, u1)
            normals[2 * ROOM + n], normals[3 * ROOM + n] = normal_pair(u2, u3)
        whole = min(count, pairs // 2 - first)
        for n in range(count):
            m = 2 * (first + n)
            out[m, 0], out[m, 1] = normals[n], normals[ROOM + n]
            if n < whole:
                out[m + 1, 0], out[m + 1, 1] = normals[2 * ROOM + n], normals[3 * ROOM + n]
