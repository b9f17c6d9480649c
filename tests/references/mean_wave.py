"""The mean field inside a random medium, from the wave equation, against the effective medium's.

A line source stands at the origin in the middle of a gas of cylinders. Averaged over placements, the field at
distance r is that of a homogeneous medium of complex wavenumber K,

    <u(r)> = c H_0^(1)(K r),   K^2 = k^2 - 4 i n sum_n T_n,   2 Im K ~ sigma_t = n c_s

([Bar19] Eq. 20 and Fig. 4b: tau xi, with e^{-sigma_t r / 2}). A resonant cylinder has Re sum T_n = -1 and almost
nothing else, so Re K is k to second order in the density. Foldy, *Phys. Rev.* 67, 107 (1945), Eq. 23.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.statistics import jackknife
from specklegen.oracles.wave_ensemble import CylinderGas, ensemble
from specklegen.oracles.wave_solver import LineSources, Scattered, directions_of

SOURCE = np.zeros((1, 2))


def foldy_wavenumber(gas: CylinderGas) -> complex:
    """Effective wavenumber K of the mean field, radians per unit length."""
    k = gas.cylinder.wavenumber
    return complex(np.sqrt(k**2 - 4j * gas.density * gas.cylinder.t_matrix.sum()))


@dataclass(frozen=True)
class CoherentField:
    """Mean field over the free field of the same source, at distances ``radii`` float64[R].

    Attributes
    ----------
    gas : CylinderGas
    radii : float64[R]
    batches : complex128[B, R]
        Mean over free field, H_0(Kr) / H_0(kr) = e^{i(K - k)r} sqrt(k/K) by the effective medium; their mean
        over the first axis is the estimate.
    """

    gas: CylinderGas
    radii: np.ndarray
    batches: np.ndarray

    @property
    def ratio(self) -> np.ndarray:
        """Mean field over free field, complex128[R]."""
        return self.batches.mean(axis=0)

    def decay(self) -> tuple[float, float]:
        """Decay of |<u>| sqrt(r) per unit length, to be sigma_t / 2, and its standard error."""
        weight = self._weight()
        centred = self.radii - weight @ self.radii / weight.sum()
        return self._estimate(lambda ratio: -(weight * centred) @ np.log(np.abs(ratio)) / (weight @ centred**2))

    def phase(self) -> tuple[np.ndarray, np.ndarray]:
        """Phase of <u> beyond that of e^{i Re K r}, radians, float64[R], and its standard error."""
        turn = np.exp(-1j * (foldy_wavenumber(self.gas).real - self.gas.cylinder.wavenumber) * self.radii)
        return self._estimate(lambda ratio: np.angle(ratio * turn))

    def magnitude(self) -> tuple[np.ndarray, np.ndarray]:
        """|<u>| over the free field's, float64[R], and its standard error."""
        return self._estimate(np.abs)

    def _weight(self) -> np.ndarray:
        """One over the variance of ln |ratio|."""
        return np.square(np.abs(self.ratio)) / np.var(self.batches, axis=0)

    def _estimate(self, function: Callable[[np.ndarray], np.ndarray]) -> tuple:
        """Apply a function of the mean ratio, with the jackknife's correction and error."""
        ones = np.ones((len(self.batches), 1))
        return jackknife(np.hstack([self.batches, ones]), lambda total: function(total[:-1] / total[-1].real))


def coherent_field(
    gas: CylinderGas, radii: np.ndarray, *, placements: int, seed: int, workers: int | None = None,
    progress: bool = False,
) -> CoherentField:  # fmt: skip
    """Average the field of a line source at the origin over circles of the given radii and over placements.

    Points on a circle stand half a wavelength apart, about the size of a speckle.

    Raises
    ------
    RuleError
        If a circle leaves the rectangle of the gas, or comes closer to the source than a radius of a cylinder.
    """
    radii = np.asarray(radii, dtype=np.float64)
    room = float(min(*np.negative(gas.lower), *gas.upper))
    if not (radii.ndim == 1 and len(radii) > 1 and gas.cylinder.radius < radii.min() and radii.max() < room):
        reject("radii", f"at least two distances between {gas.cylinder.radius:g} and {room:g}", radii)
    counts = np.ceil(4 * np.pi * radii / gas.cylinder.wavelength).astype(int)
    rings = [r * directions_of(2 * np.pi * np.arange(n) / n) for r, n in zip(radii, counts, strict=True)]
    points, starts = np.concatenate(rings), np.concatenate([[0], np.cumsum(counts)[:-1]])
    light = LineSources(SOURCE)
    free = light.field(gas.cylinder.wavenumber, points)

    def ratio(solved: Scattered) -> np.ndarray:
        return np.add.reduceat(1 + solved.near_field(points) / free, starts, axis=1) / counts

    measured = ensemble(gas, light, {"ratio": ratio}, placements=placements, seed=seed, workers=workers,
                        progress=progress)  # fmt: skip
    return CoherentField(gas, radii, measured["ratio"].mean_batches[:, :, 0])
