"""Measurements of a slab, as values: with standard errors, checked once.

Each is a mean over speckle, and says of the material what :func:`specklegen.fit.fit_material` makes of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NoReturn, Self

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import choice, finite_numbers, positive_number, real_number
from specklegen.core.display.plot import Pictured, draw_curve
from specklegen.core.errors import reject
from specklegen.core.quantities import takes_units
from specklegen.core.units import INVERSE_LENGTH, RADIAN, TIME
from specklegen.measured.curve import read_curve

SURE = 4.0
"""Standard errors by which a value may lie outside its range."""


class Observation(Pictured):
    """Measured values of a slab: one number, or several, each with its standard error."""

    @property
    def values(self) -> np.ndarray:
        """float64[M]."""
        raise NotImplementedError

    @property
    def errors(self) -> np.ndarray:
        """Standard errors of the values, float64[M]."""
        raise NotImplementedError

    @property
    def planned(self) -> bool:
        """True if nothing was measured yet: values given as None, for :func:`specklegen.fit.advise`."""
        return bool(np.isnan(self.values).any())


@dataclass(frozen=True, eq=False, repr=False)
class _Curve(Observation):
    """Values at places; a subclass names both."""

    _where: ClassVar[str]
    _what: ClassVar[str]
    _range: ClassVar[tuple[float, float]]
    file: str = field(default="", kw_only=True)
    lines: tuple[int, ...] = field(default=(), kw_only=True)

    @property
    def at(self) -> np.ndarray:
        """Places of the measured values, float64[M]."""
        return getattr(self, self._where)

    @property
    def values(self) -> np.ndarray:
        """Measured values, float64[M]."""
        return getattr(self, self._what)

    @property
    def errors(self) -> np.ndarray:
        """Standard errors of the values, float64[M]."""
        return getattr(self, "error")  # noqa: B009

    def _facts(self) -> Mapping[str, object]:
        return {self._where: self.at, self._what: self.values, "standard errors": self.errors}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        draw_curve(axes, self.at, self.values, self.errors, label, fmt="o", xlabel=self._where, ylabel=self._what)

    def _check(self) -> None:
        """Bring fields to arrays, and refuse what no measurement gives; the line of a file is named."""
        owner = type(self).__name__
        at = finite_numbers(f"{owner} {self._where}", getattr(self, self._where))
        given = getattr(self, self._what)
        planned = given is None
        values = np.full(at.shape, self._range[1]) if planned else finite_numbers(f"{owner} {self._what}", given)
        error = finite_numbers(f"{owner} error", self.errors)
        for name, array in ((self._where, at), (self._what, values), ("error", error)):
            if array.dtype.kind == "c" or array.ndim > 1:
                reject(f"{owner} {name}", "real numbers, one for each value", getattr(self, name))
        at, values = np.atleast_1d(at).astype(np.float64), np.atleast_1d(values).astype(np.float64)
        if not len(at) or values.shape != at.shape:
            reject(f"{owner} {self._what}", f"one number for each of {len(at)} {self._where}", values.shape)
        if error.ndim and error.shape != at.shape:
            reject(f"{owner} error", f"one number, or one for each of {len(at)} {self._where}", error.shape)
        error = np.broadcast_to(error, at.shape).astype(np.float64)
        low, high = self._range
        for n in range(len(at)):
            if not error[n] > 0:
                self._refuse(n, "error", "greater than 0", error[n], "A fit needs errors: repeat the measurement, "
                             "or estimate them.")  # fmt: skip
            if at[n] < 0 or (n and not at[n] > at[n - 1]):
                rule = "at least 0" if at[n] < 0 else f"above the value before it, {at[n - 1]:g}"
                self._refuse(n, self._where, rule, at[n], "Sort the values and average repeated places.")
            if not low - SURE * error[n] <= values[n] <= high + SURE * error[n]:
                self._refuse(n, self._what, f"from {low:g} to {high:g}, within {SURE:g} standard errors", values[n],
                             self._remedy())  # fmt: skip
        if planned:
            values = np.full(at.shape, np.nan)
        for name, array in ((self._where, at), (self._what, values), ("error", error)):
            object.__setattr__(self, name, array)

    def _remedy(self) -> str:
        return ""

    def _refuse(self, number: int, what: str, rule: str, value: float, remedy: str) -> NoReturn:
        owner = type(self).__name__
        place = f"{owner} {self.file}, line {self.lines[number]}, {what}" if self.lines else (
            f"{owner} {what}, number {number + 1},")  # fmt: skip
        reject(place, rule, float(value), remedy)

    @classmethod
    def read(cls, path: str | Path, *, error: float | None = None, **fields: Any) -> Self:
        """Read it from a text of columns, as :func:`specklegen.measured.read_curve` does.

        Parameters
        ----------
        path
            Columns: where, value, standard error.
        error
            Standard error of all values, of a file that has none.
        fields
            Further ones of the class.
        """
        curve = read_curve(path)
        errors = curve.errors
        if error is not None:
            errors = np.full(len(curve.at), positive_number(f"{cls.__name__} error", error))
        if errors is None:
            reject(f"{cls.__name__} {path}", "of three columns: where, value, standard error", "two",
                   "Give the error of all values by error=.")  # fmt: skip
        given: dict[str, Any] = {cls._where: curve.at, cls._what: curve.values, "error": errors} | fields
        return cls(**given | {"file": str(path), "lines": curve.lines})


@takes_units
@dataclass(frozen=True, eq=False, repr=False)
class MemoryCurve(_Curve):
    """Correlation of the speckle under tilts, C_I = |K|^2, in transmission along the axis.

    Parameters
    ----------
    tilts
        Radians, float[M], from 0 on, rising; inside the medium, as its wavelength is.
    c_i
        C_I, float[M]: 1 at zero tilt, of a beam much wider than the slab is thick; None of a curve that is planned.
    error
        Standard error, one number or float[M]. Of independent values: tilts that share one reference image share its
        error (docs/notes/materialfit.md).
    file, lines
        Where the values were read, for messages; by default nowhere.

    Examples
    --------
    >>> from specklegen.measured import MemoryCurve
    >>> MemoryCurve(tilts=[1e-4, 2e-4, 4e-4], c_i=[0.93, 0.78, 0.35], error=0.01)
    MemoryCurve(3 values from 0.0001 to 0.0004)
    """

    _where, _what, _range = "tilts", "c_i", (0.0, 1.0)

    tilts: Annotated[np.ndarray | ArrayLike, RADIAN]
    c_i: np.ndarray | ArrayLike | None
    error: np.ndarray | ArrayLike

    def __post_init__(self) -> None:
        self._check()
        if self.at[-1] >= np.pi / 2:
            self._refuse(len(self.at) - 1, "tilts", "below pi/2 radians", self.at[-1], "Use np.deg2rad.")
        if self.values[0] < 0.2:
            self._refuse(
                0, "c_i", "at least 0.2 at the first tilt", self.values[0],
                "The first tilt is beyond the memory effect: are tilts in radians (np.deg2rad)? Otherwise measure "
                "smaller tilts.",
            )  # fmt: skip

    def _remedy(self) -> str:
        return "Subtract the square of the mean, divide by the value at zero tilt, and correct for noise and contrast."


@takes_units
@dataclass(frozen=True, eq=False, repr=False)
class TemporalCurve(_Curve):
    """Correlation of the intensity with itself a lag later, g2 = 1 + beta |g1|^2, of Brownian scatterers.

    Parameters
    ----------
    lags
        float[M], from 0 on, rising, in the unit of time of the diffusion.
    g2
        float[M], from 1 to 1 + beta; None of a curve that is planned.
    error
        Standard error, one number or float[M].
    beta
        What pixels, polarisation and bandwidth leave of g2 - 1 at lag 0.
    file, lines
        Where the values were read, for messages; by default nowhere.

    Examples
    --------
    >>> from specklegen.measured import TemporalCurve
    >>> TemporalCurve(lags=[1e-4, 1e-3, 1e-2], g2=[1.95, 1.61, 1.02], error=0.01)
    TemporalCurve(3 values from 0.0001 to 0.01)
    """

    _where, _what, _range = "lags", "g2", (1.0, 2.0)

    lags: Annotated[np.ndarray | ArrayLike, TIME]
    g2: np.ndarray | ArrayLike | None
    error: np.ndarray | ArrayLike
    beta: float = 1.0

    def __post_init__(self) -> None:
        beta = positive_number("TemporalCurve beta", self.beta)
        if beta > 1:
            reject("TemporalCurve beta", "at most 1", self.beta)
        object.__setattr__(self, "beta", beta)
        self._check()

    def _remedy(self) -> str:
        return "g2 is the mean of I(t) I(t + lag) over the squared mean: if this is g2 - 1, add 1."


@takes_units
@dataclass(frozen=True, eq=False, repr=False)
class ContrastVersusBandwidth(_Curve):
    """Contrast of the speckle of one beam, for light of several bandwidths.

    Parameters
    ----------
    bandwidths
        Full widths at half maximum, in wavenumber inside the medium, float[M] from 0 on, rising.
    contrast
        Standard deviation over mean, float[M]: 1 of one wavelength and one polarisation; None if it is planned.
    error
        Standard error, one number or float[M].
    spectrum
        "gaussian" or "flat".
    file, lines
        Where the values were read, for messages; by default nowhere.

    Examples
    --------
    >>> from specklegen.measured import ContrastVersusBandwidth
    >>> ContrastVersusBandwidth(bandwidths=[0.001, 0.01], contrast=[0.9, 0.42], error=0.01)
    ContrastVersusBandwidth(2 values from 0.001 to 0.01)
    """

    _where, _what, _range = "bandwidths", "contrast", (0.0, 1.0)

    bandwidths: Annotated[np.ndarray | ArrayLike, INVERSE_LENGTH]
    contrast: np.ndarray | ArrayLike | None
    error: np.ndarray | ArrayLike
    spectrum: Literal["gaussian", "flat"] = "gaussian"

    def __post_init__(self) -> None:
        choice("ContrastVersusBandwidth spectrum", self.spectrum, ("gaussian", "flat"))
        self._check()


@dataclass(frozen=True, eq=False, repr=False)
class _Share(Observation):
    """A share of the incident light."""

    value: float | None
    error: float

    def __post_init__(self) -> None:
        owner = type(self).__name__
        error = positive_number(f"{owner} error", self.error)
        value = float("nan") if self.value is None else real_number(f"{owner} value", self.value)
        if self.value is not None and not -SURE * error <= value <= 1 + SURE * error:
            reject(f"{owner} value", "a share of the incident light, from 0 to 1", self.value)
        object.__setattr__(self, "value", value)
        object.__setattr__(self, "error", error)

    @property
    def values(self) -> np.ndarray:
        """float64[1]."""
        return np.array([self.value])

    @property
    def errors(self) -> np.ndarray:
        """float64[1]."""
        return np.array([self.error])

    def _draw(self, axes: Any, label: str | None = None) -> None:
        draw_curve(axes, [type(self).__name__], self.values, self.errors, label, fmt="o")


class Transmittance(_Share):
    """Share of the light that leaves behind, in all directions, unscattered light included (an integrating sphere).

    Parameters
    ----------
    value, error
        With its standard error; None of what is planned.

    Examples
    --------
    >>> from specklegen.measured import Transmittance
    >>> Transmittance(0.31, 0.01)
    Transmittance(0.31 ± 0.01)
    """


class BallisticFraction(_Share):
    """Share of the light that goes straight through, e^-OD (collimated transmittance).

    Parameters
    ----------
    value, error
        With its standard error; None of what is planned.

    Examples
    --------
    >>> from specklegen.measured import BallisticFraction
    >>> BallisticFraction(0.0067, 0.0005)
    BallisticFraction(0.0067 ± 0.0005)
    """
