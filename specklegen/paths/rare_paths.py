"""Rare paths of great weight: errors that rest on few of them are too low more often than not, and say so.

Where a narrow lobe has turned by far more than its width, a path comes out of the scatterers' lobe about the view once
in thousands, and then counts for thousands. What k such paths show of their variance is off by 1/sqrt(k) of it.
"""

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import warn_user
from specklegen.core.statistics import BATCHES, rarity

ENOUGH = 25.0
"""Paths that have to carry a variance for an error known to a tenth."""
FEW = 4.0
"""Fewer than these, and an error is known to a factor of two at best."""


def rare_paths_decision(effective_paths: float) -> Decision | None:
    """A doubt where next to none of a pilot's paths carry the variance that it states."""
    if effective_paths >= FEW:
        return None
    return Decision("rare paths", True, f"the expected error rests on {_counted(effective_paths)}", doubt=True)


def warn_of_rare_paths(owner: str, powers: np.ndarray) -> None:
    """Issue a DoubtWarning where standard errors rest on next to no path.

    Parameters
    ----------
    owner
        Function that is asked, for the message.
    powers
        float64[batches, ...], intensities that batches of paths find.
    """
    if len(powers) < BATCHES or not np.any(powers):
        return
    rare = float(rarity(powers - powers.mean(axis=0)).max(initial=0.0))
    if rare * FEW > 1:
        warn_user(f"{owner}: standard errors rest on {_counted(1 / rare)}.")


def _counted(count: float) -> str:
    return (
        f"about {max(1, round(count))} of the paths, rare ones of great weight: what is stated may be several "
        "times too low. Trace ten times the paths, or more"
    )
