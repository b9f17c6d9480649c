"""The memory-effect correlation of a wide camera: K_v averaged over its directions v, light along the axis.

    K(q) = sum_n s_n E_n[w J0(q |R - <R>_n|)] / E_n[w],     n the 3 x 3 nodes of Gauss over the camera, s_n their shares

R is the way from face to face towards the node (:mod:`specklegen.memory_effects.oblique`). Its mean <R>_n turns the
phase of K_v, of which intensities know nothing, by another angle at each node, and is taken off lest the average lose
by it. The average is over the directions of q as well: to second order in v a square camera has no direction of its
own. Nodes that are mirror images of one another are one, and share the paths by their weight, so that K costs no more
than that of the axis.
"""

import numpy as np

from specklegen.core.quadrature import gauss_legendre
from specklegen.core.random_streams import Seed, seed_words
from specklegen.core.statistics import BATCHES
from specklegen.memory_effects.correlation import (
    RADIUS_BINS,
    MemoryEffectCorrelation,
    correlation_of_bins,
    radius_bins,
)
from specklegen.memory_effects.oblique import estimate_oblique_correlation
from specklegen.paths.endpoints import AXIS
from specklegen.scene.illumination import directions_of_sines
from specklegen.scene.media import PlaneMedium

_NODES = 3


def camera_nodes(half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Direction sines float64[n, 2] and shares float64[n] of the nodes of a camera of such half sides (x, y).

    The first lies on the axis; mirror images count with the one whose sines are not below 0.
    """
    points, weights = gauss_legendre(_NODES)
    middle = _NODES // 2
    points, weights = points[middle:], weights[middle:] * np.where(points[middle:] > 0, 1.0, 0.5)
    shares = np.outer(weights, weights).reshape(-1)
    return np.stack(np.meshgrid(*(points * side for side in half), indexing="ij"), -1).reshape(-1, 2), shares


def estimate_camera_correlation(
    medium: PlaneMedium, half: np.ndarray, paths: int, seed: Seed, *, threads: int | None = None
) -> MemoryEffectCorrelation:
    """Estimate K of a slab in transmission over a camera about the axis, from ``paths`` paths in 64 batches.

    Parameters
    ----------
    medium
        Without layers that refract.
    half : float64[2]
        Direction sines (x, y) from the camera's middle to its sides.
    paths, seed, threads
        Of all nodes together; the intensity that the weights tell is that of the axis.
    """
    (nodes, shares), unit, single = camera_nodes(half), 0.0, 0.0
    batches = min(BATCHES, max(paths // 16, 1))
    found = []
    for n, (sines, share) in enumerate(zip(nodes, shares, strict=True)):
        count = max(batches, round(paths * share))
        view = directions_of_sines("view", sines)
        ways = estimate_oblique_correlation(medium, AXIS, view, count, (*seed_words(seed), n), threads=threads)
        total = ways.weights.sum()
        unit = paths * total / count if n == 0 else unit
        scale = share * unit / total if total else 0.0
        middle = ways.weights @ ways.displacement / total if total else np.zeros(2)
        found.append((np.hypot(*(ways.displacement - middle).T), scale * ways.weights, ways.owners * batches // count))
        single += share * unit * ways.single_share
    radius, weight, owner = (np.concatenate(each) for each in zip(*found, strict=True))
    place = radius_bins(medium, radius)
    rows = np.bincount(owner * RADIUS_BINS + place, weight, batches * RADIUS_BINS).reshape(batches, RADIUS_BINS)
    return correlation_of_bins(rows, radius, weight, place, single, paths)
