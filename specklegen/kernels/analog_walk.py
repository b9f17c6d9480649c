"""Light that goes as it goes: exponential flights, the phase function's angles, nothing aimed at any view.

Each path enters through the face at the lower end of z and ends where it leaves the medium. Absorption is a weight, the
product of the albedos of its collisions; paths of little weight end by Russian roulette, which keeps the mean. A flight
that meets a face which reflects is turned back with Fresnel's probability and keeps its remaining optical depth; so it
does where it is refracted into a layer of another index.

Behind layers that refract, a path may be looked at along the axis: each collision adds the light that it sends there,

    w = p(+-mu) (n' / n)^2 e^(-OD) P+-,

P+ and P- the shares of light down and up the axis, at the ends of a layer, that leave by the far face
(:mod:`specklegen.paths.steps`); (n' / n)^2 for the solid angle that refraction to the index n' outside makes wider. Of
the places where it is sent off, one is kept, by its share of w: with the sum of all, it has their E[w e^(-iq.R)].
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import kernel
from specklegen.kernels.arithmetic import minus_log
from specklegen.kernels.frames import deflect
from specklegen.kernels.fresnel import reflectance
from specklegen.kernels.lanes import carried
from specklegen.kernels.phase_table import choose_type, power, sample
from specklegen.kernels.refraction import BEHIND, fly_layers
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.kernels.volume import exit_distance, march, voxel

X, Y, Z, DX, DY, DZ, WEIGHT = range(7)
"""Columns of an exit: where, in which direction inside the medium, with which weight."""
COLUMNS = 7
ENTRANCE, FAR, SIDE, ENDED = 0, 1, 2, 3
"""Ends of a path: through the face where light came in, the one opposite, a side; inside, by roulette."""
_LIGHT, _KEPT = 1e-3, 0.1  # weight below which roulette is played, and the chance to go on

# Random dimensions: block 0 of the start, blocks 2 n + 1 and 2 n + 2 of the flight after n collisions and of its end;
# from _BOUNCE on, of meetings with faces.
_BOUNCE = np.uint64(0x80000000)
_ONE, _TWO = np.uint64(1), np.uint64(2)

SEEN_X, SEEN_Y, SEEN, SEEN_ONCE, SEEN_TURNED = range(5)
"""Columns of light that is seen along the axis: place of one collision, light of all, of the first; transfer to one."""
SEEN_COLUMNS = 5


class Steps(NamedTuple):
    """Layers of refractive indices that differ.

    Attributes
    ----------
    indices, edges : float64[n], float64[n + 1]
        Of each layer; depths of their faces, 0 first.
    entrance, far : float
        Indices of the walls over both outer faces; those of the layers behind them where there are none.
    down, up : float64[n]
        Share of the light at the lower (upper) end of each layer, on its way down (up) the axis, that leaves by the far
        face, over the square of the layer's index beside that outside, times what the first face lets in.
    seen : float64[paths, SEEN_COLUMNS], or float64[0, SEEN_COLUMNS] where not asked for
        Output: what is seen along the axis behind the layers.
    """

    indices: np.ndarray
    edges: np.ndarray
    entrance: float
    far: float
    down: np.ndarray
    up: np.ndarray
    seen: np.ndarray


class Ends(NamedTuple):
    """Ends of paths, written by the walk.

    Attributes
    ----------
    exits : float64[n, COLUMNS]
    collisions, faces : int64[n]
        Scattering events; ENTRANCE, FAR, SIDE or ENDED.
    turned : float64[n], or float64[0] where not asked for
        Sum of 1 - cos theta, each times the mobility there.
    doppler : float64[n], or float64[0] where not asked for
        Sum of (w - w') . V, w' the direction that leaves a collision, V the flow there.
    """

    exits: np.ndarray
    collisions: np.ndarray
    faces: np.ndarray
    turned: np.ndarray
    doppler: np.ndarray


@kernel
def walk_analog(key0, key1, first, volume, table, outer, steps, light, out):
    """Walk the paths ``first`` ... and write where each of them ends.

    volume, table : Volume, PhaseTable   in three dimensions
    outer : (float, float, float)        refractive indices inside, of the wall, outside
    steps : Steps or None                of layers; None leaves all that belongs to them out of the compiled walk
    light : float64[3]                   direction of the light in the first layer, light[2] > 0
    out : Ends                           output
    """
    exits, collisions, ends, turned = out.exits, out.collisions, out.faces, out.turned
    bounds, cells, per_length = volume.bounds, volume.cells, volume.per_length
    extinction, albedo, material = volume.extinction, volume.albedo, volume.material
    inside, wall, outside = outer
    stepped = inside != wall or wall != outside
    mobility, transfers = volume.mobility, turned.shape[0] > 0
    flow, doppler, flows = volume.flow, out.doppler, out.doppler.shape[0] > 0
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
        weight, events, end, total, shift = 1.0, 0, ENDED, 0.0, 0.0
        dimension, bounce = _ONE, _BOUNCE
        layer, walls = 0, (inside, inside, outside)
        if steps is not None:
            steps.seen[n : n + 1] = 0.0
            walls = steps.entrance, steps.far, outside
        while weight > 0.0:
            flight, azimuth, polar, second = uniforms(k0, k1, zero, path, dimension)
            choice, coin, pick, other_pick = uniforms(k0, k1, zero, path, dimension + _ONE)
            dimension += _TWO
            target, left = minus_log(flight), False
            while True:
                if steps is not None:  # a layer at a time
                    layer, x, y, z, dx, dy, dz, _, bounce = fly_layers(
                        steps.indices, extinction, steps.edges, walls, layer, (x, y, z, dx, dy, dz), target,
                        (k0, k1, zero), path, bounce,
                    )  # fmt: skip
                    if layer < 0:
                        end, left = FAR if layer == BEHIND else ENTRANCE, True
                    break
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
            here = voxel(bounds, cells, per_length, x, y, z) if steps is None else layer
            weight *= albedo[here]
            kind = choose_type(table, material[here], choice)
            if steps is not None:
                for side, u in ((1.0, pick), (-1.0, other_pick)):
                    gain = steps.down[here] if side > 0.0 else steps.up[here]
                    if steps.seen.shape[0] == 0 or gain == 0.0:
                        continue
                    reach = steps.edges[here + 1] - z if side > 0.0 else z - steps.edges[here]
                    w = weight * power(table, kind, side * dz) * gain * math.exp(-extinction[here] * max(reach, 0.0))
                    steps.seen[n, SEEN] += w
                    if events == 1:
                        steps.seen[n, SEEN_ONCE] += w
                    if u * steps.seen[n, SEEN] < w:
                        steps.seen[n, SEEN_X], steps.seen[n, SEEN_Y] = x, y
                        if transfers:
                            steps.seen[n, SEEN_TURNED] = total + (1.0 - side * dz) * mobility[here]
            if weight < _LIGHT:
                weight = weight / _KEPT if coin < _KEPT else 0.0
            sine, cosine = sincos_turns(azimuth)
            drop = sample(table, kind, polar, second)
            if flows:
                shift += carried(flow, here, x, y, z, dx, dy, dz)
            dx, dy, dz = deflect(dx, dy, dz, drop, cosine, sine)
            if flows:
                shift -= carried(flow, here, x, y, z, dx, dy, dz)
            if transfers:
                total += drop * mobility[here]
        exits[n, X], exits[n, Y], exits[n, Z] = x, y, z
        exits[n, DX], exits[n, DY], exits[n, DZ], exits[n, WEIGHT] = dx, dy, dz, weight
        collisions[n], ends[n] = events, end
        if transfers:
            turned[n] = total
        if flows:
            doppler[n] = shift
