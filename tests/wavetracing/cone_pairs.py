"""Random pairs of a cone and a triangle, special positions among them."""

import numpy as np

from specklegen.kernels import kernel
from specklegen.wavetracing.kernels.cone_bvh import _box, _span, unpacked
from specklegen.wavetracing.kernels.cones import CONE, rounding, triangle_in_cone

KINDS = ("any", "across", "through the axis", "collinear", "at the apex", "cylinder", "slab", "thin")


def pairs(rng: np.random.Generator, count: int, decades: float = 0.0):
    """Cones float64[n, CONE] about z at the origin, near, far float64[n], corners float64[n, 9], sizes float64[n].

    Each kind has an equal share. With ``decades`` each pair is scaled by a power of ten of that range.
    """
    a, t = rng.uniform(0.1, 2, count), rng.uniform(0.01, 1, count)
    near, far = np.zeros(count), np.full(count, 50.0)
    centre = np.stack([*rng.normal(0, 4, (2, count)), rng.uniform(-3, 12, count)], axis=1)
    spread = 10 ** rng.uniform(-1, 1, count)
    corners = centre[:, None] + spread[:, None, None] * rng.normal(size=(count, 3, 3))
    kind = np.arange(count) % len(KINDS)
    corners[kind == 1, :, 2] = corners[kind == 1, :1, 2]
    axis = kind == 2
    corners[axis] -= corners[axis].mean(axis=1, keepdims=True) * [1, 1, 0]
    line = kind == 3
    corners[line, 2] = (corners[line, 0] + corners[line, 1]) / 2
    apex = kind == 4
    corners[apex, 0] = 0
    corners[apex, 0, 2] = -a[apex] / t[apex] * rng.choice([0.0, 1.0, 1.5], apex.sum())
    near[apex] = -100
    t[kind == 5] = 0
    slab = kind == 6
    near[slab] = rng.uniform(0, 5, slab.sum())
    far[slab] = near[slab] + rng.uniform(0, 3, slab.sum())
    thin = kind == 7
    corners[thin, 2] = corners[thin, 0] + 1e-9 * (corners[thin, 2] - corners[thin, 0])
    scale = 10 ** rng.uniform(-decades / 2, decades / 2, count)
    cones = np.zeros((count, CONE))
    cones[:, 3] = cones[:, 7] = cones[:, 11] = 1
    cones[:, 12], cones[:, 13] = a * scale, t
    return cones, near * scale, far * scale, (corners * scale[:, None, None]).reshape(count, 9), scale


@kernel
def triangles_in_cones(cones, near, far, corners, low, high):
    """Depths of triangle n in cone n, for all n; (inf, -inf) for a miss.

    cones : float64[n, CONE];  near, far : float64[n];  corners : float64[n, 9];  low, high : float64[n], out
    """
    for n in range(cones.shape[0]):
        low[n], high[n] = triangle_in_cone(unpacked(cones[n]), near[n], far[n], corners, n)


@kernel
def boxes_in_cones(cones, near, far, boxes, low):
    """Depth of box n in cone n, for all n; inf for a miss."""
    for n in range(cones.shape[0]):
        cone, box = unpacked(cones[n]), boxes[n : n + 1]
        slack = rounding(cones[n], box)
        slack_y, span = slack * (abs(cone[6]) + abs(cone[7]) + abs(cone[8])), _span(cone, near[n], far[n], slack)
        low[n] = _box(cone, span, slack, slack_y, near[n], far[n], box, 0)
