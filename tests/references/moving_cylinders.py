"""Temporal correlation of speckle from the wave equation: cylinders that move, every placement solved again.

    g1(x; v, j) = C_x / sqrt(C_0 C_xx),   C_x = <u_0 u_x*> - <u_0><u_x>*

u_x is the field behind the same cylinders after independent Gaussian steps of <dr^2> = 4 D tau (flatland), which leave
e^(-D q^2 tau) of the correlation of light scattered once with momentum transfer q; x = D k^2 tau. No path, no phase
function and no momentum transfer enters: transport theory says E[w e^(-2xY)] / E[w] (docs/physics.md), and is judged.

A step that would make two cylinders overlap is drawn again; in an ideal gas few do. Cylinders that a flow carries
instead go where it says; those that would come to overlap stay where they were.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from specklegen.core.errors import reject
from specklegen.core.parallel import map_blocks
from specklegen.core.statistics import BATCHES, jackknife
from specklegen.oracles.wave_ensemble import CylinderGas, Sensor
from specklegen.oracles.wave_solver import Light, LineSources, scatter


@dataclass(frozen=True)
class TemporalCorrelation:
    """g1 of every view and light.

    Attributes
    ----------
    x : float64[X]
        D k^2 tau; of a flow times.
    field, standard_error : float64[X, V, L]
        Real part of g1 (of random motion the law has no other), and its error by the jackknife over batches.
    imaginary, imaginary_error : float64[X, V, L]
        Of the imaginary part, of random motion 0 within noise.
    """

    x: np.ndarray
    field: np.ndarray
    standard_error: np.ndarray
    imaginary: np.ndarray
    imaginary_error: np.ndarray


def moved(
    gas: CylinderGas, centres: np.ndarray, step: float, rng: np.random.Generator, clear: np.ndarray
) -> np.ndarray:
    """Centres float64[N, 2] after one Gaussian step each, ``step`` its standard deviation along an axis."""
    places = centres + step * rng.standard_normal(centres.shape)
    radius = gas.cylinder.radius
    while len(places):
        bad = cKDTree(places).query_pairs(2 * radius, output_type="ndarray").max(axis=1)
        if len(clear):
            bad = np.append(bad, np.flatnonzero(cKDTree(clear).query(places)[0] <= radius))
        if not len(bad):
            break
        places[bad.min()] = centres[bad.min()] + step * rng.standard_normal(2)
    return places


def _carried(
    gas: CylinderGas, centres: np.ndarray, time: float, flow: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Centres float64[N, 2] a time later; pairs that would come to overlap stay where they were."""
    places, radius = centres + time * flow(centres), gas.cylinder.radius
    while len(places):
        pairs = cKDTree(places).query_pairs(2 * radius, output_type="ndarray").ravel()
        if not len(pairs):
            break
        places[pairs] = centres[pairs]
    return places


def temporal_correlation(
    gas: CylinderGas,
    light: Light,
    sensor: Sensor,
    x: ArrayLike,
    *,
    placements: int,
    seed: int,
    batches: int = BATCHES,
    workers: int | None = None,
    flow: Callable[[np.ndarray], np.ndarray] | None = None,
) -> TemporalCorrelation:
    """Solve ``placements`` placements, and each again after every lag.

    Parameters
    ----------
    gas, light
        The random medium and its illumination.
    sensor
        What is measured, as ``lambda s: s.far_field(directions)``.
    x
        float64[X], D k^2 tau >= 0 that do not fall: cylinders walk from one lag to the next.
    placements
        In equal batches of at least two; the remainder of a division by ``batches`` is left out.
    seed
        Placement n is ``gas.placement(seed, n)``, its steps are another stream's.
    batches
        Independent batches behind the standard errors.
    workers
        Threads; by default one per core. The result is the same to the bit for any number.
    flow
        Velocities float64[N, 2] of centres float64[N, 2], which then move by these alone for the times ``x``.
    """
    x = np.atleast_1d(np.asarray(x, dtype=np.float64))
    if x.ndim != 1 or not len(x) or not np.isfinite(x).all() or (np.diff(x, prepend=0.0) < 0).any():
        reject("temporal_correlation x", "finite, at least 0, and each at least the one before", x)
    each = placements // batches if batches >= 2 else 0
    if each < 2:
        reject("temporal_correlation placements", f"at least two for each of {max(batches, 2)} batches", placements)
    clear = light.points if isinstance(light, LineSources) else np.empty((0, 2))
    steps = np.sqrt(2 * np.diff(x, prepend=0.0)) / gas.cylinder.wavenumber

    def fields(number: int) -> np.ndarray:
        """Before any motion and after each lag, complex128[1 + X, V, L]."""
        rng = np.random.default_rng(np.random.SeedSequence([seed, number, 1]))
        centres = gas.placement(seed, number, clear)
        series = [sensor(scatter(gas.cylinder, centres, light)).T]
        for step, time in zip(steps, np.diff(x, prepend=0.0), strict=True):
            if step > 0:
                centres = moved(gas, centres, step, rng, clear) if flow is None else _carried(gas, centres, time, flow)
                series.append(sensor(scatter(gas.cylinder, centres, light)).T)
            else:
                series.append(series[-1])
        return np.array(series)

    def run(batch: int) -> np.ndarray:
        """Sums of u_0 u_x*, |u_x|^2, u_x and 1: complex128[4, 1 + X, V, L]."""
        sums: np.ndarray | float = 0.0
        for number in range(batch * each, (batch + 1) * each):
            u = fields(number)
            sums = sums + np.array([u[:1] * u.conj(), np.square(np.abs(u)), u, np.ones_like(u)])
        return np.asarray(sums)

    with threadpool_limits(1):
        done = np.array(map_blocks(run, range(batches), workers))

    def ratio(sums: np.ndarray) -> np.ndarray:
        product, power, u, count = sums / sums[3]
        covariance = product - u[:1] * u.conj()
        own = (power - np.square(np.abs(u))).real
        return (covariance / np.sqrt(own[:1] * own))[1:]

    real, error = jackknife(done, lambda sums: ratio(sums).real)
    imaginary, imaginary_error = jackknife(done, lambda sums: ratio(sums).imag)
    return TemporalCorrelation(x, real, error, imaginary, imaginary_error)
