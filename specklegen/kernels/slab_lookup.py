"""Memory effect of slabs: lookup table between its nodes, and the half range of the mixtures that it gives.

    K(q) = sum_m share[m] J0(q radius[m]),   radius[m] = thickness exp(sum_n w_n table[n, m])

w_n are products of Lagrange's cubic weights on four nodes along each of three axes: docs/atlas.md.
"""

import math

import numpy as np

from specklegen.kernels import kernel
from specklegen.kernels.bessel import bessel_mixture


@kernel
def fill_slab_mixtures(slabs, x, y, z, shares, table, bounds, tolerance, radius, share, single, served):
    """Look slabs up: the radii and shares of their mixtures, their single shares, and whether the table has them.

    slabs  : float64[B, 4]
        Thickness, optical depth, g and albedo of each.
    x, y, z : float64[D], float64[G], float64[A]
        Nodes along ln(optical depth), ln(1 - g), absorption.
    shares : float64[n]
    table  : float32[D G A, n + 1]
    bounds : float32[cells]
        Error of C_I in each cell, of which ``tolerance`` is allowed.
    radius, share : float64[B, n + 1]
        Filled; the first is of single scattering.
    single, served : float64[B], bool[B]
        Filled.
    """
    count = len(shares)
    place, weights, row = np.empty(3), np.empty((3, 4)), np.empty(count + 1)
    first, below = np.empty(3, np.int64), np.empty(3, np.int64)
    for slab in range(len(slabs)):
        thickness, depth, albedo = slabs[slab, 0], slabs[slab, 1], slabs[slab, 3]
        drop = 1.0 - slabs[slab, 2]
        place[0], place[1] = math.log(depth), math.log(drop)
        place[2] = math.sqrt(1.0 - math.log(albedo) * (depth * (1.0 + 0.5 * depth * drop))) - 1.0
        # Four nodes about each coordinate, and Lagrange's weights on them.
        inside = True
        for axis in range(3):
            nodes = x if axis == 0 else (y if axis == 1 else z)
            at = place[axis]
            inside = inside and nodes[0] <= at <= nodes[-1]
            last = np.searchsorted(nodes, at, side="right") - 1
            below[axis] = min(max(last, 0), len(nodes) - 2)
            first[axis] = min(max(last - 1, 0), len(nodes) - 4)
            for n in range(4):
                weight, own = 1.0, nodes[first[axis] + n]
                for m in range(4):
                    if m != n:
                        other = nodes[first[axis] + m]
                        weight *= (at - other) / (own - other)
                weights[axis, n] = weight
        # Interpolated row.
        row[:] = 0.0
        for i in range(4):
            for j in range(4):
                for k in range(4):
                    weight = weights[0, i] * weights[1, j] * weights[2, k]
                    node = table[((first[0] + i) * len(y) + first[1] + j) * len(z) + first[2] + k]
                    for m in range(count + 1):
                        row[m] += weight * node[m]
        # Single scattering is exact; the rest is a mixture.
        alone = albedo * depth * math.exp(-depth) * (2.0 - drop) / (4.0 * math.pi * (drop * drop))
        multiple = albedo * albedo * math.exp(row[count])
        total = alone
        for m in range(count):
            total += multiple * shares[m]
        radius[slab, 0], share[slab, 0] = 0.0, alone / total
        for m in range(count):
            radius[slab, m + 1] = thickness * math.exp(row[m])
            share[slab, m + 1] = multiple * shares[m] / total
        single[slab] = alone / (alone + multiple)
        cell = (below[0] * (len(y) - 1) + below[1]) * (len(z) - 1) + below[2]
        served[slab] = inside and bounds[cell] <= tolerance


@kernel
def fill_half_ranges(radius, share, single, nodes, scan, step, half, found):
    """Find where C_I = K^2 of mixtures is half way to its floor, the square of the single share.

    K is scanned upwards from a lower bound, q is interpolated by Lagrange's polynomial in K, and a Newton step follows.

    radius, share : float64[B, m]
    single : float64[B]
    nodes  : float64[n]
        Of the polynomial, over the first q of the scan at which K is below.
    scan   : float64[s]
        Steps of the scan over its start.
    step   : float
        Relative step of the Newton step's slope.
    half, found : float64[B], bool[B]
        Filled: the half range, and whether there is one.
    """
    count = len(nodes)
    q, seen = np.empty(max(count, 4)), np.empty(max(count, 4))
    for place in range(len(single)):
        r, p = radius[place], share[place]
        floor = single[place] * single[place]
        level = math.sqrt(floor + 0.5 * (1.0 - floor))
        squares = 0.0
        for m in range(len(r)):
            squares += p[m] * (r[m] * r[m])
        start = 1.999 * math.sqrt((1.0 - level) / squares)
        # The scan, four q at once; where none is below, the first counts.
        high, below = start * scan[0], False
        for first in range(0, len(scan), 4):
            some = min(4, len(scan) - first)
            for n in range(some):
                q[n] = start * scan[first + n]
            bessel_mixture(q[:some], r, p, seen[:some])
            for n in range(some):
                if not below and seen[n] < level:
                    high, below = q[n], True
            if below:
                break
        for n in range(count):
            q[n] = high * nodes[n]
        bessel_mixture(q[:count], r, p, seen[:count])
        at = 0.0
        for n in range(count):
            ratio = 1.0
            for m in range(count):
                if m != n:
                    ratio *= (level - seen[m]) / (seen[n] - seen[m])
            at += q[n] * ratio
        q[0], q[1], q[2] = at * (1.0 - step), at, at * (1.0 + step)
        bessel_mixture(q[:3], r, p, seen[:3])
        half[place] = at * (1.0 + 2.0 * step * (seen[1] - level) / (seen[0] - seen[2]))
        found[place] = below and floor <= 1.0 - 1e-9
