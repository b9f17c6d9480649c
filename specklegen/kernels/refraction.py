"""Flights through layers whose refractive indices differ: reflected or refracted at every face that they meet."""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined
from specklegen.kernels.fresnel import fresnel, reflectance
from specklegen.kernels.rng import uniforms

BEFORE, BEHIND = -1, -2
"""Exit of a flight from the layers, in place of a layer's number: through the first face, or through the last."""
_ONE = np.uint64(1)


class Stack(NamedTuple):
    """Layers as light in flight meets them.

    Attributes
    ----------
    indices, extinction : float64[n]
        Refractive index and extinction of each layer.
    edges : float64[n + 1]
        Depths of their faces, 0 first.
    entrance, far, outside : float
        Indices of the walls over both outer faces, those of the layers behind them where there are none; and around.
    """

    indices: np.ndarray
    extinction: np.ndarray
    edges: np.ndarray
    entrance: float
    far: float
    outside: float


@inlined
def bent(dx, dy, dz, before, behind):
    """Direction behind a step that lets the light through."""
    ratio = before / behind
    dx, dy = dx * ratio, dy * ratio
    return dx, dy, math.copysign(math.sqrt(max(1.0 - (dx * dx + dy * dy), 0.0)), dz)


@inlined
def fly_layers(indices, extinction, edges, walls, layer, ray, target, key, path, bounce):
    """Fly until an optical depth is spent, or out; chance, addressed from ``bounce`` on, decides at faces that reflect.

    walls : (entrance, far, outside)       ray : x, y, z and direction
    key : two words of the key and the number of the realization

    Returns (layer, or BEFORE or BEHIND; x, y, z and direction; the way flown, each length times its index; the next
    unused dimension).
    """
    x, y, z, dx, dy, dz = ray
    k0, k1, sample = key
    entrance, exit_wall, outside = walls
    flown = 0.0
    while True:
        face = edges[layer + 1] if dz > 0.0 else edges[layer]
        far = max((face - z) / dz, 0.0) if dz != 0.0 else math.inf
        depth = extinction[layer] * far
        here = indices[layer]
        if depth >= target:
            t = target / extinction[layer]
            return layer, x + t * dx, y + t * dy, z + t * dz, dx, dy, dz, flown + here * t, bounce
        x, y, z, target, flown = x + far * dx, y + far * dy, face, target - depth, flown + here * far
        beyond = layer + 1 if dz > 0.0 else layer - 1
        if 0 <= beyond < indices.shape[0]:
            s, p = fresnel(abs(dz), here, indices[beyond])
            back = 0.5 * (s + p)
        else:
            back = reflectance(abs(dz), here, exit_wall if dz > 0.0 else entrance, outside)
        if back > 0.0:
            again, _, _, _ = uniforms(k0, k1, sample, path, bounce)
            bounce += _ONE
            if again < back:
                dz = -dz
                continue
        if not 0 <= beyond < indices.shape[0]:
            return BEHIND if dz > 0.0 else BEFORE, x, y, z, dx, dy, dz, flown, bounce
        dx, dy, dz = bent(dx, dy, dz, here, indices[beyond])
        layer = beyond
