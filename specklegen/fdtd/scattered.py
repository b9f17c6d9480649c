"""Results of the solvers: scattered fields at the two faces of a layer."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np

from specklegen.core.display.plot import SHOWN, Pictured


class Validity(TypedDict):
    """Validity of a mean field of first or second order; see `specklegen.fdtd.validity`.

    Examples
    --------
    >>> import warnings
    >>> from specklegen.fdtd import RandomLayer, single_realization
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore")  # it warns of what is printed here
    ...     found = single_realization(RandomLayer(correlation_length=3.0, n_points=500), method="frequency")
    >>> sorted(found.validity)
    ['back', 'back_error', 'forward', 'forward_error', 'phase_variance']
    """

    phase_variance: float
    forward_error: float
    back_error: float
    forward: bool
    back: bool


@dataclass(frozen=True, repr=False)
class ScatteredField(Pictured):
    """Scattered field, total minus incident, in time.

    Attributes
    ----------
    time : float64[T]
        c0 t, a length.
    incident : float64[T]
        The incident field at the first cell.
    back, forward : float64[T] or float64[R, T]
        The scattered field at the first and at the last cell.
    validity : Validity or None
        Judgement of a perturbation order; None where nothing was approximated.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, yee
    >>> found = yee(RandomLayer(correlation_length=0.02, n_points=100))
    >>> found.back.shape == found.forward.shape == found.time.shape
    True
    """

    time: np.ndarray
    incident: np.ndarray
    back: np.ndarray
    forward: np.ndarray
    validity: Validity | None = None

    _named = {"time": "time", "forward": "forward", "back": "back"}

    def _facts(self) -> Mapping[str, object]:
        return {**super()._facts(), **(self.validity or {"validity": "nothing was approximated"})}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Both fields over time, of six media at most."""
        for name, field, colour in (("forward", self.forward, "C0"), ("back", self.back, "C1")):
            for n, each in enumerate(np.atleast_2d(field)[:SHOWN]):
                axes.plot(self.time, each, color=colour, lw=1, label=None if n else name)
        axes.set(xlabel=r"time $c_0 t$", ylabel="scattered field")
        axes.legend()


@dataclass(frozen=True, kw_only=True, repr=False)
class MeanField(ScatteredField):
    """Brute-force mean over ``realizations`` media.

    Attributes
    ----------
    time : float64[T]
        c0 t, a length.
    incident : float64[T]
        The incident field at the first cell.
    back, forward : float64[T]
        Mean scattered field at the first and at the last cell.
    validity : Validity or None
        Of brute force None: nothing was approximated.
    back_error, forward_error : float64[T]
        Standard errors of the means; NaN for one realization.
    realizations : int
        Media in the mean.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, monte_carlo_mean
    >>> found = monte_carlo_mean(RandomLayer(correlation_length=0.02, n_points=100), 16)
    >>> found.forward.shape == found.forward_error.shape == found.time.shape
    True
    """

    back_error: np.ndarray
    forward_error: np.ndarray
    realizations: int

    _named = {**ScatteredField._named, "realizations": "realizations"}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Both means over time, with bands of two standard errors."""
        super()._draw(axes, label)
        for field, error in ((self.forward, self.forward_error), (self.back, self.back_error)):
            axes.fill_between(self.time, field - 2 * error, field + 2 * error, alpha=0.3)
