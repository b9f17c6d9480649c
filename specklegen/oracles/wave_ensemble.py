"""Speckle statistics from the wave equation: many random placements of cylinders, each solved exactly.

    C[v1, v2, j] = <u_v1(light 0) u_v2(light j)*> - m_v1(light 0) m_v2(light j)*,   m = <u>

over independent placements; no transport theory enters. [Bar19], section 5.

The number of cylinders is Poisson, so that a thin medium is the ideal gas that transport theory assumes. A
cylinder that overlaps an earlier one is drawn again, because the addition theorem needs them apart; that
concerns a fraction of the order of the filled area, 2e-4 in the oracle's scene.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from specklegen.core.errors import reject
from specklegen.core.parallel import map_blocks
from specklegen.core.statistics import BATCHES
from specklegen.oracles.cylinder import Cylinder
from specklegen.oracles.wave_solver import Light, LineSources, Scattered, scatter

CHUNK = 64
"""Placements whose fields are held before they are summed."""

Sensor = Callable[[Scattered], np.ndarray]
"""What is measured in one placement: complex128[L, V], e.g. ``lambda s: s.far_field(directions)``."""


@dataclass(frozen=True)
class CylinderGas:
    """Equal cylinders at random in a rectangle.

    Attributes
    ----------
    lower, upper : tuple of float
        Opposite corners (x, z).
    density : float
        Mean number of cylinders per area.
    """

    cylinder: Cylinder
    lower: tuple[float, float]
    upper: tuple[float, float]
    density: float

    def __post_init__(self) -> None:
        if not np.all(np.isfinite([self.lower, self.upper])) or not np.all(np.less(self.lower, self.upper)):
            reject("CylinderGas.lower", "finite and below upper in x and z", (self.lower, self.upper))
        if not 0 <= self.density < np.inf:
            reject("CylinderGas.density", "finite and at least 0", self.density)
        if self.density * np.pi * self.cylinder.radius**2 > 0.1:
            reject("CylinderGas.density", "low enough that cylinders fill at most a tenth of the area", self.density,
                   "Placements that avoid overlap are no longer an ideal gas.")  # fmt: skip

    @classmethod
    def with_mean_free_path(
        cls, cylinder: Cylinder, lower: tuple[float, float], upper: tuple[float, float], mean_free_path: float
    ) -> "CylinderGas":
        """Return the gas of density 1 / (c_s mean_free_path): independent scattering."""
        return cls(cylinder, lower, upper, 1 / (cylinder.cross_section * mean_free_path))

    @property
    def mean_free_path(self) -> float:
        """1 / (density c_s)."""
        return 1 / (self.density * self.cylinder.cross_section)

    @property
    def mean_number(self) -> float:
        """Mean number of cylinders."""
        return self.density * float(np.prod(np.subtract(self.upper, self.lower)))

    def placement(self, seed: int, realization: int, clear: np.ndarray | None = None) -> np.ndarray:
        """Centres of one placement, float64[N, 2]: a pure function of (seed, realization).

        A Poisson number, one after another uniform in the rectangle; one closer than two radii to an earlier
        one, or than a radius to a point of ``clear`` float64[n, 2] (line sources), is drawn again.
        """
        rng = np.random.default_rng(np.random.SeedSequence([seed, realization]))
        centres = rng.uniform(self.lower, self.upper, (rng.poisson(self.mean_number), 2))
        radius = self.cylinder.radius
        while len(centres):
            bad = cKDTree(centres).query_pairs(2 * radius, output_type="ndarray").max(axis=1)
            if clear is not None and len(clear):
                bad = np.append(bad, np.flatnonzero(cKDTree(clear).query(centres)[0] <= radius))
            if not len(bad):
                break
            centres[bad.min()] = rng.uniform(self.lower, self.upper)  # the first: those after it wait for it
        return centres


@dataclass(frozen=True)
class Moments:
    """Mean, intensity and covariance of the field at V places for L lights, with errors from independent batches.

    Attributes
    ----------
    placements : int
    mean, mean_error : complex128[V, L]
        <u>; standard errors of the real part (in the real part) and of the imaginary part (in the imaginary).
    covariance, covariance_error : complex128[V, V, L]
        C[v1, v2, j] = <u_v1(light 0) u_v2(light j)*> - mean mean*, unbiased; errors as above.
    intensity, intensity_error : float64[V, L]
        <|u - mean|^2>, unbiased.
    mean_batches : complex128[B, V, L]
    intensity_batches : float64[B, V, L]
        What every batch found; for errors of sums over places, whose errors are not independent.
    """

    placements: int
    mean: np.ndarray
    mean_error: np.ndarray
    covariance: np.ndarray
    covariance_error: np.ndarray
    intensity: np.ndarray
    intensity_error: np.ndarray
    mean_batches: np.ndarray
    intensity_batches: np.ndarray


def ensemble(
    gas: CylinderGas, light: Light, sensors: Mapping[str, Sensor], *, placements: int, seed: int,
    batches: int = BATCHES, workers: int | None = None, progress: bool = False,
) -> dict[str, Moments]:  # fmt: skip
    """Solve ``placements`` placements and return the moments of what every sensor sees.

    Memory holds one covariance per batch and does not grow with ``placements``. The result is the same to the
    bit for any number of workers.

    Parameters
    ----------
    gas, light
        The random medium and its illumination.
    sensors
        Named measurements, all taken from the same placements.
    placements
        In equal batches of at least two; the remainder of a division by ``batches`` is left out.
    seed
        Placement n is ``gas.placement(seed, n)``.
    batches
        Independent batches behind the standard errors.
    workers
        Threads; by default one per core.
    progress
        Show a progress bar.
    """
    if batches < 2:
        reject("batches", "at least 2", batches)
    each = placements // batches
    if each < 2:
        reject("placements", f"at least two for each of the {batches} batches", placements)
    bar = _bar(each * batches) if progress else None

    def run(number: int) -> dict[str, tuple]:
        return _batch(gas, light, sensors, seed, range(number * each, (number + 1) * each), bar)

    try:
        with threadpool_limits(1):  # threads of its own would change the last bit, and slow these small systems
            done = map_blocks(run, range(batches), workers)
    finally:
        if bar is not None:
            bar.close()
    return {name: _moments([batch[name] for batch in done], each * batches) for name in sensors}


def _batch(
    gas: CylinderGas, light: Light, sensors: Mapping[str, Sensor], seed: int, numbers: range, bar
) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Mean [V, L], covariance [V, V, L] and intensity [V, L] of one batch, for every sensor."""
    clear = light.points if isinstance(light, LineSources) else None
    sums: dict[str, list] = {name: [0.0, 0.0, 0.0] for name in sensors}
    for start in range(0, len(numbers), CHUNK):
        fields: dict[str, list[np.ndarray]] = {name: [] for name in sensors}
        for realization in numbers[start : start + CHUNK]:
            solved = scatter(gas.cylinder, gas.placement(seed, realization, clear), light)
            for name, sensor in sensors.items():
                fields[name].append(sensor(solved).T)
            if bar is not None:
                bar.update()
        for name, some in fields.items():
            u = np.array(some)  # placements, V, L
            sums[name][0] += u.sum(axis=0)
            sums[name][1] += _products(u)
            sums[name][2] += np.square(np.abs(u)).sum(axis=0)
    n = len(numbers)
    return {name: _unbiased(n, *three) for name, three in sums.items()}


def _products(u: np.ndarray) -> np.ndarray:
    """Sum over the first axis of u_v1(light 0) u_v2(light j)*, complex128[V, V, L]."""
    views = u.shape[1]
    return (u[:, :, 0].T @ u.conj().reshape(len(u), -1)).reshape(views, views, -1)


def _unbiased(n: int, field: np.ndarray, product: np.ndarray, power: np.ndarray) -> tuple:
    """Sample mean, covariance and variance, the last two over n - 1."""
    mean = field / n
    covariance = (product - n * _products(mean[None])) / (n - 1)
    return mean, covariance, (power - n * np.square(np.abs(mean))) / (n - 1)


def _moments(batches: list[tuple], placements: int) -> Moments:
    """Means over the batches and their standard errors."""
    mean, covariance, intensity = (np.array(kind) for kind in zip(*batches, strict=True))
    return Moments(
        placements=placements,
        mean=mean.mean(axis=0),
        mean_error=_error(mean),
        covariance=covariance.mean(axis=0),
        covariance_error=_error(covariance),
        intensity=intensity.mean(axis=0),
        intensity_error=_error(intensity).real,
        mean_batches=mean,
        intensity_batches=intensity,
    )


def _error(batches: np.ndarray) -> np.ndarray:
    """Standard errors of the mean over the first axis, of the real and the imaginary part apart."""
    parts = (np.std(part, axis=0, ddof=1) / np.sqrt(len(batches)) for part in (batches.real, batches.imag))
    real, imaginary = parts
    return real + 1j * imaginary


def _bar(total: int):
    from tqdm import tqdm

    return tqdm(total=total, unit="placement", disable=None)
