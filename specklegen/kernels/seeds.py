"""NumPy's SeedSequence and Philox 4x64-10 for many addresses at once: the same words to the bit.

Sources: O'Neill, *Developing a seed_seq alternative* (2015), as NumPy's SeedSequence has it; Salmon, Moraes, Dror,
Shaw, *Parallel random numbers: as easy as 1, 2, 3* (SC11).
"""

import numpy as np

from specklegen.kernels import inlined, kernel

_LOW = np.uint64(0xFFFFFFFF)
_32, _16, _11 = np.uint64(32), np.uint64(16), np.uint64(11)
_INIT_A, _MULT_A = np.uint64(0x43B0D7E5), np.uint64(0x931E8875)
_INIT_B, _MULT_B = np.uint64(0x8B51F9DD), np.uint64(0x58F38DED)
_MIX_L, _MIX_R = np.uint64(0xCA01F9DD), np.uint64(0x4973F715)
_M0, _M1 = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)
_W0, _W1 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B)
_TO_UNIT = 2.0**-53


@inlined
def _hashed(word, constant, factor):
    """A word of 32 bits hashed, and the constant of the next hash."""
    following = constant * factor & _LOW
    product = (word ^ constant) * following & _LOW
    return product ^ (product >> _16), following


@inlined
def _mixed(x, y):
    mixed = (x * _MIX_L - y * _MIX_R) & _LOW
    return mixed ^ (mixed >> _16)


@kernel
def fill_seed_states(entropy, out):
    """Fill ``out`` int64[n, k], k <= 4, with ``SeedSequence(words).generate_state(k)`` of int64[n, w], w >= 4."""
    pool = np.empty(4, np.uint64)
    for row in range(entropy.shape[0]):
        constant = _INIT_A
        for n in range(4):
            pool[n], constant = _hashed(np.uint64(entropy[row, n]), constant, _MULT_A)
        for source in range(4):
            for target in range(4):
                if source != target:
                    word, constant = _hashed(pool[source], constant, _MULT_A)
                    pool[target] = _mixed(pool[target], word)
        for n in range(4, entropy.shape[1]):
            for target in range(4):
                word, constant = _hashed(np.uint64(entropy[row, n]), constant, _MULT_A)
                pool[target] = _mixed(pool[target], word)
        constant = _INIT_B
        for n in range(out.shape[1]):
            word, constant = _hashed(pool[n], constant, _MULT_B)
            out[row, n] = np.int64(word)


@inlined
def _high(a, b):
    """High 64 bits of a product of two numbers of 64 bits."""
    a_high, a_low, b_high, b_low = a >> _32, a & _LOW, b >> _32, b & _LOW
    middle = a_high * b_low + (a_low * b_low >> _32)
    other = a_low * b_high + (middle & _LOW)
    return a_high * b_high + (middle >> _32) + (other >> _32)


@kernel
def fill_first_uniforms(states, out):
    """Fill ``out`` float64[n, 4] with the first ``Generator(Philox(...)).random(4)`` of seed states int64[n, 4]."""
    for row in range(states.shape[0]):
        key0 = np.uint64(states[row, 0]) | np.uint64(states[row, 1]) << _32
        key1 = np.uint64(states[row, 2]) | np.uint64(states[row, 3]) << _32
        a, b, c, d = np.uint64(1), np.uint64(0), np.uint64(0), np.uint64(0)
        for _ in range(10):
            a, b, c, d = _high(c, _M1) ^ b ^ key0, c * _M1, _high(a, _M0) ^ d ^ key1, a * _M0
            key0 += _W0
            key1 += _W1
        out[row, 0] = (a >> _11) * _TO_UNIT
        out[row, 1] = (b >> _11) * _TO_UNIT
        out[row, 2] = (c >> _11) * _TO_UNIT
        out[row, 3] = (d >> _11) * _TO_UNIT
