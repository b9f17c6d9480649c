"""Algorithms 1 and 2 of [Bar19], transcribed to NumPy with the corrections of physics.md 2.

    C_pq = E[ W a_p a_q* ]                        Algorithm 1
    u_p  = N^(-1/2) sum over paths and B of z sqrt(W) a_p,    z = e^(2 pi i zeta)        Algorithm 2

for pairs p = (illumination i, view v), a slab 0 <= z <= L and square collimated beams. As printed, the
first vertex is uniform in the illuminated volume and the first direction uniform on the sphere; every
vertex is connected to the sensor. Corrected: W carries 4 pi = 1/p_omega for B >= 2; single scattering has
sqrt(V), not sqrt(V/2), and is never doubled; free paths have sigma_t, and the albedo weighs; a reversed
path that would start outside the volume has no share in the balance heuristic. The mean field is left
out: C and u are of u - m.

Source: Bar, Alterman, Gkioulekas, Levin, *A Monte Carlo framework for rendering speckle statistics in
scattering media* (ACM TOG 38(4), 2019), Algorithms 1-2, Eqs. 13-17, 38.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from specklegen.scene.media import Slab

SOLID_ANGLE = 4 * np.pi


@dataclass(frozen=True)
class Pairs:
    """A slab seen at P pairs of a collimated beam and a far-field view.

    Attributes
    ----------
    medium : Slab
    wavelength, width : float
        Inside the medium; full side of the square beam on the face z = 0, centred at the origin. The beam
        has unit irradiance per area of the face at every tilt.
    lights, views : float64[P, 3]
        Unit vectors of travel, of the beams and of the views.
    """

    medium: Slab
    wavelength: float
    width: float
    lights: np.ndarray
    views: np.ndarray

    @property
    def half_side(self) -> float:
        """Half side of the square column that holds the footprints of all beams at every depth."""
        return self.width / 2 + self.medium.thickness * float(np.abs(self.lights[:, :2] / self.lights[:, 2:]).max())

    @property
    def volume(self) -> float:
        """V, the volume in which first vertices are drawn."""
        return (2 * self.half_side) ** 2 * self.medium.thickness


def algorithm1(pairs: Pairs, paths: int, rng: np.random.Generator, *, reverse: bool = False) -> np.ndarray:
    """Covariance C_pq = E[u_p u_q*] - m_p m_q*, complex128[P, P], area per steradian for unit irradiance."""
    covariance = np.zeros((len(pairs.lights), len(pairs.lights)), np.complex128)
    for _, weight, amplitude in contributions(pairs, paths, rng, reverse=reverse):
        covariance += (weight * amplitude) @ amplitude.conj().T
    return covariance / paths


def algorithm2(
    pairs: Pairs, paths: int, realizations: int, rng: np.random.Generator, *, reverse: bool = False
) -> np.ndarray:
    """Fields u - m, complex128[realizations, P], each from ``paths`` paths of its own."""
    field = np.zeros((realizations, len(pairs.lights)), np.complex128)
    for path, weight, amplitude in contributions(pairs, paths * realizations, rng, reverse=reverse):
        phase = np.exp(2j * np.pi * rng.random(len(path)))  # one for all pairs: their correlation
        np.add.at(field, path // paths, (phase * np.sqrt(weight) * amplitude).T)
    return field / np.sqrt(paths)


def contributions(
    pairs: Pairs, paths: int, rng: np.random.Generator, *, reverse: bool
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield for B = 1, 2, ...: path numbers int64[n], weights W float64[n], amplitudes a complex128[P, n]."""
    medium, volume = pairs.medium, pairs.volume
    scattering = medium.albedo * medium.extinction
    lights, views = pairs.lights, pairs.views
    s = lambda cos: amplitude_function(medium.scatterer.g, cos)  # noqa: E731
    for order, path, x1, w1, xb, wb in subpaths(medium, pairs.half_side, paths, rng):
        if order == 1:
            weight = np.full(len(path), scattering * volume)
            turn = s(np.sum(lights * views, axis=1))[:, None]
            yield path, weight, _illumination(pairs, x1) * turn * _sensor(pairs, x1)
            continue
        density = np.full(len(path), 1 / (SOLID_ANGLE * volume))
        amplitude = _illumination(pairs, x1) * s(lights @ w1.T) * s(views @ wb.T) * _sensor(pairs, xb)
        if reverse:
            in_volume = (np.abs(xb[:, :2]) <= pairs.half_side).all(axis=1)
            density += in_volume / (SOLID_ANGLE * volume)
            amplitude += _illumination(pairs, xb) * s(-lights @ wb.T) * s(-views @ w1.T) * _sensor(pairs, x1)
        yield path, scattering * medium.albedo ** (order - 1) / density, amplitude


def subpaths(medium: Slab, half_side: float, paths: int, rng: np.random.Generator) -> Iterator[tuple]:
    """Walk all paths at once; yield (B, path, x1, omega_1, x_B, omega_(B-1)) of those still inside.

    path : int64[n];   x1, omega_1, x_B, omega_(B-1) : float64[n, 3] (omega_0 is omega_1, and unused)
    """
    path = np.arange(paths)
    x1 = rng.uniform((-half_side, -half_side, 0), (half_side, half_side, medium.thickness), (paths, 3))
    w1 = _deflect(np.tile((0.0, 0.0, 1.0), (paths, 1)), 1 - 2 * rng.random(paths), rng)
    x, w = x1, w1
    order = 1
    while len(path):
        yield order, path, x1, w1, x, w
        if order > 1:
            w = _deflect(w, henyey_greenstein_cosines(medium.scatterer.g, rng.random(len(path))), rng)
        x = x + w * rng.exponential(medium.mean_free_path, (len(path), 1))
        inside = (x[:, 2] >= 0) & (x[:, 2] <= medium.thickness)
        path, x1, w1, x, w = path[inside], x1[inside], w1[inside], x[inside], w[inside]
        order += 1


def amplitude_function(g: float, cos: np.ndarray) -> np.ndarray:
    """Scattering amplitude s = sqrt(rho), rho = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2)), Henyey-Greenstein."""
    return np.sqrt((1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * cos) ** 1.5))


def henyey_greenstein_cosines(g: float, u: np.ndarray) -> np.ndarray:
    """Cosines drawn from the Henyey-Greenstein phase function by inversion, u uniform in (0, 1)."""
    if g == 0:
        return 1 - 2 * u
    return (1 + g**2 - ((1 - g**2) / (1 - g + 2 * g * u)) ** 2) / (2 * g)


def _deflect(w: np.ndarray, cos: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Turn directions float64[n, 3] by polar angles of the given cosine, at uniform azimuths."""
    azimuth = 2 * np.pi * rng.random(len(w))
    helper = np.where(np.abs(w[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    across = np.cross(w, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    upright = np.cross(across, w)
    sin = np.sqrt(np.clip(1 - cos**2, 0, None))
    turned = across * (sin * np.cos(azimuth))[:, None] + upright * (sin * np.sin(azimuth))[:, None] + w * cos[:, None]
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def _illumination(pairs: Pairs, x: np.ndarray) -> np.ndarray:
    """b_i(x) tau(i, x) xi(i -> x), complex128[P, n]."""
    lights = pairs.lights[:, None, :]
    depth = x[:, 2] / lights[..., 2]
    face = x[:, :2] - depth[..., None] * lights[..., :2]  # where the ray through x enters
    profile = (np.abs(face) <= pairs.width / 2).all(axis=-1) / np.sqrt(lights[..., 2])
    turns = pairs.lights @ x.T / pairs.wavelength
    return profile * np.exp(-0.5 * pairs.medium.extinction * depth + 2j * np.pi * turns)


def _sensor(pairs: Pairs, x: np.ndarray) -> np.ndarray:
    """Compute tau(x, v) xi(x -> v), complex128[P, n]."""
    along = pairs.views[:, 2:]
    distance = np.where(along > 0, pairs.medium.thickness - x[:, 2], -x[:, 2]) / along
    turns = pairs.views @ x.T / pairs.wavelength
    return np.exp(-0.5 * pairs.medium.extinction * distance - 2j * np.pi * turns)
