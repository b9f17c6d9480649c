"""Your material from your own measurements: :func:`fit_material`.

Of a slab, least squares in logarithms of thickness, optical depth, 1 - g and diffusion, and in -ln albedo, over all
observations at once; of any model, in its own free numbers (:mod:`specklegen.models.calibration.model_fit`). Where a
valley is curved, pulls of a covariance claim too much: intervals are those of profiles; these are the values at which
the least chi squared with that value held has risen by as much as at the truth of drawn data (Hall, *The Bootstrap and
Edgeworth Expansion* (1992), chapter 1); at least by the quantile of chi squared of one degree.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, NamedTuple, Unpack, cast

import numpy as np
import tomli_w
from numpy.typing import ArrayLike
from scipy.linalg import block_diag
from scipy.stats import chi2

from specklegen.core.arguments import choice, instance, positive_number, real_array, real_number, several
from specklegen.core.budgets import Budget, BudgetFields, budget_of
from specklegen.core.display.plot import Pictured, with_interval
from specklegen.core.display.repr import summary
from specklegen.core.errors import reject
from specklegen.core.quantities import Like, with_units
from specklegen.core.shielded import shielded
from specklegen.core.units import WAVELENGTH
from specklegen.measured.observations import MemoryCurve, Observation, TemporalCurve
from specklegen.models.calibration.least_squares import Held, Minimum, minimize, nothing_held
from specklegen.models.calibration.model_fit import Data, Model, Ranges, Surface, ranges_of, surface_of
from specklegen.models.calibration.prediction import (
    DEPTH,
    DIFFUSION,
    DROP,
    LOSS,
    THICKNESS,
    covariance_of_tables,
    predict,
)
from specklegen.models.calibration.unknowns import Unknowns, unknowns_of
from specklegen.scene.media import PlaneMedium, Slab
from specklegen.scene.motion import Brownian
from specklegen.scene.scatterers import HenyeyGreenstein

VAGUE = 0.5
"""Standard error of a logarithm above which a number is not determined."""
_DOUBTFUL = 1e-3  # chance of a chi squared as large
_STARTS = 6
_PATHS = 20_000  # of every curve of a run
_SCAN = 9  # values of a curve that are looked at
_FAR = 0.2  # C_I at the first tilt below which tilts are beyond the memory effect
_CLOSE = 0.01  # of the root of a rise of chi squared
_SETS, _DRAWN = 99, 5  # of data, drawn at the fit, and their seed
_APART = 2.0  # standard errors from the fit, where sets are sought too

WORDS = {
    "thickness": "thickness", "mean_free_path": "mean free path", "optical_depth": "optical depth", "g": "1 - g",
    "transport_mean_free_path": "transport mean free path", "transport_depth": "transport depth L (1 - g) / l",
    "albedo": "-ln albedo", "diffusion": "diffusion",
}  # fmt: skip


class Interval(NamedTuple):
    """Ends of an interval; one that the data leave open ends where the tables do, or at infinity.

    Examples
    --------
    >>> from specklegen.models.calibration.material_fit import Interval
    >>> 0.9 in Interval(0.8, 0.95), 0.9 in Interval(0.2, 0.5)
    (True, False)
    """

    low: float
    high: float

    def __contains__(self, value: object) -> bool:
        return self.low <= real_number("Interval value", value) <= self.high


@dataclass(frozen=True)
class Problem(Data):
    """Data and unknowns of one slab, whose values the lookup tables give."""

    wavelength: float
    unknowns: Unknowns

    @property
    def covariance(self) -> np.ndarray:
        """Covariance float64[M, M] of the tables."""
        return block_diag(*(covariance_of_tables(each) for each in self.observations))

    def shown(self, at: np.ndarray) -> np.ndarray:
        """Values that slabs would show, float64[B, M], at unknowns float64[B, n]."""
        return predict(self.observations, self.wavelength, self.unknowns.slabs(at), ()).values

    def media_of(self, at: np.ndarray) -> tuple[Slab, ...]:
        """Return the slab at unknowns float64[n], once for each observation."""
        return (slab_of(self.unknowns.slabs(at)),) * len(self.observations)

    def model(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (model less data), made independent, and their derivatives, at unknowns float64[B, n]."""
        prediction = predict(self.observations, self.wavelength, self.unknowns.slabs(at), self.unknowns.moved)
        residual = np.where(prediction.inside[:, None], (prediction.values - self.values) @ self.whitening.T, np.inf)
        slopes = self.whitening @ (prediction.slopes @ self.unknowns.matrix)
        return np.nan_to_num(residual, posinf=1e150), np.nan_to_num(slopes)


@dataclass(frozen=True, eq=False, repr=False)
class MaterialFit(Pictured):
    """A fitted material.

    Attributes
    ----------
    media : tuple of Slab or Layers
        The medium of each observation that fits best.
    observations : tuple of Observation
        What it was fitted to.
    predicted : tuple of float64[M]
        What of each its medium would show.
    residuals : tuple of float64[M]
        Measured less predicted, in standard errors of the data alone.
    free : tuple of str
        What was looked for.
    covariance : float64[n, n]
        Of the logarithms of a slab's free numbers (of g that of 1 - g, of the albedo -ln), where chi squared is a
        parabola; of a model's, in units of their ranges.
    chi_squared : float
        Of the residuals, by the errors of the data and of the tables together.
    degrees : int
        Its degrees of freedom: values less free numbers.
    p_value : float
        Chance of a chi squared as large, if model and errors are right.
    degenerate : tuple of str
        What the data do not determine, and what they do instead; empty where all is determined.
    doubts : tuple of str
        What speaks against the model or the data.
    problem : Problem or Surface
        What was fitted, from which further fits and profiles start.
    spread : float64[n, n]
        Covariance of the problem's own unknowns at the best fit; of directions that the data leave open 1e12.
    at : float64[n]
        Those unknowns at the best fit.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> from specklegen.measured import MemoryCurve, Transmittance
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> tilts = np.linspace(2e-5, 5e-4, 25)
    >>> curve = sg.memory_effect(slab, wavelength=0.5, tilts=tilts, paths=20_000)
    >>> fit = sg.fit.fit_material([MemoryCurve(tilts, curve.intensity, 0.01), Transmittance(0.68, 0.01)],
    ...                       wavelength=0.5, known={"thickness": 1000.0, "g": 0.9}, free=("mean_free_path",))
    >>> 100 in fit.interval(0.999)["mean_free_path"]
    True
    """

    media: tuple[PlaneMedium, ...]
    observations: tuple[Observation, ...]
    predicted: tuple[np.ndarray, ...]
    residuals: tuple[np.ndarray, ...]
    free: tuple[str, ...]
    covariance: np.ndarray
    chi_squared: float
    degrees: int
    p_value: float
    degenerate: tuple[str, ...]
    doubts: tuple[str, ...]
    problem: Problem | Surface = field(repr=False)
    spread: np.ndarray = field(repr=False)
    at: np.ndarray = field(repr=False)

    def __repr__(self) -> str:
        return summary(self, ("values", "chi_squared", "degrees"))

    @property
    def slab(self) -> Slab:
        """The slab that fits best."""
        if isinstance(self.problem, Surface):
            reject("MaterialFit.slab", "read from a fit without a model", self, "Use .media: one for each observation.")
        return cast(Slab, self.media[0])

    @property
    def values(self) -> dict[str, float]:
        """The free numbers and what follows from them, by name."""
        unknowns = self.problem.unknowns
        return {name: unknowns.value(name, float(unknowns.weights(name) @ self.at)) for name in unknowns.names()}

    @property
    def hopeless(self) -> bool:
        """True if ``p_value`` is below 0.001, so that intervals of the free numbers mean nothing."""
        return self.p_value < _DOUBTFUL

    def interval(self, level: float = 0.95, *, force: bool = False) -> dict[str, Interval]:
        """Profile intervals, by name as in ``values``.

        A fit whose chi squared is ``hopeless`` has none: intervals assume that the model is right.

        They end where chi squared has risen by :attr:`rises`' quantile, or that of chi squared if it is larger. Share
        of setups in which intervals by the latter alone held the truth (docs/notes/materialfit.md):

            curves of        setups   level   thickness   mean free path   g
            paths            220      0.68    0.63        0.67             0.60
            paths            220      0.95    0.93        0.95             0.95
            lookup tables    224      0.68    0.67        0.67             0.72
            lookup tables    224      0.95    0.94        0.97             0.97

        Parameters
        ----------
        level
            Between 0 and 1, both excluded.
        force
            Whether to compute them for a hopeless fit too.

        Raises
        ------
        RuleError
            For a hopeless fit without ``force``.
        """
        if self.hopeless and not force:
            reject("MaterialFit.interval", f"computed for a fit with p_value of at least {_DOUBTFUL:g}",
                   f"{self.p_value:.1g}: chi squared {self.chi_squared:.4g} of {self.degrees}",
                   "The model or the errors are wrong: check the residuals, and fit another model. force=True computes "
                   "intervals nevertheless.")  # fmt: skip
        level = real_number("MaterialFit.interval level", level)
        if not 0 < level < 1:
            reject("MaterialFit.interval level", "between 0 and 1, both excluded", level)
        with shielded():
            return _profile_intervals(self, self.critical(level))

    @cached_property
    def rises(self) -> np.ndarray:
        """Sorted rises float64[names, n] of the least chi squared at the truth, of data drawn at the fitted slab.

        The truth of each drawn set is the fitted slab: how far chi squared is above its least value where a number of
        ``values`` is held there. Of one degree of freedom where the model is straight, more where it bends.
        """
        with shielded():
            return _drawn_rises(self)

    def critical(self, level: float) -> np.ndarray:
        """Rise of chi squared at the ends of intervals, float64[names].

        Of n drawn rises the k-th least is above a further one in k of n + 1; the quantile of chi squared where that is
        larger. Beyond the largest of them, that quantile, as much larger as it is at 95 %.
        """
        count = self.rises.shape[1]
        place = math.ceil(level * (count + 1) - 1e-9)
        straight = float(chi2.ppf(level, 1))
        if place <= count:
            return np.maximum(self.rises[:, place - 1], straight)  # at an end of the tables rises are cut short
        near = self.rises[:, math.ceil(0.95 * (count + 1)) - 1]
        return straight * np.maximum(1.0, near / float(chi2.ppf(0.95, 1)))

    def profile(self, name: str, values: ArrayLike) -> np.ndarray:
        """Rise of the least chi squared where a number is held at given values, the others fitted, float64[V].

        Parameters
        ----------
        name
            Of a free number, or of one that follows from them: a key of ``values``.
        values
            What it is held at, float[V], in its own unit.
        """
        unknowns = self.problem.unknowns
        choice("MaterialFit.profile name", name, unknowns.names())
        values = np.atleast_1d(real_array("MaterialFit.profile values", values))
        ends = unknowns.limits(name)
        if values.ndim != 1 or not ((values > ends[0]) & (values < ends[1])).all():
            reject("MaterialFit.profile values", f"numbers between {ends[0]:g} and {ends[1]:g}", values)
        weights = np.broadcast_to(unknowns.weights(name), (len(values), len(self.at)))
        goals = np.array([unknowns.held(name, float(value)) for value in values])
        with shielded():
            return np.maximum(_held(self, weights, goals, np.repeat(self.at[None], len(values), 0)).cost
                              - self.chi_squared, 0.0)  # fmt: skip

    def recipe(self, name: str) -> str:
        """Write a recipe of tilt stacks of this material under the tilts that were measured, as TOML.

        Parameters
        ----------
        name
            Of the recipe.
        """
        instance("MaterialFit.recipe name", name, str)
        slab, scatterer, problem = self.slab, self.slab.scatterer, self.problem
        assert isinstance(problem, Problem)
        tilts = [each.at for each in self.observations if isinstance(each, MemoryCurve)]
        largest = float(tilts[0][-1]) if tilts else 0.0
        count = min(len(tilts[0]), 16) if tilts else 5
        step = largest / max(count - 1, 1) or 0.1 * problem.wavelength / slab.thickness
        bounds = {} if self.hopeless else self.interval(0.95)
        comments = "".join(f"# {key}: {self.values[key]:.5g}, 95 %: {low:.5g} to {high:.5g}\n"
                           for key, (low, high) in bounds.items())  # fmt: skip
        doubts = "".join(f"# {each}\n" for each in (*self.degenerate, *self.doubts))
        table = {
            "inherits": "tilt-stack", "name": name,
            "description": "Speckle of a material that was fitted to measurements, under tilts.",
            "material": {
                "wavelength": problem.wavelength, "thickness": slab.thickness,
                "optical_depth": slab.optical_depth, "g": scatterer.mean_cosine(), "albedo": slab.albedo,
            },
            "window": {"width": 30 * (slab.thickness + slab.transport_length)},
            "tilts": {"count": count, "step": step},
        }  # fmt: skip
        heading = f"# chi squared {self.chi_squared:.4g} of {self.degrees} degrees of freedom\n"
        return heading + comments + doubts + tomli_w.dumps(table)

    def _facts(self) -> Mapping[str, object]:
        numbers: dict[str, object] = dict(self.values)
        if not self.hopeless:
            numbers = {name: with_interval(self.values[name], ends) for name, ends in self.interval(0.95).items()}
        return numbers | {
            "χ²": f"{self.chi_squared:.4g} of {self.degrees} (p = {self.p_value:.2g})",
            "not determined": self.degenerate,
            "doubts": self.doubts,
        }

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Residuals in standard errors, one observation behind the other."""
        start = 0
        for each, residual in zip(self.observations, self.residuals, strict=True):
            place = start + np.arange(len(residual))
            axes.plot(place, residual, "o", ms=3, label=f"{label + ': ' if label else ''}{type(each).__name__}")
            start += len(residual)
        axes.axhspan(-2, 2, color="grey", alpha=0.15)
        axes.set(xlabel="number of the value", ylabel="measured - fitted, in standard errors")
        axes.legend()
        axes.grid(alpha=0.3)


@with_units
@shielded()
def fit_material(
    observations: Observation | Sequence[Observation], *,
    wavelength: Annotated[float | Sequence[float], WAVELENGTH], model: Model | None = None,
    known: Annotated[Mapping[str, float], Like(Slab, Brownian)] | None = None,
    free: Sequence[str] | Mapping[str, tuple[float, float]] = ("thickness", "mean_free_path", "g"),
    budget: Budget | None = None, **fields: Unpack[BudgetFields],
) -> MaterialFit:  # fmt: skip
    """Fit a slab, or any layers, to what was measured of it.

    Without a ``model``, a slab of Henyey-Greenstein scatterers and matched faces, from lookup tables. With one, any
    layers: their curves are computed by Monte Carlo at numbers within the given ranges, and joined by polynomials.

    Parameters
    ----------
    observations
        Values of :mod:`specklegen.measured`: `MemoryCurve`, `Transmittance`, `TemporalCurve`, `BallisticFraction`,
        `ContrastVersusBandwidth`. With a model, the latter of scalar light through layers without index steps.
    wavelength
        Inside the medium, in the unit of length of all lengths; of layers in the index ``faces.inside``. One number, or
        with a model one for each observation.
    model
        A function that takes the free numbers by name, and returns the `Slab` or `Layers` of all observations, or a
        sequence of one for each (several thicknesses, separate numbers). Angles of tilts are those inside
        ``faces.inside``. Without it one slab is fitted by the lookup table.
    known
        Numbers that are known, by name: "thickness", "mean_free_path", "g", "albedo", "diffusion". Without it the
        albedo is 1. With a model, none: write them into the function.
    free
        Names of those to be found. With a model a table of any names and the ends of the range in which each is sought.
    budget
        With a model: paths of every curve of a run, 20 000 by default, seed and threads
        (:class:`specklegen.results.Budget`). A
        fit of one, two or three numbers takes some 80, 110 or 150 runs. The runs' own scatter widens the intervals.
    fields
        Fields of the budget by name, such as ``paths=50_000, seed=1``.

    Returns
    -------
    fit
        Its ``interval`` is refused where chi squared is hopeless (p below 0.001), unless with ``force=True``.

    Raises
    ------
    RuleError
        For fewer values than free numbers, numbers neither known nor free, known ones outside the tables, and tilts at
        which no slab of the known thickness would be correlated; what the model or its media raise.

    Examples
    --------
    >>> import specklegen as sg
    >>> from specklegen.measured import BallisticFraction, Transmittance
    >>> data = [Transmittance(0.68, 0.01), BallisticFraction(4.5e-5, 2e-6)]
    >>> fit = sg.fit.fit_material(data, wavelength=0.5, known={"thickness": 1000.0}, free=("mean_free_path", "g"))
    >>> round(fit.slab.optical_depth, 1), fit.degrees
    (10.0, 0)
    >>> def cell(g):
    ...     return sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(g),
    ...                    faces=sg.media.Faces(inside=1.33))
    >>> fit = sg.fit.fit_material(Transmittance(0.5, 0.02), wavelength=0.5, model=cell, free={"g": (0.5, 0.98)},
    ...                           paths=1000)
    >>> fit.media[0].faces.inside, 0.7 < fit.values["g"] < 0.9
    (1.33, True)
    """
    owner = "fit_material"
    seen = several(f"{owner} observations", observations, Observation)
    for each in seen:
        if each.planned:
            reject(f"{owner} observations", "measured", each, "For planned observations use advise.")
    unused = ("rel_error", "seconds", "reverse", "tolerance")
    budget = budget_of(owner, budget, fields, unused if model is not None else ("paths", "seed", "threads", *unused))
    if model is not None:
        return _fit_model(owner, seen, wavelength, model, known, free, budget)
    wavelength = positive_number(f"{owner} wavelength", wavelength)
    moving = any(isinstance(each, TemporalCurve) for each in seen)
    unknowns = unknowns_of(owner, {} if known is None else known, free, moving)  # type: ignore[arg-type]
    problem = Problem(seen, wavelength, unknowns)
    _require_values(owner, seen, unknowns.free)
    starts = _starts(problem)
    minimum = minimize(problem.model, starts, unknowns.low, unknowns.high, nothing_held(len(starts), starts.shape[1]))
    best = int(np.argmin(minimum.cost))
    if not np.isfinite(minimum.cost[best]):
        reject(f"{owner} observations", "possible for a slab of the tables", seen)
    fit = _fit_at(problem, minimum.at[best], float(minimum.cost[best]))
    if fit.p_value < _DOUBTFUL:
        _require_correlation(owner, problem)
    return fit


def _fit_model(
    owner: str, seen: tuple[Observation, ...], wavelength: Any, model: Model, known: object, free: Any, budget: Budget
) -> MaterialFit:  # fmt: skip
    if not callable(model):
        reject(f"{owner} model", "a function of the free numbers that returns a Slab or Layers", model)
    if known is not None:
        reject(f"{owner} known", "left out where a model is given", known, "Write known numbers into the function.")
    ranges = ranges_of(owner, free)
    _require_values(owner, seen, ranges.free)
    given = wavelength if isinstance(wavelength, Sequence | np.ndarray) else [wavelength] * len(seen)
    wavelengths = [positive_number(f"{owner} wavelength", each) for each in given]
    if len(wavelengths) != len(seen):
        reject(f"{owner} wavelength", f"one number, or one for each of {len(seen)} observations", wavelength)
    budget = replace(budget, paths=_PATHS if budget.paths is None else budget.paths)
    surface = surface_of(owner, seen, wavelengths, model, ranges, budget)
    return _fit_at(surface, *surface.best())


def _require_values(owner: str, seen: Sequence[Observation], free: Sequence[str]) -> None:
    count = sum(len(each.values) for each in seen)
    if count < len(free):
        reject(f"{owner} observations", f"at least {len(free)} values, as many as there are free numbers", count,
               "Add observations, or name fewer numbers in free.")  # fmt: skip


def _fit_at(problem: Problem | Surface, at: np.ndarray, cost: float) -> MaterialFit:
    unknowns, covariance = problem.unknowns, covariance_of(problem.model(at[None])[1][0])
    ends = np.cumsum([len(each.values) for each in problem.observations])[:-1]
    shown = problem.shown(at[None])[0]
    predicted, residuals = (np.split(each, ends) for each in (shown, (problem.values - shown) / problem.errors))
    degrees = len(problem.values) - len(at)
    chance = float(chi2.sf(cost, degrees)) if degrees else 1.0
    doubts, vague = (), ()
    if degrees and chance < _DOUBTFUL:
        what = "the model does not predict" if isinstance(unknowns, Ranges) else (
            "no slab of Henyey-Greenstein scatterers and index-matched faces predicts")  # fmt: skip
        doubts = (f"chi squared is {cost:.4g} of {degrees} (p = {chance:.1g}): {what} these data within their errors",)
    if isinstance(unknowns, Ranges):
        for name, u, error in zip(unknowns.free, at, np.sqrt(np.diag(covariance)), strict=True):
            if min(u, 1 - u) < 1e-6:
                doubts += (f"{name} lies at the end of its range: the true value may be outside",)
            if error > VAGUE:
                vague += (f"{name} is not determined within its range by these data",)
        media = problem.media_of(at)
    else:
        assert isinstance(problem, Problem)
        media, vague = problem.media_of(at), degeneracies(unknowns, covariance)
        doubts += _doubts(problem, at, media[0])
    weights = np.array([unknowns.weights(name) for name in unknowns.free])
    return MaterialFit(
        media, problem.observations, tuple(predicted), tuple(residuals), unknowns.free,
        weights @ covariance @ weights.T, cost, degrees, chance, vague, doubts, problem, covariance, at,
    )  # fmt: skip


def covariance_of(slope: np.ndarray) -> np.ndarray:
    """(J^T J)^-1 float64[n, n] of residuals' derivatives float64[M, n]; directions without data get 1e12."""
    values, vectors = np.linalg.eigh(slope.T @ slope)
    return (vectors / np.maximum(values, 1e-12)) @ vectors.T


def degeneracies(unknowns: Unknowns, covariance: np.ndarray) -> tuple[str, ...]:
    """Say what is not determined to e^0.5, and the combination that is."""
    errors = standard_errors(unknowns, covariance)
    vague = [name for name in unknowns.free if errors[name] > VAGUE and name != "albedo"]
    if not vague:
        return ()
    sure = [f"{WORDS[name]} (± {100 * error:.2g} %)" for name, error in errors.items()
            if error <= VAGUE and name != "albedo"]  # fmt: skip
    lost = " and ".join(f"{WORDS[name]} (ln ± {min(errors[name], 1e6):.2g})" for name in vague)
    instead = ", ".join(sure) if sure else "nothing else"
    return (f"{lost} {'is' if len(vague) == 1 else 'are'} not determined by these data; determined: {instead}",)


def standard_errors(unknowns: Unknowns, covariance: np.ndarray) -> dict[str, float]:
    """Standard errors of the logarithms of all combinations that are not known, by name."""
    errors = {}
    for name in unknowns.names():
        weights = unknowns.weights(name)
        errors[name] = float(np.sqrt(max(weights @ covariance @ weights, 0.0)))
    return errors


def slab_of(x: np.ndarray) -> Slab:
    """Return the slab of columns float64[5]."""
    thickness = float(np.exp(x[THICKNESS]))
    moves = Brownian(diffusion=float(np.exp(x[DIFFUSION]))) if x[DIFFUSION] else None
    return Slab(
        thickness=thickness, mean_free_path=float(np.exp(x[THICKNESS] - x[DEPTH])), albedo=float(np.exp(-x[LOSS])),
        scatterer=HenyeyGreenstein(g=1 - float(np.exp(x[DROP]))), motion=moves,
    )  # fmt: skip


def _doubts(problem: Problem, at: np.ndarray, slab: Slab) -> tuple[str, ...]:
    unknowns, doubts = problem.unknowns, []
    for name, value, low, high in zip(unknowns.free, at, unknowns.low, unknowns.high, strict=True):
        if name != "albedo" and min(value - low, high - value) < 1e-6:
            doubts.append(f"{name} lies at the end of the tables: the true value may be outside")
    if slab.mean_free_path < problem.wavelength:
        doubts.append(
            f"a mean free path of {slab.mean_free_path:.2g} is below the wavelength of {problem.wavelength:.2g}: are "
            "tilts in radians, and lengths in one unit?"
        )
    return tuple(doubts)


def _grid(unknowns: Unknowns) -> np.ndarray:
    """Unknowns float64[n, u] all over the tables, thickness and diffusion 1 where they scale what is seen."""
    rows = []
    for low, high, name in zip(unknowns.low, unknowns.high, unknowns.free, strict=True):
        rows.append([0.0] if name == "diffusion" or (name == "thickness" and not unknowns.matrix[DEPTH].any()) else
                    [0.0] if name == "thickness" and "mean_free_path" in unknowns.free else
                    [1e-4, 0.01, 0.05] if name == "albedo" else np.linspace(low + 0.1, high - 0.1, 9))  # fmt: skip
    return np.stack([axis.ravel() for axis in np.meshgrid(*rows, indexing="ij")], -1).astype(np.float64)


def _starts(problem: Problem) -> np.ndarray:
    """Unknowns float64[n, u] to start from: the best of a grid, thickness and diffusion the best of many each."""
    unknowns = problem.unknowns
    grid = _grid(unknowns)
    total = np.zeros(len(grid))
    chosen = grid.copy()
    for column, name in ((THICKNESS, "thickness"), (DIFFUSION, "diffusion"), (-1, "")):
        scales = name in unknowns.free and not (name == "thickness" and unknowns.matrix[DEPTH] @ (
            np.array(unknowns.free) == name))  # fmt: skip
        some = [each for each in problem.observations if _scaled_by(each) == column]
        if not some:
            continue
        steps = _scales(problem, some, column) if scales and column >= 0 else np.zeros(1)
        tried = np.repeat(grid[:, None], len(steps), axis=1)
        if scales:
            tried[:, :, unknowns.free.index(name)] = steps
        slabs = unknowns.slabs(tried.reshape(-1, grid.shape[1]))
        squares = np.zeros(len(slabs))
        for each in some:
            few = np.unique(np.linspace(0, len(each.values) - 1, _SCAN).astype(int))
            value = predict([each], problem.wavelength, slabs, ())
            miss = (value.values - each.values)[:, few] / each.errors[few]
            squares += np.where(value.inside, np.square(miss).sum(-1), np.inf)
        squares = squares.reshape(len(grid), len(steps))
        total += squares.min(axis=1)
        if scales:
            chosen[:, unknowns.free.index(name)] = steps[np.argmin(squares, axis=1)]
    order = np.argsort(np.nan_to_num(total, nan=np.inf))[: _STARTS * 3]
    return chosen[order[: _STARTS // 2].tolist() + order[_STARTS // 2 :: 5].tolist()]


def _scaled_by(each: Observation) -> int:
    """Column of x that stretches what is observed; -1 where none does."""
    if isinstance(each, TemporalCurve):
        return DIFFUSION
    return THICKNESS if hasattr(each, "at") else -1


def _scales(problem: Problem, some: Sequence[Observation], column: int) -> np.ndarray:
    """Logarithms of thicknesses, or of diffusions, at which something is seen where it was measured."""
    wavenumber = 2 * np.pi / problem.wavelength
    if column == DIFFUSION:
        middle = [np.median(each.at[each.at > 0]) for each in some]
        return np.log(np.geomspace(1e-3, 10, 16) / (wavenumber**2 * min(middle)))
    middle = [np.median(each.at[each.at > 0]) * (wavenumber if isinstance(each, MemoryCurve) else 1) for each in some]
    return np.log(np.geomspace(0.2, 200, 20) / np.median(middle))


def _require_correlation(owner: str, problem: Problem) -> None:
    """Refuse tilts at which next to no slab of the known thickness is correlated, though the data are."""
    if THICKNESS in problem.unknowns.moved:
        return
    slabs = problem.unknowns.slabs(_grid(problem.unknowns))
    for each in problem.observations:
        if not isinstance(each, MemoryCurve) or not (each.at > 0).any():
            continue
        first = int(np.flatnonzero(each.at > 0)[0])
        middle = float(np.median(predict([each], problem.wavelength, slabs, ()).values[:, first]))
        if middle < _FAR < each.values[first]:
            reject(f"{owner} tilts", "in radians, and the thickness in the unit of the wavelength",
                   f"{float(each.at[first]):g} first, where C_I of such a thick slab is {middle:.2g}, not "
                   f"{float(each.values[first]):.2g}", "Convert degrees by np.deg2rad.")  # fmt: skip


def _held(fit: MaterialFit, weights: np.ndarray, goals: np.ndarray, near: np.ndarray) -> Minimum:
    """Minima where combinations ``weights`` float64[B, n] are held at ``goals`` float64[B], sought from ``near``."""
    problem, covariance = fit.problem, fit.spread
    turned = weights @ covariance
    # Of the unknowns, where the combination moves by 1.
    along = turned / np.einsum("bn,bn->b", turned, weights)[:, None]
    start = near + (goals - np.einsum("bn,bn->b", weights, near))[:, None] * along
    held = Held(weights, np.argmax(np.abs(weights), axis=1), goals)
    return minimize(problem.model, start, problem.unknowns.low, problem.unknowns.high, held)


def _drawn_rises(fit: MaterialFit) -> np.ndarray:
    """Sorted rises float64[names, n] of sets of data that are drawn at the fit.

    A set's residuals at the fit are independent normal numbers (those of data and tables together, made independent);
    all sets are fitted at once, freely and with each combination held, from the fit. A bent valley has a lower minimum
    elsewhere for one set in six: free fits also start up and down the two directions that the data tell least.
    """
    problem, unknowns = fit.problem, fit.problem.unknowns
    weights = np.array([unknowns.weights(name) for name in unknowns.names()])
    drawn = np.random.default_rng(_DRAWN).normal(size=(_SETS, len(problem.values)))
    there = problem.model(fit.at[None])[0][0]  # what the data lie off the fit: the sets lie as drawn

    def model(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residual, slope = problem.model(at)
        return residual - there, slope

    def least(held: Held, moved: np.ndarray, at: np.ndarray = fit.at) -> np.ndarray:
        start = np.repeat(at[None], len(moved), axis=0)
        return minimize(model, start, unknowns.low, unknowns.high, held, moved).cost

    variances, directions = np.linalg.eigh(fit.spread)
    apart = (directions * np.minimum(_APART * np.sqrt(variances), 1.0)).T[-2:]  # a factor e at most
    starts = [fit.at, *(fit.at + apart), *(fit.at - apart)]
    free = np.min([least(nothing_held(_SETS, len(fit.at)), drawn, at) for at in starts], axis=0)
    each = np.repeat(weights, _SETS, axis=0)
    held = Held(each, np.argmax(np.abs(each), axis=1), each @ fit.at)
    rises = least(held, np.tile(drawn, (len(weights), 1))).reshape(len(weights), _SETS) - free
    return np.sort(np.maximum(rises, 0.0), axis=1)


def _profile_intervals(fit: MaterialFit, rises: np.ndarray) -> dict[str, Interval]:
    """Find where the profile of each combination has risen by ``rises``, on both sides of all at once."""
    unknowns, covariance = fit.problem.unknowns, fit.spread
    names = unknowns.names()
    weights = np.repeat([unknowns.weights(name) for name in names], 2, axis=0)
    side = np.tile([-1.0, 1.0], len(names))
    middle = weights @ fit.at
    low, high = _reach(weights, unknowns)
    end = np.where(side < 0, low, high)
    spread = np.sqrt(np.maximum(np.einsum("bn,np,bp->b", weights, covariance, weights), 1e-24))
    goals = np.sqrt(np.repeat(rises, 2))
    inner, inner_rise = np.zeros(len(side)), np.zeros(len(side))
    outer = np.full(len(side), np.inf)
    outer_rise = np.full(len(side), np.inf)
    step = goals * np.minimum(spread, 1.0 / goals)
    at = np.repeat(fit.at[None], len(side), axis=0)
    crossing = np.full(len(side), np.nan)
    most = np.abs(end - middle)
    step = np.minimum(step, most)
    for _ in range(24):
        some = np.flatnonzero(np.isnan(crossing))
        if not len(some):
            break
        minimum = _held(fit, weights[some], middle[some] + side[some] * step[some], at[some])
        root = np.sqrt(np.maximum(minimum.cost - fit.chi_squared, 0.0))
        for n, b in enumerate(some):
            s, r, goal = step[b], root[n], goals[b]
            if r <= goal:
                inner[b], inner_rise[b], at[b] = s, r, minimum.at[n]
            else:
                outer[b], outer_rise[b] = s, r
            if abs(r - goal) < _CLOSE:
                crossing[b] = s
            elif r <= goal and s >= most[b] * (1 - 1e-9):
                crossing[b] = np.inf
            elif not np.isfinite(outer[b]):
                step[b] = min(most[b], s * min(max(1.05 * goal / max(r, 1e-9), 1.2), 3.0))
            elif not np.isfinite(outer_rise[b]) or outer_rise[b] > 1e3:
                step[b] = (inner[b] + outer[b]) / 2
            else:
                share = (goal - inner_rise[b]) / (outer_rise[b] - inner_rise[b])
                step[b] = inner[b] + float(np.clip(share, 0.05, 0.95)) * (outer[b] - inner[b])
            if np.isfinite(outer[b]) and outer[b] - inner[b] < 1e-4 * spread[b]:
                crossing[b] = outer[b]
    crossing = np.where(np.isnan(crossing), np.where(np.isfinite(outer), outer, np.inf), crossing)
    ends = middle + side * np.minimum(crossing, most)
    return {name: Interval(*sorted(unknowns.value(name, float(ends[2 * n + i])) for i in (0, 1)))
            for n, name in enumerate(names)}  # fmt: skip


def _reach(weights: np.ndarray, unknowns: Unknowns | Ranges) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest values of combinations within the bounds."""
    one, other = weights * unknowns.low, weights * unknowns.high
    return np.minimum(one, other).sum(-1), np.maximum(one, other).sum(-1)
