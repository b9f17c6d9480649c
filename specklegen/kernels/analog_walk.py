"""Light that goes as it goes: exponential flights, the lobe's angles, nothing aimed at any view.

Each path enters through the face at the lower end of z and ends where it leaves the medium. Absorption is a weight, the
product of the albedos of its collisions; paths of little weight end by Russian roulette, which keeps the mean. A flight
that meets a face which reflects is turned back with Fresnel's probability and keeps its remaining optical depth.
"""

import math

import numpy as np

from specklegen.kernels import kernel
from specklegen.kernels.arithmetic import minus_log
from specklegen.kernels.frames import deflect
from specklegen.kernels.fresnel import reflectance
from specklegen.kernels.phase_table import choose_type, sample
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.kernels.volume import exit_distance, march, voxel

X, Y, Z, DX, DY, DZ, WEIGHT = range(7)
"""Columns of an exit: where, in which direction inside the medium, with which weight."""
COLUMNS = 7
ENTRANCE, FAR, SIDE, ENDED = 0, 1, 2, 3
"""Where a path ended: through the face where light came in, the one opposite, a side; inside, by roulette."""
_LIGHT, _KEPT = 1e-3, 0.1  # weight below which roulette is played, and the chance to go on

# Random dimensions: block 0 of the start, blocks 2 n + 1 and 2 n + 2 of the flight after n collisions and of its end;
# from _BOUNCE on, of meetings with faces.
_BOUNCE = np.uint64(0x80000000)
_ONE, _TWO = np.uint64(1), np.uint64(2)


@kernel
def walk_analog(key0, key1, first, volume, table, indices, light, exits, collisions, ends, turned):
    """Walk the paths ``first`` ... and write where each of them ends.

    volume, table : Volume, PhaseTable   in three dimensions
    indices : (float, float, float)      refractive indices inside, of the wall, outside
    light : float64[3]                   direction of the light inside, light[2] > 0
    exits : float64[n, COLUMNS]          output
    collisions, ends : int64[n]          output: scattering events, and ENTRANCE, FAR, SIDE or ENDED
    turned : float64[n], or float64[0]   output where asked for: sum of 1 - cos theta, each times the mobility there
    """
    bounds, cells, per_length = volume.bounds, volume.cells, volume.per_length
    extinction, albedo, material = volume.extinction, volume.albedo, volume.material
    inside, wall, outside = indices
    stepped = inside != wall or wall != outside
    mobility, transfers = volume.mobility, turned.shape[0] > 0
    k0, k1, zero = np.uint64(key0), np.uint64(key1), np.uint64(0)
    bounded = math.isfinite(bounds[0, 0])
    for n in range(exits.shape[0]):
        path = np.uint64(first + n)
        x = y = 0.0
        z = bounds[0, 2]
        if bounded:  # anywhere on the entrance face
            u, v, _, _ = uniforms(k0, k1, zero, path, zero)
            x = bounds[0, 0] + u * (bounds[1, 0] - bounds[0, 0])
            y = bounds[0, 1] + v * (bounds[1, 1] - bounds[0, 1])
        dx, dy, dz = light[0], light[1], light[2]
        weight, events, end, total = 1.0, 0, ENDED, 0.0
        dimension, bounce = _ONE, _BOUNCE
        while weight > 0.0:
            flight, azimuth, polar, second = uniforms(k0, k1, zero, path, dimension)
            choice, coin, _, _ = uniforms(k0, k1, zero, path, dimension + _ONE)
            dimension += _TWO
            target, left = minus_log(flight), False
            while True:
                far = exit_distance(bounds, x, y, z, dx, dy, dz)
                depth, t = march(bounds, cells, extinction, x, y, z, dx, dy, dz, 0.0, far, target)
                if depth >= target:
                    x, y, z = x + t * dx, y + t * dy, z + t * dz
                    break
                x, y = x + far * dx, y + far * dy
                face = bounds[1, 2] if dz > 0.0 else bounds[0, 2]
                ahead = (face - z) / dz if dz != 0.0 else math.inf
                if ahead > far:
                    z, end, left = z + far * dz, SIDE, True
                    break
                z = face
                if stepped:
                    again, _, _, _ = uniforms(k0, k1, zero, path, bounce)
                    bounce += _ONE
                    if again < reflectance(abs(dz), inside, wall, outside):
                        dz = -dz
                        target -= depth
                        continue
                end, left = FAR if dz > 0.0 else ENTRANCE, True
                break
            if left:
                break
            events += 1
            here = voxel(bounds, cells, per_length, x, y, z)
            weight *= albedo[here]
            if weight < _LIGHT:
                weight = weight / _KEPT if coin < _KEPT else 0.0
            kind = choose_type(table, material[here], choice)
            sine, cosine = sincos_turns(azimuth)
            drop = sample(table, kind, polar, second)
            dx, dy, dz = deflect(dx, dy, dz, drop, cosine, sine)
            if transfers:
                total += drop * mobility[here]
        exits[n, X], exits[n, Y], exits[n, Z] = x, y, z
        exits[n, DX], exits[n, DY], exits[n, DZ], exits[n, WEIGHT] = dx, dy, dz, weight
        collisions[n], ends[n] = events, end
        if transfers:
            turned[n] = total
