"""Curves of any layered medium as smooth functions of its free numbers, fitted to Monte Carlo runs.

Runs of one seed at neighbouring numbers do not stay together: behind two layers, a change of g by 1e-4 moves C_I by a
third of its standard error. So every run has a seed of its own, and a polynomial is fitted to all runs within a box
of the free numbers: of degree 2 while the box shrinks onto the best fit, at the end of 3 and more, as long as that
predicts runs that are left out better. The scatter of the
runs about it gives the covariance S of the runs and of what the polynomial misses; of P terms fitted to N runs, the
polynomial's is P S / N at a run on average (Box and Wilson, J. R. Stat. Soc. B 13, 1 (1951)). It is added to that of
the data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from specklegen.core.arguments import real_number
from specklegen.core.budgets import Budget
from specklegen.core.errors import reject
from specklegen.mean.reflectance import reflectance_transmittance
from specklegen.measured.observations import (
    BallisticFraction,
    ContrastVersusBandwidth,
    MemoryCurve,
    Observation,
    TemporalCurve,
    Transmittance,
)
from specklegen.memory_effects.curve import memory_effect
from specklegen.memory_effects.temporal import temporal_correlation
from specklegen.models.calibration.least_squares import Held, minimize, nothing_held
from specklegen.scene.media import PlaneMedium
from specklegen.scene.polarisation import require_scalar
from specklegen.synthesis.spectrum import estimate_spectral_correlation

Model = Callable[..., PlaneMedium | Sequence[PlaneMedium]]
"""The medium of free numbers given by name, or one medium for each observation."""
_SHRINK, _REACH = 0.25, 6.0  # largest change of the box's width in a round; its half width in standard errors
_RISE, _WIDER = 12.0, 4  # least rise of chi squared at a face of the box, and times that it is widened
_GAIN = 0.9  # of the error at runs that are left out, by which a further degree has to lower it
_ROUNDS, _DEGREE, _SPARE = 12, 7, 8  # rounds, largest degree, and runs beyond two for each term
_STARTS = 5  # places along each axis from which the polynomial is minimised


@dataclass(frozen=True)
class Ranges:
    """Free numbers of a model and the ranges in which they are sought; the unknowns are 0 to 1 across each.

    Attributes
    ----------
    ends : float64[n, 2]
    low, high : float64[n]
        The box within which curves are known.
    """

    free: tuple[str, ...]
    ends: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def names(self) -> list[str]:
        """The free numbers."""
        return list(self.free)

    def weights(self, name: str) -> np.ndarray:
        """Return the unknown of a name, float64[n]."""
        return np.array([float(each == name) for each in self.free])

    def value(self, name: str, unknown: float) -> float:
        """Return the number of an unknown; at an end of the box, beyond which nothing is known, that of the range."""
        n = self.free.index(name)
        low, high = self.ends[n]
        share = 0.0 if unknown <= self.low[n] + 1e-9 else 1.0 if unknown >= self.high[n] - 1e-9 else unknown
        return float(low + share * (high - low))

    def held(self, name: str, value: float) -> float:
        """Return the unknown of a number."""
        low, high = self.limits(name)
        return (value - low) / (high - low)

    def limits(self, name: str) -> tuple[float, float]:
        """Ends of the range of a name."""
        low, high = self.ends[self.free.index(name)]
        return float(low), float(high)


def ranges_of(owner: str, free: Mapping[str, Any]) -> Ranges:
    """Return the ranges of a table of names and pairs, or refuse it."""
    if not isinstance(free, Mapping) or not free:
        reject(f"{owner} free", 'a table of names and ranges for a model, such as {"g": (0.5, 0.99)}', free)
    ends = []
    for name, pair in free.items():
        if isinstance(pair, str) or not isinstance(pair, Sequence) or len(pair) != 2:
            reject(f"{owner} free[{name!r}]", "a pair of numbers, the ends of its range", pair)
        low, high = (real_number(f"{owner} free[{name!r}]", each) for each in pair)
        if not -np.inf < low < high < np.inf:
            reject(f"{owner} free[{name!r}]", "a pair of finite numbers that rises", pair)
        ends.append((low, high))
    return Ranges(tuple(free), np.array(ends), np.zeros(len(ends)), np.ones(len(ends)))


@dataclass(frozen=True)
class Data:
    """Measured values.

    Attributes
    ----------
    observations : tuple of Observation
    """

    observations: tuple[Observation, ...]

    @cached_property
    def values(self) -> np.ndarray:
        """Measured values, float64[M]."""
        return np.concatenate([each.values for each in self.observations])

    @cached_property
    def errors(self) -> np.ndarray:
        """Standard errors float64[M]."""
        return np.concatenate([each.errors for each in self.observations])

    @property
    def covariance(self) -> np.ndarray:
        """Covariance float64[M, M] of the model's values."""
        raise NotImplementedError

    @cached_property
    def whitening(self) -> np.ndarray:
        """W float64[M, M]: residuals W (model less data) are independent, of variance 1."""
        return np.linalg.inv(np.linalg.cholesky(self.covariance + np.diag(self.errors**2)))


@dataclass(frozen=True)
class Surface(Data):
    """Data, and the polynomial of all their values within a box of the unknowns.

    Attributes
    ----------
    media_of : callable
        The medium of each observation, at unknowns float64[n].
    powers : int64[P, n]
        Of the polynomial's terms.
    terms : float64[P, M]
        Their factors.
    scatter : float64[M, M]
        Covariance of the runs, observations independent of each other.
    share : float
        What of it the polynomial has, at a run on average: terms over runs.
    """

    unknowns: Ranges
    media_of: Callable[[np.ndarray], tuple[PlaneMedium, ...]]
    powers: np.ndarray
    terms: np.ndarray
    scatter: np.ndarray
    share: float

    @property
    def covariance(self) -> np.ndarray:
        """Covariance float64[M, M] of the polynomial."""
        return self.share * self.scatter

    def shown(self, at: np.ndarray) -> np.ndarray:
        """Values that the model would show, float64[B, M], at unknowns float64[B, n]."""
        return _powers_at(_centred(at, self.unknowns), self.powers) @ self.terms

    def model(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (model less data), made independent, and their derivatives, at unknowns float64[B, n]."""
        ranges, centred = self.unknowns, _centred(at, self.unknowns)
        slopes = []
        for n in range(len(ranges.free)):
            lower = self.powers - (np.arange(self.powers.shape[1]) == n)
            factor = self.powers[:, n] * 2 / (ranges.high[n] - ranges.low[n])
            slopes.append((_powers_at(centred, np.maximum(lower, 0)) * factor) @ self.terms)
        return (self.shown(at) - self.values) @ self.whitening.T, self.whitening @ np.stack(slopes, -1)

    def best(self) -> tuple[np.ndarray, float]:
        """Unknowns float64[n] of the least chi squared within the box, and that."""
        low, high = self.unknowns.low, self.unknowns.high
        axes = np.linspace(low + 0.05 * (high - low), high - 0.05 * (high - low), _STARTS).T
        starts = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], -1)
        starts = starts[np.argsort(np.square(self.model(starts)[0]).sum(-1))[:_STARTS]]
        found = minimize(self.model, starts, low, high, nothing_held(len(starts), starts.shape[1]))
        least = int(np.argmin(found.cost))
        return found.at[least], float(found.cost[least])

    def open_faces(self) -> np.ndarray:
        """Return whether chi squared rises too little towards each face of the box, bool[2, n]: low, high."""
        (best, cost), ranges, count = self.best(), self.unknowns, len(self.unknowns.free)
        weights, values = np.tile(np.eye(count), (2, 1)), np.concatenate([ranges.low, ranges.high])
        held = Held(weights, np.tile(np.arange(count), 2), values)
        found = minimize(self.model, np.repeat(best[None], 2 * count, axis=0), ranges.low, ranges.high, held)
        return ((found.cost - cost < _RISE) & (values > 0) & (values < 1)).reshape(2, count)


def surface_of(
    owner: str, observations: tuple[Observation, ...], wavelengths: Sequence[float], model: Model, ranges: Ranges,
    budget: Budget,
) -> Surface:  # fmt: skip
    """Return the polynomial about the best fit."""

    def media_of(at: np.ndarray) -> tuple[PlaneMedium, ...]:
        made = model(**{name: float(low + u * (high - low))
                        for name, u, (low, high) in zip(ranges.free, at, ranges.ends, strict=True)})  # fmt: skip
        media = (made,) * len(observations) if isinstance(made, PlaneMedium) else tuple(made)
        if len(media) != len(observations) or not all(isinstance(each, PlaneMedium) for each in media):
            reject(f"{owner} model",
                   f"a function that returns a Slab or Layers, or one for each of {len(observations)} "
                   "observations", made)  # fmt: skip
        return media

    count = len(ranges.free)
    centre, half = np.full(count, 0.5), np.full(count, 0.5)
    at, values = np.empty((0, count)), np.empty((0, sum(len(each.values) for each in observations)))

    def surface_within(low: np.ndarray, high: np.ndarray, degree: int, number: int) -> tuple[Surface, float]:
        """Fit a polynomial within a box, after as many further runs there as it takes."""
        nonlocal at, values
        powers = _powers(count, degree)
        more = max(2 * len(powers) + _SPARE - int(_within(at, low, high).sum()), 1 if degree > 3 else _SPARE)
        places = low + (high - low) * _latin_hypercube(more, count, number)
        runs = [_run(owner, observations, media_of(place), wavelengths, budget, (number, n))
                for n, place in enumerate(places)]  # fmt: skip
        at, values = np.concatenate([at, places]), np.concatenate([values, runs])
        near = _within(at, low, high)
        return _fitted(observations, Ranges(ranges.free, ranges.ends, low, high), media_of, powers, at[near],
                       values[near])  # fmt: skip

    number = 0
    while True:
        low, high = np.maximum(centre - half, 0.0), np.minimum(centre + half, 1.0)
        surface, missed = surface_within(low, high, 2, number)
        number += 1
        best, _ = surface.best()
        slope = surface.model(best[None])[1][0]
        error = np.sqrt(np.diag(np.linalg.pinv(slope.T @ slope, rcond=1e-12)))
        beside = ((best - low < 0.1 * half) & (low > 0)) | ((high - best < 0.1 * half) & (high < 1))
        wanted = np.where(beside, half, np.clip(_REACH * error, _SHRINK * half, 0.5))
        if number == _ROUNDS or (not beside.any() and (wanted > 0.7 * half).all()):
            break
        centre, half = best, wanted
    for wider in range(_WIDER):
        for degree in range(3, _DEGREE + 1):
            better, misses = surface_within(low, high, degree, _ROUNDS + wider * _DEGREE + degree)
            if misses > _GAIN * missed and degree > 3:
                break
            surface, missed = better, misses
        below, above = surface.open_faces()
        if not (below | above).any():
            break
        width = high - low
        low, high = np.maximum(low - below * width / 2, 0.0), np.minimum(high + above * width / 2, 1.0)
    return surface


def _latin_hypercube(points: int, count: int, seed: int) -> np.ndarray:
    """Places float64[points, n] of 0 to 1, one in each slice of each axis; SciPy's has another argument by version."""
    draws = np.random.default_rng(seed)
    slices = draws.permuted(np.tile(np.arange(points), (count, 1)), axis=1).T
    return (slices + draws.random((points, count))) / points


def _within(at: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.all((at >= low) & (at <= high), axis=1)


def _fitted(
    observations: tuple[Observation, ...], box: Ranges, media_of: Callable[[np.ndarray], tuple[PlaneMedium, ...]],
    powers: np.ndarray, at: np.ndarray, values: np.ndarray,
) -> tuple[Surface, float]:  # fmt: skip
    """Fit a polynomial to runs, and return its mean square error at a run that is left out, in variances of the data.

    Allen, Technometrics 16, 125 (1974).
    """
    basis = _powers_at(_centred(at, box), powers)
    terms, *_ = np.linalg.lstsq(basis, values, rcond=None)
    missed = values - basis @ terms
    ends = np.cumsum([len(each.values) for each in observations])[:-1]
    scatter = block_diag(*(part.T @ part for part in np.split(missed, ends, axis=1))) / (len(at) - len(powers))
    surface = Surface(observations, box, media_of, powers, terms, scatter, len(powers) / len(at))
    left_out = missed / (1 - np.einsum("bp,pb->b", basis, np.linalg.pinv(basis)))[:, None]
    return surface, float(np.square(left_out / surface.errors).mean())


def _run(
    owner: str, observations: Sequence[Observation], media: Sequence[PlaneMedium], wavelengths: Sequence[float],
    budget: Budget, key: tuple[int, int],
) -> np.ndarray:  # fmt: skip
    """Values float64[M] of one run."""
    seed = tuple(np.atleast_1d(budget.seed).tolist())
    parts = []
    for n, (each, medium, wavelength) in enumerate(zip(observations, media, wavelengths, strict=True)):
        fields: Any = {"paths": budget.paths, "threads": budget.threads, "seed": (*seed, *key, n)}
        if isinstance(each, MemoryCurve):
            value = memory_effect(medium, wavelength=wavelength, tilts=each.at, **fields).intensity
        elif isinstance(each, TemporalCurve):
            found = temporal_correlation(medium, wavelength=wavelength, lags=each.at, **fields)
            value = 1 + each.beta * found.intensity
        elif isinstance(each, ContrastVersusBandwidth):
            require_scalar(f"{owner} model", medium)
            lengths = estimate_spectral_correlation(medium, **fields)
            value = [lengths.contrast(width, each.spectrum) for width in each.at]
        elif isinstance(each, Transmittance | BallisticFraction):
            light = reflectance_transmittance(medium, **fields)
            value = [light.ballistic if isinstance(each, BallisticFraction) else light.transmittance]
        else:
            reject(f"{owner} observations", "of another type, since a model does not predict this one", each)
        parts.append(value)
    row = np.concatenate(parts)
    if not np.isfinite(row).all():
        reject(f"{owner} paths", "enough that some carry light", budget.paths)
    return row


def _powers(count: int, degree: int) -> np.ndarray:
    """Powers int64[P, n] of all terms of a polynomial of n variables."""
    terms = [each for order in range(degree + 1) for each in combinations_with_replacement(range(count), order)]
    return np.array([np.bincount(np.array(each, int), minlength=count) for each in terms])


def _powers_at(centred: np.ndarray, powers: np.ndarray) -> np.ndarray:
    """Terms float64[B, P] at places float64[B, n] of -1 to 1."""
    return np.prod(centred[:, None, :] ** powers, axis=-1)


def _centred(at: np.ndarray, box: Ranges) -> np.ndarray:
    """Places float64[B, n] within a box: -1 to 1."""
    return (2 * at - box.low - box.high) / (box.high - box.low)
