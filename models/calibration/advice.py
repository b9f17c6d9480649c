"""Advice on measurements: the expected errors of a fit, before anything is measured.

Fisher's information of a slab: (J^T J)^-1 of the derivatives of what would be observed, over its errors. Logarithms'
standard errors above about 0.5 say "not determined", not how far off: valleys are curved (docs/measured.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from specklegen.core.arguments import positive_number, several
from specklegen.core.display.plot import Pictured
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.shielded import shielded
from specklegen.core.units import WAVELENGTH
from specklegen.measured.observations import (
    ContrastVersusBandwidth,
    MemoryCurve,
    Observation,
    TemporalCurve,
    Transmittance,
)
from specklegen.models.calibration.material_fit import WORDS, covariance_of, degeneracies, standard_errors
from specklegen.models.calibration.prediction import predict
from specklegen.models.calibration.unknowns import COMBINATIONS, NAMES, Unknowns, logarithm_of, unknowns_of
from specklegen.scene.layers import PlaneParallel
from specklegen.scene.media import Slab, as_slab
from specklegen.scene.polarisation import require_scalar

_POINTS, _ERROR, _RELATIVE = 25, 0.01, 0.02


@dataclass(frozen=True)
class Expected:
    """Expected information of a set of instruments.

    Attributes
    ----------
    errors : Mapping[str, float]
        Standard errors of logarithms, by name: of g that of 1 - g, of the albedo that of -ln albedo itself.
    degenerate : tuple of str
        What would not be determined, and what would be instead.
    """

    instruments: tuple[Observation, ...]
    errors: Mapping[str, float]
    degenerate: tuple[str, ...]

    @property
    def name(self) -> str:
        """Names of the instruments."""
        return " + ".join(type(each).__name__ for each in self.instruments)

    @property
    def worst(self) -> float:
        """Largest standard error."""
        return max(self.errors.values())


@dataclass(frozen=True, eq=False)
class Advice(Pictured):
    """Errors to be expected of sets of instruments.

    Attributes
    ----------
    rows : tuple of Expected
        The first instrument, the first two, and so on.
    additions : tuple of Expected
        All of them, and one more each that was not given, the most useful first.

    Examples
    --------
    >>> import specklegen as sg
    >>> from specklegen.measured import MemoryCurve
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=1000 / 30, scatterer=sg.media.HenyeyGreenstein(0.8))
    >>> tilts = [2e-5 * n for n in range(1, 25)]
    >>> advice = sg.fit.advise(slab, wavelength=0.5, instruments=[MemoryCurve(tilts, None, 0.01)])
    >>> advice.rows[0].errors["optical_depth"] > 1, advice.rows[0].errors["thickness"] < 0.3
    (True, True)
    """

    rows: tuple[Expected, ...]
    additions: tuple[Expected, ...]

    def __repr__(self) -> str:
        return f"Advice({self.rows[-1].name}: worst error {self.rows[-1].worst:.2g})"

    def _facts(self) -> Mapping[str, object]:
        facts: dict[str, object] = {}
        for row in (*self.rows, *self.additions):
            facts[row.name] = ", ".join(f"{WORDS[name]} ± {error:.3f}" for name, error in row.errors.items())
        facts["not determined"] = self.rows[-1].degenerate
        return facts

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Errors of the logarithms, set by set."""
        rows = (*self.rows, *self.additions)
        for name in self.rows[0].errors:
            axes.plot([row.errors[name] for row in rows], range(len(rows)), "o", ms=4, label=WORDS[name])
        axes.set_yticks(range(len(rows)), [row.name for row in rows])
        axes.set(xlabel="standard error of the logarithm", xscale="log")
        axes.legend()
        axes.grid(alpha=0.3)


@with_units
@shielded()
def advise(
    slab: Slab, *, wavelength: Annotated[float, WAVELENGTH],
    instruments: Observation | Sequence[Observation] | None = None,
    free: Sequence[str] = ("thickness", "mean_free_path", "g"),
) -> Advice:  # fmt: skip
    """Say how well a slab would be known from measurements, and which one to add.

    Parameters
    ----------
    slab
        What you expect, of Henyey-Greenstein scatterers and matched faces.
    wavelength
        Inside the medium, in the slab's unit of length.
    instruments
        Measured or planned values (``MemoryCurve(tilts, None, 0.01)``); by default the usual ones: C_I at 25 tilts to
        3 half ranges ± 0.01, transmittance ± 2 %, contrast at three bandwidths ± 0.01, and of a moving slab g2 at 25
        lags ± 0.01.
    free
        What is not known, as of :func:`specklegen.fit.fit_material`; all else is known.

    Returns
    -------
    advice
        Expected errors of the first instrument, the first two, and so on; and of all with one of the usual ones more.

    Raises
    ------
    RuleError
        For slabs outside the tables, and names that are none.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> advice = sg.fit.advise(slab, wavelength=0.5)
    >>> [round(row.errors["thickness"], 2) for row in advice.rows][0]
    0.13
    """
    owner = "advise"
    if not isinstance(slab, PlaneParallel) or as_slab(slab) is None:
        reject(f"{owner} slab", "a Slab", slab)
    require_scalar(f"{owner} slab", slab)
    wavelength = positive_number(f"{owner} wavelength", wavelength)
    if not slab.faces.matched or slab.scatterer.type not in ("HenyeyGreenstein", "Isotropic"):
        reject(f"{owner} slab",
               "a slab of Henyey-Greenstein scatterers and index-matched faces, as in the lookup table", slab)
    numbers = _numbers(slab)
    moving = "diffusion" in numbers
    known = {name: value for name, value in numbers.items() if name not in free}
    unknowns = unknowns_of(owner, known, free, moving)
    at = _place(owner, unknowns, numbers)
    usual = _usual(unknowns.slabs(at), wavelength, moving)
    given = usual if instruments is None else several(f"{owner} instruments", instruments, Observation)
    if not moving and any(isinstance(each, TemporalCurve) for each in given):
        reject(f"{owner} slab", "a slab of moving particles, for a TemporalCurve", slab,
               "Give it motion=Brownian(diffusion=...).")  # fmt: skip
    for each in given:
        if not predict([each], wavelength, unknowns.slabs(at)[None], ()).inside[0]:
            reject(f"{owner} slab", "within the tables of path lengths (optical depth at most 20) for this measurement",
                   each, "Leave this measurement out.")  # fmt: skip
    rows = tuple(_expected(unknowns, at, wavelength, given[: n + 1]) for n in range(len(given)))
    missing = [each for each in usual if type(each) not in {type(other) for other in given}]
    additions = [_expected(unknowns, at, wavelength, (*given, each)) for each in missing]
    return Advice(rows, tuple(sorted(additions, key=lambda row: row.worst)))


def _numbers(slab: Slab) -> dict[str, float]:
    numbers = {"thickness": slab.thickness, "mean_free_path": slab.mean_free_path,
               "g": slab.scatterer.mean_cosine(), "albedo": slab.albedo}  # fmt: skip
    diffusion = getattr(slab.motion, "diffusion", None)
    return numbers | ({"diffusion": diffusion} if diffusion else {})


def _place(owner: str, unknowns: Unknowns, numbers: Mapping[str, float]) -> np.ndarray:
    """Unknowns of the slab itself, float64[n]."""
    weights = np.array([unknowns.weights(name) for name in unknowns.free])
    goals = np.array([logarithm_of(name, numbers[name]) - COMBINATIONS[name] @ unknowns.base
                      for name in unknowns.free])  # fmt: skip
    at = np.linalg.solve(weights, goals)
    if not predict([Transmittance(None, 1.0)], 1.0, unknowns.slabs(at)[None], ()).inside[0]:
        reject(f"{owner} slab", "within the lookup table", {name: numbers[name] for name in NAMES if name in numbers},
               "It holds optical depths of 0.4 to 64 and g of -0.6 to 0.985 (docs/atlas.md).")  # fmt: skip
    return at


def _expected(
    unknowns: Unknowns, at: np.ndarray, wavelength: float, instruments: Sequence[Observation]
) -> Expected:  # fmt: skip
    prediction = predict(instruments, wavelength, unknowns.slabs(at)[None], unknowns.moved)
    errors = np.concatenate([each.errors for each in instruments])
    covariance = covariance_of((prediction.slopes[0] @ unknowns.matrix) / errors[:, None])
    return Expected(tuple(instruments), standard_errors(unknowns, covariance), degeneracies(unknowns, covariance))


def _usual(x: np.ndarray, wavelength: float, moving: bool) -> tuple[Observation, ...]:
    """Return the usual instruments for a slab of columns float64[5]."""

    def seen(each: Observation) -> np.ndarray:
        return predict([each], wavelength, x[None], ()).values[0]

    thickness = float(np.exp(x[0]))
    scan = np.geomspace(1e-3, 1e3, 400)
    tilts = scan / thickness * wavelength / (2 * np.pi)
    tilts = tilts[tilts < 1.0]
    curve = seen(MemoryCurve(tilts, None, 1.0))
    half = _crossing(tilts, curve, (1 + curve[-1]) / 2)
    light = seen(Transmittance(None, 1.0))
    memory = MemoryCurve(half * np.arange(1, _POINTS + 1) * 3 / _POINTS, None, _ERROR)
    instruments: list[Observation] = [memory, Transmittance(None, _RELATIVE * float(light[0]))]
    if not predict([ContrastVersusBandwidth([1.0], None, 1.0)], wavelength, x[None], ()).inside[0]:
        return tuple(instruments)
    widths = scan / thickness
    contrast = seen(ContrastVersusBandwidth(widths, None, 1.0))
    three = [_crossing(widths, contrast, level) for level in (0.8, 0.5, 0.25)]
    rising = np.unique(three)
    instruments.append(ContrastVersusBandwidth(rising, None, _ERROR))
    if moving:
        lags = scan * (wavelength / (2 * np.pi)) ** 2 / float(np.exp(x[4]))
        decay = seen(TemporalCurve(lags, None, 1.0))
        half_time = _crossing(lags, decay, (1 + decay[0]) / 2)
        instruments.append(TemporalCurve(half_time * np.arange(1, _POINTS + 1) * 3 / _POINTS, None, _ERROR))
    return tuple(instruments)


def _crossing(at: np.ndarray, falling: np.ndarray, level: float) -> float:
    """Return where a falling curve first passes a level; its last place if it never does."""
    below = np.flatnonzero(falling < level)
    if not len(below) or not below[0]:
        return float(at[-1] if not len(below) else at[0])
    n = int(below[0])
    share = (falling[n - 1] - level) / (falling[n - 1] - falling[n])
    return float(at[n - 1] + share * (at[n] - at[n - 1]))
