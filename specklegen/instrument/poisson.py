"""Poisson numbers of one mean for a whole image, by a table of the law: several times faster than one by one.

The table holds P(N <= n) to where the tail falls below the resolution of a double, and the first n to look at for each
of 2048 equal parts of ``(0, 1)``. The numbers are those of :func:`specklegen.kernels.quantiles.poisson_quantile` at the
same uniform numbers, but for a few in a million. Source: Chen and Asau, *AIIE Transactions* 6, 163 (1974), guide
tables.
"""

from functools import lru_cache

import numpy as np
from scipy.special import pdtr

from specklegen.kernels import quantiles

LARGEST = 500.0
"""Mean above which each number is drawn on its own: tables would leave the fast memory."""
_PARTS = 2048


def add_poisson_field(charge: np.ndarray, mean: float, key: tuple[int, int]) -> None:
    """Add to ``charge`` float64[n] independent Poisson numbers of one mean, number m from uniform number m of a key."""
    if mean > LARGEST:
        quantiles.add_poisson(*key, np.broadcast_to(np.float64(mean), charge.shape), charge)
    else:
        quantiles.add_tabulated(*key, *table(float(mean)), charge)


@lru_cache(maxsize=16)
def table(mean: float) -> tuple[np.ndarray, np.ndarray]:
    """P(N <= 0), P(N <= 1), ... as float64[n], the last above 1; and the first number of each part, int64[2048]."""
    count = int(mean + 10 * np.sqrt(mean)) + 25  # by Bennett's inequality what is above has less than 2**-53
    cumulative = pdtr(np.arange(count), mean)
    cumulative[-1] = 2.0
    guide = np.searchsorted(cumulative, np.arange(_PARTS) / _PARTS, side="right")
    return cumulative, guide.astype(np.int64)
