"""Walks that are drawn towards the far face of an absorbing slab: stretched flights, steered scatterings.

A light that falls as e^(-rate sigma_t z) is walked by paths that do not: flights are drawn with the density sigma_t (1
- rate w_z) e^(-sigma_t (1 - rate w_z) s), directions w with rho(w' . w) H(w_z) / (1 - rate w_z), by rejection. H solves
the equation of :mod:`specklegen.paths.stretching`, so that a step changes the weight W by H(w'_z) / H(w_z) e^(-rate
sigma_t dz) and by nothing else: all that cross the slab weigh nearly the same.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined
from specklegen.kernels.arithmetic import minus_log
from specklegen.kernels.frames import deflect
from specklegen.kernels.lanes import AMOUNT, ASIDE, DROP, FLIGHT, FLOWN, ORDER, PATH, SHAPE, WX, WY, WZ, X, Y, Z
from specklegen.kernels.lobes import sample_density
from specklegen.kernels.phase_functions import henyey_greenstein, sample_henyey_greenstein
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns

_TAU = 2.0 * math.pi
_ONE = np.uint64(1)


class Stretch(NamedTuple):
    """Stretching of a walk towards the far face; helpers take it apart.

    Attributes
    ----------
    rate : float
        Share of sigma_t that flights straight ahead are spared; 0 leaves the walk as it is.
    survival : float
        Chance of a path to go on at a scattering: the albedo, over that of the medium whose H this is.
    most : float
        Largest H / (1 - rate w_z).
    aimed : float
        Mean of H / (1 - rate w_z) over the phase function that first directions are drawn from, over that of the phase
        function.
    rows : float64[n, 2]
        H, and its slope, at even steps of sqrt((1 - w_z) / 2) from 0 to 1.
    """

    rate: float
    survival: float
    most: float
    aimed: float
    rows: np.ndarray


class Pull(NamedTuple):
    """The numbers of a :class:`Stretch` that a walk's steps need."""

    rate: float
    most: float
    aimed: float


@inlined
def scattered_importance(rows, z):
    """H at w_z, by the cubic of values and slopes."""
    last = rows.shape[0] - 1
    place = math.sqrt(max(0.5 * (1.0 - z), 0.0)) * last
    j = min(int(place), last - 1)
    t = place - j
    u = 1.0 - t
    values = u * u * (1.0 + 2.0 * t) * rows[j, 0] + t * t * (1.0 + 2.0 * u) * rows[j + 1, 0]
    return values + t * u * (u * rows[j, 1] - t * rows[j + 1, 1]) / last


@inlined
def steer(where, g, rows, guide, pull, importance, state, address, count):
    """Turn every lane by an angle of the phase function, drawn towards the far face; multiply its weight by H.

    The density of the phase function's 1 - cos is left in ``SHAPE``. Every try has a key of its own, for tries have no
    bound.
    """
    for i in range(count):
        x, y, z = state[WX + i], state[WY + i], state[WZ + i]
        key = where.key1
        while True:
            key += _ONE
            a, b, c, _ = uniforms(where.key0, key, where.sample, address[PATH + i], address[ORDER + i] + ASIDE)
            if rows.shape[0] == 0:
                drop = sample_henyey_greenstein(g, a)
                shape = _TAU * henyey_greenstein(g, 1.0 - drop)
            else:
                drop, shape = sample_density(rows, guide, a)
            sine, cosine = sincos_turns(b)
            nx, ny, nz = deflect(x, y, z, drop, cosine, sine)
            after = scattered_importance(importance, nz)
            if c * pull.most * (1.0 - pull.rate * nz) < after:
                break
        state[WX + i], state[WY + i], state[WZ + i], state[SHAPE + i] = nx, ny, nz, shape
        state[DROP + i] = drop
        state[AMOUNT + i] *= scattered_importance(importance, z) / after


@inlined
def fly_stretched(mean_free_path, rate, state, count):
    """Move every lane by a stretched flight along its direction."""
    for i in range(count):
        z = state[WZ + i]
        depths = minus_log(state[FLIGHT + i]) / (1.0 - rate * z)  # in mean free paths
        flight = depths * mean_free_path
        state[X + i] += state[WX + i] * flight
        state[Y + i] += state[WY + i] * flight
        state[Z + i] += z * flight
        state[FLOWN + i] += flight
        state[AMOUNT + i] *= math.exp(-rate * z * depths)
