"""Families of phase functions for small angles, which hardly any measurement of tissue shows.

Phase functions of one mean cosine leave one transport length, but not one memory effect: one that is Gaussian has no
tails, that of Henyey and Greenstein wide ones, and measured tissues lie between them. Both have lookup tables.
"""

from functools import lru_cache

import numpy as np

from specklegen.core.arguments import real_number
from specklegen.core.errors import reject
from specklegen.core.lazy import optimize
from specklegen.scene.scatterers import HenyeyGreenstein, Scatterer, VonMisesFisher

LOBES = ("henyey-greenstein", "von-mises-fisher")


def lobe_of(family: str, g: float) -> Scatterer:
    """Return the phase function of a family of ``LOBES`` with mean cosine g; at g <= 0 there is one family."""
    if family == LOBES[0] or g <= 0:
        return HenyeyGreenstein(g=g)
    return VonMisesFisher(concentration=_concentration(real_number("materials g", g)))


@lru_cache
def _concentration(g: float) -> float:
    """Kappa of coth kappa - 1 / kappa = g."""
    if not g < 1:
        reject("materials g", "below 1", g)
    low, high = np.log([g, 4 / (1 - g)])  # g < kappa / 3 of a wide lobe, 1 - 1 / kappa of a narrow one

    def off(log: float) -> float:
        return VonMisesFisher(concentration=float(np.exp(log))).mean_cosine() - g

    log = optimize.brentq(off, low, high, xtol=1e-14)
    return float(np.exp(log))  # type: ignore[arg-type]
