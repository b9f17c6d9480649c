"""What the solvers return: scattered fields at the two faces of a layer."""

from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from specklegen.core.showing import short


class Validity(TypedDict):
    """Whether a mean field of first or second order may be believed; see `specklegen.fdtd.validity`."""

    phase_variance: float
    forward_error: float
    back_error: float
    forward: bool
    back: bool


@dataclass(frozen=True)
class ScatteredField:
    """Scattered field, total minus incident, in time.

    time : float64[T], c0 t
    incident : float64[T], the incident field at the first cell
    back, forward : float64[T] or float64[R, T], the scattered field at the first and at the last cell
    validity : verdict of a perturbation order; None where nothing was approximated
    """

    time: np.ndarray
    incident: np.ndarray
    back: np.ndarray
    forward: np.ndarray
    validity: Validity | None = None

    __repr__ = short


@dataclass(frozen=True, kw_only=True)
class MeanField(ScatteredField):
    """Brute-force mean over ``realizations`` media.

    back_error, forward_error : float64[T], standard errors of the means; NaN for one realization
    """

    back_error: np.ndarray
    forward_error: np.ndarray
    realizations: int

    __repr__ = short
