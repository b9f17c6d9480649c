"""Algorithm 1 of [Bar19] for a slab as a straightforward Numba program: the covariance at a few points.

    C_pq = E[ W a_p a_q* ]

The walk and the ends of ``naive_numba``, every connection kept, with the phases averaged out. Forward paths.
"""

import numpy as np
from numba import njit
from references.naive_numba import (
    _amplitude,
    _deflect,
    _dot,
    _first_vertex,
    _illumination_end,
    _phase_function,
    _sample_cosine,
    _sensor_end,
    laid_out,
)

from specklegen.scene.media import Slab


def naive_covariance(
    medium: Slab, *, wavelength: float, width: float, lights: np.ndarray, views: np.ndarray, paths: int, seed: int
) -> np.ndarray:
    """C = E[(u - m)(u - m)*] between n points, complex128[n, n].

    Parameters
    ----------
    medium, wavelength, width, paths, seed
        As in :func:`references.naive_numba.naive_field`.
    lights, views
        float64[n, 3] each, unit vectors of travel; lights with z > 0.
    """
    lights, views = np.ascontiguousarray(lights), np.ascontiguousarray(views)
    scene, reference, half_side = laid_out(medium, wavelength, width, lights)
    total = np.zeros((len(lights), len(lights)), np.complex128)
    _algorithm1(scene, medium.albedo, half_side, reference, lights, views, paths, seed, total)
    return total / paths


@njit
def _algorithm1(scene, albedo, half_side, reference, lights, views, paths, seed, total):
    thickness, sigma_t, g, _, _ = scene
    np.random.seed(seed)  # noqa: NPY002 (Numba's own generator)
    x1, w1, x, w = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    entering, a = np.empty(len(lights), np.complex128), np.empty(len(lights), np.complex128)
    for _ in range(paths):
        weight = _first_vertex(sigma_t, albedo, half_side, reference, x1)
        if x1[2] > thickness:
            continue  # crossed without a collision
        for p in range(len(lights)):
            entering[p] = _illumination_end(scene, x1, lights[p])
            a[p] = entering[p] * _amplitude(g, _dot(lights[p], views[p]))
            a[p] *= _sensor_end(scene, x1, views[p, 0], views[p, 1], views[p, 2])
        _add(weight, a, total)
        cosine = _sample_cosine(g)
        _deflect(reference, cosine, w1)
        weight /= _phase_function(g, cosine)  # p_omega
        for p in range(len(lights)):
            entering[p] *= _amplitude(g, _dot(lights[p], w1))
        x[:] = x1
        w[:] = w1
        while True:
            x += np.random.exponential(1 / sigma_t) * w  # noqa: NPY002
            if x[2] < 0 or x[2] > thickness:
                break
            weight *= albedo
            for p in range(len(lights)):
                a[p] = entering[p] * _amplitude(g, _dot(w, views[p]))
                a[p] *= _sensor_end(scene, x, views[p, 0], views[p, 1], views[p, 2])
            _add(weight, a, total)
            _deflect(w, _sample_cosine(g), w)


@njit
def _add(weight, a, total):
    for p in range(len(a)):
        for q in range(len(a)):
            total[p, q] += weight * a[p] * a[q].conjugate()
