"""A memory effect that was measured at a few distances, as a function that every likelihood can be asked with.

C_I enters the mean of a periodogram as a product of lags, and a periodogram is at least 0. So C_I must be positive
definite, its own transform at least 0: straight lines between measured values are not, nor is noise on them, and the
spectrum of an object comes out below 0 somewhere. Taken here is a mixture

    C_I(d) = w_0 + sum_k w_k exp(-d^2 / (2 s_k^2)),     w >= 0 of sum 1

which falls with the distance, is 1 at 0, and positive definite in every dimension, as by Schoenberg (*Ann. Math.*
39, 811 (1938)) only such mixtures are. The weights are fitted by non-negative least squares.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from specklegen.core.arguments import real_array
from specklegen.core.errors import reject
from specklegen.models.retrieval.autocorrelation import MemoryEffect

Numbers = Sequence[float] | np.ndarray
_WIDTHS = 60  # of the Gaussians, from a third of the smallest distance to ten of the largest
_WHOLE = 30.0  # weight of their sum being 1, over that of one value


def measured_memory_effect(distance: Numbers, values: Numbers) -> MemoryEffect:
    """Return the memory effect nearest to measured values that a likelihood can have.

    Parameters
    ----------
    distance
        Object pixels, at least 0, float[n]; those of a tilt over the direction sine of a pixel.
    values
        C_I there, float[n], 1 at no distance; with its noise, which may take it below 0 or above 1.

    Raises
    ------
    RuleError
        If they are not two lists of one length, finite, with two distances above 0 or more.

    Examples
    --------
    >>> from specklegen.models import measured_memory_effect
    >>> c_i = measured_memory_effect([0, 5, 10, 20, 40], [1.0, 0.86, 0.55, 0.12, 0.0])
    >>> 0.5 < float(c_i(10.0)) < 0.6
    True
    """
    at = real_array("measured_memory_effect distance", distance)
    seen = real_array("measured_memory_effect values", values)
    if at.ndim != 1 or at.shape != seen.shape or not np.isfinite(at).all() or not np.isfinite(seen).all():
        reject("measured_memory_effect distance, values", "two lists of one length, finite", (at.shape, seen.shape))
    if (at < 0).any() or (at > 0).sum() < 2:
        reject("measured_memory_effect distance", "at least 0, two of them above", at)
    widths = np.geomspace(at[at > 0].min() / 3, 10 * at.max(), _WIDTHS)

    def shapes(where: np.ndarray) -> np.ndarray:
        near = np.exp(-0.5 * np.square(where[..., None] / widths))
        return np.concatenate([near, np.ones((*where.shape, 1))], axis=-1)

    whole = np.full((1, _WIDTHS + 1), _WHOLE)
    weights, _ = nnls(np.concatenate([shapes(at), whole]), np.concatenate([seen, [_WHOLE]]))
    weights = weights / weights.sum()
    return lambda where: shapes(np.asarray(where, np.float64)) @ weights
