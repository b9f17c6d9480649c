"""Random displacements of the particles at both ends of connections, and of those between, step by step in time.

Every normal is addressed by (key of the seed and step, sample, path, order): a film with one frame more draws the same.
"""

import numpy as np

from specklegen.kernels import kernel
from specklegen.kernels.rng import normal_pair, uniforms

COLUMNS = 7
"""Three components of the first particle, three of the last, one for all between."""
_ONE = np.uint64(1)


@kernel
def add_step(key0, key1, sample, orders, paths, amount, out):
    """Add ``amount`` times standard normals to ``out`` float64[M, COLUMNS], those of paths and orders int[M]."""
    for m in range(out.shape[0]):
        path, block = np.uint64(paths[m]), np.uint64(2 * np.int64(orders[m]))
        a, b, c, d = uniforms(np.uint64(key0), np.uint64(key1), np.uint64(sample), path, block)
        e, f, g, h = uniforms(np.uint64(key0), np.uint64(key1), np.uint64(sample), path, block + _ONE)
        n0, n1 = normal_pair(a, b)
        n2, n3 = normal_pair(c, d)
        n4, n5 = normal_pair(e, f)
        n6, _ = normal_pair(g, h)
        row = out[m]
        row[0] += amount * n0
        row[1] += amount * n1
        row[2] += amount * n2
        row[3] += amount * n3
        row[4] += amount * n4
        row[5] += amount * n5
        row[6] += amount * n6
