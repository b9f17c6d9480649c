"""Every order in which a wave can visit the same nodes: [Bar19] Eqs. 59-61, Figs. 14-15.

    C_B = sum over pi of sigma_s^B integral of mu(x_1 ... x_B) mu(x_pi(1) ... x_pi(B))* dx_1 ... dx_B
    mu  = xi(i -> x_1) s xi(x_1 -> x_2) s ... xi(x_B -> v),      xi(a -> b) = tau e^(ik|b - a|) / |b - a|^((d - 1)/2)

over the permutations pi of the nodes. The identity is the forward path and always positive, the reversal is
stationary only where v = -i; the rest turn too fast to count, and the framework leaves them out.
"""

from itertools import combinations, permutations

import numpy as np

from specklegen.oracles.box_media import SOLID_ANGLE, Medium


def permutation_covariance(
    medium: Medium, wavelength: float, lights: tuple[np.ndarray, np.ndarray], views: tuple[np.ndarray, np.ndarray],
    paths: int, rng: np.random.Generator, *, nodes: int = 3, apart: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Mean contribution of every permutation to the covariance of u(i1, v1) and u(i2, v2), complex128[B!, V].

    The forward path is first and the reversed one last, as :func:`itertools.permutations` has them.

    Parameters
    ----------
    medium
        One box and one kind of particle.
    wavelength
        Inside the medium.
    lights, views
        (i1, i2) float64[d] and (v1, v2) float64[V, d], unit vectors of travel.
    paths, nodes
        Sets of nodes drawn, and B.
    apart
        Only sets whose nodes are all at least this far from each other.
    """
    visited, weights = draw_nodes(medium, paths, nodes, rng)
    for a, b in combinations(range(nodes), 2):
        weights = weights * (np.linalg.norm(visited[:, a] - visited[:, b], axis=1) >= apart)
    first = throughput(medium, wavelength, lights[0], views[0], visited)
    return np.array(
        [
            weights @ (first * throughput(medium, wavelength, lights[1], views[1], visited[:, list(order)]).conj())
            for order in permutations(range(nodes))
        ]
    ) / paths  # fmt: skip


def draw_nodes(medium: Medium, paths: int, nodes: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Positions float64[n, B, d] inside the box and their weights sigma_s^B over density, n <= paths. The first is
    uniform; each next at a uniform distance from the one before, in a uniform direction: that takes up the 1/r^(d - 1)
    of the forward path."""
    (lower,), (upper,), dimension = medium.lower, medium.upper, medium.dimension
    reach = float(np.linalg.norm(upper - lower))
    x = [rng.uniform(lower, upper, (paths, dimension))]
    weights = np.full(paths, float(np.prod(upper - lower)))
    for _ in range(nodes - 1):
        step = rng.normal(size=(paths, dimension))
        r = rng.uniform(0, reach, paths)
        x.append(x[-1] + step * (r / np.linalg.norm(step, axis=1))[:, None])
        weights *= SOLID_ANGLE[dimension] * r ** (dimension - 1) * reach
    x = np.stack(x, axis=1)
    inside = ((x >= lower) & (x <= upper)).all(axis=(1, 2))
    return x[inside], weights[inside] * float(medium.albedo[0] * medium.extinction[0]) ** nodes


def throughput(medium: Medium, wavelength: float, light: np.ndarray, views: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Amplitude mu of visiting the nodes float64[n, B, d] in their order, complex128[n, V]."""
    k, s = 2 * np.pi / wavelength, medium.particles[0].amplitude
    steps = np.diff(x, axis=1)
    r = np.linalg.norm(steps, axis=2)
    w = np.concatenate([np.broadcast_to(light, (len(x), 1, x.shape[2])), steps / r[..., None]], axis=1)
    mu = np.exp(1j * k * (x[:, 0] @ light) - 0.5 * medium.optical_depth(x[:, 0], -np.asarray(light), np.inf))
    mu = mu * np.prod(s((w[:, :-1] * w[:, 1:]).sum(axis=-1)), axis=1)
    mu = mu * np.exp((1j * k - 0.5 * medium.extinction[0]) * r.sum(axis=1))
    mu = mu / np.prod(r, axis=1) ** ((x.shape[2] - 1) / 2)
    away = np.array([medium.optical_depth(x[:, -1], v, np.inf) for v in views]).T
    return mu[:, None] * s(w[:, -1] @ views.T) * np.exp(-0.5 * away - 1j * k * (x[:, -1] @ views.T))
