"""Light walked through layers one photon after the other, by the book: no lanes, no volumes, no thinning.

Flights are exponential and end anew in every layer; angles are those of Henyey and Greenstein; absorption is a weight
with roulette. At a step of the refractive index a photon is reflected with Fresnel's probability for unpolarised light,
else refracted [L. Wang, S. L. Jacques, L. Zheng, *MCML*, Comput. Methods Programs Biomed. 47, 131 (1995)]. At every
collision the light that would leave straight along the axis is noted with its place, whose distribution is the
memory-effect correlation: K(q) = E[w J0(q r)] / E[w]. It goes there either way, reflected by chance at every step; from
a layer of index n it spreads outside over (n / outside)^2 times its solid angle.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.special import j0

BATCHES = 64
_FAINT, _SURVIVES = 1e-4, 0.1


@dataclass(frozen=True)
class LayeredLight:
    """Light of layers for unit irradiance along the axis.

    Attributes
    ----------
    specular : float
        Reflected by the first face.
    reflected, transmitted : float64[BATCHES]
        Diffusely reflected, and transmitted, shares; means of batches of photons.
    radii, weights, batch : float64[M], float64[M], int64[M]
        Places r at which light leaves along the axis behind the layers, its radiance there times the photons traced,
        and its batch.
    """

    specular: float
    reflected: np.ndarray
    transmitted: np.ndarray
    radii: np.ndarray
    weights: np.ndarray
    batch: np.ndarray

    def sums(self, q: np.ndarray) -> np.ndarray:
        """Sums of w and of w J0(q r), float64[BATCHES, 1 + n], at lateral wavevector differences float64[n]."""
        waves = [self.weights, *(self.weights * j0(each * self.radii) for each in q)]
        return np.stack([np.bincount(self.batch, wave, BATCHES) for wave in waves], axis=-1)


def walk_layers(
    layers: Sequence[tuple[float, float, float, float, float]], *, paths: int, seed: int, outside: float = 1.0
) -> LayeredLight:
    """Walk photons through layers, each (thickness, mean free path, albedo, g, refractive index).

    Parameters
    ----------
    layers
        From the one that light enters first.
    paths, seed
        Photons, in 64 equal batches; seed of Numba's own generator, below 2^32.
    outside
        Refractive index around.
    """
    table = np.array(layers, np.float64)
    indices = np.concatenate([[outside], table[:, 4], [outside]])
    edges, each = np.append(0.0, np.cumsum(table[:, 0])), paths // BATCHES
    back, through = np.zeros(BATCHES), np.zeros(BATCHES)
    room = 64 * paths
    while True:
        places, weights, batch = np.empty(room), np.empty(room), np.empty(room, np.int64)
        back[:], through[:] = 0.0, 0.0
        found = _walk(table, edges, indices, each, seed, back, through, places, weights, batch)
        if found <= room:
            break
        room = found
    return LayeredLight(_reflectance(indices[0], indices[1], 1.0)[0], back / each, through / each, places[:found],
                        weights[:found], batch[:found])  # fmt: skip


@njit
def _reflectance(before, behind, cosine):
    """R of unpolarised light at an angle, and the cosine of the angle behind."""
    if before == behind:
        return 0.0, cosine
    sine = before / behind * math.sqrt(max(0.0, 1.0 - cosine * cosine))
    if sine >= 1.0:
        return 1.0, 0.0
    other = math.sqrt(1.0 - sine * sine)
    s = (before * cosine - behind * other) / (before * cosine + behind * other)
    p = (before * other - behind * cosine) / (before * other + behind * cosine)
    return 0.5 * (s * s + p * p), other


@njit
def _walk(table, edges, indices, each, seed, back, through, places, weights, batch):
    np.random.seed(seed)  # noqa: NPY002 (Numba's own generator)
    last, found = len(table) - 1, 0
    for number in range(each * len(back)):
        owner = number // each
        weight = 1.0 - _reflectance(indices[0], indices[1], 1.0)[0]
        x = y = z = u = v = 0.0
        w, k = 1.0, 0
        while True:
            left = -math.log(1.0 - np.random.random()) * table[k, 1]  # noqa: NPY002
            face = edges[k + 1] if w > 0.0 else edges[k]
            ahead = (face - z) / w if w != 0.0 else math.inf
            if left >= ahead:
                x, y, z = x + ahead * u, y + ahead * v, face
                other = k + 1 if w > 0.0 else k - 1
                r, cosine = _reflectance(indices[k + 1], indices[other + 1], abs(w))
                if np.random.random() < r:  # noqa: NPY002
                    w = -w
                    continue
                ratio = indices[k + 1] / indices[other + 1]
                u, v, w = u * ratio, v * ratio, math.copysign(cosine, w)
                k = other
                if k < 0:
                    back[owner] += weight
                    break
                if k > last:
                    through[owner] += weight
                    break
                continue
            x, y, z = x + left * u, y + left * v, z + left * w
            weight *= table[k, 2]
            g = table[k, 3]
            for way in (1.0, -1.0):
                left = _left_along_axis(table, edges, indices, k, z, way)
                if left == 0.0:
                    continue
                if found < len(places):
                    lobe = (1.0 - g * g) / (4.0 * math.pi * (1.0 + g * g - 2.0 * g * w * way) ** 1.5)
                    narrower = (indices[0] / indices[k + 1]) ** 2
                    places[found], weights[found] = math.hypot(x, y), weight * lobe * narrower * left
                    batch[found] = owner
                found += 1
            if weight < _FAINT:
                if np.random.random() >= _SURVIVES:  # noqa: NPY002
                    break
                weight /= _SURVIVES
            u, v, w = _scattered(u, v, w, g)
    return found


@njit
def _left_along_axis(table, edges, indices, k, z, way):
    """What leaves by the far face of light that goes straight along the axis, its reflections chosen by chance."""
    depth = ((edges[k + 1] - z) if way > 0.0 else (z - edges[k])) / table[k, 1]
    while depth < 700.0:
        other = k + 1 if way > 0.0 else k - 1
        r = _reflectance(indices[k + 1], indices[other + 1], 1.0)[0]
        if r > 0.0 and np.random.random() < r:  # noqa: NPY002
            way = -way
        else:
            k = other
        if k < 0:
            return 0.0
        if k == len(table):
            return math.exp(-depth)
        depth += table[k, 0] / table[k, 1]
    return 0.0


@njit
def _scattered(u, v, w, g):
    chance, turn = np.random.random(), 2.0 * math.pi * np.random.random()  # noqa: NPY002
    if g == 0.0:
        cosine = 2.0 * chance - 1.0
    else:
        part = (1.0 - g * g) / (1.0 - g + 2.0 * g * chance)
        cosine = (1.0 + g * g - part * part) / (2.0 * g)
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    a, b = sine * math.cos(turn), sine * math.sin(turn)
    if abs(w) > 0.99999:
        return a, b, cosine * math.copysign(1.0, w)
    across = math.sqrt(1.0 - w * w)
    return (a * u * w / across - b * v / across + u * cosine, a * v * w / across + b * u / across + v * cosine,
            -a * across + w * cosine)  # fmt: skip
