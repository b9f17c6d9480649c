"""The correlation transfer equation of a slab of isotropic scatterers, solved without Monte Carlo.

Between two tilts, every path carries the extra phase e^(i kappa.(r_1 - r_B)) of its lateral displacement, so the
correlation of the fields obeys radiative transfer with a lateral wave number kappa (in units of 1/l, l the mean free
path; forward paths only). Integrated over directions, with depths in mean free paths and D the optical depth,

    psi(z) = S(z) + albedo integral_0^D K(|z - z'|) psi(z') dz',     S(z) = e^(-alpha z)
    K(z) = integral d^2r e^(i kappa.r) e^(-R) / (4 pi R^2) = 1/2 integral_1^inf e^(-p z) / p ds,   p^2 = s^2 + kappa^2

K is a sum of decaying exponentials because e^(-R)/R is the integral of e^(-sR) over s >= 1, and each Yukawa
potential e^(-sR)/(4 pi R) has the transform e^(-pz)/(2p); at kappa = 0 it is Schwarzschild and Milne's E1(z)/2. The
exponents of source and sensor are complex: (1/mu_1 + 1/mu_2)/2 attenuates, and k l (i_1z - i_2z) turns.

Product integration on Gauss panels, graded towards the faces, exact for the logarithm of K.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expn

from specklegen.core.quadrature import gauss_legendre

_NODES = 8  # a panel
_FIRST_PANEL = 1e-4  # mean free paths: psi has a term z log z at the faces
_GRID = gauss_legendre(_NODES)
_EXPONENTIALS = gauss_legendre(48)  # K to 3e-11 (E1 at kappa = 0)


@dataclass(frozen=True)
class Exchange:
    """Correlation of the fields per unit area of the face, in units of albedo/(4 pi).

    Attributes
    ----------
    single, multiple : complex
        Scattered once, and more often (forward paths), in mean free paths.
    """

    single: complex
    multiple: complex

    @property
    def total(self) -> complex:
        """Single and multiple scattering together."""
        return self.single + self.multiple


def field_correlation(
    q: ArrayLike,
    optical_depth: float,
    *,
    albedo: float = 1.0,
    mode: Literal["transmission", "reflection"] = "transmission",
) -> np.ndarray:
    """Field correlation K(q) between normal incidence and a small tilt, views moved along, float64 of the shape of q.

    Isotropic scatterers, view along the normal, kappa = q / OD; C_I = K^2. Forward paths only.

    Parameters
    ----------
    q
        k L sin(tilt), any shape.
    optical_depth, albedo
        Thickness over mean free path; share of collisions that scatter.
    mode
        Which face is looked at.
    """
    side = 1.0 if mode == "transmission" else -1.0
    q = np.abs(np.asarray(q, dtype=np.float64))

    def total(kappa: float) -> float:
        return exchange(kappa, optical_depth, source=1.0, sensor=side, albedo=albedo).total.real

    return np.array([total(float(each)) for each in q.ravel() / optical_depth]).reshape(q.shape) / total(0.0)


def quadruple(
    optical_depth: float,
    *,
    mean_free_path: float,
    wavelength: float,
    lights: tuple[ArrayLike, ArrayLike],
    views: tuple[ArrayLike, ArrayLike],
    albedo: float = 1.0,
) -> Exchange:
    """Correlation of u(i1, v1) with u(i2, v2) of a slab under unlimited plane waves of unit amplitude.

    Parameters
    ----------
    optical_depth, mean_free_path, wavelength, albedo
        Of the slab; the wavelength inside it, in the unit of the mean free path.
    lights, views
        (i1, i2) and (v1, v2), unit vectors of travel float[3]; i1 - i2 and v1 - v2 agree sideways, for all other
        correlations vanish.
    """
    (i1, i2), (v1, v2) = np.asarray(lights, dtype=np.float64), np.asarray(views, dtype=np.float64)
    assert np.abs((i1 - i2 - v1 + v2)[:2]).max() <= 1e-9
    assert i1[2] * i2[2] > 0
    assert v1[2] * v2[2] > 0
    k = 2 * np.pi * mean_free_path / wavelength

    def exponent(a, b):
        """Decay from the face that the rays cross, signed by the side on which it lies."""
        return np.sign(a[2]) * (1 / abs(a[2]) + 1 / abs(b[2])) / 2 - 1j * k * (a[2] - b[2])

    kappa = float(k * np.linalg.norm((i1 - i2)[:2]))
    found = exchange(kappa, optical_depth, exponent(i1, i2), exponent(v1, v2), albedo)
    # `exchange` measures depths from the face that the rays cross.
    phase = np.exp(1j * k * optical_depth * ((i1[2] < 0) * (i1[2] - i2[2]) - (v1[2] > 0) * (v1[2] - v2[2])))
    return Exchange(found.single * phase, found.multiple * phase)


def exchange(kappa: float, optical_depth: float, source: complex, sensor: complex, albedo: float = 1.0) -> Exchange:
    """Solve at one lateral wave number.

    Parameters
    ----------
    kappa
        Lateral wave number times the mean free path.
    optical_depth, albedo
        As above.
    source, sensor
        Exponents: the source is e^(-source z) for light that enters at z = 0 (real part above 0), and
        e^(-source (z - D)) for light that enters at z = D (below 0); the sensor is e^(-sensor (D - z)) at z = D
        (above 0, transmission) and e^(sensor z) at z = 0 (below 0, reflection).
    """
    nodes, weights, edges = _panels(optical_depth, kappa, max(abs(source.imag), abs(sensor.imag)))
    entering = np.exp(-source * (nodes - (optical_depth if source.real < 0 else 0.0)))
    leaving = np.exp(-sensor * ((optical_depth if sensor.real > 0 else 0.0) - nodes))
    density = collision_density(kappa, edges, entering, albedo)
    return Exchange(complex(weights @ (leaving * entering)), complex(weights @ (leaving * (density - entering))))


def transmittance(optical_depth: float, albedo: float = 1.0) -> float:
    """Total transmittance at normal incidence, ballistic light included."""
    nodes, weights, edges = _panels(optical_depth, 0.0, 0.0)
    density = collision_density(0.0, edges, np.exp(-nodes), albedo)
    return float(np.exp(-optical_depth) + albedo / 2 * (weights @ (density * expn(2, optical_depth - nodes))))


def collision_density(kappa: float, edges: np.ndarray, source: np.ndarray, albedo: float) -> np.ndarray:
    """Solve psi = S + albedo K psi at the Gauss nodes of the panels, complex128[N]."""
    matrix = np.eye(len(source)) - albedo * _transfer(kappa, edges)
    return np.linalg.solve(matrix, source)


def _panels(optical_depth: float, kappa: float, turn: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss nodes, weights float64[N] and panel edges, finer at the faces, and fine enough for kappa and phases."""
    longest = 3 / max(1.0, kappa, turn)
    halves = [0.0, min(_FIRST_PANEL, optical_depth / 4)]
    while halves[-1] < optical_depth / 2:
        halves.append(halves[-1] + min(longest, 2 * halves[-1]))
    halves = np.array(halves) * (optical_depth / 2 / halves[-1])
    edges = np.concatenate([halves, (optical_depth - halves)[-2::-1]])
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (1 + _GRID[0])).ravel(), (half * _GRID[1]).ravel(), edges


def _transfer(kappa: float, edges: np.ndarray) -> np.ndarray:
    """Matrix float64[N, N] of psi -> integral K(|z - z'|) psi(z') dz' from nodes to nodes."""
    half = np.diff(edges) / 2
    nodes = edges[:-1, None] + half[:, None] * (1 + _GRID[0])
    z = nodes.ravel()
    matrix = _kernel(kappa, np.abs(z[:, None] - z)) * (half[:, None] * _GRID[1]).ravel()
    # Near the diagonal the logarithm is integrated by t -> t^4, which removes it, from the nearest point of the panel.
    t, w = gauss_legendre(20)
    t, w = (1 + t) / 2, w / 2
    t, w = t**4, 4 * t**3 * w
    for panel in range(len(half)):
        start, end = edges[panel], edges[panel + 1]
        near = np.flatnonzero((z > start - 2 * (end - start)) & (z < end + 2 * (end - start)))
        target = z[near, None]
        split = np.clip(target, start, end)
        points = np.concatenate([split - (split - start) * t, split + (end - split) * t], axis=1)
        weights = np.concatenate([(split - start) * w, (end - split) * w], axis=1)
        values = weights * _kernel(kappa, np.abs(points - target))
        inside = (points - start) / half[panel] - 1
        columns = slice(panel * _NODES, (panel + 1) * _NODES)
        matrix[near, columns] = np.einsum("np,npj->nj", values, _lagrange(inside))
    return matrix


def _lagrange(x: np.ndarray) -> np.ndarray:
    """Lagrange polynomials of the Gauss nodes, float64[..., nodes]: sums of Legendre polynomials."""
    nodes, weights = _GRID
    degrees = np.arange(_NODES)
    vandermonde = np.polynomial.legendre.legvander
    return vandermonde(x, _NODES - 1) @ (vandermonde(nodes, _NODES - 1) * (degrees + 0.5) * weights[:, None]).T


def _kernel(kappa: float, distance: np.ndarray) -> np.ndarray:
    """K of depth differences float64[...]: 1/2 integral e^(-p z) s/p dt with s = e^t; finite, but of no use, at 0."""
    distance = np.maximum(distance, 1e-280)
    x, w = _EXPONENTIALS
    top = np.log1p(45 / distance)  # beyond it e^(-s z) < e^-45
    total = np.zeros_like(distance)
    for node, weight in zip(x, w, strict=True):
        s = np.exp(top * (1 + node) / 2)
        p = np.hypot(s, kappa)
        total += weight * s / p * np.exp(-p * distance)
    return total * top / 4
