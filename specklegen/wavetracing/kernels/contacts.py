"""Segments against the triangles of a scene: which ones lie near which."""

import math

import numpy as np

from specklegen.kernels import kernel
from specklegen.wavetracing.kernels.beam_state import axes_about
from specklegen.wavetracing.kernels.cone_bvh import collect_all
from specklegen.wavetracing.kernels.cones import CONE


@kernel
def neighbours(segments, reach, tree, pairs):
    """List segments and the places of triangles within ``reach`` of them: their number, and as many as fit.

    segments : float64[n, 6], both ends;  pairs : int64[room, 2], out
    """
    cone, places, count = np.empty(CONE), np.empty(256, np.int64), 0
    for s in range(segments.shape[0]):
        x, y, z = segments[s, 3:] - segments[s, :3]
        length = math.sqrt(x * x + y * y + z * z)
        if length == 0.0:
            continue
        x, y, z = x / length, y / length, z / length
        cone[:3] = segments[s, :3]
        cone[3], cone[4], cone[5], cone[6], cone[7], cone[8] = axes_about(x, y, z)
        cone[9], cone[10], cone[11], cone[12], cone[13] = x, y, z, reach, 0.0
        places, found = collect_all(cone, 0.0, length, tree, places)
        for n in range(found):
            if count < pairs.shape[0]:
                pairs[count, 0], pairs[count, 1] = s, places[n]
            count += 1
    return count
