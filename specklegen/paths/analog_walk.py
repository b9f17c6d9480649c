"""Light walked through a slab as it goes, collision after collision, to where it leaves by the far face.

The flights are exponential, the angles those of the lobe, and absorption is a weight: nothing is aimed at a view, so
that sums over all views come without the variance of connections to narrow ones. A flight that meets a face which
reflects is turned back with Fresnel's probability and keeps its remaining length. All light here has entered the slab.
"""

import numpy as np

from specklegen.paths.faces import reflectance
from specklegen.scene.media import Slab

_NODES = 20001  # of the scattering angle, dense towards the forward lobe
_MOST_COLLISIONS = 100_000


def transmittance(slab: Slab, paths: int, seed: int) -> tuple[float, float]:
    """Share of a beam along the axis that leaves by the far face, unscattered light included; its standard error.

    Of a slab with faces, the share of the light that has entered it. The error is at least one path's, since none that
    was lost does not mean that none can be.
    """
    weights = walked(slab, paths, seed)[2]
    error = max(float(weights.std() / np.sqrt(paths)), 1 / paths)
    straight, back = np.exp(-slab.optical_depth), float(reflectance(slab.faces, np.ones(1))[0])
    return float((1 - back) * straight / (1 - (back * straight) ** 2) + weights.mean()), error


def walked(slab: Slab, paths: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lateral walks float64[P, 2], directions float64[P, 2] and weights float64[P], 0 of light that is not seen."""
    rng = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed)))
    tables = [_angles(scatterer) for scatterer, _ in slab.scatterer.components]
    shares = np.cumsum([share for _, share in slab.scatterer.components])
    position, direction = np.zeros((paths, 3)), np.tile([0.0, 0.0, 1.0], (paths, 1))
    weights, collided, alive = np.zeros(paths), np.zeros(paths), np.arange(paths)
    for _ in range(_MOST_COLLISIONS):
        flight = rng.exponential(slab.mean_free_path, len(alive))[:, None]
        ahead = position[alive] + flight * direction[alive]
        if not slab.faces.matched:
            _turned_back(slab, alive, position, direction, ahead, rng)
        inside = (ahead[:, 2] >= 0) & (ahead[:, 2] <= slab.thickness)
        out = alive[(ahead[:, 2] > slab.thickness) & (collided[alive] > 0)]
        left = (slab.thickness - position[out, 2:]) / direction[out, 2:]
        position[out] += left * direction[out]
        weights[out] = slab.albedo ** collided[out]
        alive, ahead = alive[inside], ahead[inside]
        if not len(alive):
            break
        position[alive] = ahead
        collided[alive] += 1
        kind = np.searchsorted(shares[:-1], rng.random(len(alive)) * shares[-1])
        drawn = rng.random(len(alive))
        theta = np.select([kind == n for n in range(len(tables))], [np.interp(drawn, *table) for table in tables])
        direction[alive] = _turned(direction[alive], theta, 2 * np.pi * rng.random(len(alive)))
    return position[:, :2], direction[:, :2], weights


def _turned_back(slab: Slab, alive: np.ndarray, position, direction, ahead: np.ndarray, rng) -> None:
    """Reflect flights to points ``ahead`` float64[n, 3], as often as faces do; legs are unfolded.

    Depths of ``position``, ``direction`` and ``ahead`` are mirrored about the face that a flight met.
    """
    there = np.arange(len(alive))
    while True:
        there = there[(ahead[there, 2] < 0) | (ahead[there, 2] > slab.thickness)]
        if not len(there):
            return
        slant = direction[alive[there], 2]
        there = there[rng.random(len(there)) < reflectance(slab.faces, slant)]
        who = alive[there]
        face = np.where(direction[who, 2] > 0, slab.thickness, 0.0)
        position[who, 2], ahead[there, 2] = 2 * face - position[who, 2], 2 * face - ahead[there, 2]
        direction[who, 2] *= -1


def _angles(scatterer) -> tuple[np.ndarray, np.ndarray]:
    """Shares of the light below an angle, and the angles, both float64[n]."""
    theta = np.pi * np.square(np.linspace(0, 1, _NODES))
    density = np.square(np.abs(scatterer.amplitude(np.cos(theta)))) * np.sin(theta)
    shares = np.append(0.0, np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(theta)))
    return shares / shares[-1], theta


def _turned(direction: np.ndarray, theta: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Unit vectors turned by theta about azimuths; the frame of Duff et al., JCGT 6, 1 (2017)."""
    x, y, z = direction.T
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    first = np.stack([1 + sign * x * x * a, sign * x * y * a, -sign * x], axis=1)
    second = np.stack([x * y * a, sign + y * y * a, -y], axis=1)
    across = np.sin(theta)[:, None] * (np.cos(azimuth)[:, None] * first + np.sin(azimuth)[:, None] * second)
    return across + np.cos(theta)[:, None] * direction
