"""Diffusing-wave spectroscopy: the field correlation of moving media in the diffusion approximation.

Every path of length s is taken to have the momentum transfer Y = s / l*, and lengths to be those of diffusion, so that

    slab:          g1 = (Lambda + 2h)/(1 + h) [sinh a + h a cosh a] / {[1 + (ha)^2] sinh(Lambda a) + 2ha cosh(Lambda a)}
    half space:    g1 = e^-a / (1 + ha),                   a = sqrt(6 x),  x = D k^2 tau = tau / tau0

with light that starts l* deep, Lambda = L / l* and the extrapolation length h l*. Any mean square displacement enters
by ``x = k^2 <dr^2> / 6``. Source: Weitz and Pine, in *Dynamic Light Scattering* (Brown, ed., 1993), Eqs. 16.35 and
16.39a. The truth (transfer equation, tests) is some per cent off: from Lambda = 10 on 5 % of what is inferred.
"""

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import array_from_zero, number_from_zero, positive_number, real_number
from specklegen.core.errors import reject

EXTRAPOLATION = 2 / 3
"""h as this method's literature has it; 0.7104 is Milne's, faces that reflect have more (theory/slab.py)."""
_MOST_DEPTHS = 1e6


def transmitted_field(x: ArrayLike, transport_depths: float, *, extrapolation: float = EXTRAPOLATION) -> np.ndarray:
    """g1 of light that goes through a slab, float64 of the shape of ``x``.

    Parameters
    ----------
    x
        tau / tau0 >= 0, any shape.
    transport_depths
        Lambda = L / l* > 0; of Lambda above 10 it is meant.
    extrapolation
        h, over l*, at least 0.

    Examples
    --------
    >>> from specklegen.theory.diffusing_wave import transmitted_field
    >>> [float(g) for g in transmitted_field([0.0, 0.002, 0.01, 0.1], 10.0).round(4)]
    [1.0, 0.7896, 0.362, 0.0039]
    """
    a = _root(x, "transmitted_field")
    depths = positive_number("transmitted_field transport_depths", transport_depths)
    return _through(a, depths, _length("transmitted_field", extrapolation))


def _through(a: np.ndarray, depths: float, h: float) -> np.ndarray:
    """All hyperbolic functions over e^a and e^(Lambda a): nothing overflows, and nothing cancels at a = 0."""
    safe = np.where(a > 0, a, 1.0)

    def sinh(y: np.ndarray) -> np.ndarray:
        return -np.expm1(-2 * y) / 2

    def cosh(y: np.ndarray) -> np.ndarray:
        return (1 + np.exp(-2 * y)) / 2

    above = sinh(safe) + h * safe * cosh(safe)
    below = (1 + (h * safe) ** 2) * sinh(depths * safe) + 2 * h * safe * cosh(depths * safe)
    # A source beyond a slab thinner than l* has no meaning: the factor then grows, and the field is above 1.
    field = (depths + 2 * h) / (1 + h) * np.exp(np.minimum((1 - depths) * safe, 700.0)) * above / below
    return np.where(a > 0, field, 1.0)


def reflected_field(x: ArrayLike, *, extrapolation: float = EXTRAPOLATION) -> np.ndarray:
    """g1 = e^-a / (1 + ha) of light that a half space sends back, float64 of the shape of ``x``; near e^(-5a/3).

    Parameters
    ----------
    x, extrapolation
        As in :func:`transmitted_field`.

    Examples
    --------
    >>> from specklegen.theory.diffusing_wave import reflected_field
    >>> [float(g) for g in reflected_field([0.0, 0.001, 0.01, 0.1]).round(3)]
    [1.0, 0.88, 0.673, 0.304]
    """
    a = _root(x, "reflected_field")
    return np.exp(-a) / (1 + _length("reflected_field", extrapolation) * a)


def inferred_depths(field: float, x: float, *, extrapolation: float = EXTRAPOLATION) -> float:
    """Lambda that this theory reads off a slab's g1 at x, where D, k and hence x are known.

    Raise a `RuleError` for a number outside its range, or a field that no slab between 1 and 1e6 transport lengths has.

    Parameters
    ----------
    field
        g1, between 0 and 1.
    x
        tau / tau0 > 0.
    extrapolation
        As in :func:`transmitted_field`.

    Examples
    --------
    >>> from specklegen.theory.diffusing_wave import inferred_depths, transmitted_field
    >>> round(inferred_depths(float(transmitted_field(0.01, 12.0)), 0.01), 6)
    12.0
    """
    from scipy.optimize import root_scalar

    if not 0 < real_number("inferred_depths field", field) < 1:
        reject("inferred_depths field", "between 0 and 1", field)
    a = np.sqrt(6 * positive_number("inferred_depths x", x))
    h = _length("inferred_depths", extrapolation)

    def excess(log_depths: float) -> float:
        return float(_through(np.asarray(a), np.exp(log_depths), h)) - field

    ends = 0.0, np.log(_MOST_DEPTHS)
    if not excess(ends[0]) > 0 > excess(ends[1]):
        reject("inferred_depths field", f"that of a slab of 1 to {_MOST_DEPTHS:g} transport lengths at x = {x:g}",
               field,
               "Choose a lag at which g1 is between 0.1 and 0.9.")  # fmt: skip
    return float(np.exp(root_scalar(excess, bracket=ends, xtol=1e-14).root))


def _root(x: ArrayLike, owner: str) -> np.ndarray:
    return np.sqrt(6 * array_from_zero(f"{owner} x", x, finite=True))


def _length(owner: str, value: float) -> float:
    return number_from_zero(f"{owner} extrapolation", value, finite=True)
